"""Small sites for the seeding tests: terrain in memory and on disk, releases, and the grid's view of columns."""

import numpy as np
import rasterio
import shapely
from affine import Affine

from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_parts import ReleaseArea, ReleasePart, ThicknessRaster
from mpmgis.terrain.synthetic_terrain import plane

EAST, NORTH = 500_000.0, 5_100_000.0
PIXELS = {
    "north_up": Affine(5, 0, EAST, 0, -5, NORTH + 300),
    "south_up": Affine(5, 0, EAST, 0, 5, NORTH),
    "non_square": Affine(8, 0, EAST, 0, -3, NORTH + 300),
    "rotated": Affine.translation(EAST + 90, NORTH + 300) * Affine.rotation(20) * Affine.scale(5, -5),
    "rotated_non_square": Affine.translation(EAST + 90, NORTH + 300) * Affine.rotation(-65) * Affine.scale(4, 7),
    "sheared": Affine(5, 1.5, EAST - 60, 0.5, -4, NORTH + 260),
}
CENTRE = (EAST + 150.0, NORTH + 150.0)


def grid_of(transform, shape=(100, 100), crs=None):
    """A Grid large enough for the shapes around CENTRE: the transform is moved so that CENTRE is in its middle."""
    middle = transform * (shape[1] / 2, shape[0] / 2)
    return Grid(crs, Affine.translation(CENTRE[0] - middle[0], CENTRE[1] - middle[1]) * transform, shape)


def inclined(transform, angle=30.0, azimuth=110.0, shape=(100, 100), crs=None):
    """A plane terrain at `angle` on pixels of `transform`."""
    return plane(angle, azimuth, CENTRE, 1500.0).terrain(grid_of(transform, shape, crs))


def ring(radius=40.0, hole=12.0):
    """A polygon with a hole, off the centre."""
    outer = shapely.Point(*CENTRE).buffer(radius, quad_segs=7)
    return outer.difference(shapely.Point(CENTRE[0] + 9.0, CENTRE[1] - 6.0).buffer(hole, quad_segs=5))


def two_islands():
    """A MultiPolygon: a ring and a triangle apart from it."""
    x, y = CENTRE
    return shapely.union_all([ring(), shapely.Polygon([(x + 60, y + 3), (x + 75.3, y + 40.1), (x + 57.7, y + 31)])])


def area_of(*polygons, thickness=2.0, mode="normal"):
    """A ReleaseArea of polygons of one thickness (a number, or one a polygon)."""
    values = thickness if isinstance(thickness, (list, tuple)) else [thickness] * len(polygons)
    parts = [ReleasePart(f"A{i + 1}", p, h) for i, (p, h) in enumerate(zip(polygons, values, strict=True))]
    return ReleaseArea(tuple(parts), mode)


def paper_hump():
    """The paper's test of section 4.1: 100 x 100 pixels of 1 m, eq (9) thickness, the release is the whole raster."""
    grid = Grid(None, Affine(1, 0, 0, 0, -1, 100), (100, 100))
    x, y = grid.xy(*np.indices(grid.shape))
    hump = ThicknessRaster(1 + 2 * np.exp(-((x - 50) ** 2 + (y - 50) ** 2) / 150), grid)
    release = ReleaseArea((ReleasePart("psi", shapely.box(0, 0, 100, 100), hump),), "vertical")
    return plane(20.0, 90.0).terrain(grid), release, hump


def quadratic_weights(x, spacing):
    """Node index of the lowest of three nodes, and the three quadratic B-spline weights of points `x`."""
    base = np.floor(x / spacing - 0.5).astype(int)
    f = x / spacing - base
    return base, np.stack((0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2))


def to_nodes(x, y, values, spacing, shape):
    """float64[shape]: `values` of points scattered to nodes (y, x) of a grid with the quadratic kernel."""
    i, wx = quadratic_weights(x, spacing)
    j, wy = quadratic_weights(y, spacing)
    total = np.zeros(shape)
    for a in range(3):
        for b in range(3):
            np.add.at(total, (np.clip(j + b, 0, shape[0] - 1), np.clip(i + a, 0, shape[1] - 1)), wx[a] * wy[b] * values)
    return total


def write_raster(path, values, transform, crs="EPSG:32632", nodata=None, unit=None, **tags):
    """A GeoTIFF of one band, or of several where `values` is three-dimensional."""
    values = np.asarray(values)
    bands = values if values.ndim == 3 else values[None]
    profile = {
        "driver": "GTiff",
        "height": bands.shape[1],
        "width": bands.shape[2],
        "count": len(bands),
        "dtype": bands.dtype,
        "crs": crs,
        "transform": transform,
        "nodata": nodata,
    }
    with rasterio.open(path, "w", **profile) as sink:
        sink.write(bands)
        if unit:
            sink.units = [unit] * len(bands)
        sink.update_tags(**tags)
    return path


def write_dtm(path, transform=PIXELS["north_up"], shape=(60, 60), crs="EPSG:32632", angle=30.0, **options):
    """A plane DTM on disk, float64."""
    grid = Grid(None, transform, shape)
    heights = plane(angle, 110.0, CENTRE, 1500.0).terrain(grid).elevation
    return write_raster(path, heights, transform, crs, **options)
