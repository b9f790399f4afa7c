"""Analysis of a listening test: files that pages of `stylus compare` saved, or simulated listeners without any.

    python analyse_listening.py answers-*.csv
    python analyse_listening.py

Every design that the files hold is analysed: d' of each pair and listener (A/B/X), thresholds (staircases), and a mixed
model (ratings; pip install statsmodels). Without files listeners are simulated, and what they were made with is printed
beside what is found.
"""

import sys

import numpy as np
from stylus_haptics import psychophysics


def simulated() -> list[psychophysics.Row]:
    """Rows of all designs; figures in the names of pairs and parts are what the listeners were made with."""
    generator = np.random.default_rng(1)
    rows = []
    for listener in range(1, 4):
        for d_prime in (0.5, 1.5, 2.5):
            for right in psychophysics.simulated_abx(d_prime, 60, generator):
                row = {"design": "abx", "listener": listener, "pair": f"d' {d_prime}", "correct": int(right)}
                rows.append(row)
    at_threshold = psychophysics.abx_d_prime(psychophysics.TWO_DOWN_ONE_UP)
    levels_db = [8 * 2 ** (n / 4) for n in range(-16, 1)]
    for listener, truth_db in ((1, 1.5), (2, 2.0), (3, 3.0)):
        for row in psychophysics.simulated_staircase(lambda db: at_threshold * db / truth_db, levels_db, generator):
            rows.append({**row, "listener": listener, "part": f"level, {truth_db} dB"})
    means = {"recording-fitted": 70.0, "recording-gaussian": 40.0, "recording-recording": 85.0}
    return rows + psychophysics.simulated_ratings(means, 12, 6, generator)


def main(paths: list[str]) -> None:
    rows = psychophysics.read(paths) if paths else simulated()
    if not paths or any(row.get("origin") == "SIMULATED" for row in rows):
        print("SIMULATED: nothing here says anything of real surfaces" if paths else "SIMULATED listeners")
    of = {design: [row for row in rows if row["design"] == design] for design in ("abx", "staircase", "similarity")}
    if of["abx"]:
        print("\nd' by differencing, with exact intervals of 95 %")
        for listener in sorted({row["listener"] for row in of["abx"]}, key=str):
            for one in psychophysics.sensitivities(row for row in of["abx"] if row["listener"] == listener):
                found = f"{one.right} of {one.trials}: {one.d_prime:.2f} ({one.low:.2f} to {one.high:.2f})"
                print(f"  listener {listener}  {one.pair:20} {found}")
    if of["staircase"]:
        print("\nthresholds: 70.7 % of answers right")
        for one in psychophysics.thresholds(of["staircase"]):
            where = ", at an end of the grid" if one.at_end else ""
            found = f"{one.threshold:.2f} {one.unit} after {one.trials} trials{where}"
            print(f"  listener {one.listener}  {one.part:20} {found}")
    if of["similarity"]:
        print("\nratings: differences by a mixed model, with intervals of 95 %")
        try:
            for one in psychophysics.ratings(of["similarity"]):
                interval = f"{one.difference:+.1f} ({one.low:+.1f} to {one.high:+.1f})"
                print(f"  {one.pair:20} mean {one.mean:.1f}, {interval}")
        except (ImportError, ValueError) as failure:
            print(f"  none: {failure}")


if __name__ == "__main__":
    main(sys.argv[1:])
