"""The command ``stylus-convert``."""

from __future__ import annotations

import argparse
import glob
import io
import os
import sys
from typing import Optional, Sequence

from . import convert, tree
from .tree import Refusal


def _behind(name: str) -> list[str]:
    """The files behind a pattern, which shells of Windows leave to the command; any other name as it is."""
    return [name] if os.path.lexists(name) else sorted(glob.glob(name)) or [name]


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Runs the command; returns 2 after a refusal."""
    told = argparse.ArgumentParser(
        prog="stylus-convert",
        description="Make CSV or WAV that stylus reads of .mat, .h5, .npy, .npz, .tdms, .parquet and .xlsx. Without "
        "--out, print what is in them.",
    )
    told.add_argument("files", nargs="+", metavar="FILE")
    for option, value, about in (
        ("--out", "DIR", "folder of the outputs; several trials get a trials.csv in it"),
        ("--signal", "NAME", "array or group of samples, by name or path; with * in it, several trials"),
        ("--time", "NAME", "array or column of the times, by name or number"),
        ("--axes", "LIST", "columns of the axes, by names or numbers, as 2,3,4; each: every column is a trial; d1 to "
         "d3: the dimension that has the axes"),
        ("--unit", "UNIT", "unit of the samples, as stylus takes it: g, mg, m/s^2, g/256"),
    ):
        told.add_argument(option, metavar=value, help=about)
    told.add_argument("--rate", dest="rate_hz", type=float, metavar="HZ", help="sample rate, for the file's own")
    told.add_argument("--wav", action="store_true", help="write WAV of 64-bit floats, and not CSV")
    told.add_argument("--overwrite", action="store_true", help="replace outputs that are there already")
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Names in files have signs that a terminal's code page may lack.
        sys.stdout.reconfigure(errors="replace")
    try:
        given = vars(told.parse_args(arguments))
        print(convert(**given | {"files": [file for name in given["files"] for file in _behind(name)]}))
    except (Refusal, OSError) as fault:
        print(f"stylus-convert: {fault}", file=sys.stderr)
        return 2
    return 0


def command() -> int:
    """Runs the command within a bound on memory, because some formats unpack to any size."""
    try:
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        bound = 4 * tree.MOST_BYTES
        resource.setrlimit(resource.RLIMIT_DATA, (bound if most < 0 else min(bound, most), most))
    except (ImportError, ValueError, OSError):
        pass
    return main()


if __name__ == "__main__":
    raise SystemExit(command())
