"""Classes of terrain on forms whose classes are known, and friction from tables."""

import numpy as np
import pytest
from affine import Affine
from scipy.optimize import brentq

from mpmgis.system.errors import FormatError, InputError
from mpmgis.terrain.class_limits import ClassLimits
from mpmgis.terrain.dtm_blocks import block_heights, dtm_blocks
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.friction_table import FrictionCells, read_friction_table, rows_of_event
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.terrain_classes import CHANNEL, FLAT, GULLY, OPEN_SLOPE, OUTSIDE, block_classes, class_halo

LIMITS = ClassLimits()


def terrain_classes(terrain, limits=LIMITS, side=1000):
    """Classes of a terrain, by blocks."""
    classes, halo = np.full(terrain.grid.shape, 255, np.uint8), class_halo(terrain.grid, limits)
    for block in dtm_blocks(terrain, side):
        classes[block.cells] = block_classes(block_heights(terrain, block, halo), block, terrain.grid, limits)
    return classes


def friction_values(rows, classes, elevation, path):
    """Parameters on cells; numbers where they are the same everywhere."""
    cells = FrictionCells(rows, path)
    chosen = cells.chosen(classes, elevation)
    return {key: low if low == high else cells.values(key, chosen) for key, (low, high) in cells.found().items()}


def ground(height, size=400.0, cell=5.0, moved=0.0):
    """Terrain of `height(x, y)` around (0, 0), its grid moved by a part of a cell."""
    n = round(size / cell)
    grid = Grid.north_up("EPSG:32632", -0.5 * size + moved, 0.5 * size + moved, cell, (n, n))
    x, y = grid.xy(*np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    return Terrain(grid, height(x, y)), x, y


def rise_in_v(distance, radius, side):
    """Mean rise over the radius at a distance from the axis of a V: an integral over the circle, numerically."""
    angle = (np.arange(100_000) + 0.5) * 2 * np.pi / 100_000
    return side * (np.abs(distance + radius * np.cos(angle)).mean() - distance) / radius


def border(radius, side, least):
    return brentq(lambda d: rise_in_v(d, radius, side) - least, 0.0, radius)


@pytest.mark.parametrize("slope", [0.0, 5.0, 7.9, 8.1, 20.0, 45.0, 70.0])
@pytest.mark.parametrize("aspect", [0.0, 30.0, 90.0, 137.0])
def test_a_plane_has_one_class_up_to_its_edges(slope, aspect):
    tan, turn = np.tan(np.radians(slope)), np.radians(aspect)
    terrain, *_ = ground(lambda x, y: tan * (np.cos(turn) * x + np.sin(turn) * y))
    assert np.unique(terrain_classes(terrain)) == [FLAT if slope < LIMITS.flat_slope else OPEN_SLOPE]


@pytest.mark.parametrize("cell", [2.0, 5.0, 8.0])
@pytest.mark.parametrize(("side", "down"), [(0.3, 0.4), (0.5, 0.2), (1.0, 0.6)])
@pytest.mark.parametrize("turn", [0.0, 27.0, 90.0])
def test_a_v_channel_has_its_borders_within_a_cell(cell, side, down, turn):
    """Gully, channel and open slope from its axis outwards, whatever its direction and the place of its axis."""
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    terrain, x, y = ground(
        lambda x, y: side * np.abs(cosine * x + sine * y) + down * (cosine * y - sine * x), cell=cell, moved=0.37 * cell
    )
    distance = np.abs(cosine * x + sine * y)
    channel = border(LIMITS.channel_radius, side, LIMITS.channel_rise)
    gully = (
        border(LIMITS.gully_radius, side, LIMITS.gully_rise)
        if rise_in_v(0.0, LIMITS.gully_radius, side) > LIMITS.gully_rise
        else -cell
    )
    exact = np.where(distance < gully, GULLY, np.where(distance < channel, CHANNEL, OPEN_SLOPE))
    near = (np.abs(distance - gully) < cell) | (np.abs(distance - channel) < cell)
    inside = (np.abs(x) < 100) & (np.abs(y) < 100)
    assert (terrain_classes(terrain) == exact)[inside & ~near].all()
    assert {OPEN_SLOPE, CHANNEL} <= set(np.unique(exact[inside])) | {OPEN_SLOPE}


def test_a_narrow_gully_in_an_open_slope():
    """10 m deep, 20 m wide: a gully, whose sides beyond are open slope; a ridge of the same form is open slope."""
    cut = lambda x, y: 0.5 * y - np.maximum(10.0 - np.abs(x), 0.0)  # noqa: E731
    terrain, x, y = ground(cut, cell=2.0)
    classes = terrain_classes(terrain)
    assert (classes[(np.abs(x) < 2.0) & (np.abs(y) < 195.0)] == GULLY).all()
    assert (classes[np.abs(x) > 75.0] == OPEN_SLOPE).all()
    ridge, *_ = ground(lambda x, y: -cut(x, y), cell=2.0)
    assert (terrain_classes(ridge)[np.abs(x) < 2.0] == OPEN_SLOPE).all()


def test_turned_and_mirrored_ground_has_turned_and_mirrored_classes():
    rng = np.random.default_rng(1)
    z = np.cumsum(np.cumsum(rng.normal(size=(60, 60)), 0), 1) * 0.5

    def classes(z):
        return terrain_classes(Terrain(Grid.north_up("EPSG:32632", 0, 0, 5.0, z.shape), np.ascontiguousarray(z)))

    own = classes(z)
    assert len(np.unique(own)) >= 3
    for turn in (np.rot90, np.flipud, np.fliplr, np.transpose):
        assert (classes(turn(z)) == turn(own)).mean() > 0.999  # rounding at a limit


def test_ground_around_nodata_keeps_its_class():
    terrain, x, y = ground(lambda x, y: 0.4 * x)
    terrain.elevation[(np.abs(x) < 20) & (np.abs(y) < 20)] = np.nan
    classes = terrain_classes(terrain)
    assert set(np.unique(classes)) == {OUTSIDE, OPEN_SLOPE} and (classes == OUTSIDE).sum() == 64
    with pytest.raises(InputError, match=r"at least 1\.5 cells"):
        class_halo(terrain.grid, ClassLimits(gully_radius=7.0))


# a pixel of 5 m: north-up, south-up, mirrored, not square, rotated, sheared
MATRICES = [(5, 0, 0, -5), (5, 0, 0, 5), (-5, 0, 0, -5), (5, 0, 0, -8), (4, 3, 3, -4), (0, 5, 5, 0), (5, 1.7, 0.6, -6)]


@pytest.mark.parametrize("matrix", MATRICES)
@pytest.mark.parametrize("shape", [(2, 2), (3, 40), (61, 47)])
def test_blocks_of_any_size_give_the_same_classes(matrix, shape):
    """Also at the rim and around holes."""
    a, b, d, e = matrix
    rng = np.random.default_rng(sum(shape))
    heights = rng.normal(size=shape).cumsum(0).cumsum(1) * 0.3
    heights[rng.random(shape) < 0.01] = np.nan
    heights[20:30, 15:] = np.nan
    terrain = Terrain(Grid(None, Affine(a, b, 4e5, d, e, 5e6), shape), heights)
    for radius in (13.0, 33.3):
        limits = ClassLimits(gully_radius=12.5, channel_radius=radius)
        whole = terrain_classes(terrain, limits)
        for side in (1, 7) if shape[0] < 50 else (16, 50):
            assert (terrain_classes(terrain, limits, side) == whole).all()
    assert len(np.unique(whole)) >= (3 if shape == (61, 47) else 1)


TABLE = """terrain,altitude_from,altitude_to,volume_from,volume_to,return_period,mu,xi
open,1500,,60000,,300,0.155,3000
open,,1500,60000,,300,0.18,2500
channel,,,60000,,300,0.21,2000
gully,,,60000,,300,0.27,1500
flat,,,60000,,300,0.14,4000
,,,,60000,300,0.25,2000
,,,,,30,0.3,1500
"""


def table(tmp_path, text=TABLE):
    path = tmp_path / "friction.csv"
    path.write_text(text)
    return path


def test_each_cell_has_the_friction_of_its_class_and_altitude(tmp_path):
    path = table(tmp_path)
    rows = rows_of_event(read_friction_table(path, "Voellmy"), 80e3, 300.0, path)
    classes = np.array([[OPEN_SLOPE, OPEN_SLOPE, CHANNEL], [GULLY, FLAT, OUTSIDE]], np.uint8)
    elevation = np.array([[1500.0, 1499.9, 2000.0], [100.0, 3000.0, np.nan]])
    values = friction_values(rows, classes, elevation, path)
    np.testing.assert_array_equal(values["mu"], [[0.155, 0.18, 0.21], [0.27, 0.14, np.nan]])
    np.testing.assert_array_equal(values["xi"], [[3000, 2500, 2000], [1500, 4000, np.nan]])
    small = rows_of_event(read_friction_table(path, "Voellmy"), 59_999.0, 300.0, path)
    assert friction_values(small, classes, elevation, path) == {"mu": 0.25, "xi": 2000.0}
    frequent = rows_of_event(read_friction_table(path, "Voellmy"), 80e3, 30.0, path)
    assert friction_values(frequent, classes, elevation, path) == {"mu": 0.3, "xi": 1500.0}


SIZED = "volume_to,volume_from,size,tau0\n25000,,small,0\n60000,25000,Medium,0\n,60000,large,10\n"


def test_sizes_of_samos_at_are_its_published_coefficients(tmp_path):
    path = table(tmp_path, SIZED)
    for volume, mu, tau0 in ((1e3, 0.22, 0.0), (25e3, 0.17, 0.0), (60e3, 0.155, 10.0)):
        rows = rows_of_event(read_friction_table(path, "SamosAT"), volume, None, path)
        assert [row.values for row in rows] == [{"mu": mu, "tau0": tau0}]


@pytest.mark.parametrize(
    ("old", "new", "law", "words"),
    [
        ("Medium", "auto", "SamosAT", "line 3: size is 'auto', expected small, medium, large; for a size by volume"),
        ("Medium", "huge", "SamosAT", "line 3: size is 'huge', expected small, medium, large"),
        ("Medium", "", "SamosAT", "line 3: size is empty, expected small, medium, large"),
        ("tau0", "mu", "SamosAT", "size is in place of mu, and both are columns; remove one"),
        ("size", "sizes", "SamosAT", r"column 'sizes' is neither .* \(mu, tau0, Rs0, kappa, R, B, size\)"),
        ("", "", "VoellmyMinShear", "column 'size' is neither"),
    ],
)
def test_wrong_sizes_are_refused_in_a_line(tmp_path, old, new, law, words):
    with pytest.raises(FormatError, match=words) as error:
        read_friction_table(table(tmp_path, SIZED.replace(old, new, 1)), law)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "law", "words"),
    [
        ("mu,xi", "my,xi", "Voellmy", "column 'my' is neither a condition"),
        (",xi", ",k", "Voellmy", "line 2: k is '3000', expected"),
        ("mu,xi", "mu,mu", "Voellmy", "mu occurs twice"),
        ("", "", "Bingham", "column 'mu' is neither"),
        ("", "", "SamosAT", "column 'xi' is neither"),
        ("return_period,mu,xi", "k,mu,xi", "Voellmy", "k is in place of xi, and both"),
        ("channel", "canal", "Voellmy", "line 4: terrain is 'canal', expected one of open, channel"),
        ("open,1500,", "open,1500,1500", "Voellmy", "line 2: altitude_from = 1500 is not below altitude_to = 1500"),
        ("0.155", "15.5", "Voellmy", "line 2: mu is '15.5', expected 0 to 10"),
        ("0.155", "", "Voellmy", "line 2: mu is empty"),
        ("0.155", "low", "Voellmy", "line 2: mu is 'low', expected a number"),
        ("60000,,300,0.155", "60000,,often,0.155", "Voellmy", "line 2: return_period is 'often'"),
    ],
)
def test_wrong_tables_are_refused_in_a_line(tmp_path, old, new, law, words):
    with pytest.raises(FormatError, match=words) as error:
        read_friction_table(table(tmp_path, TABLE.replace(old, new, 1)), law)
    assert "\n" not in str(error.value)


def test_events_and_places_without_a_row_are_named(tmp_path):
    path = table(tmp_path)
    rows = read_friction_table(path, "Voellmy")
    for volume, period, words in (
        (80e3, None, "return periods of 30, 300 years; choose one"),
        (80e3, 100.0, "no return period of 100 years; it has 30, 300"),
        (None, 300.0, "depends on the volume"),
    ):
        with pytest.raises(InputError, match=words):
            rows_of_event(rows, volume, period, path)
    classes, elevation = np.full((2, 2), GULLY, np.uint8), np.full((2, 2), 900.0)
    large = rows_of_event(rows, 80e3, 300.0, path)
    with pytest.raises(InputError, match="no row for gully terrain at 900 to 900 m; add one"):
        friction_values([row for row in large if row.terrain != "gully"], classes, elevation, path)
    with pytest.raises(InputError, match="lines 5 and 5 both apply to gully terrain at 900 to 900 m"):
        friction_values([*large, large[3]], classes, elevation, path)


def test_a_gap_is_named_as_a_whole_whatever_the_blocks(tmp_path):
    path = table(tmp_path)
    large = rows_of_event(read_friction_table(path, "Voellmy"), 80e3, 300.0, path)
    rows = [*[row for row in large if row.terrain not in ("gully", "channel")], large[0]]
    classes = np.array([[GULLY, OPEN_SLOPE], [CHANNEL, OPEN_SLOPE], [CHANNEL, OPEN_SLOPE]], np.uint8)
    elevation = np.array([[800.0, 1600.0], [900.0, 1700.0], [1000.0, 1400.0]])
    for kept, words in ((rows, "lines 2 and 2 .* open terrain at 1600 to 1700"), (rows[:-1], "channel .* 900 to 1000")):
        for order in ([0, 1, 2], [2, 0, 1]):
            cells = FrictionCells(kept, path)
            for line in order:
                cells.chosen(classes[line : line + 1], elevation[line : line + 1])
            with pytest.raises(InputError, match=words):
                cells.found()
