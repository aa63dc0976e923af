"""Columns of the release areas of a region: frequencies, and names that results or GeoPackage take."""

import geopandas
import numpy as np
import pytest
import shapely

from mpmgis.studies.region_areas import RegionAreas, write_areas
from mpmgis.system.errors import InputError
from mpmgis.system.messages import collected
from mpmgis.terrain.release_parts import ReleasePart

SHAPES = [shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)]


def areas(**columns):
    parts = [ReleasePart(f"area {n}", shape, 1.0) for n, shape in enumerate(SHAPES)]
    return RegionAreas(parts, {name: np.asarray(values) for name, values in columns.items()}, None)


@pytest.mark.parametrize(
    ("values", "named"),
    [([0.1, np.nan], "area 2 has empty"), ([-0.5, 0.1], "area 1 has -0.5"), (["often", "rare"], "text .*'often'")],
)
def test_a_wrong_frequency_is_named(values, named):
    with pytest.raises(InputError, match=named):
        areas(f=values).frequencies("f")


def test_columns_that_cannot_be_kept_are_named(tmp_path):
    """A result has the name `status`, and GeoPackage does not distinguish ID and id."""
    given = areas(ID=[1, 2], id=[3, 4], Status=["old", "old"], place=["a", "b"])
    with collected() as messages:
        write_areas(tmp_path / "areas.gpkg", given, {"status": ["finished", "dry"]})
    (message,) = [text for text in messages if "left out" in text]
    assert "`id`" in message and "`Status`" in message and "`place`" not in message
    table = geopandas.read_file(tmp_path / "areas.gpkg")
    assert list(table["ID"]) == [1, 2] and list(table["status"]) == ["finished", "dry"]
    assert list(table["place"]) == ["a", "b"]
