"""Positions of the elements of the picture."""

import itertools

import matplotlib.image
import numpy as np
import pytest
import qgis_run
import shapely
from affine import Affine
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pyproj import CRS

from mpmgis.maps.export.run_picture import (
    GREYS,
    SCALE_BAR,
    _stretched,
    beside,
    draw_north_arrow,
    draw_scale_bar,
    draw_title,
    map_axes,
    map_view,
    shaded_relief,
    write_picture,
)
from mpmgis.system.errors import OutputError
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

GRID = Grid.north_up(CRS.from_epsg(32632), 686000.0, 5212000.0, 5.0, (120, 160))


def scene(progress=0.5):
    x, y = GRID.xy(*np.indices(GRID.shape))
    x, y = x - GRID.transform.c, y - GRID.transform.f
    fields = qgis_run.blob(x, y, progress, GRID)
    return Terrain(GRID, qgis_run.hill(x, y)), fields["Ut"], fields["h"]


def coloured(path):
    """Number of pixels that are not grey."""
    image = matplotlib.image.imread(path)[..., :3]
    return np.count_nonzero(np.ptp(image, axis=-1) > 0.2)


def test_flow_and_release_add_colour(tmp_path):
    terrain, speed, depth = scene()
    release = [shapely.Point(686160, 5211880).buffer(40)]
    write_picture(tmp_path / "with.png", terrain, GRID, speed, depth, release, "A slide", "Terrain: made up")
    dry = np.full(GRID.shape, np.nan)
    write_picture(tmp_path / "dry.png", terrain, GRID, dry, np.zeros(GRID.shape))
    assert coloured(tmp_path / "with.png") > 20_000
    assert coloured(tmp_path / "dry.png") < 0.02 * coloured(tmp_path / "with.png")
    assert matplotlib.image.imread(tmp_path / "with.png").shape[0] > 700


def test_view_contains_flow_and_release_within_the_terrain():
    terrain, speed, _ = scene(0.0)
    release = [shapely.Point(686700, 5211450).buffer(20)]
    west, south, east, north = map_view(terrain, GRID, np.isfinite(speed), release)
    row, column = np.nonzero(np.isfinite(speed))
    x, y = GRID.xy(row, column)
    assert west < x.min() and north > y.max() and east > 686720 and south < 5211430
    bounds = GRID.bounds
    assert bounds[0] <= west < east <= bounds[2] and bounds[1] <= south < north <= bounds[3]


def test_view_zooms_to_a_small_flow():
    terrain, speed, _ = scene(0.0)
    west, south, east, north = map_view(terrain, GRID, np.isfinite(speed))
    assert max(east - west, north - south) < 200
    assert min(east - west, north - south) > 0.6 * max(east - west, north - south)


def test_slopes_towards_the_light_are_brighter():
    x, y = np.meshgrid(np.arange(20.0), -np.arange(20.0))
    facing_north_west = shaded_relief(0.5 * (x - y), 1.0).mean()
    facing_south_east = shaded_relief(-0.5 * (x - y), 1.0).mean()
    assert facing_north_west > shaded_relief(0 * x, 1.0).mean() > facing_south_east


def test_a_plane_is_neither_black_nor_white():
    """The relief of level ground has no contrast to stretch; it was drawn in the darkest grey."""
    shade = _stretched(shaded_relief(np.full((20, 20), 100.0), 1.0))
    assert np.allclose(shade, np.mean(GREYS))
    x, y = np.meshgrid(np.arange(50.0), np.arange(50.0))
    shade = _stretched(shaded_relief(10 * np.sin(x / 5) * np.cos(y / 7), 1.0))
    assert (shade.min(), shade.max()) == GREYS


@pytest.mark.parametrize(
    "transform", [Affine(5, 0, 686000, 0, 5, 5211400), Affine(3.6, 3.4, 686000, 3.4, -3.6, 5211700)]
)
def test_terrain_on_another_kind_of_grid(tmp_path, transform):
    grid = Grid(GRID.crs, transform, (120, 160))
    x, y = grid.xy(*np.indices(grid.shape))
    terrain = Terrain(grid, qgis_run.hill(x - 686000, y - 5212000))
    _, speed, depth = scene()
    write_picture(tmp_path / "map.png", terrain, GRID, speed, depth)
    assert coloured(tmp_path / "map.png") > 20_000


def test_flat_terrain_and_missing_heights(tmp_path):
    _, speed, depth = scene()
    heights = np.zeros(GRID.shape)
    heights[:, 100:] = np.nan
    write_picture(tmp_path / "flat.png", Terrain(GRID, heights), GRID, speed, depth)
    assert coloured(tmp_path / "flat.png") > 20_000


def test_a_failed_write_leaves_no_file(tmp_path):
    terrain, speed, depth = scene()
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError):
        write_picture(tmp_path / "file" / "map.png", terrain, GRID, speed, depth)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("view", [(0, 0, 800, 600), (0, 0, 90, 1000), (0, 0, 30_000, 900), (0, 0, 0.7, 0.7)])
def test_scale_bar_and_north_arrow_are_beside_the_map(view):

    figure = Figure(figsize=(1, 1))
    axes = map_axes(figure, view)
    draw_scale_bar(axes, view)
    draw_north_arrow(axes)
    canvas = FigureCanvasAgg(figure).get_renderer()
    right = axes.get_window_extent(canvas).x1
    drawn = [artist for artist in figure.get_children() if artist.get_gid()] + figure.texts
    assert len(drawn) == 6  # two halves and two numbers, arrow and N
    for artist in drawn:
        box = artist.get_window_extent(canvas)
        assert box.x0 > right and box.x1 < figure.bbox.x1 and box.y0 >= 0


def test_the_scale_bar_has_a_round_length_that_is_true_to_scale():

    figure, view = Figure(figsize=(1, 1)), (0, 0, 7300, 5000)
    axes = map_axes(figure, view)
    draw_scale_bar(axes, view)
    halves = [artist for artist in figure.get_children() if artist.get_gid() == "scale bar"]
    metres = view[2] / axes.get_window_extent().width * sum(half.get_window_extent().width for half in halves)
    assert metres == pytest.approx(1000.0, rel=1e-6)
    assert [text.get_text() for text in figure.texts] == ["0", "1 km"]
    assert sum(half.get_width() for half in halves) <= SCALE_BAR


@pytest.mark.parametrize("view", [(500000, 4999900, 500002, 4999990), (500000, 4999998, 500090, 5000000)])
def test_coordinates_of_a_slim_map_do_not_lie_on_each_other(view):
    """A flume of 90 m x 2 m: the map is 4 mm wide."""
    figure = Figure(figsize=(1, 1))
    FigureCanvasAgg(figure)
    axes = map_axes(figure, view)
    figure.canvas.draw()
    for labels in (axes.get_xticklabels(), axes.get_yticklabels()):
        boxes = [label.get_window_extent() for label in labels if label.get_text()]
        assert boxes and not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    left = axes.transAxes.transform(beside(axes))[0]
    assert left >= axes.transData.transform((view[0], view[1]))[0] + 0.6 * figure.dpi


@pytest.mark.parametrize("view", [(0, 0, 100, 100), (0, 0, 62, 100)])
@pytest.mark.parametrize("words", [4, 12, 60])
def test_a_title_stays_on_the_picture(view, words):
    figure = Figure(figsize=(1, 1))
    FigureCanvasAgg(figure)
    axes = map_axes(figure, view)
    draw_title(axes, "mudflow " * words)
    figure.canvas.draw()
    box = axes.title.get_window_extent() if axes.get_title() else axes._left_title.get_window_extent()
    assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
