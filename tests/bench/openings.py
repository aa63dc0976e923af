"""Discharge of openings in barriers over critical flow b sqrt(g) (2 E / 3)^1.5: `python tests/bench/openings.py`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))

from opening_scenes import discharge_of_columns, discharge_of_points

COLUMNS = [
    (2.0, 2.0, 0.0, (0.0, 0.0), 1.0),
    (2.0, 4.0, 0.0, (0.0, 0.0), 1.0),
    (2.0, 8.0, 0.0, (0.0, 0.0), 1.0),
    (2.0, 4.0, 33.0, (0.7, 0.2), 0.5),
    (1.0, 1.0, 45.0, (0.2, 0.4), 0.3),
    (2.0, 6.0, 20.0, (0.2, 0.4), 4.0),
    (2.0, 1.2, 75.0, (0.4, 0.8), 0.2),
]
POINTS = [
    (1.0, 1.0, 0.0, (0.3, 0.1), 0.5),
    (1.0, 2.0, 0.0, (0.0, 0.0), 1.0),
    (1.0, 3.0, 30.0, (0.3, 0.1), 1.0),
    (1.0, 6.0, 20.0, (0.2, 0.6), 1.0),
    (1.0, 2.0, 10.0, (0.2, 0.6), 4.0),
]

if __name__ == "__main__":
    print("| solver | cell | opening | direction | wall thick | discharge |\n|---|---|---|---|---|---|")
    for name, law, cases in (("columns", discharge_of_columns, COLUMNS), ("points", discharge_of_points, POINTS)):
        for case in cases:
            cell, gap, degrees, _, thick = case
            print(f"| {name} | {cell:g} m | {gap:g} m | {degrees:g} deg | {thick:g} m | {law(*case):.2f} |", flush=True)
