"""Recordings in the formats of laboratories, as CSV or WAV for the command: ``stylus-convert FILE... --out DIR``.

    >>> from stylus_haptics.convert import convert
    >>> print(convert(["take1.tdms"]))                                       # what is in it, as a tree
    >>> convert(["take1.tdms", "take2.mat"], "recordings", unit="g")

MATLAB's .mat (version 5 by SciPy, 7.3 by h5py), HDF5 and pandas' frames in it (h5py), .npy and .npz (NumPy), .tdms
(npTDMS), .parquet (pyarrow) and .xlsx (openpyxl). Nothing pickled is run. Each sample that is written is the one that
was read, in float64, or a note says otherwise. What has one answer is taken; what has several is refused with them.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Iterable, Iterator, Optional, Union

from . import choose, readers, tree, write
from .signal import RATES_HZ, Asked, Signal
from .tree import Group, Refusal, shown

__all__ = ["Converted", "Refusal", "convert"]


@dataclass(frozen=True)
class Converted:
    """The files that were written, and what is in those that were read, in lines."""

    files: list[Path]
    lines: list[str]

    def __str__(self) -> str:
        return "\n".join(self.lines)


def convert(
    files: Iterable[Union[str, Path]],
    out: Union[str, Path, None] = None,
    *,
    signal: Optional[str] = None,
    time: Optional[str] = None,
    rate_hz: Optional[float] = None,
    axes: Optional[str] = None,
    unit: Optional[str] = None,
    wav: bool = False,
    overwrite: bool = False,
) -> Converted:
    """Converts files into the folder ``out``, or without it only says what they hold. Several trials get a trials.csv.

    Raises ``Refusal``, a ValueError, and writes nothing then.
    """
    least, most = RATES_HZ
    if rate_hz is not None and not least <= rate_hz <= most:
        raise Refusal(f"--rate {rate_hz:g}, where {least:g} to {most:g} Hz can be")
    asked = Asked(signal, time, rate_hz, axes, unit)
    lines: list[str] = []
    if out is None:
        for file in map(Path, files):
            with _opened(file) as root:
                lines += [f"{shown(file, 200)}:", *tree.lines(root)]
        return Converted([], lines)
    taken, rows, out = {"trials"}, [], Path(out)
    with write.outputs(out, overwrite) as draft:
        for file in map(Path, files):
            with _opened(file) as root:
                lines += [f"{shown(file, 200)}:", *tree.lines(root)]
                found = choose.signals(root, asked)
                for own in found:
                    stem = file.stem + (f"_{own.path}" if len(found) > 1 else "")
                    name = write.name_of(stem, taken) + (".wav" if wav else ".csv")
                    if wav:
                        write.wave(draft / name, own)
                    else:
                        write.table(draft / name, own, unit is not None)
                    rows.append((name, own))
                    lines += _told(out / name, own, wav)
        if len(rows) > 1:
            (draft / "trials.csv").write_text(write.trials(rows, wav), encoding="utf-8")
            lines.append(f"{shown(out / 'trials.csv', 200)}: {len(rows)} trials; fill in what the file does not tell, "
                         "or let `stylus trials` make the list of the files' names")
    written = [name for name, _ in rows] + ["trials.csv"] * (len(rows) > 1)
    return Converted([out / name for name in written], lines)


def _told(file: Path, own: Signal, wav: bool) -> list[str]:
    axes = ", ".join(shown(axis.name, 30) for axis in own.axes)
    units = ", ".join(dict.fromkeys(shown(unit or "no unit", 30) for unit in own.units))
    at = f"{own.rate_hz:g} Hz" if own.time is None else f"times '{shown(own.time.name)}'"
    scale = f", which a WAV does not hold: give stylus --scale {units}" if wav and any(own.units) else ""
    return [f"{shown(file, 200)}: {axes}; {at}; {units}{scale}", *(f"  {note}" for note in own.notes)]


@contextmanager
def _opened(file: Path) -> Iterator[Group]:
    """The tree of a file, which is named in a refusal. Whatever a library fails with becomes one."""
    try:
        with readers.opened(file) as root:
            yield root
    except Refusal as fault:
        raise Refusal(f"{shown(file, 200)}: {fault}") from fault
    except (Exception, MemoryError) as fault:
        told = shown(f"{type(fault).__name__}: {fault}", 200)
        raise Refusal(f"{shown(file, 200)}: cannot be read ({told}): save it again, or as .csv") from fault
