"""Collapse of a column of sand (Lube et al. 2004, 2005; Lajeunesse et al. 2005), computed with the commands of mpmgis.

python tests/scenes/granular_column/make.py FOLDER [--aspect 1 --cells 16 --round --law DruckerPrager] [--png FOLDER]
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles

LENGTH, GRAVITY, DENSITY = 0.1, 9.81, 1500.0  # L0 [m], half the length if a column collapses to both sides, or radius
WIDE, PER_CELL = 3, 2  # cells across a strip, points along the side of a cell
STIFF = 7.0  # speed of pressure waves over sqrt(g H), approximately: the weight of the column compresses it by 2 %
FALLS = 5  # length of a run, in sqrt(H / g)
EDGE = LENGTH / 30.0  # [m], thickness at the edge of a deposit: one grain
DRUCKER_PRAGER = "friction_angle = 30\ncohesion = 0\nmatch = "


class Column(NamedTuple):
    """One collapse: height over L0, cells over the smaller of height and L0, shape, law."""

    aspect: float
    cells: int
    round: bool = False
    law: str = "MuI"

    @property
    def height(self):
        return self.aspect * LENGTH

    @property
    def cell(self):
        return LENGTH * min(self.aspect, 1.0) / self.cells

    @property
    def fall(self):
        """sqrt(H / g) [s]."""
        return np.sqrt(self.height / GRAVITY)

    @property
    def measured(self):
        """Runout [L0] of Lube et al. (2005) between walls, of Lube et al. (2004) of a round column."""
        return lube_round(self.aspect) if self.round else lube_plane(self.aspect)


def lube_plane(a):
    """1.2 a up to a = 1.8, 1.9 a^(2/3) from a = 2.8, and a power law between them."""
    low, high = 1.2 * 1.8, 1.9 * 2.8 ** (2.0 / 3.0)
    if a <= 1.8:
        return 1.2 * a
    if a >= 2.8:
        return 1.9 * a ** (2.0 / 3.0)
    return low * (a / 1.8) ** (np.log(high / low) / np.log(2.8 / 1.8))


def lube_round(a):
    """1.24 a up to a = 1.7, 1.6 a^(1/2) above."""
    return 1.24 * a if a < 1.7 else 1.6 * np.sqrt(a)


def moduli(column, stiff=STIFF):
    """Bulk and shear modulus [Pa] for Poisson's ratio 0.3 and pressure waves of about `stiff` times sqrt(g H)."""
    young = 0.8 * DENSITY * stiff**2 * GRAVITY * column.height
    return young / 1.2, young / 2.6


def write_inputs(folder, column):
    """Write level ground and the column on it, at the western edge (a round column: also at the southern edge)."""
    cell = column.cell
    reach = LENGTH * (1.0 + 1.6 * column.measured) + 4 * cell
    long = int(np.ceil(reach / cell))
    wide = long if column.round else WIDE
    chain.write_raster(folder / "dtm.tif", np.zeros((wide, long)), 0.0, wide * cell, cell)
    spacing = cell / PER_CELL
    sides = LENGTH, LENGTH if column.round else WIDE * cell, column.height
    axes = [(np.arange(round(side / spacing)) + 0.5) * spacing for side in sides]
    position = np.column_stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")])
    if column.round:
        position = position[np.hypot(position[:, 0], position[:, 1]) <= LENGTH]
    volume = np.full(len(position), spacing**3)
    particles = Particles(position, np.zeros_like(position), DENSITY * volume, volume)
    write_frame(folder / "column.h5", Frame(particles, dimension=3, time=0.0, header={"density": DENSITY}))


def make(folder, column):
    """Run the scene in `folder`; returns its record."""
    folder = chain.fresh(folder)
    write_inputs(folder, column)
    bulk, shear = moduli(column)
    path = chain.write_scene(
        "granular_column",
        folder,
        cell_size=column.cell,
        bulk_modulus=f"{bulk:.6g}",
        shear_modulus=f"{shear:.6g}",
        end_time=f"{FALLS * column.fall:.6g}",
        frame_interval=f"{column.fall:.6g}",
    )
    if column.law == "DruckerPrager":
        _without_rate(path, "triaxial" if column.round else "plane_strain")
    return chain.run_scene(folder)[0]


def _without_rate(path, match):
    """Change the material of the scene to Drucker-Prager with a friction angle of 30 degrees."""
    gone = ("mu1 ", "mu2 ", "inertial_number", "grain_", "volume_correction")
    lines = [line for line in path.read_text().splitlines() if not line.startswith(gone)]
    law = lines.index('law = "MuI"')
    lines[law : law + 1] = ['law = "DruckerPrager"', *f'{DRUCKER_PRAGER}"{match}"'.splitlines()]
    path.write_text("\n".join(lines) + "\n")


class Deposit(NamedTuple):
    """The deposit in units of L0: front, distance within which 99 % of the mass lie, top; and the remaining speed."""

    front: float
    mass99: float
    top: float
    speed: float  # mean over the mass [sqrt(g H)]


def deposit(folder, column):
    """The Deposit of the last frame of a run."""
    *_, last = chain.frames(folder)
    place = chain.placed(last)
    out = np.hypot(place[:, 0], place[:, 1]) if column.round else place[:, 0]
    speed = np.linalg.norm(last.particles.velocity, axis=1).mean() / np.sqrt(GRAVITY * column.height)
    within = float(np.quantile(out, 0.99))
    return Deposit(
        ends(out, column) / LENGTH - 1.0,
        within / LENGTH - 1.0,
        float(place[out < 0.15 * LENGTH, 2].max()) / LENGTH,
        float(speed),
    )


def thickness_along(out, column):
    """(outer edges [m], thickness [m]) of rings one cell wide, from distances `out` [m] of points of equal volume."""
    ring = column.cell
    count = np.bincount((out / ring).astype(int))
    edges = (np.arange(len(count)) + 1.0) * ring
    area = np.pi / 4.0 * (edges**2 - (edges - ring) ** 2) if column.round else ring * WIDE * column.cell
    return edges, count * (column.cell / PER_CELL) ** 3 / area


def ends(out, column):
    """Distance [m] of the outermost ring that is thicker than EDGE."""
    edges, thick = thickness_along(out, column)
    return float(edges[thick >= EDGE][-1])


def profile_figure(folders, png):
    """Draw the deposits of {name: (folder, Column)} over the distance."""
    figure, ((axis,),) = profiles.picture(1, 1, (8.0, 3.2))
    for name, (folder, column) in folders.items():
        *_, last = chain.frames(folder)
        place = chain.placed(last)
        out = np.hypot(place[:, 0], place[:, 1]) if column.round else place[:, 0]
        edges, thick = thickness_along(out, column)
        axis.plot(edges / LENGTH, thick / LENGTH, label=name)
    axis.axvline(1.0 + column.measured, color="black", lw=0.6, ls=":", label="front of Lube et al.")
    axis.set(xlabel="x / L0", ylabel="thickness / L0")
    axis.legend(fontsize=8)
    profiles.save(figure, png)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--aspect", type=float, default=1.0, help="height over length, or over the radius (default: 1)")
    parser.add_argument("--cells", type=int, default=16, help="cells over the smaller of the two (default: 16)")
    parser.add_argument("--round", action="store_true", help="a quarter of a round column instead of a strip")
    parser.add_argument("--law", choices=["MuI", "DruckerPrager"], default="MuI", help="material (default: MuI)")
    parser.add_argument("--png", type=Path, help="folder for a figure of the deposit")
    asked = parser.parse_args()
    column = Column(asked.aspect, asked.cells, asked.round, asked.law)
    record = make(asked.folder, column)
    found = deposit(asked.folder, column)
    values = *found, column.measured, found.mass99 / column.measured
    row = [f"{column.aspect:g}", column.cells, *(f"{value:.3f}" for value in values)]
    print(chain.table([row], ["a", "cells", "front", "99 %", "top", "speed left", "Lube", "99 % over Lube"]))
    print(record["volume"])
    if asked.png:
        profile_figure({f"{column.cells} cells": (asked.folder, column)}, asked.png / "granular_column.png")


if __name__ == "__main__":
    main()
