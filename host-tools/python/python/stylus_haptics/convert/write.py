"""What is written: tables and sounds with each sample as it was read, and the list of trials. All files are made beside
their places first, and come there at once or not at all."""

from __future__ import annotations

import os
import re
import shutil
import struct
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import Iterator, Optional

import numpy as np

from . import names
from .signal import Column, Signal
from .tree import Refusal, shown

#: Largest table that the command reads, bytes.
MOST_TABLE_BYTES = 512 << 20

_ROWS = 1 << 15
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def table(file: Path, signal: Signal, is_unit_given: bool) -> None:
    """Writes a signal as CSV. Each number has as many digits as its bits need."""
    axes = [float64(axis, signal) for axis in signal.axes]
    unit, times = _times(signal, len(axes[0]))
    named = [_title(axis.name, unit, is_unit_given) for axis, unit in zip(signal.axes, signal.units)]
    with open(file, "x", encoding="utf-8", newline="\n") as out:
        out.write(",".join([f"time_{unit}" if unit else "time", *named]) + "\n")
        for begin in range(0, len(times), _ROWS):
            part = [column[begin : begin + _ROWS].tolist() for column in (times, *axes)]
            out.write("".join(",".join(map(repr, row)) + "\n" for row in zip(*part)))
            if out.tell() > MOST_TABLE_BYTES:
                raise Refusal(f"{signal.told()} takes more than {MOST_TABLE_BYTES >> 20} MiB as a table: give --wav")


def wave(file: Path, signal: Signal) -> None:
    """Writes a signal as WAV of 64-bit floats."""
    if signal.time is not None:
        raise Refusal(f"{signal.told()} has times, which a WAV does not hold: leave --wav, or give --rate HZ")
    rate_hz = signal.rate_hz or 0.0
    rate = round(rate_hz)
    if abs(rate_hz - rate) > 1e-9 * rate_hz:
        raise Refusal(f"{signal.told()} has a rate of {rate_hz} Hz, and a WAV has whole numbers: leave --wav")
    axes = [float64(axis, signal) for axis in signal.axes]
    width, count = 8 * len(axes), len(axes[0])
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 3, len(axes), rate, rate * width, width, 64)
    with open(file, "xb") as out:
        out.write(struct.pack("<4sI4s", b"RIFF", 36 + width * count, b"WAVE") + form)
        out.write(struct.pack("<4sI", b"data", width * count))
        for begin in range(0, count, _ROWS):
            out.write(np.stack([axis[begin : begin + _ROWS] for axis in axes], axis=1).astype("<f8").tobytes())


def float64(column: Column, signal: Signal) -> np.ndarray:
    """The samples in float64, bit for bit, or with a note on those that it does not hold."""
    own = column.values()
    found = own.astype(np.float64)
    rounded = 0
    if own.dtype.kind in "iu":
        # Above 2^53 a float64 steps by 2 and more, and its highest is out of an integer's range.
        large = abs(found) >= 2**53
        rounded = sum(int(value) != int(near) for value, near in zip(own[large], found[large]))
    elif own.dtype.itemsize > 8:
        rounded = int((found.astype(own.dtype) != own).sum() - np.isnan(own).sum())
    if rounded:
        signal.notes.append(f"{rounded} values of {shown(column.name)} are rounded from {own.dtype} to float64")
    return found


def _times(signal: Signal, count: int) -> tuple[str, np.ndarray]:
    """The unit of the times, and the times: as the file has them, of dates from the first on, or by the rate."""
    if signal.time is None:
        return "s", signal.start_s + np.arange(count) / (signal.rate_hz or np.nan)
    own = signal.time.values()
    if own.dtype.kind not in "mM":
        return signal.time_unit, float64(signal.time, signal)
    unit, many = np.datetime_data(own.dtype)
    if unit not in _PER_SECOND or np.isnat(own).any():
        raise Refusal(f"'{shown(signal.time.name)}' lacks times, or has them in '{unit}': give --rate HZ")
    signal.notes.append(f"times in s from {own[0]} on")
    return "s", (own - own[0]).astype(np.int64) * many / _PER_SECOND[unit]


def _title(name: str, unit: Optional[str], is_given: bool) -> str:
    """A column's name, which the command takes for an acceleration whatever its words are, with one unit."""
    if unit and (is_given or unit != names.unit_in(name)):
        name = re.sub(r"[\[(][^\[\]()]*[\])]", "", name).strip()[:60] + f" [{unit[:30]}]"
    plain = re.sub(r"[^\w ./\-()\[\]²⁻°µ%^*]", " ", shown(name, 100)).strip()
    return plain if re.match(r"acc(el\w*)?([\W_]|$)", plain, re.IGNORECASE) else f"accel_{plain}"


def trials(rows: list[tuple[str, Signal]], is_wave: bool) -> str:
    """The list of trials. What a file does not tell is empty."""
    titles = ["texture", "speed_mm_s", "force_n", *(["scale_m_s2"] if is_wave else [])]
    lines = [["file", *titles]]
    for file, signal in rows:
        scales = {names.m_s2(unit or "") for unit in signal.units}
        known = {**signal.trial, "scale_m_s2": scales.pop() if len(scales) == 1 else None}
        lines.append([file, *(_field(known.get(title)) for title in titles)])
    return "".join(",".join(line) + "\n" for line in lines)


def _field(value: object) -> str:
    text = "" if value is None else shown(value, 48).strip()
    # A spreadsheet must not compute a text; the command leaves the sign out.
    text = f"'{text}" if isinstance(value, str) and re.match(r"'*[=+\-@]", text) else text
    return '"' + text.replace('"', '""') + '"' if re.search(r'[,"#%;]', text) else text


def name_of(text: str, taken: set[str]) -> str:
    """A file's name in one folder, and no other's, whatever ``text`` holds."""
    plain = re.sub(r"[^A-Za-z0-9._\-]+", "_", text).strip("._-")[:100].rstrip("._-") or "signal"
    name, number = plain, 2
    while name.lower() in taken:
        name, number = f"{plain}_{number}", number + 1
    taken.add(name.lower())
    return name


@contextmanager
def outputs(out: Path, overwrite: bool) -> Iterator[Path]:
    """A folder whose files come to ``out`` if the block ends well. Without ``overwrite`` nothing there is replaced."""
    is_new = not os.path.lexists(out)
    if not (out.parent if is_new else out).is_dir():
        raise Refusal(f"{out} is no folder, and none can be made there: give another --out")
    draft = Path(tempfile.mkdtemp(prefix=".convert-", dir=out.parent if is_new else out))
    moved: list[Path] = []
    try:
        yield draft
        files = sorted(draft.iterdir(), key=lambda file: file.name == "trials.csv")
        there = [file.name for file in files if os.path.lexists(out / file.name)]
        if there and not overwrite:
            raise Refusal(f"{out / there[0]} is there already: give --overwrite, or another --out")
        if is_new:
            mask = os.umask(0)
            os.umask(mask)
            draft.chmod(0o777 & ~mask)
            draft.rename(out)
        for file in [] if is_new else files:
            if overwrite:
                os.replace(file, out / file.name)
            else:
                # Unlike a rename, a link replaces nothing that came meanwhile.
                os.link(file, out / file.name)
                moved.append(out / file.name)
        moved = []
    finally:
        for file in moved:
            file.unlink()
        shutil.rmtree(draft, ignore_errors=True)
