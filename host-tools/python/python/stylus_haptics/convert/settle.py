"""What a file tells of a signal: its times or its rate, its units, its trial. What is asked for counts before that."""

from __future__ import annotations

import re
from typing import Iterator, Optional, Union

import numpy as np

from . import names
from .signal import RATES_HZ, Asked, Column, Place, Signal
from .tree import Array, Fact, Group, Refusal, shown

Beside = tuple[list[tuple[str, Fact]], list[Column]]


def _around(place: Optional[Place]) -> Iterator[Beside]:
    """Facts and vectors beside a signal, from its own group to the root; of what has a part per trial, that part."""
    part: Optional[tuple[int, int]] = None
    while place is not None:
        part, facts, vectors = place.part or part, list(place.group.facts.items()), []
        for child in place.group.children if not place.group.is_list else []:
            own: Union[Array, Group, None] = child
            if isinstance(child, Group) and part and child.is_list:
                number = str(part[0] + 1)
                facts += [(child.name, child.facts[number])] if number in child.facts else []
                own = next((one for one in child.children if one.name == number), None)
            if not isinstance(own, Array):
                continue
            if own.is_vector:
                vectors.append(Column(child.name, own))
                if part and own.size == part[1] and own.dtype.kind in "iuf":
                    facts.append((own.name, float(vectors[-1].values()[part[0]])))
            elif part and len(own.shape) == 2 and part[1] in own.shape:
                whole = slice(None)
                index = (part[0], whole) if own.shape[0] == part[1] else (whole, part[0])
                vectors.append(Column(own.name, own, index))
        yield facts, vectors
        place = place.above


def settle(signal: Signal, asked: Asked) -> None:
    """Settles times or rate, units, and what the file tells of the trial. What is asked for counts before the file."""
    of_axes = [fact for axis in signal.axes for fact in axis.array.facts.items()]
    levels: list[Beside] = [(of_axes, []), *_around(signal.place)]
    signal.units = [asked.unit or unit_of(signal.place, axis) for axis in signal.axes]
    for facts, _ in levels:
        for name, fact in facts:
            own = [word for word in names.words(name) if word not in ("normal", "tangential")]
            if isinstance(fact, str) and names.bare(name) in names.TEXTURES:
                signal.trial.setdefault("texture", fact)
            elif isinstance(fact, float) and own in (["speed", "mm", "s"], ["force", "n"]):
                signal.trial.setdefault("_".join(own), fact)
    near = [own for _, vectors in levels for own in vectors if own.length() == signal.axes[0].length()]
    if asked.time and not (asked.time.isdecimal() and signal.time):
        signal.time = next((own for own in near if own.name == asked.time_name), None)
        if signal.time is None:
            raise Refusal(f"has no '{shown(asked.time)}' with as many values as {signal.told()}")
    if signal.time is None:
        times = [own for own in near if own.array.dtype.kind in "mM" or names.time_unit(own.name) is not None]
        times += [own for own in near if own.array.is_index and own.rises() and not _counts(own)]
        # The first that tells its unit, as the command takes it.
        is_told = lambda own: own.array.dtype.kind in "mM" or _time_unit(own) != ""
        signal.time = next(filter(is_told, times), times[0] if times else None)
    rates, told = _rates(signal, levels)
    if asked.rate_hz is not None:
        told += [f"times '{shown(signal.time.name)}'"] if signal.time else []
        signal.notes += [f"--rate {asked.rate_hz:g} counts, and not {', '.join(told)}"] if told else []
        signal.rate_hz, signal.time = asked.rate_hz, None
    elif signal.time is not None and signal.time.array.dtype.kind not in "mM":
        signal.time_unit = _agreed(signal, signal.time, rates, told)
    elif signal.time is None and len(rates) == 1:
        signal.rate_hz = rates[0]
        signal.notes.append(f"rate by {told[0]}")
    elif signal.time is None:
        told = told or ["no times and no rate"]
        raise Refusal(f"{signal.told()} has {', '.join(told)}: give --rate HZ, or --time NAME for its times")


def _counts(column: Column) -> bool:
    return column.array.dtype.kind in "iuf" and bool((np.diff(column.values()) == 1).all())


def _time_unit(time: Column) -> str:
    unit = str(time.array.facts.get("unit", time.array.facts.get("units", "")))
    own = names.TIME_UNITS.get(unit.strip("[]() ").lower()) if not isinstance(time.index, tuple) else None
    return own or names.time_unit(time.name) or ""


def _agreed(signal: Signal, time: Column, rates: list[float], told: list[str]) -> str:
    """The unit of times: as they tell it, or else the one that agrees with the file's rate, or the largest in which a
    sensor can have been as fast. Refuses times that disagree."""
    unit, per_second = _time_unit(time), {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
    if not unit and not rates and _counts(time):
        raise Refusal(f"'{shown(time.name)}' counts samples, in no unit: give --rate HZ")
    values = time.values().astype(np.float64)
    step = (values[-1] - values[0]) / (len(values) - 1)
    least, most = (min(rates) / 1.1, max(rates) * 1.1) if rates else RATES_HZ
    near = [own for own in ([unit] if unit else per_second) if least * step <= per_second[own] <= most * step]
    if not near or len(rates) > 1:
        others = ", ".join(told) + ", and " if told else ""
        raise Refusal(f"{signal.told()} has {others}'{shown(time.name)}' with steps of {step:g} {unit}: give --rate "
                      "HZ, which then counts")
    if not unit and near[0] != "s":
        signal.notes.append(f"times '{shown(time.name)}' are taken as {near[0]}, by their steps")
    return near[0]


def _rates(signal: Signal, levels: list[Beside]) -> tuple[list[float], list[str]]:
    """The different rates that the nearest facts tell, Hz, and their words."""
    for facts, _ in levels:
        rates, told = [], []
        for name, fact in facts:
            bare, number = names.bare(name), _number(fact)
            if number and (bare in names.INTERVALS or names.RATE.fullmatch(re.sub("k?hz$", "", bare))):
                rate = 1 / number if bare in names.INTERVALS else number * (1000 if bare.endswith("khz") else 1)
                # 1 / 0.0002 is 5000.
                rate = round(rate) if abs(rate - round(rate)) < 1e-9 * rate else rate
                told += [f"{shown(name)} = {number:g}"] if rate not in rates else []
                rates += [rate] if RATES_HZ[0] <= rate <= RATES_HZ[1] and rate not in rates else []
            elif bare == "wfstartoffset":
                signal.start_s = number
        if told:
            return rates, told
    return [], []


def _number(fact: Fact) -> float:
    try:
        return float(re.sub(" ?hz$", "", str(fact).lower()))
    except ValueError:
        return 0.0


def unit_of(place: Place, column: Column) -> Optional[str]:
    """The unit of a column: by the facts of its array, by a text beside it, or by its name."""
    group = place.above.group if place.group.is_list and place.above else place.group
    own = [str(fact) for name, fact in column.array.facts.items() if names.bare(name) in names.UNITS]
    beside = {names.bare(name): str(fact) for name, fact in group.facts.items() if isinstance(fact, str)}
    name = names.bare(column.array.name)
    own += [beside.get(name + "unit", ""), beside.get(name + "units", ""), names.unit_in(column.name) or ""]
    own += [beside.get("unit", ""), beside.get("units", "")]
    return next((unit.strip() for unit in own if unit.strip()), None)
