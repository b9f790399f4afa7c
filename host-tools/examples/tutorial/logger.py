"""A logger with three axes, SIMULATED: writes the recordings of `stylus simulate-rig` as a logger's CSV files.

    python3 logger.py RIG OUT [--range G] [--warm]

It writes counts of milli-g at 6.4 kHz, clips at its range (2 g as it comes), and one axis drifts while it warms up,
which `--warm` waits for.
"""

import argparse
import csv
import struct
from pathlib import Path

RATE_HZ, MILLI_G = 6400, 9.80665e-3


def axes(wav: Path) -> list[tuple[float, ...]]:
    """Samples of three axes, m/s², of a WAV file of 32-bit floats."""
    data = wav.read_bytes()
    at = data.index(b"data") + 8
    (length,) = struct.unpack_from("<I", data, at - 4)
    return list(struct.iter_unpack("<3f", data[at : at + length]))


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("rig", type=Path)
parser.add_argument("out", type=Path)
parser.add_argument("--range", type=float, default=2.0, metavar="G")
parser.add_argument("--warm", action="store_true")
asked = parser.parse_args()
asked.out.mkdir(parents=True)
with open(asked.rig / "trials.csv", newline="") as file:
    rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
most = 1000 * asked.range
for number, row in enumerate(rows):
    # The first recording, before the sensor is warm.
    drift = 0.0 if asked.warm or number else 600.0
    name = f"{row['texture']}_{float(row['speed_mm_s']):g}mms_{float(row['force_n']):g}N.csv"
    samples = axes(asked.rig / row["file"])
    with open(asked.out / name, "w") as out:
        out.write("# SIMULATED: a logger's file, computed from a simulated recording\ntime_s,x,y,z\n")
        for at, (x, y, z) in enumerate(samples):
            warming = drift * at / len(samples)
            values = (x / MILLI_G, y / MILLI_G, z / MILLI_G + warming)
            counts = (round(max(-most, min(most, value))) for value in values)
            out.write(f"{at / RATE_HZ:.6f},{','.join(map(str, counts))}\n")
print(f"{len(rows)} files of three axes, SIMULATED -> {asked.out}")
