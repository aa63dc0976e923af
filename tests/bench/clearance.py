"""What the clearance does, height above the ground up to which nodes touch it: `python tests/bench/clearance.py`.

For the page's decision (mpmgis/ARCHITECTURE.md). A minute or two, mostly for compiling.
"""

import sys
from pathlib import Path

import numpy as np

TESTS = Path(__file__).resolve().parents[1]
sys.path += [str(TESTS), *(str(folder) for folder in TESTS.iterdir() if folder.is_dir())]

import test_points_catalogue as catalogue  # noqa: E402
from point_scenes import block_of, march_to, plane, points_on, sorted_points  # noqa: E402

from mpmgis.effects.contact import CoulombContact  # noqa: E402

ABOVE = (0.0, 0.05, 0.25, 0.45, 0.5, 0.55, 0.75, 0.95)  # [cells] of the ground above a node
SLOPE = np.radians(30.0)


def worst_stress(clearance):
    """Largest relative errors of stress in a column that starts under its weight: (lowest two cells, all others)."""
    cell, found = catalogue.DEPTH / 10, []
    for above in ABOVE:
        frame = block_of((4 * cell, 4 * cell, catalogue.DEPTH), 0.5 * cell, (0.0, 0.0, above * cell))
        stress = np.zeros((len(frame.particles), 6))
        stress[:, 2] = -1000.0 * catalogue.G * (catalogue.DEPTH + above * cell - frame.particles.position[:, 2])
        stress[:, 0] = stress[:, 1] = 0.3 / 0.7 * stress[:, 2]
        ground = catalogue.level(4 * cell, 4 * cell, cell, above * cell)
        solver = points_on(ground, frame, cell, catalogue.SOIL, stress=stress, edges="wall", clearance=clearance)
        start = 4 * catalogue.RINGING
        found.append(np.abs(catalogue.watched(solver, start, 1.5 * start, 16, above)[0] - 1.0))
    return max(layers[0] for layers in found), max(layers[1:].max() for layers in found)


def fallen(clearance, above):
    """How high [cells] sand that fell by a metre rests above the ground."""
    frame = block_of((3.0, 3.0, 6.0), 0.5, (0.0, 0.0, above + 2.0))
    sand = catalogue.drucker_prager(1e7, 6e6, 30.0, 0.0, "plane_strain")
    ground = catalogue.level(3.0, 3.0, 1.0, above)
    solver = points_on(ground, frame, 1.0, sand, CoulombContact(0.5), edges="wall", clearance=clearance)
    march_to(solver, 4.0)
    return sorted_points(solver).position[:, 2].mean() - above - 3.0


def lowest_of_a_slide(clearance):
    """Height [cells] above the ground of the lowest points of sand that slides down 30 degrees."""
    sand = catalogue.drucker_prager(6.7e6, 4e6, 30.0, 0.0, "plane_strain")
    corner = (20.0, 0.0, 120.0 - 20.0 * np.tan(SLOPE))
    frame = block_of((20.0, 4.0, 5.0), 0.5, corner, density=1500.0, turned=SLOPE)
    terrain = plane(30.0, width=4.0)
    solver = points_on(terrain, frame, 1.0, sand, CoulombContact(0.4), edges="wall", clearance=clearance)
    march_to(solver, 6.0)
    position = sorted_points(solver).position
    height = (position[:, 2] - 120.0 + np.tan(SLOPE) * position[:, 0]) * np.cos(SLOPE)
    columns = np.floor(position[:, 0])
    full = [column for column in np.unique(columns) if (columns == column).sum() > 30]
    return np.mean([np.sort(height[columns == column])[:6].mean() for column in full])


def main():
    """Print a line for each clearance."""
    print("clearance | stress off, lowest two cells, others | fallen, mean, least, most | lowest of a slide   [cells]")
    for clearance in (0.0, 0.25, 0.5, 0.75, 1.0):
        lowest, others = worst_stress(clearance)
        rests = [fallen(clearance, above) for above in ABOVE]
        heights = f"{np.mean(rests):.2f} {min(rests):.2f} {max(rests):.2f}"
        stress = f"{100 * lowest:.0f} % {100 * others:.0f} %"
        print(f"{clearance:.2f} | {stress} | {heights} | {lowest_of_a_slide(clearance):.2f}", flush=True)


if __name__ == "__main__":
    main()
