"""Measures every program in turns, checks what it played, and prints a table: table.py BUILT [PROGRAM...]

BUILT has the folders that the Makefile fills: own/ and native/ with programs, and one for each order. Each figure of
time is the median of ROUNDS runs, in which all programs take turns. Instructions are callgrind's, the difference of two
runs over that of their samples; they are exact. Left out is what valgrind cannot run, and SciPy, because Python
never starts twice with the same number.

No figure is of silence or overflow: a program whose output is further than a bound from the model's RMS, or from its
spectrum in a third octave, ends the table.
"""

import os
import platform
import re
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.signal import welch

ORDERS = [20, 100, 400]
ROUNDS = 11
SAMPLES = 1 << 18
SHORT, LONG = 1 << 13, 1 << 14  # samples of callgrind's two runs
RATE_HZ = 5000
LEVEL_DB, BAND_DB = 0.5, 1.5  # of 52 s of noise
WORD = 2.0**27  # RMS of what a filter of integers puts out

BUILT = Path(sys.argv[1])
HERE = Path(__file__).parent
# Row of the table: program, arguments, type of the samples, model that is played.
ROWS = {
    "stylus player, at a node": ("player", ["120", "0.5"], "<f4", "node"),
    "stylus player, between four nodes": ("player", ["150", "0.75"], "<f4", "middle"),
    "idsp, `Cascade` of sections, i32": ("idsp", [], "<i4", "node"),
    "CMSIS-DSP, `arm_iir_lattice_q31`": ("cmsis_dsp", [], "<i4", "node"),
}
ROWS = {name: row for name, row in ROWS.items() if (BUILT / "own" / row[0]).exists()}


def commands():
    """Every program to run: row, kind of build, command before its folder, arguments, type of samples, model."""
    for row, (program, arguments, words, model) in ROWS.items():
        for kind in ["own", "native"]:
            yield row, kind, [BUILT / kind / program], arguments, words, model
    yield "SciPy, `lfilter`, f64", "own", [sys.executable, HERE / "lfilter.py"], [], "<f4", "node"
    for program in sys.argv[2:]:
        yield Path(program).name, "own", [Path(program).resolve()], [], "<f4", "node"


def run(command, samples, arguments, before=()):
    line = [*before, *command[0], command[1], str(samples), *arguments]
    return subprocess.run(line, capture_output=True, check=True)


def check(what, samples, model):
    frequency, power = welch(samples, RATE_HZ, nperseg=4096)
    response = 1 / np.polyval(model["polynomial"][::-1], np.exp(-2j * np.pi * frequency / RATE_HZ))
    wanted = np.abs(response) ** 2 * model["noise"].var() * 2 / RATE_HZ
    level_db = 20 * np.log10(samples.std() / model["rms"])
    centres = 1000 * 2 ** (np.arange(-17, 4) / 3)
    bands = [(frequency > centre * 2 ** (-1 / 6)) & (frequency < centre * 2 ** (1 / 6)) for centre in centres]
    band_db = max(abs(10 * np.log10(power[band].sum() / wanted[band].sum())) for band in bands)
    if not (abs(level_db) < LEVEL_DB and band_db < BAND_DB):
        raise SystemExit(f"{what}: off by {level_db:.2f} dB, and up to {band_db:.2f} dB in a third octave")


def instructions(command, arguments):
    """Instructions per sample; None if there is no valgrind, or if it does not know this processor's."""
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    counts = []
    for samples in (SHORT, LONG):
        try:
            told = run(command, samples, arguments, valgrind).stderr
        except (FileNotFoundError, subprocess.CalledProcessError):
            return None
        counts.append(int(re.search(rb"Collected : (\d+)", told)[1]))
    return (counts[1] - counts[0]) / (LONG - SHORT)


def measured():
    """Times of all rounds, ns, and instructions, by row, kind and order."""
    times, counts = {}, {}
    for turn in range(ROUNDS):
        for row, kind, command, arguments, words, model_name in commands():
            for order in ORDERS:
                key, folder = (row, kind, order), BUILT / str(order)
                if turn and key not in times:
                    continue
                try:
                    result = run((command, folder), SAMPLES, arguments)
                except subprocess.CalledProcessError as error:
                    print(f"{row}, order {order}: {error.stderr.decode().strip()}", file=sys.stderr)
                    continue
                times.setdefault(key, []).append(float(result.stderr))
                if turn:
                    continue
                model = np.load(folder / f"{model_name}.npz")
                samples = np.frombuffer(result.stdout, words).astype(float)
                check(f"{row}, {kind}, order {order}", samples * (model["rms"] / WORD if words == "<i4" else 1), model)
                if kind == "own" and command[0] != sys.executable:
                    counts[key] = instructions((command, folder), arguments)
    return times, counts


times, counts = measured()
medians = {key: statistics.median(values) for key, values in times.items()}
quartiles = {key: statistics.quantiles(values) for key, values in times.items()}
spread = max((high - low) / middle for low, middle, high in quartiles.values())
processor = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())[1]
print(f"{processor}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {platform.system()}.")
print(f"Half of the rounds lie within {100 * spread:.0f} % of the median, or less.\n")
heads = [f"{head}{order}" for head in ("ns, ", "ns, native, ", "instructions, ") for order in ORDERS]
print("| program |", " | ".join(heads), "|")
print("|---" * (1 + len(heads)) + "|")
for row in dict.fromkeys(key[0] for key in medians):
    cells = [(medians, "own"), (medians, "native"), (counts, "own")]
    numbers = [figures.get((row, kind, order)) for figures, kind in cells for order in ORDERS]
    print(f"| {row} |", " | ".join("–" if number is None else f"{number:.0f}" for number in numbers), "|")
