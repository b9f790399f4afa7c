"""HDF5: files of any program, MATLAB's of version 7.3, and frames that pandas stored. No pickle in one is run."""

from __future__ import annotations

import pickletools
import re
from typing import Any, Iterator, Union

import numpy as np

from . import tree
from .tree import Array, Fact, Group, Refusal


class Reader:
    """The tree of an open file of h5py."""

    def __init__(self, file: Any):
        self._file, self._parts = file, 0

    def group(self, name: str, group: Any, above: tuple[Any, ...] = ()) -> Group:
        """A group and what is below it, to which a link may lead back."""
        import h5py  # type: ignore

        key = h5py.h5o.get_info(group.id).addr
        if len(above) > tree.MOST_LEVELS or key in above:
            return Group(name, facts={"(not read)": "it is within itself, or too deep"})
        found = Group(name, facts=_facts(group))
        if found.facts.get("pandas_type") in ("frame", "frame_table", "series", "series_table"):
            return Group(name, list(_frame(group)))
        for child in group:
            if isinstance(group.get(child, getlink=True), h5py.ExternalLink):
                found.facts[child] = "(not read: it is in another file)"
            elif not child.startswith("#"):
                self._add(found, child, group.get(child), (*above, key))
        return found

    def _add(self, group: Group, name: str, thing: Any, above: tuple[Any, ...]) -> None:
        import h5py

        self._parts += 1
        if self._parts > tree.MOST_PARTS:
            raise Refusal(f"has more than {tree.MOST_PARTS} parts: write the arrays that are meant into a new file")
        if isinstance(thing, h5py.Group):
            group.children.append(self.group(name, thing, above))
        elif isinstance(thing, h5py.Dataset) and thing.shape is not None:
            found = self._dataset(name, thing, above)
            if isinstance(found, (Array, Group)):
                group.children.append(found)
            elif found is not None:
                group.facts[name] = found

    def _dataset(self, name: str, data: Any, above: tuple[Any, ...]) -> Union[Array, Group, Fact, None]:
        import h5py

        facts, kind, size = _facts(data), data.dtype, int(np.prod(data.shape, dtype=object))
        matlab = facts.pop("MATLAB_class", None)
        if "MATLAB_empty" in facts:
            return None
        if data.external or data.is_virtual:
            return "(not read: its samples are in another file)"
        if max(size, int(np.prod(data.chunks or 0, dtype=object))) * kind.itemsize > tree.MOST_BYTES:
            return f"(not read: more than {tree.MOST_BYTES >> 20} MiB)"
        if h5py.check_ref_dtype(kind) is h5py.Reference:
            cells = Group(name, is_list=True)
            for number, reference in enumerate(data[()].reshape(-1) if size <= tree.MOST_PARTS else [], 1):
                if reference and len(above) <= tree.MOST_LEVELS:
                    self._add(cells, str(number), self._file[reference], (*above, None))
            return cells
        if kind.names:
            return Group(name, list(_fields(data)), facts)
        if matlab == "char" and kind.kind == "u":
            return "".join(map(chr, data[()].reshape(-1)[:10_000]))
        if size == 1 and (h5py.check_string_dtype(kind) or kind.kind in "iuf"):
            return _fact(data[()])
        if matlab:
            # MATLAB's order of dimensions is the other one.
            return Array(name, data.shape[::-1], kind, lambda index: _transposed(data, index), facts)
        return Array(name, data.shape, kind, data.__getitem__, facts)


def _transposed(data: Any, index: Any) -> np.ndarray:
    return np.asarray(data[index[::-1]] if isinstance(index, tuple) else data[()].T[index])


def _fact(value: Any) -> Fact:
    own = np.asarray(value).reshape(-1)[0]
    return own.decode("utf-8", "replace") if isinstance(own, bytes) else own if isinstance(own, str) else float(own)


def _facts(thing: Any) -> dict[str, Fact]:
    """Attributes that are one text or one number."""
    found: dict[str, Fact] = {}
    for name in list(thing.attrs)[:100]:
        try:
            found[name] = _fact(thing.attrs[name])
        except (OSError, TypeError, ValueError, IndexError):
            continue
    return found


def _fields(data: Any) -> Iterator[Array]:
    for name in data.dtype.names:
        kind = data.dtype[name]
        read = lambda index, name=name: np.asarray(data.fields(name)[()])[index]
        yield Array(name, (*data.shape, *kind.shape), kind.base, read)


def _frame(group: Any) -> Iterator[Array]:
    """The columns of a frame that pandas stored, in blocks, and its index."""
    if "table" in group:
        about = group["table"].attrs
        for array in _fields(group["table"]):
            if array.name == "index":
                named = _texts(group.attrs.get("info"))
                array.name = named[named.index("index_name") + 1] if "index_name" in named[:-1] else "index"
                yield _index(array, about.get("index_kind"))
            else:
                yield from _columns(array, _texts(about.get(f"{array.name}_kind")) or [array.name])
        return
    for name, data in group.items():
        array = Array(name, data.shape, data.dtype, data.__getitem__)
        if name in ("axis1", "index"):
            own = str(_facts(data).get("name", ""))
            array.name = own if own.isprintable() and own not in ("", "N.") else "index"
            yield _index(array, data.attrs.get("kind"))
        elif name == "values" or re.fullmatch(r"block\d+_values", name):
            items = group.get(name.replace("_values", "_items"))
            yield from _columns(array, [str(_fact(item)) for item in items[()]] if items is not None else [name])


def _columns(block: Array, titles: list[str]) -> Iterator[Array]:
    if len(block.shape) == 1:
        yield Array(titles[0], block.shape, block.dtype, block.read)
        return
    for place, title in enumerate(titles[: block.shape[1]]):
        read = lambda index, place=place: np.asarray(block.read((slice(None), place)))[index]
        yield Array(title, block.shape[:1], block.dtype, read)


def _index(array: Array, kind: Any) -> Array:
    times = re.match(r"(d|t)(?:atetime|imedelta)64(\[\w+\])?", str(_fact(kind)) if kind is not None else "")
    stored = np.dtype(("M8" if times[1] == "d" else "m8") + (times[2] or "[ns]")) if times else array.dtype
    read = lambda index: np.asarray(array.read(index)).astype("i8").view(stored) if times else array.read(index)
    return Array(array.name, array.shape, stored, read, is_index=True)


def _texts(pickled: Any) -> list[str]:
    """The texts in a pickle, which is looked through and not run."""
    data = bytes(pickled) if isinstance(pickled, bytes) else b""
    try:
        return [str(text) for op, text, _ in pickletools.genops(data) if "UNICODE" in op.name or "STRING" in op.name]
    except ValueError:
        return []
