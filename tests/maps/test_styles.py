"""Classes and colours: the same for all steps, hazard classes where they fit, every value covered."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest
import qgis_run
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS

from mpmgis.laws.quantities import BAND, Quantity
from mpmgis.maps.qgis import colours, raster_styles
from mpmgis.maps.qgis.colours import LOOKS, class_limits, colour_classes, look_of, ramp_colours, round_up
from mpmgis.maps.qgis.map_clock import Clock
from mpmgis.maps.qgis.xml_markup import TEMPLATES, filled, node
from mpmgis.system.errors import InputError


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
        ("h", 0.08, (0.01, 0.02, 0.04, 0.06)),
        ("h", 12.4, (1, 2, 4, 6, 8, 10, 12)),
        ("h", 40.0, (5, 10, 20, 30)),
        ("Ut", 33.0, (1, 5, 10, 15, 20, 25, 30)),
        ("p", 60e3, (1, 10, 25, 50, 100)),
        ("t_arrival", 180.0, (25, 50, 100, 150)),
        ("h", 0.0, (0.1, 0.2, 0.4, 0.6, 0.8, 1.0)),
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


@given(st.sampled_from(["h", "mass", "t_arrival"]), st.floats(1e-6, 1e6))
def test_classes_span_the_values(name, typical):
    limits = np.array(class_limits(LOOKS[name], typical)) / typical
    if limits[-1] * typical not in colours.DEPTH_LIMITS:
        assert 0.7 < limits[-1] < 1.0 + 1e-6
    assert 4 <= len(limits) <= 8


def luminance(colour):
    """Linear red, green, blue."""
    value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lightness(rgb):
    """CIE L* of linear red, green, blue."""
    return 116 * np.cbrt(rgb @ [0.2126, 0.7152, 0.0722]) - 16


# Machado, Oliveira and Fernandes (2009), doi:10.1109/TVCG.2009.113: full protanopia and deuteranopia
BLIND = (
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
)


@pytest.mark.parametrize("band", ["h", "Ut", "p", "mass", "t_arrival", "P_h_0.5"])
def test_classes_are_ordered_in_lightness_for_all_readers(band):
    look = LOOKS.get(band) or look_of(Quantity(band, "1", "probability", "float32"))
    linear = np.array([luminance(colour) for colour in ramp_colours(look.ramp, 8)])
    for seen in (np.eye(3), *map(np.array, BLIND)):
        steps = np.diff(lightness(np.clip(linear @ seen.T, 0, 1)))
        assert (np.abs(steps) > 2).all() and len(set(np.sign(steps))) == 1, band
    assert lightness(linear).min() > 30  # a hillshade shows through


def test_each_quantity_has_its_own_colours():
    ramps = {LOOKS[name].ramp for name in ("h", "Ut", "p", "mass", "t_arrival", "Un")}
    assert len(ramps | {look_of(Quantity("P_h_1", "1", "", "float32")).ramp}) == 7


@pytest.mark.parametrize(
    ("band", "name"),
    [
        ("h_max", "h max [m]: largest flow depth (normal)"),
        ("t_vol", "t_vol [m]: thickness by volume (normal)"),
        ("Un", "Un [m/s]: velocity normal to the slope"),
        ("P_h_0.5", "P(h >= 0.5 m): words"),
        ("P_Ut_10", "P(Ut >= 10 m/s): words"),
        ("P_arrival", "P(arrival): words"),
        ("Ut_p97.5", "Ut p97.5 [m/s]: words"),
        ("t_arrival_p50", "t_arrival p50 [s]: words"),
    ],
)
def test_layer_names_begin_with_the_symbol(band, name):
    unit = {"P": "1", "U": "m s-1", "t": "s"}.get(band[0], "m")
    assert look_of(Quantity(band, unit, "words", "float32")).layer_name(band) == name


def test_ramp_keeps_its_ends_and_stops():
    assert ramp_colours(colours.VIK, 7) == list(colours.VIK)
    assert ramp_colours(colours.LAJOLLA, 4)[0] == colours.LAJOLLA[0]
    assert ramp_colours(colours.LAJOLLA, 4)[-1] == colours.LAJOLLA[-1]


def test_signed_ramp_is_symmetric():
    shader = raster_styles.value_renderer(LOOKS["Un"], 1.3, 0.05, 2).find("rastershader/colorrampshader")
    values = [float(item.get("value")) for item in shader.findall("item")]
    assert np.allclose(values, -np.array(values[::-1]))
    assert values[-1] == 2.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("styles"), CRS.from_epsg(32632))
    raster_styles.write_styles(run)
    return run


def test_every_raster_has_its_style(run):
    files = [*run.step_files, run.maxima_file, run.last_file, run.terrain_file, *map(run.stack_file, run.step_bands)]
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
    assert class_limits(LOOKS["h"], run.typical["h"]) == colours.DEPTH_LIMITS
    assert run.typical["Un"] == run.typical["Un_max"] == run.typical["Un_min"]


def test_values_of_a_template_are_text_and_elements_are_elements():
    text = 'a <b> & "c"\nd'
    root = filled("rules.qml", key=text, rules=[node("rule", {"label": text}), node("rule")], symbols=())
    rules = root.find("renderer-v2/rules")
    assert rules.get("key") == rules[0].get("label") == text and [rule.tag for rule in rules] == ["rule", "rule"]
    assert not any((element.text or "").isspace() or (element.tail or "").isspace() for element in root.iter())


def test_every_template_is_used():
    code = "".join(path.read_text(encoding="utf-8") for path in TEMPLATES.parent.glob("*.py"))
    assert [path.name for path in TEMPLATES.iterdir() if f'"{path.name}"' not in code] == []


def test_chosen_classes_hold_for_a_quantity_its_maxima_and_statistics():
    chosen = colours.chosen_classes(("h=0.5,1,2,4", "p=3,30"))
    for name in ("h", "h_max", "h_p95", "h_mean"):
        assert class_limits(look_of(Quantity(name, "m", "words", "float32"), chosen), 40.0) == (0.5, 1, 2, 4)
    assert [c.upper for c in colour_classes(look_of(BAND["p_max"], chosen), 1.0)] == [3e3, 30e3, math.inf]
    for name in ("t_arrival", "Ut", "Un_max"):
        assert look_of(BAND[name], {"t": (1.0,), "Un": (1.0,)}) == LOOKS[name]


@pytest.mark.parametrize("text", ["depth=1,2", "h_max=1,2", "Un=1,2"])
def test_a_quantity_without_classes_is_refused(text):
    with pytest.raises(InputError, match=f"`classes={text}`.* expected one of h, t, Ut"):
        colours.chosen_classes((text,))


@pytest.mark.parametrize("text", ["h", "h=", "h=2,1", "h=0,1", "h=1,nan", "h=1,inf"])
def test_limits_must_ascend(text):
    with pytest.raises(InputError, match="expected ascending numbers above 0"):
        colours.chosen_classes((text,))


def test_depths_that_crowd_in_the_last_class_have_classes_of_equal_area():
    deep = np.r_[np.linspace(0.2, 6, 400), np.linspace(6, 7.5, 600)]
    limits = colours.balanced_limits(LOOKS["h"], deep)
    shares = np.diff([0.0, *(np.mean(deep <= limit) for limit in limits), 1.0])
    assert len(limits) == 6 and shares.max() < 0.2
    assert colours.balanced_limits(LOOKS["h"], np.linspace(0.1, 7.5, 1000)) == ()
    assert colours.balanced_limits(LOOKS["h"], np.full(100, 7.0)) == ()
    assert colours.balanced_limits(LOOKS["Ut"], deep) == ()


def test_a_run_takes_chosen_classes_before_balanced_ones(tmp_path):
    import rasterio

    run = qgis_run.make_run(tmp_path, CRS.from_epsg(32632), times=[0, 1])
    with rasterio.open(run.folder / run.maxima_file, "r+") as file:
        depth = file.read(1)
        file.write(np.where(depth > 0.5, 6.0 + depth / 4, depth).astype("float32"), 1)
    assert raster_styles.with_classes(run, {}).classes["h"][-1] > 5
    run = raster_styles.with_classes(run, {"h": (1.0, 2.0)})
    assert run.classes["h"] == (1.0, 2.0)
    items = raster_styles.value_pipe(BAND["h_max"], run, 1).iter("item")
    assert [item.get("value") for item in items] == ["0.05", "1", "2", "inf"]


def test_layer_and_colours_share_the_opacity():
    pipe = raster_styles.value_renderer(LOOKS["h"], 4.0, 0.05, 1)
    alphas = {int(item.get("alpha")) for item in pipe.iter("item")} - {0}
    assert len(alphas) == 1
    assert math.isclose(float(pipe.get("opacity")) * alphas.pop() / 255, colours.OPACITY, rel_tol=0.01)
