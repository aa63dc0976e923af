"""Contact of 3D flows with the ground, for the page decisions.md: `python tests/bench/contact.py`.

Stress in the lowest cells, gap after a fall, and slabs near their friction angle, for several positions of the ground
between two nodes. It takes some minutes.
"""

import sys
from pathlib import Path

import numpy as np

TESTS = Path(__file__).resolve().parents[1]
sys.path += [str(TESTS), *(str(folder) for folder in TESTS.iterdir() if folder.is_dir())]

import test_points_catalogue as catalogue  # noqa: E402
from contact_scenes import slab  # noqa: E402
from point_scenes import block_of, integrate_to, points_on, sorted_points  # noqa: E402

from mpmgis.laws.friction import friction_law  # noqa: E402

SLABS = ((24.0, False, 6.0), (26.0, False, 6.0), (26.0, True, 6.0), (35.0, False, 3.0))  # degrees, weighted, time [s]
ABOVE = (0.0, 0.05, 0.25, 0.45, 0.5, 0.55, 0.75, 0.95)  # [cells], height of the ground above a node


def worst_stress():
    """Largest relative errors of stress in a column under its weight: (lowest two cells, all others)."""
    found = [np.abs(catalogue.resting(above)[0] - 1.0) for above in ABOVE]
    return max(layers[0] for layers in found), max(layers[1:].max() for layers in found)


def fallen(above, layers):
    """Gap [cells] under the lowest of `layers` of points, half a cell apart, after a fall by two cells."""
    frame = block_of((3.0, 3.0, 0.5 * layers), 0.5, (0.0, 0.0, above + 2.0))
    sand = catalogue.drucker_prager(1e7, 6e6, 30.0, 0.0, "plane_strain")
    solver = points_on(
        catalogue.level(3.0, 3.0, 1.0, above), frame, 1.0, sand, friction_law("Coulomb", 0.5), edges="wall"
    )
    integrate_to(solver, 4.0)
    return sorted_points(solver).position[:, 2].min() - above - 0.25


def main():
    """Print the tables."""
    print("error of the stress: lowest two cells {:.1%}, others {:.1%}".format(*worst_stress()))
    for layers in (20, 4, 1):
        gaps = [fallen(above, layers) for above in ABOVE]
        print(f"{layers} layers after a fall by two cells: gap {min(gaps):+.2f} to {max(gaps):+.2f} cells", flush=True)
    print("slab: degrees, weighted, cell [m], ground above a node [cells] | distance, exact [m], speed [m/s]")
    for cell in (0.5, 0.25):
        for above in (0.0, 0.3, 0.6):
            for degrees, weighted, time in SLABS:
                moved, speed, exact, _ = slab(degrees, time, cell, above, weighted)
                case = f"{degrees:g} {weighted} {cell:g} {above:g}"
                print(f"{case} | {moved:.3f} {exact:.3f} {speed:.3f}", flush=True)


if __name__ == "__main__":
    main()
