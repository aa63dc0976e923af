"""NHESS 25:3897, supplement S1, with the commands of mpmgis: a block slides down a plane and over a cliff.

python tests/scenes/s1_block/make.py FOLDER [--cell 0.05] [--png FOLDER]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.terrain.synthetic_terrain import ramp_with_cliff

GRAVITY, SLOPE, LENGTH, CLIFF = 9.81, np.radians(30.0), 22.0, 10.0
HEIGHT, BLOCK, DENSITY, SHIFT = 0.1, 0.3, 1000.0, 0.02  # [m], [m], [kg m-3], [m] upwards
EDGE = LENGTH * np.cos(SLOPE)  # [m] from the start of the tail, like x in Eqs S1 to S5
TERMINAL = np.sqrt(2.0 * GRAVITY * LENGTH * np.sin(SLOPE))  # Eq S3
MARGIN, WIDE, END = 1.0, 3, 32.0  # [m] of plane behind the tail, [cells], [m] beyond the start of the tail
PER_CELL = 2  # points along the side of a cell
BANDS = ("h", "t", "Un", "Ut")


def exact(x):
    """{h, t, Ut, Un} of Eqs S1, S2, S4, S5 at distances `x` [m] from the start of the tail; t is its lower bound."""
    flown = np.maximum(x - EDGE, 0.0)
    across = TERMINAL * np.cos(SLOPE)
    flies = x >= EDGE
    fallen = np.tan(SLOPE) * flown + 0.5 * GRAVITY * (flown / across) ** 2
    return {
        "t": np.full(len(x), HEIGHT),
        "h": np.where(flies, HEIGHT + CLIFF - fallen, HEIGHT),
        "Ut": np.where(flies, across, np.sqrt(2.0 * GRAVITY * np.maximum(x, 0.0) * np.tan(SLOPE))),
        "Un": np.where(flies, -TERMINAL * np.sin(SLOPE) - GRAVITY * flown / across, 0.0),
    }


def write_terrain(path, cell):
    """Write the plane, the cliff at the pixel border nearest to the edge, and the floor at 0; x starts at MARGIN."""
    columns = round((MARGIN + END) / cell)
    west = EDGE - round((EDGE + MARGIN) / cell) * cell
    x = west + (np.arange(columns) + 0.5) * cell
    surface = ramp_with_cliff(np.degrees(SLOPE), CLIFF, edge=(EDGE, 0.0))
    chain.write_raster(path, np.tile(surface.height(x, 0.0 * x), (WIDE, 1)), west, WIDE * cell, cell)


def write_block(path, cell):
    """Write the block, SHIFT above the plane, with the foot of its tail at x = 0."""
    spacing = cell / PER_CELL
    axes = [(np.arange(round(side / spacing)) + 0.5) * spacing for side in (BLOCK, WIDE * cell, HEIGHT)]
    along, y, up = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    cos, sin = np.cos(SLOPE), np.sin(SLOPE)
    foot = CLIFF + LENGTH * sin + SHIFT
    position = np.column_stack([along * cos + up * sin, y, foot + up * cos - along * sin])
    volume = np.full(len(y), spacing**3)
    particles = Particles(position, np.zeros_like(position), DENSITY * volume, volume)
    write_frame(path, Frame(particles, dimension=3))


def make(folder, cell=0.01, interval=None):
    """Write the inputs in `folder`, run and export; returns the record of the run."""
    folder = chain.fresh(folder)
    write_terrain(folder / "dtm.tif", cell)
    write_block(folder / "block.h5", cell)
    changed = {} if interval is None else {"frame_interval": interval}
    chain.write_scene("s1_block", folder, cell_size=cell, **changed)
    record, _ = chain.run_scene(folder)
    chain.export(folder, "--min-depth", 0, "--no-qgis", "--crs", "local")
    return record


def extremes(folder, cell):
    """x [m] and {h, t, Ut: largest, Un: least} of all times along the middle of the strip."""
    line = (-MARGIN, 0.5 * WIDE * cell), (END - 1.0, 0.5 * WIDE * cell)
    x, values = profiles.cells_along(profiles.maxima(folder / "gis"), *line, cell, "h_max", "t_max", "Ut_max", "Un_min")
    return x - MARGIN, {name.split("_")[0]: band for name, band in values.items()}


def figures(folder, cell, png):
    """Draw figure S1: (a) the start, (b) largest depth and thickness, (c) parallel, (d) normal velocity."""
    figure, axes = profiles.picture(2, 2, (10.0, 6.5))
    (start, depth), (parallel, normal) = axes
    first = profiles.steps(folder / "gis")[0]
    line = (-0.1, 0.5 * WIDE * cell), (0.5, 0.5 * WIDE * cell)
    x, at_start = profiles.cells_along(first.path, *line, cell, "h", "t")
    for name, colour in (("h", "red"), ("t", "blue")):
        start.plot(x - 0.1, at_start[name], colour, marker=".", label=f"{name} at t = 0")
    start.axhline(HEIGHT, color="black", lw=0.5)
    x, found = extremes(folder, cell)
    some = np.linspace(0.0, 30.0, 61)
    wanted = exact(some)
    for axis, name, colour in ((depth, "h", "red"), (depth, "t", "blue"), (parallel, "Ut", "c"), (normal, "Un", "m")):
        axis.plot(x, found[name], colour, label=f"{name}, {'least' if name == 'Un' else 'largest'} over time")
        axis.plot(some, wanted[name], "ko", ms=3, mfc="none", label="Eqs S1 to S5" if name != "t" else None)
    depth.set_yscale("log")
    for axis, label in ((start, "[m]"), (depth, "[m]"), (parallel, "[m/s]"), (normal, "[m/s]")):
        axis.set(xlabel="x from the tail's start [m]", ylabel=label)
        axis.legend(fontsize=8)
    for axis in (depth, parallel, normal):
        axis.axvline(EDGE, color="gray", lw=0.5)
        axis.set_xlim(-0.5, 31.0)
    figure.suptitle(f"Block off a cliff (S1) in cells of {cell:g} m")
    profiles.save(figure, png)


def compared(folder, cell):
    """Name -> largest error against Eqs S1 to S5, over x from 1 m to 0.5 m before the front lands.

    Two cells on both sides of the edge are left out, because the cell at the edge has ground of both levels.
    """
    x, found = extremes(folder, cell)
    wanted = exact(x)
    slide = (x > 1.0) & (x < EDGE - 2 * cell)
    flight = (x > EDGE + 2 * cell) & (x < 29.0)
    both = slide | flight
    point = cell / PER_CELL
    return {
        "Ut": chain.relative(found["Ut"][both], wanted["Ut"][both]),
        "Un on the plane, of v_term": float(np.abs(found["Un"][slide]).max() / TERMINAL),
        "Un in flight": chain.relative(found["Un"][flight], wanted["Un"][flight]),
        "h in flight, of 10.1 m": float(np.abs(found["h"] - wanted["h"])[flight].max() / 10.1),
        "h on the plane [m], least": float(found["h"][slide].min()),
        "h on the plane [m], largest": float(found["h"][slide].max()),
        "t and a point's size [m], least": float(found["t"][both].min() + point),
        "t and a point's size [m], largest": float(found["t"][both].max() + point),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--cell", type=float, default=0.01, help="cell size of grid, DTM and export [m] (default 0.01)")
    parser.add_argument("--png", type=Path, help="folder for the figure (default: FOLDER)")
    asked = parser.parse_args()
    record = make(asked.folder, asked.cell)
    print(chain.table([(k, f"{v:.4g}") for k, v in compared(asked.folder, asked.cell).items()], ("", "measured")))
    print({k: record["balances"][k] for k in ("mass_error_relative", "momentum_error_relative", "mach_max")})
    figures(asked.folder, asked.cell, (asked.png or asked.folder) / f"s1_{asked.cell * 1000:.0f}mm.png")


if __name__ == "__main__":
    main()
