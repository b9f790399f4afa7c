"""The signals of a tree: what is sampled, and on which axes. What has one answer is taken, what has several is asked
for."""

from __future__ import annotations

import re
from typing import Iterator

from . import names
from .settle import settle, unit_of
from .signal import Asked, Column, Place, Signal
from .tree import Array, Group, Refusal, shown

#: Fewest samples of a signal.
LEAST_SAMPLES = 16


def signals(root: Group, asked: Asked) -> list[Signal]:
    """The recordings in a file: one, or trials of one kind.

    Raises ``Refusal`` with the choices where there are several kinds, and with the remedy where something is missing.
    """
    found = [own for table in _tables(Place(root), asked) for own in _of_table(table, asked)]
    best = max([0, *(own.rank for own in found)])
    left = [own.told() for own in found if own.rank < best]
    found = [own for own in found if own.rank == best]
    if not found:
        wanted = "".join(f" of '{shown(own)}'" for own in (asked.signal, asked.axes) if own)
        others = f"; --signal NAME takes what is named as another quantity: {', '.join(left[:8])}" if left else ""
        raise Refusal(f"has no accelerations of {LEAST_SAMPLES} samples or more{wanted}: without --out, its names are "
                      f"printed{others}")
    if len({own.key() for own in found}) > 1 and "*" not in (asked.signal or ""):
        listed = "; ".join(own.told() for own in found[:12]) + (f"; and {len(found) - 12} more" if found[12:] else "")
        raise Refusal(f"has several signals: {listed}; give --signal NAME, or with * in it for several trials")
    if left and not asked.signal:
        found[0].notes.append(f"left out, because accelerations are named beside them: {', '.join(left[:8])}")
    for own in found:
        # Axes, trials and other quantities look alike where nothing names accelerations.
        if len(own.axes) > (1 if own.is_named and own.rank == 0 else 3):
            own.ask = (f"which are the axes? Give --axes with names, or numbers from 1 to {len(own.axes)}, such as "
                       "1,2,3; or --axes each, if each is a trial of one axis")
        if own.ask:
            raise Refusal(f"{own.told()}: {own.ask}")
        settle(own, asked)
    return found


def _tables(place: Place, asked: Asked) -> Iterator[Signal]:
    """Columns of one length: those of an array, and vectors of one group. With a name or pattern, only what it fits."""
    group = place.group
    vectors: dict[int, list[Column]] = {}
    for number, child in enumerate(group.children):
        path, name = group.path_of(child.name, place.path), group.name if group.is_list else child.name
        inner = place._replace(part=(number, len(group.children))) if group.is_list else place
        if isinstance(child, Group):
            # What is in a group that is meant is meant.
            within = asked._replace(signal=None) if asked.signal and asked.means(path) else asked
            yield from _tables(Place(child, path, inner), within)
        elif child.dtype.kind not in "iuf" or child.size < LEAST_SAMPLES or child.is_index:
            continue
        elif names.time_unit(name) is not None or name == asked.time_name:
            continue
        elif not child.is_vector or group.is_list:
            yield from _of_array(path, name, inner, child, asked) if asked.means(path) else ()
        elif asked.signal and asked.means(path):
            yield Signal(path, [Column(name, child)], place, kind="meant")
        else:
            vectors.setdefault(child.size, []).append(Column(name, child))
    if asked.signal is None or asked.signal == "/" and not place.path:
        yield from (Signal(place.path, columns, place) for columns in vectors.values())


def _of_array(path: str, name: str, place: Place, array: Array, asked: Asked) -> Iterator[Signal]:
    """The columns of an array of one to three dimensions, in any order: the longest has the samples, one of up to three
    the axes, and the third the trials."""
    sizes = array.shape
    samples, *others = sorted((d for d, size in enumerate(sizes) if size > 1), key=lambda d: -sizes[d])
    if len(others) > 2 or sizes[samples] < LEAST_SAMPLES:
        return
    given = re.fullmatch("d([123])", asked.axes or "")
    few = [d for d in others if given and d == int(given[1]) - 1]
    few = few or [d for d in others if sizes[d] <= 3 or len(others) == 1]
    if len(others) == 2 and len(few) != 1:
        which = " or ".join(f"d{d + 1}" for d in others)
        ask = f"which dimension has the axes? Give --axes {which}"
        yield Signal(path, [Column(name, array)], place, False, ask=ask)
        return
    trials = [d for d in others if d not in few]
    count = sizes[trials[0]] if trials else 1
    for trial in range(count):
        at = {**dict.fromkeys(trials, trial), samples: slice(None)}
        columns = []
        for axis in range(sizes[few[0]] if few else 1):
            index = tuple(at.get(d, axis if d in few else 0) for d in range(len(sizes)))
            columns.append(Column(f"{name}_{axis + 1}", array, index))
        own = place._replace(part=(trial, count)) if trials else place
        kind = "meant" if asked.signal else ""
        yield Signal(f"{path}({trial + 1})" if trials else path, columns, own, False, kind=kind)


def _of_table(table: Signal, asked: Asked) -> Iterator[Signal]:
    """The signals in columns of one length: as they are asked for, or as their names and units tell."""
    columns, picked = table.axes, asked.axes and not re.fullmatch("d[123]", asked.axes)
    if table.ask:
        table.rank = _rank(table.place, columns[0])
        yield table
        return
    if not table.is_named and len(columns) > 1:
        if asked.time_name.isdecimal():
            table.time = dict(enumerate(columns, 1)).get(int(asked.time_name))
        elif columns[0].rises():
            # No acceleration rises in every row.
            table.time = columns[0]
    # What is asked for by its name needs no other one.
    ranks = [2 if table.kind else _rank(table.place, column) for column in columns]
    table.rank = max(ranks)
    if picked and asked.axes == "each":
        for number, own in enumerate(columns):
            if own != table.time:
                place, path = table.place._replace(part=(number, len(columns))), f"{table.path}({number + 1})"
                path = table.place.group.path_of(own.name, table.path) if table.is_named else path
                yield Signal(path, [own], place, False, table.rank, table.time, kind=table.key())
        return
    if picked:
        known = {str(number): own for number, own in enumerate(columns, 1)}
        known.update((own.name, own) for own in columns if table.is_named)
        table.axes = [known[word.strip()] for word in str(asked.axes).split(",") if word.strip() in known]
        table.rank, table.is_named = 2, False
        if len(table.axes) < len(str(asked.axes).split(",")):
            return
    else:
        named = [column for column, rank in zip(columns, ranks) if rank > 0]
        sums = [column for column in named if names.is_magnitude(column.name)]
        if len(named) == 4 and len(sums) == 1:
            named.remove(sums[0])
        others = [column for column, rank in zip(columns, ranks) if rank == 0]
        table.axes = [column for column in named or others or columns if column != table.time]
    left = [shown(own.name, 30) for own in columns if own not in table.axes and own != table.time]
    table.notes += [f"left out: {', '.join(left[:12])}"] if left else []
    if table.axes:
        yield table


def _rank(place: Place, column: Column) -> int:
    """The rank of a column's name; a group that is named as accelerations has no others."""
    own = names.rank(column.name, unit_of(place, column))
    return 2 if own >= 0 and names.rank(place.group.name, None) == 2 else own
