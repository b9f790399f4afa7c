"""Draws the beginning of one column of the logger's CSV files, in mg, one panel above the other, as an SVG.

    python3 draw.py COLUMN SECONDS OUT.svg CSV...
"""

import csv
import sys
from pathlib import Path

WIDTH, HEIGHT, LEFT, GAP = 720, 110, 60, 30
column, seconds, out, files = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:]
parts = []
for panel, name in enumerate(files):
    with open(name, newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        points = [(float(row["time_s"]), float(row[column])) for row in rows]
    # At most one point per pixel.
    points = [point for point in points if point[0] <= seconds]
    points = points[:: max(1, len(points) // WIDTH)]
    most = max(abs(value) for _, value in points) * 1.05
    top = panel * (HEIGHT + GAP) + GAP

    def x(time_s: float) -> float:
        return LEFT + (WIDTH - LEFT - 10) * time_s / seconds

    def y(value: float) -> float:
        return top + HEIGHT / 2 * (1 - value / most)

    line = " ".join(f"{x(time_s):.1f},{y(value):.1f}" for time_s, value in points)
    title = f"{Path(name).parent}/{Path(name).name}, {column}, mg (SIMULATED)"
    parts.append(f'<text x="{LEFT}" y="{top - 8}">{title}</text>')
    for value in (-most / 1.05, 0, most / 1.05):
        parts.append(f'<text x="{LEFT - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.0f}</text>')
        parts.append(f'<path d="M{LEFT} {y(value):.1f}H{WIDTH - 10}" stroke="#8888" fill="none"/>')
    parts.append(f'<polyline points="{line}" fill="none" stroke="#27c" stroke-width="1"/>')
height = len(files) * (HEIGHT + GAP) + GAP
for share, anchor in ((0, "start"), (0.5, "middle"), (1, "end")):
    place = f'x="{LEFT + (WIDTH - LEFT - 10) * share:g}" y="{height - 8}" text-anchor="{anchor}"'
    parts.append(f"<text {place}>{seconds * share:g} s</text>")
style = "<style>text{fill:#555}@media(prefers-color-scheme:dark){text{fill:#bbb}}</style>"
head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12"'
out.write_text(f"{head}>\n{style}\n" + "\n".join(parts) + "\n</svg>\n")
