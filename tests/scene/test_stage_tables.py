"""[[stage]] tables of a scene: what is refused, what comes back from text, what each stage has alone."""

import tomllib

import pytest

from mpmgis.scene import scene_from_tables, scene_text, template
from mpmgis.system.errors import SceneError

BLOCK = {"law": "DruckerPrager", "bulk_modulus": 4e6, "shear_modulus": 2e6, "friction_angle": 35}
COLUMNS, POINTS = {"solver": "columns"}, {"solver": "points"}
DAM = {"source": "dam.gpkg", "height": 8}
TABLES = {
    "terrain": {"dem": "d.tif"},
    "release": {"source": "r.shp"},
    "output": {"end_time": 50, "frame_interval": 1},
    "numerics": {"cell_size": 2},
    "material": BLOCK,
    "friction": {"law": "Coulomb", "mu": 0.3},
    "curvature": {},
    "stage": [{**COLUMNS, "until": {"time": 30}, "cell_size": 5}, {**POINTS, "window": "box.gpkg"}],
}


def scene(**tables):
    """The scene of TABLES with these in place of its own; None takes a table out."""
    made = {**TABLES, **tables}
    return scene_from_tables({name: table for name, table in made.items() if table is not None})


def stages(*tables):
    """Those stages; all but the last end every ten seconds where they do not say."""
    return [{"until": {"time": 10.0 * k}, **table} for k, table in enumerate(tables[:-1], 1)] + [tables[-1]]


def test_stages_come_back_from_text():
    given = scene(
        barrier=[DAM],
        stage=[
            {**COLUMNS, "until": {"time": 30, "reach": "area.gpkg|layername=a"}},
            {**POINTS, "window": "box.gpkg", "outside": "ledger", "until": {"calm": 1.5}, "cell_size": 0.5},
            COLUMNS,
        ],
    )
    text = scene_text(given)
    assert 'until = {time = 30.0, reach = "area.gpkg|layername=a"}' in text and "until = {calm = 1.5}" in text
    again = scene_from_tables(tomllib.loads(text))
    assert again == given and again.digest() == given.digest()
    assert given.digest() != scene(barrier=[DAM]).digest()
    assert "[[stage]]" in template() and "solver =" not in text.splitlines()[0]


def test_the_text_of_stages_has_the_keys_of_both_solvers():
    text = scene_text(scene(numerics={"cell_size": 2, "particles_per_cell": 9, "points_per_cell": 27}))
    for key in ("points_per_cell = 27", "particles_per_cell = 9", "[curvature]", "[material]", "stiffness"):
        assert key in text


def test_a_stage_alone_is_a_scene_of_its_solver():
    columns, points = scene().alone()
    assert (columns.solver, points.solver) == ("columns", "points") and not columns.stage and not points.stage
    assert columns.material is None and columns.curvature is not None and columns.numerics.cell_size == 5.0
    assert points.curvature is None and points.material.law == "DruckerPrager" and points.numerics.cell_size == 2.0
    assert points.friction == columns.friction
    one = scene(stage=None, material=None)
    assert one.alone() == (one,) and one.solvers == {"columns"}
    assert scene(solver="columns").solver == "columns" and scene().solvers == {"columns", "points"}


def test_files_of_stages_are_moved_and_reported():
    given = scene(stage=[{**COLUMNS, "until": {"reach": "area.gpkg"}}, {**POINTS, "window": "box.gpkg"}])
    assert {"area.gpkg", "box.gpkg"} <= set(given.files())
    moved = given.with_files(lambda name: "far/" + name)
    assert moved.stage[0].until == {"reach": "far/area.gpkg"} and moved.stage[1].window == "far/box.gpkg"
    named = scene(barrier=[DAM], stage=[{**COLUMNS, "until": {"reach": "barrier"}}, POINTS])
    assert named.with_files(lambda name: "far/" + name).stage[0].until == {"reach": "barrier"}


FLUID = {"law": "Fluid", "bulk_modulus": 2e6}
REFUSED = {
    "until of the last": ({"material": None, "stage": [{**COLUMNS, "until": {"time": 3}}]}, "lasts to [output]"),
    "no until": ({"stage": [COLUMNS, POINTS]}, "until is missing"),
    "an empty until": ({"stage": [{**COLUMNS, "until": {}}, POINTS]}, "until is missing"),
    "until of a number": ({"stage": [{**COLUMNS, "until": 30}, POINTS]}, "expected a table like {time = 30}"),
    "until misspelt": ({"stage": [{**COLUMNS, "until": {"tme": 3}}, POINTS]}, "until has no 'tme'; it takes time"),
    "a time of words": ({"stage": [{**COLUMNS, "until": {"time": "3"}}, POINTS]}, "time = '3', expected a finite"),
    "a time of 400 digits": ({"stage": [{**COLUMNS, "until": {"time": 10**400}}, POINTS]}, "expected a finite"),
    "time 0": ({"stage": [{**COLUMNS, "until": {"time": 0}}, POINTS]}, "above 0"),
    "infinite calm": ({"stage": stages({**POINTS, "until": {"calm": float("inf")}}, COLUMNS)}, "expected a finite"),
    "calm of columns": ({"stage": stages({**COLUMNS, "until": {"calm": 1}}, POINTS)}, "calm is of points"),
    "reach of nothing": ({"stage": stages({**COLUMNS, "until": {"reach": "dam"}}, POINTS)}, "expected 'barrier', '"),
    "reach of a number": ({"stage": stages({**COLUMNS, "until": {"reach": 3}}, POINTS)}, "expected 'barrier', 'cliff'"),
    "no barrier": ({"stage": stages({**COLUMNS, "until": {"reach": "barrier"}}, POINTS)}, "needs a [[barrier]]"),
    "a barrier that is off": (
        {"barrier": [{**DAM, "use": "off"}], "stage": stages({**COLUMNS, "until": {"reach": "barrier"}}, POINTS)},
        "needs a [[barrier]]",
    ),
    "window of columns": ({"stage": stages({**COLUMNS, "window": "b.gpkg"}, POINTS)}, "window requires solver ="),
    "outside of columns": ({"stage": stages({**COLUMNS, "outside": "ledger"}, POINTS)}, "outside requires solver ="),
    "outside of nothing": ({"stage": stages(COLUMNS, {**POINTS, "outside": "ledger"})}, "there is none; give window"),
    "outside unknown": (
        {"stage": stages(COLUMNS, {**POINTS, "window": "b.gpkg", "outside": "gone"})},
        "outside = 'gone'",
    ),
    "columns outside of the first": (
        {"stage": [{**POINTS, "window": "b.gpkg", "outside": "columns"}], "curvature": None},
        "of a previous stage",
    ),
    "the same solver twice": ({"stage": stages(COLUMNS, COLUMNS, POINTS)}, "has the solver of the one before"),
    "unknown solver": ({"stage": stages({"solver": "colums"}, POINTS)}, "did you mean 'columns'"),
    "no solver": ({"stage": [{"until": {"time": 3}}, POINTS]}, "solver is missing"),
    "another solver on top": ({"solver": "points"}, "remove this line"),
    "unknown key": ({"stage": stages(COLUMNS, {**POINTS, "windw": "b.gpkg"})}, "did you mean 'window'"),
    "one stage as a table": ({"stage": COLUMNS}, "write [[stage]]"),
    "times back": ({"stage": stages(COLUMNS, {**POINTS, "until": {"time": 9}}, COLUMNS)}, "is not after the 10 s"),
    "after the end": ({"stage": [{**COLUMNS, "until": {"time": 50}}, POINTS]}, "is not before [output] end_time"),
    "no material": ({"material": None}, "needs [material]"),
    "no cell size": ({"numerics": {}, "stage": stages(COLUMNS, POINTS)}, "needs cell_size"),
    "material without points": ({"stage": [COLUMNS], "numerics": {}}, "the depth-averaged solver has no [material]"),
    "curvature without columns": ({"stage": [POINTS]}, "the 3D solver has no [curvature]"),
    "friction that one has not": ({"friction": {"law": "Sticking"}}, "expected Coulomb"),
    "inflow after points": (
        {"hydrograph": {"source": "i.shp", "file": "h.csv"}, "stage": stages(POINTS, COLUMNS)},
        "first [[stage]]",
    ),
    "window of the release": ({"release": {"particles": "a.h5", "window": "b.gpkg"}}, "use the window of a [[stage]]"),
    "a lowered bed": (
        {
            "entrainment": {
                "law": "ErosionEnergy",
                "source": "e.gpkg",
                "thickness": 1,
                "erosion_energy": 5e3,
                "lower_bed": True,
            }
        },
        "remove lower_bed",
    ),
    "erosion before and after": (
        {
            "entrainment": {"law": "ErosionEnergy", "source": "e.gpkg", "thickness": 1, "erosion_energy": 5e3},
            "stage": stages(COLUMNS, POINTS, COLUMNS),
        },
        "is not kept through",
    ),
    "erosion before and beside": (
        {
            "entrainment": {"law": "ErosionEnergy", "source": "e.gpkg", "thickness": 1, "erosion_energy": 5e3},
            "stage": stages(COLUMNS, {**POINTS, "window": "b.gpkg", "outside": "columns"}),
        },
        "is not kept through",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_scenes_are_refused_in_one_line(name):
    tables, words = REFUSED[name]
    with pytest.raises(SceneError) as error:
        scene(**tables)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_stage_of_columns_alone_may_have_peaks_and_a_bed_that_sinks():
    bed = {"law": "ErosionEnergy", "source": "e.gpkg", "thickness": 1, "erosion_energy": 5e3, "lower_bed": True}
    given = scene(
        stage=[COLUMNS], material=None, entrainment=bed, output={"end_time": 50, "frame_interval": 1, "maxima": True}
    )
    assert given.entrainment.lower_bed and given.output.maxima
