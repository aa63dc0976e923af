"""Inputs that do not act: nothing is said about how they are computed."""

import re

import numpy as np
import pytest
import shapely
from chain import write_polygons, write_raster

from mpmgis.simulation.preparation import prepare
from mpmgis.solvers.features.feature_notes import MOST_LINES
from mpmgis.system.messages import collected

CELL, WEST, NORTH = 5.0, 600000.0, 5200000.0
PLACES = {  # on a slope of 28 degrees that ends in a plain; the flow goes east between y = 180 and 320 m
    "release": (180, 220, 260, 280),
    "unreached": (20, 450, 80, 490),
    "reached": (500, 240, 504, 260),
    "window": (160, 180, 420, 320),
}
SAID = {  # what each input is called in a line about how it is computed
    "zones": "[[zones]] number 1",
    "entrainment": "[entrainment]",
    "forest": "[[forest]] number 1",
    "barrier": "barrier",
}
ONE = {"columns": tuple(SAID), "points": ("zones", "barrier")}  # inputs of a scene of one solver
MATERIAL = {"law": "Fluid", "bulk_modulus": 4e6}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("acting")
    x = (np.arange(300) + 0.5) * CELL
    ground = np.tile(100.0 + np.where(x < 800.0, (800.0 - x) * np.tan(np.radians(28.0)), 0.0), (100, 1))
    write_raster(folder / "dtm.tif", ground, WEST, NORTH, CELL, "EPSG:32632")
    for name, (west, south, east, north) in PLACES.items():
        shape = shapely.box(WEST + west, NORTH - 500.0 + south, WEST + east, NORTH - 500.0 + north)
        write_polygons(folder / f"{name}.gpkg", [shape], "EPSG:32632", thickness=[3.0])
    return folder


def tables_of(site, place, use, solver, inputs):
    """The tables of a scene with `inputs` in a polygon."""
    where = {"source": str(site / f"{place}.gpkg"), "use": use}
    given = {
        "zones": [where | {"mu": 0.5}],
        "entrainment": where | {"law": "ErosionEnergy", "thickness": 0.5, "erosion_energy": 5000.0},
        "forest": [where | {"detrainment": 50.0, "strength": 1e4}],
        "barrier": [where | {"height": 5.0}],
    }
    tables = {
        "terrain": {"dem": str(site / "dtm.tif")},
        "release": {"source": str(site / "release.gpkg"), "density": 300.0},
        "output": {"end_time": 20.0, "frame_interval": 2.0},
        "friction": {"law": "Coulomb", "mu": 0.2},
    } | {name: given[name] for name in inputs}
    if solver != "columns":
        tables["material"] = MATERIAL
    if solver == "stages":
        window = str(site / "window.gpkg")
        tables["stage"] = [{"solver": "columns", "until": {"time": 1.0}}, {"solver": "points", "window": window}]
    else:
        tables["solver"] = solver
        tables["numerics"] = {"cell_size": {"columns": CELL, "points": 1.0}[solver]}
    return tables


@pytest.mark.parametrize("solver", ONE)
@pytest.mark.parametrize(
    ("place", "use", "said"),
    [
        ("reached", "auto", True),
        ("reached", "on", True),
        ("reached", "off", False),
        ("unreached", "auto", False),
        ("unreached", "off", False),
    ],
)
def test_only_inputs_that_act_are_described(site, solver, place, use, said):
    with collected() as lines:
        prepare(tables_of(site, place, use, solver, ONE[solver]))
    described = {name for name in SAID if any(line.startswith(SAID[name]) for line in lines)}
    assert described == (set(ONE[solver]) if said else set()), lines


@pytest.mark.parametrize(("place", "thick"), [("reached", ["15 m"]), ("unreached", [])])
def test_a_barrier_outside_the_window_of_a_stage_is_described_for_the_columns_only(site, place, thick):
    tables = tables_of(site, place, "auto", "stages", ("barrier",))
    tables["stage"][1]["cell_size"] = 4.0
    with collected() as lines:
        prepare(tables)
    described = [line for line in lines if line.startswith("barrier")]
    assert len(described) == len(thick)
    assert all(f"its nodes are {one} across" in line for one, line in zip(thick, described, strict=True))


@pytest.mark.parametrize("walls", [MOST_LINES - 1, MOST_LINES, 3 * MOST_LINES])
def test_many_barriers_have_few_lines(site, walls):
    tables = tables_of(site, "reached", "auto", "columns", ("barrier",))
    south = NORTH - 400.0 + 12.0 * np.arange(walls)
    shapes = [shapely.box(WEST + 500.0, y, WEST + 506.0, y + 6.0) for y in south - 6.0 * walls + 150.0]
    write_polygons(site / f"walls{walls}.gpkg", shapes, "EPSG:32632")
    tables["barrier"][0]["source"] = str(site / f"walls{walls}.gpkg")
    with collected() as lines:
        prepare(tables | {"numerics": {"cell_size": 2.0}})
    said = [line for line in lines if line.startswith("barrier")]
    more = walls - MOST_LINES
    assert len(said) == min(walls, MOST_LINES) + (more > 0)
    assert more <= 0 or said[-1] == f"barrier: {more} more lines of this kind"


@pytest.mark.parametrize(("cell", "nodes"), [(5.0, 3 * 5.0 * 20.0), (1.0, (4 + 2) * (20 + 2))])
def test_true_and_used_area_of_a_foot_are_named(site, cell, nodes):
    """4 x 20 m with its sides on nodes of 1 m: held a cell beyond each side, at least three cells."""
    tables = tables_of(site, "reached", "auto", "columns", ("barrier",)) | {"numerics": {"cell_size": cell}}
    with collected() as lines:
        prepare(tables)
    (line,) = [line for line in lines if line.startswith("barrier")]
    foot, used = (float(number) for number in re.findall(r"([0-9.]+) m2", line))
    assert foot == 80.0 and used == pytest.approx(nodes, rel=0.3)
