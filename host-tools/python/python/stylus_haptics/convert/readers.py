"""Trees of files, each by the library made for its format, which is imported when such a file is read."""

from __future__ import annotations

import importlib
import json
import zipfile
import zlib
from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Callable, Iterator, Optional

import numpy as np

from . import names, tree
from .hdf5 import Reader
from .tree import Array, Fact, Group, Refusal


@contextmanager
def opened(path: Path) -> Iterator[Group]:
    """The tree of a file, which stays open as long as arrays of it are read."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise Refusal(f"is none of {', '.join(READERS)}; stylus itself reads .csv and .wav")
    if not path.is_file():
        raise Refusal("is not there, or is no file: mend the name")
    _check_size(path.stat().st_size)
    with ExitStack() as open_files:
        yield reader(path, open_files)


def _check_size(size: int) -> None:
    if size > tree.MOST_BYTES:
        raise Refusal(f"holds more than {tree.MOST_BYTES >> 20} MiB: write the arrays that are meant into a new file")


def _library(module: str, name: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        raise Refusal(f"is read by {name}, which is not installed: pip install {name}") from fault


def _add(group: Group, name: str, values: Any) -> None:
    """Adds what NumPy holds: an array, columns of a record, or a fact."""
    values = np.asarray(values)
    if values.dtype.names:
        columns = [Array.of(own, values[own]) for own in values.dtype.names if values[own].dtype.kind in "iufmM"]
        group.children.append(Group(name, [*columns]))
    elif values.size == 1 and values.dtype.kind in "iufbSU":
        value = values.reshape(-1)[0]
        group.facts[name] = str(value) if values.dtype.kind in "SU" else float(value)
    elif values.size and values.dtype.kind in "iufmM":
        group.children.append(Array.of(name, values))
    elif values.size:
        group.facts[name] = f"(not read: {tree.shown(values.dtype)})"


def _mat(path: Path, open_files: ExitStack) -> Group:
    with open(path, "rb") as file:
        start = file.read(520)
    if b"\x89HDF" in (start[:4], start[512:516]):
        return _h5(path, open_files)
    found, root = _library("scipy.io", "scipy"), Group("")
    _check_packed(path)
    for name, value in found.loadmat(path, squeeze_me=True, struct_as_record=False).items():
        if not name.startswith("__"):
            _add_matlab(root, name, value)
    return root


def _check_packed(path: Path) -> None:
    """Unpacks the parts of a file of version 5 once, within the limit, because nothing states their sizes."""
    unpacked = 0
    with open(path, "rb") as file:
        order = "<u4" if file.read(128)[126:128] == b"IM" else ">u4"
        while len(head := file.read(8)) == 8:
            kind, length = (int(word) for word in np.frombuffer(head, order))
            end, unpacking = file.tell() + length, zlib.decompressobj()
            while kind == 15 and (packed := file.read(min(1 << 16, end - file.tell()))):
                while packed:
                    unpacked += len(unpacking.decompress(packed, 1 << 24))
                    packed = unpacking.unconsumed_tail
                    _check_size(unpacked)
            file.seek(end)


def _add_matlab(group: Group, name: str, value: Any) -> None:
    if hasattr(value, "_fieldnames"):
        group.children.append(inner := Group(name))
        for own in value._fieldnames:
            _add_matlab(inner, own, getattr(value, own))
    elif isinstance(value, np.ndarray) and (value.dtype.names or "Matlab" in type(value).__name__):
        group.facts[name] = "(not read: an object of MATLAB; there, writetimetable or struct makes data of it)"
    elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
        group.children.append(inner := Group(name, is_list=True))
        for number, own in enumerate(value.reshape(-1, order="F"), 1):
            _add_matlab(inner, str(number), own)
    else:
        _add(group, name, value)


def _h5(path: Path, open_files: ExitStack) -> Group:
    file = open_files.enter_context(_library("h5py", "h5py").File(path, "r"))
    return Reader(file).group("", file)


def _npy(path: Path, open_files: ExitStack) -> Group:
    root = Group("")
    # Samples stay in the file until they are taken.
    _add(root, path.stem, _unpickled(lambda: np.load(path, mmap_mode="r", allow_pickle=False)))
    return root


def _npz(path: Path, open_files: ExitStack) -> Group:
    archive, root = open_files.enter_context(np.load(path, allow_pickle=False)), Group("")
    _check_size(sum(member.file_size for member in archive.zip.infolist()))
    for name in archive.files:
        try:
            _add(root, name, _unpickled(partial(archive.__getitem__, name)))
        except Refusal as fault:
            root.facts[name] = f"(not read: {fault})"
    return root


def _unpickled(load: Callable[[], Any]) -> Any:
    try:
        return load()
    except ValueError as fault:
        if "pickle" not in str(fault) and "object" not in str(fault):
            raise
        raise Refusal("holds objects of Python, which could run any program: save plain arrays of numbers") from fault


def _tdms(path: Path, open_files: ExitStack) -> Group:
    file = open_files.enter_context(_library("nptdms", "npTDMS").TdmsFile.open(path))
    root = Group("", facts=_properties(file))
    for group in file.groups():
        root.children.append(found := Group(group.name, facts=_properties(group)))
        for channel in group.channels():
            kind = np.dtype(channel.dtype)
            read = lambda index, channel=channel: np.asarray(channel[:])[index]
            if kind.kind in "iufmM" and len(channel):
                found.children.append(Array(channel.name, (len(channel),), kind, read, _properties(channel)))
    return root


def _properties(thing: Any) -> dict[str, Fact]:
    own = {str(name): value for name, value in thing.properties.items()}
    texts = {name: value for name, value in own.items() if isinstance(value, str)}
    numbers = {name: float(value) for name, value in own.items() if isinstance(value, (int, float, np.number))}
    return {**texts, **numbers}


def _parquet(path: Path, open_files: ExitStack) -> Group:
    file = _library("pyarrow.parquet", "pyarrow").ParquetFile(path)
    open_files.callback(file.close)
    about = file.metadata
    stated = sum(about.row_group(number).total_byte_size for number in range(about.num_row_groups))
    _check_size(max(8 * about.num_rows * about.num_columns, stated))
    root = Group("", facts=_texts(file.schema_arrow.metadata))
    pandas = json.loads(str(root.facts.pop("pandas", "{}")))
    root.facts.pop("ARROW:schema", None)
    attributes = pandas.get("attributes", {})
    root.facts.update({name: own for name, own in attributes.items() if isinstance(own, (str, float, int))})
    for field, column in zip(file.schema_arrow, file.read().columns):
        values = column.to_numpy()
        if values.dtype.kind in "iufmM":
            facts = {name: own for name, own in _texts(field.metadata).items() if names.bare(name) in names.UNITS}
            array = Array.of(field.name, values, facts)
            array.is_index = field.name in pandas.get("index_columns", [])
            root.children.append(array)
    return root


def _texts(found: Optional[dict[bytes, bytes]]) -> dict[str, Fact]:
    return {key.decode(): text.decode("utf-8", "replace") for key, text in (found or {}).items()}


def _xlsx(path: Path, open_files: ExitStack) -> Group:
    with zipfile.ZipFile(path) as packed:
        _check_size(sum(member.file_size for member in packed.infolist()))
    book = _library("openpyxl", "openpyxl").load_workbook(path, read_only=True, data_only=True)
    open_files.callback(book.close)
    root, cells = Group(""), 0
    for sheet in book.worksheets:
        rows: list[tuple[Any, ...]] = []
        for row in sheet.iter_rows(values_only=True):
            cells += len(row)
            # A cell takes some 60 bytes.
            _check_size(64 * cells)
            rows.append(row)
        root.children.append(_sheet(sheet.title, rows))
    return root


def _sheet(title: str, rows: list[tuple[Any, ...]]) -> Group:
    """The columns of a sheet, below their names and a row of units, if there is one. Rows above may tell facts."""
    group = Group(title)
    counts = [sum(isinstance(cell, (int, float)) for cell in row) for row in rows]
    usual = Counter(filter(None, counts)).most_common(1)
    begin = counts.index(usual[0][0]) if usual else len(rows)
    while begin and counts[begin - 1] and not any(isinstance(cell, str) for cell in rows[begin - 1]):
        # A row with an empty cell.
        begin -= 1
    above = [row for row in rows[:begin] if any(cell is not None for cell in row)]
    for row in above:
        label, value = ([cell for cell in row if cell is not None] + [None, None])[:2]
        if isinstance(label, str) and isinstance(value, (int, float)):
            group.facts[label.rstrip(" :=")] = float(value)
    are_units = [names.rank("", own) != 0 or own in ("", "V", "mV") for own in map(_bare, above[-1] if above else ())]
    units = above.pop() if len(above) > 1 and all(are_units) else ()
    titles = above[-1] if above else ()
    for place in range(max(map(len, rows[begin:]), default=0)):
        values = _cells([row[place] if place < len(row) else None for row in rows[begin:]])
        if values is not None:
            own, unit = ((row[place] if place < len(row) else None) for row in (titles, units))
            facts: dict[str, Fact] = {"unit": _bare(unit)} if unit else {}
            group.children.append(Array.of(str(own or f"column {place + 1}"), values, facts))
    return group


def _bare(cell: Any) -> str:
    return str(cell or "").strip("[]() ")


def _cells(column: list[Any]) -> Optional[np.ndarray]:
    """The numbers or the times of a column, NaN where a cell is empty; None for a column of text."""
    empty = (None, "", "NA", "N/A", "#N/A", "NaN", "nan", "null")
    try:
        if hasattr(column[0], "isoformat"):
            return np.array(column, dtype="M8[us]")
        values = np.array([float("nan") if cell in empty else cell for cell in column], dtype=np.float64)
        return None if np.isnan(values).all() else values
    except (TypeError, ValueError):
        return None


READERS: dict[str, Callable[[Path, ExitStack], Group]] = {
    ".mat": _mat,
    ".h5": _h5,
    ".hdf5": _h5,
    ".hdf": _h5,
    ".npy": _npy,
    ".npz": _npz,
    ".tdms": _tdms,
    ".parquet": _parquet,
    ".xlsx": _xlsx,
}
