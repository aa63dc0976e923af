"""MOX report 15/2025, section 4.3: conservation by the conversion of columns into points, and the error of Figure 12.

python tests/scenes/conversion_43/make.py FOLDER [--png FOLDER]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import chain
import profiles

from mpmgis.conversion.conserved_sums import particle_mass_scatter, points_sum
from mpmgis.conversion.conversion_options import PointOptions
from mpmgis.frames.frame_files import read_frame

SPACINGS_X = (0.02, 0.01, 0.005, 0.0033, 0.0025, 0.0017)  # [m], as printed
SPACINGS_Z = (0.01, 0.001, 0.0001, 0.00005, 0.00001)
SIDE, SPEED, DENSITY = 5.0, 2.001, 1000.0  # [m], [m s-1], [kg m-3] (the report gives none)
VOLUME = 250.0 - 0.5 * (1.0 - np.cos(10.0)) * np.sin(5.0)  # [m3], the integral of Eq 10
COUNTINGS = {"paper": "floor, as printed", "round": "rounded, our default"}


def thickness(x, y):
    """Eq 10 [m]."""
    return 10.0 - np.sin(2.0 * x) * np.cos(y)


def columns(spacing):
    """(thickness [m], side [m]) of columns in the centres of squares; their number is nearest to `spacing` [m]."""
    count = round(SIDE / spacing)
    at = (np.arange(count) + 0.5) * SIDE / count
    return thickness(at[None, :], at[:, None]).ravel(), SIDE / count


def columns_at_nodes(spacing):
    """The same with columns on the nodes of the squares, also on the boundary, each with the area of a full square."""
    count = round(SIDE / spacing)
    at = np.linspace(0.0, SIDE, count + 1)
    return thickness(at[None, :], at[:, None]).ravel(), SIDE / (count + 1)


def measured(spacing, vertical, counting="paper"):
    """Number of points, lost shares and eps of the report for columns `spacing` [m] and points `vertical` [m] apart.

    The points of a column are equal, so that sums over 8.6e12 points are sums over columns.
    """
    depth, side = columns(spacing)
    volume = side**2 * depth
    mass = DENSITY * volume
    count = PointOptions(counting=counting).points_in(depth, vertical)
    exact, before = DENSITY * VOLUME, mass.sum()
    return {
        "points": float(count.sum()),
        "mass": abs(points_sum(count, mass) / before - 1.0),
        "momentum": abs(points_sum(count, mass, SPEED) / (before * SPEED) - 1.0),
        "eps_m": particle_mass_scatter(count, mass, volume, exact),
        "eps_mvx": particle_mass_scatter(count, mass, volume, exact * SPEED, SPEED),
        "eps_m of a tenth lost": particle_mass_scatter(count, 0.9 * mass, volume, exact),
    }


def quadrature(spacing, of=columns):
    """Relative error of the columns' volume against the exact integral."""
    depth, side = of(spacing)
    return abs(side**2 * depth.sum() / VOLUME - 1.0)


def sweep(wide=SPACINGS_X, deep=SPACINGS_Z):
    """{counting: (along hx at the coarsest hz, along hz at the coarsest hx)}: lists of results of `measured`."""
    return {
        counting: ([measured(h, deep[0], counting) for h in wide], [measured(wide[0], h, counting) for h in deep])
        for counting in COUNTINGS
    }


def slope(spacings, values):
    """Exponent of a power law through `values`."""
    return float(np.polyfit(np.log(spacings), np.log(values), 1)[0])


def each(rows, name):
    return [row[name] for row in rows]


def figures(found, errors, png, wide=SPACINGS_X, deep=SPACINGS_Z):
    """Figure 12 with axes labelled by the measured quantity, and figures of conservation and accuracy."""
    figure, ((by_z, by_x), (kept, volume)) = profiles.picture(2, 2, (10.0, 8.0))
    _draw_scatter(by_z, deep, {counting: along_z for counting, (_, along_z) in found.items()}, 1)
    _draw_scatter(by_x, wide, {counting: along_x for counting, (along_x, _) in found.items()}, 2)
    lossy = each(found["paper"][0], "eps_m of a tenth lost")
    by_x.loglog(wide, lossy, "x:", color="tab:red", label=f"eps_m where a tenth is lost: {slope(wide, lossy):.2f}")
    by_z.set(xlabel=f"hz [m] at hx = {wide[0]:g} m", title="Figure 12, top")
    by_x.set(xlabel=f"hx [m] at hz = {deep[0]:g} m", title="Figure 12, bottom")
    _draw_kept(kept, found)
    for name, values in errors.items():
        volume.loglog(wide, values, "o-", ms=4, label=f"{name}: slope {slope(wide, values):.2f}")
    volume.set(xlabel="hx [m]", ylabel="relative error", title="Volume of the columns against its integral")
    for axis in (by_x, volume):
        axis.set_xticks(wide, [f"{h:g}" for h in wide], fontsize=7)
        axis.minorticks_off()
    for axis in (by_z, by_x, kept, volume):
        axis.legend(fontsize=7)
    profiles.save(figure, png)


def _draw_scatter(axis, spacings, rows, order):
    """eps of the report for both ways to count points, over one spacing, with a line of the printed order."""
    for counting, style in (("paper", "o"), ("round", "x")):
        for name, colour in (("eps_m", "tab:blue"), ("eps_mvx", "tab:orange")):
            values = each(rows[counting], name)
            label = f"{name}, {COUNTINGS[counting]}: slope {slope(spacings, values):.2f}"
            line = "-" if counting == "paper" else ""
            axis.loglog(spacings, values, line + style, color=colour, ms=5, mfc="none", lw=0.8, label=label)
    first = rows["paper"][0]["eps_m"]
    axis.loglog(spacings, first * (np.array(spacings) / spacings[0]) ** order, "k:", lw=0.8, label=f"slope {order}")
    axis.set_ylabel("particle-mass scatter [kg], [kg m/s]")


def _draw_kept(axis, found):
    """Share of mass and momentum of the columns that the points do not have."""
    for counting, colour in (("paper", "tab:blue"), ("round", "tab:orange")):
        spots = [row for rows in found[counting] for row in rows]
        for name, style in (("mass", "o"), ("momentum", "s")):
            shown = np.maximum(each(spots, name), 1e-17)
            axis.loglog(
                each(spots, "points"),
                shown,
                style,
                color=colour,
                ms=4,
                mfc="none",
                label=f"{name}, {COUNTINGS[counting]}",
            )
    axis.axhline(1e-13, color="black", lw=0.8)
    axis.set(
        xlabel="points",
        ylabel="lost share of the sum (none: 1e-17)",
        ylim=(5e-18, 1e-12),
        title="What conversion loses",
    )


def stored(folder, spacing=0.1, vertical=0.1):
    """Section 4.3 with `mpmgis seed` and `mpmgis convert`, with as many points as can be stored: sums of both files."""
    folder = chain.fresh(folder)
    count = round(SIDE / spacing)
    at = (np.arange(count) + 0.5) * SIDE / count
    chain.write_raster(folder / "bed.tif", np.zeros((count, count)), 0.0, SIDE, spacing)
    chain.write_raster(folder / "thickness.tif", thickness(at[None, :], at[::-1, None]), 0.0, SIDE, spacing)
    chain.mpmgis(
        "seed",
        "--dem",
        folder / "bed.tif",
        "--crs",
        "local",
        "--release",
        folder / "thickness.tif",
        "--per-cell",
        1,
        "--velocity",
        f"{SPEED},0",
        "--density",
        DENSITY,
        "--points",
        "lattice",
        "-o",
        folder / "columns.h5",
    )
    chain.mpmgis(
        "convert",
        folder / "columns.h5",
        "--dem",
        folder / "bed.tif",
        "--crs",
        "local",
        "--spacing",
        vertical,
        "-o",
        folder / "points.h5",
    )
    sums = {}
    for name in ("columns", "points"):
        particles = read_frame(folder / f"{name}.h5").particles
        sums[name] = (len(particles), particles.mass.sum(), (particles.mass * particles.velocity[:, 0]).sum())
    return sums


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--png", type=Path, help="folder for the figure (default: FOLDER)")
    asked = parser.parse_args()
    sums = stored(asked.folder)
    rows = [(name, n, f"{mass:.9g}", f"{push:.9g}") for name, (n, mass, push) in sums.items()]
    print(chain.table(rows, ("file", "particles", "mass [kg]", "momentum east [kg m/s]")))
    found = sweep()
    for counting, (along_x, along_z) in found.items():
        for spacings, rows, name in ((SPACINGS_X, along_x, "hx"), (SPACINGS_Z, along_z, "hz")):
            told = [
                (f"{h:g}", f"{row['points']:.3g}", *(f"{row[k]:.3g}" for k in ("mass", "momentum", "eps_m", "eps_mvx")))
                for h, row in zip(spacings, rows, strict=True)
            ]
            rate = slope(spacings, each(rows, "eps_m"))
            print(f"\n{COUNTINGS[counting]}: eps_m falls with {name} to the power {rate:.2f}\n")
            print(chain.table(told, (name, "points", "mass lost", "momentum lost", "eps_m [kg]", "eps_mvx")))
    errors = {
        "middles of squares": [quadrature(h) for h in SPACINGS_X],
        "nodes, the rim's too": [quadrature(h, columns_at_nodes) for h in SPACINGS_X],
    }
    told = [(f"{h:g}", *(f"{v[k]:.3g}" for v in errors.values())) for k, h in enumerate(SPACINGS_X)]
    print(chain.table(told, ("hx", *errors)))
    figures(found, errors, (asked.png or asked.folder) / "conversion.png")


if __name__ == "__main__":
    main()
