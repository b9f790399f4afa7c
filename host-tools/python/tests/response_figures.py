"""Judge of calibrated actuators: SciPy on a plant's own acceleration of the tip.

Nothing here is of the calibration that is judged. Run on a folder that the test `figures_of_many_plants` has filled, it
prints a table and fails if a figure is missed:

    STYLUS_FIGURES=FOLDER cargo test -p host-tools --lib -- --ignored figures_of_many_plants
    python3 response_figures.py FOLDER
"""

import collections
import json
import pathlib
import sys

import numpy as np
from scipy import signal

RATE_HZ = 5000
BAND_HZ = (30, 800)
MOST = {"rms_db": 1.0, "worst_db": 2.0, "level_db": 0.5, "resonance": 0.02, "octaves_db": 1.5, "seconds": 60}


def flatness(asked: np.ndarray, tip: np.ndarray, band_hz: tuple[float, float]) -> dict[str, float]:
    """Deviation of tip (40 kHz) from asked (5 kHz), both m/s², over a band: each octave with the same weight."""
    tip = signal.resample_poly(tip, 1, 8)[: len(asked)]
    words = {"fs": RATE_HZ, "nperseg": 5000, "noverlap": 3750}
    hz, cross = signal.csd(asked, tip, **words)
    _, power = signal.welch(asked, **words)
    level = 20 * np.log10(np.abs(cross / power))
    at = np.geomspace(*band_hz, 300)
    # Mean over a twelfth of an octave, because the scatter of single bins is the estimate's.
    level = np.array([level[abs(np.log2(np.maximum(hz, 0.1) / f)) <= 1 / 24 + 0.5 / f].mean() for f in at])
    off = level - level.mean()
    return {"level_db": level.mean(), "rms_db": np.sqrt(np.mean(off**2)), "worst_db": np.abs(off).max()}


def third_octaves(samples: np.ndarray, rate_hz: float) -> np.ndarray:
    """Power in the third octaves of 40 to 800 Hz, after half a second."""
    powers = []
    for band in range(16, 30):
        edges = 10 ** (band / 10 + np.array([-0.05, 0.05]))
        sections = signal.butter(4, edges, "bandpass", fs=rate_hz, output="sos")
        powers.append(np.mean(signal.sosfilt(sections, samples)[int(rate_hz / 2) :] ** 2))
    return np.array(powers)


def octaves_db(asked: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Deviation of the tip's third octaves, in those within 40 dB of the loudest."""
    tip = signal.resample_poly(tip, 1, 8)
    wanted, found = third_octaves(asked, RATE_HZ), third_octaves(tip, RATE_HZ)
    return 10 * np.log10(found / wanted)[wanted > 1e-4 * wanted.max()]


def resonance_hz(plant: dict) -> float:
    """Undamped frequency of the fastest pair of poles: current, speeds and places of body and moving mass."""
    coil, mass, hand = plant["coil"], plant["body"]["mass_kg"], plant["hand"]
    force, moving = coil["force_n_per_a"], coil["moving_mass_kg"]
    spring, damper = coil["stiffness_n_per_m"], coil["damping_n_s_per_m"]
    body = np.array([force, -hand["damping_n_s_per_m"], -hand["stiffness_n_per_m"], damper, spring]) / mass
    own = np.array([-force, 0, 0, -damper, -spring]) / moving
    current = np.array([-coil["resistance_ohm"], 0, 0, force, 0]) / coil["inductance_h"]
    poles = np.linalg.eigvals(np.array([current, body, [0, 1, 0, 0, 0], own - body, [0, 0, 0, 1, 0]]))
    return np.abs(poles[poles.imag > 0]).max() / (2 * np.pi)


def judged(path: pathlib.Path) -> tuple[dict, dict]:
    """The report of a plant, and its figures if it passed."""
    report = json.loads(path.read_text())
    if report["verdict"] != "pass":
        return report, {}
    values = np.fromfile(path.with_suffix(".f32"), "<f4").astype(float).reshape(2, -1)
    (asked, _, after), (texture, texture_before, texture_after) = map(split, values)
    figures = flatness(asked, after, report["band_hz"])
    figures["band_hz"] = report["band_hz"][0] - BAND_HZ[0] + BAND_HZ[1] - report["band_hz"][1]
    figures["resonance"] = report["resonance_hz"] / resonance_hz(report["parameters"]) - 1
    before, after_db = octaves_db(texture, texture_before), octaves_db(texture, texture_after)
    figures["before_db"] = np.abs(before - np.mean(before)).max()
    figures["octaves_db"] = np.abs(after_db).max()
    figures["seconds"] = report["seconds"]
    return report, figures


def split(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What was asked, and the tip before and after."""
    count = len(values) // 33
    asked, before, after = np.split(values, [count, 17 * count])
    return asked, before[1::2], after[1::2]


def missed(figures: dict) -> list[str]:
    return [name for name, most in MOST.items() if not abs(figures[name]) <= most]


def main(folder: str) -> int:
    failures = 0
    verdicts = collections.defaultdict(collections.Counter)
    sound = []
    for path in sorted(pathlib.Path(folder).glob("*.json")):
        report, figures = judged(path)
        faults = report["parameters"]["faults"]
        verdicts[faults[0]["kind"] if faults else "none"][report["verdict"]] += 1
        is_wrong = bool(missed(figures)) if figures else not faults
        if is_wrong:
            failures += 1
            print(path.stem, faults, report["verdict"], figures, "MISSED", missed(figures) if figures else "")
        if path.stem.startswith("sound") and figures:
            sound.append(figures)
    print(f"{len(sound)} sound plants that passed: median, 90 %, worst")
    for name in sound[0] if sound else []:
        values = np.abs([figures[name] for figures in sound])
        figures = np.median(values), np.quantile(values, 0.9), values.max()
        print(f"  {name:11}", *(f"{value:8.3f}" for value in figures))
    for fault, counts in sorted(verdicts.items()):
        print(f"  {fault:18}", dict(counts))
    print(f"{failures} missed")
    return failures > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
