"""`mpmgis.plot`: the map of a variable has the classes and view of the report's."""

import numpy as np
import pytest
import rioxarray  # noqa: F401  (the accessor `rio`)
import xarray
from block_frames import write_block_run
from matplotlib import pyplot
from matplotlib.colors import to_hex

import mpmgis
from mpmgis.maps.qgis.colours import LAJOLLA
from mpmgis.system.errors import InputError


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plot")
    return write_block_run(folder).parent


@pytest.fixture
def results(site):
    pyplot.switch_backend("agg")
    yield mpmgis.open_results(site / "run")
    pyplot.close("all")


def test_a_map_has_hillshade_classes_contours_and_release(site, results):
    axes = mpmgis.plot(
        results.h.isel(time=0), site / "run" / "terrain.tif", title="The block", release=site / "release.geojson"
    )
    legend = axes.get_legend()
    words = [text.get_text() for text in legend.get_texts()]
    assert words[0].startswith("0.05 - ") and words[-2:] == ["release area", words[-1]] and "contours" in words[-1]
    assert to_hex(legend.get_patches()[0].get_facecolor()) == LAJOLLA[0]
    assert len(axes.images) == 2 and axes.get_title(loc="left") == "The block"
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    depth = results.h.isel(time=0).compute()
    wet = depth.where(depth > 0.05, drop=True)
    assert west < wet.x.min() and east > wet.x.max() and south < wet.y.min() and north > wet.y.max()


def test_maps_side_by_side_have_one_scale(site, results):
    _, pair = pyplot.subplots(1, 2)
    terrain = results.elevation
    for axes, factor in zip(pair, (1.0, 0.1), strict=True):
        band = (factor * results.h.isel(time=0)).rename("h")
        assert mpmgis.plot(band, terrain, like=results.h.isel(time=0), axes=axes, legend=False) is axes
        assert axes.get_legend() is None and len(axes.images) == 2
    assert pair[0].get_xlim() == pair[1].get_xlim() and pair[0].get_ylim() == pair[1].get_ylim()
    pictures = [np.unique(axes.images[-1].get_array().reshape(-1, 4), axis=0) for axes in pair]
    assert pictures[0][:, 3].max() == pictures[1][:, 3].max() > 0 and not np.array_equal(*map(np.max, pictures))


def test_one_legend_beside_maps_in_a_figure_with_a_layout(site, results):
    """It lies in the figure, beside its map, and no scale bar of another place of the map lies on one."""
    figure, pair = pyplot.subplots(1, 2, layout="constrained")
    depth = results.h.isel(time=0)
    for axes, factor in zip(pair, (1.0, 0.1), strict=True):
        band = (factor * depth).rename("h")
        mpmgis.plot(band, results.elevation, like=depth, axes=axes, legend=axes is pair[-1])
    figure.draw_without_rendering()
    box, own = (of.get_window_extent() for of in (pair[-1].get_legend(), pair[-1]))
    assert own.x1 <= box.x0 and box.x1 <= figure.bbox.x1 and figure.bbox.y0 <= box.y0
    assert not figure.texts and pair[0].get_legend() is None
    words = [[text.get_text() for text in axes.get_legend().get_texts()] for axes in (pair[-1], mpmgis.plot(depth))]
    assert words[0][:-1] == words[1]  # classes of both maps, then the contours


def test_a_map_without_flow_has_a_legend(results):
    axes = mpmgis.plot(results.h.isel(time=0).where(False), results.elevation)
    assert [text.get_text().split()[0] for text in axes.get_legend().get_texts()] == ["contours"]


def test_a_variable_that_is_not_in_the_table_is_drawn_too(results):
    band = results.h.isel(time=0).rename("mine").assign_attrs(units="m", long_name="half of it")
    axes = mpmgis.plot(band)
    assert axes.get_legend().get_title().get_text() == "Half of it" and len(axes.images) == 1


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (lambda results: results, "got Dataset, expected one variable"),
        (lambda results: results.h, "has the dimensions time, y, x, expected y and x; select one time"),
        (lambda results: np.zeros((2, 2)), "got ndarray"),
        (lambda results: xarray.DataArray(np.zeros(3), dims="x", name="h"), "has the dimensions x"),
    ],
)
def test_what_is_no_map_is_refused(results, what, words):
    with pytest.raises(InputError, match=words):
        mpmgis.plot(what(results))
