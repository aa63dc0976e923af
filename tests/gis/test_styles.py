"""Classes and colours: the same for all steps, hazard classes where they fit, every value covered."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest
import qgis_run
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from mpmgis.fields import BAND, Quantity
from mpmgis.gis import styles
from mpmgis.gis.clock import Clock
from mpmgis.gis.styles import LOOKS, class_limits, colour_classes, look_of, ramp_colours, round_up


def test_every_band_has_a_look():
    assert set(BAND) == set(LOOKS)


def test_an_unknown_band_has_a_default_style():
    look = look_of(Quantity("heat", "K s-1", "warming", "float32"))
    assert look.title("heat") == "warming heat (K/s)"
    assert colour_classes(look, 3.0)[-1].upper == math.inf


@pytest.mark.parametrize(
    ("name", "typical", "limits"),
    [
        ("h", 4.2, (0.5, 1, 2, 3, 4, 5)),
        ("h", 0.08, (0.01, 0.02, 0.04, 0.06, 0.08, 0.1)),
        ("h", 40.0, (5, 10, 20, 30, 40, 50)),
        ("Ut", 33.0, (1, 5, 10, 15, 20, 25, 30)),
        ("p", 60e3, (1, 10, 25, 50, 100)),
        ("t_arrival", 180.0, (20, 40, 80, 120, 160, 200)),
    ],
)
def test_limits(name, typical, limits):
    assert class_limits(LOOKS[name], typical) == limits


def test_pressure_classes_are_in_pascal_with_labels_in_kilopascal():
    classes = colour_classes(LOOKS["p"], 60e3)
    assert [c.upper for c in classes] == [1e3, 10e3, 25e3, 50e3, 100e3, math.inf]
    assert classes[1].label == "1 - 10 kPa"


@given(st.sampled_from(sorted(LOOKS)), st.floats(0, 1e7), st.floats(0, 2))
def test_classes_are_ascending_and_cover_all_values(name, typical, min_depth):
    classes = colour_classes(LOOKS[name], typical, min_depth)
    uppers = [entry.upper for entry in classes]
    assert uppers == sorted(set(uppers))
    assert uppers[-1] == math.inf
    assert len({entry.colour for entry in classes}) == len(classes)


def test_depths_below_the_minimum_are_not_drawn():
    first, second, *_ = colour_classes(LOOKS["h"], 4.0, 0.05)
    assert (first.upper, first.colour) == (0.05, None)
    assert second.label == "0.05 - 0.5 m"


@given(st.floats(1e-9, 1e9))
def test_round_up_is_a_one_two_or_five(value):
    rounded = round_up(value)
    assert value * (1 - 1e-6) <= rounded <= 2.5 * value * (1 + 1e-6)
    assert f"{rounded:e}"[0] in "125"


def test_ramp_keeps_its_ends_and_stops():
    assert ramp_colours(styles.VIK, 7) == list(styles.VIK)
    assert ramp_colours(styles.LAJOLLA, 4)[0] == styles.LAJOLLA[0]
    assert ramp_colours(styles.LAJOLLA, 4)[-1] == styles.LAJOLLA[-1]


def test_signed_ramp_is_symmetric():
    shader = styles.value_renderer(LOOKS["Un"], 1.3, 0.05, 2).find("rastershader/colorrampshader")
    values = [float(item.get("value")) for item in shader.findall("item")]
    assert np.allclose(values, -np.array(values[::-1]))
    assert values[-1] == 2.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("styles"), CRS.from_epsg(32632))
    styles.write_styles(run)
    return run


def test_every_raster_has_its_style(run):
    files = [*run.step_files, run.maxima_file, run.deposit_file, run.terrain_file, *map(run.stack_file, run.step_bands)]
    roots = {file: ElementTree.parse((run.folder / file).with_suffix(".qml")).getroot() for file in files}
    for file, root in roots.items():
        kind = "hillshade" if file == run.terrain_file else "singlebandpseudocolor"
        assert root.find("pipe/rasterrenderer").get("type") == kind
    assert len({ElementTree.tostring(roots[file].find("pipe")) for file in run.step_files}) == 1


def test_style_of_a_stack_gives_each_band_its_time(run):
    root = ElementTree.parse((run.folder / run.stack_file("Ut")).with_suffix(".qml")).getroot()
    ranges = root.findall("temporal/ranges/range")
    assert len(ranges) == len(Clock.of(run.times).begins)


def test_colours_ignore_a_single_outlier(tmp_path):
    run = qgis_run.make_run(tmp_path, CRS.from_epsg(32632), times=[0, 1])
    import rasterio

    with rasterio.open(run.folder / run.maxima_file, "r+") as file:
        depth = file.read(1)
        depth[np.unravel_index(depth.argmax(), depth.shape)] = 500.0
        file.write(depth, 1)
    assert run.typical["h"] < 5.0
    assert class_limits(LOOKS["h"], run.typical["h"]) == styles.DEPTH_LIMITS
    assert run.typical["Un"] == run.typical["Un_max"] == run.typical["Un_min"]
