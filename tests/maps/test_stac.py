"""The STAC item of an export: valid by the schema of STAC 1.1, read by pystac, in its place on the globe."""

import json

import pyproj
import pytest
import qgis_run

from mpmgis.maps.qgis.stac import require_stac, stac_item, write_stac_item
from mpmgis.system.errors import GeoreferenceError


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("stac"), pyproj.CRS.from_epsg(32632), times=[0.0, 0.5, 1.0])
    write_stac_item(run)
    return run


@pytest.fixture(scope="module")
def item(run):
    pystac = pytest.importorskip("pystac", reason="no pystac (pip install it)")
    return pystac.Item.from_file(str(run.folder / "slide.stac.json"))


def test_it_is_valid_by_the_schema_of_stac(run, item):
    """pystac brings the schemas of STAC 1.1 and GeoJSON; those of extensions lie on the network."""
    jsonschema = pytest.importorskip("jsonschema", reason="no jsonschema (pip install it)")
    from pystac.validation.local_validator import get_local_schema_cache
    from referencing import Registry
    from referencing.jsonschema import DRAFT7

    schemas = get_local_schema_cache()
    registry = Registry().with_resources((uri, DRAFT7.create_resource(text)) for uri, text in schemas.items())
    schema = schemas["https://schemas.stacspec.org/v1.1.0/item-spec/json-schema/item.json"]
    check = jsonschema.Draft7Validator(schema, registry=registry)
    text = json.loads((run.folder / "slide.stac.json").read_text())
    assert not list(check.iter_errors(text))
    assert list(check.iter_errors(text | {"assets": 1}))


def test_assets_are_there(run, item):
    assert {"maxima", "deposit", "terrain", "step_0000", "step_0001", "step_0002"} <= set(item.assets)
    for asset in item.assets.values():
        assert (run.folder / asset.href.removeprefix("./")).exists()
    bands = item.assets["step_0001"].extra_fields["bands"]
    assert [(band["name"], band["unit"]) for band in bands][:2] == [("h", "m"), ("t", "m")]


def test_it_lies_in_its_place(run, item):
    to_globe = pyproj.Transformer.from_crs(32632, 4326, always_xy=True)
    west, south, east, north = run.grid.bounds
    x, y = to_globe.transform([west, west, east, east], [south, north, south, north])
    assert item.bbox == pytest.approx([min(x), min(y), max(x), max(y)], abs=1e-6)
    assert item.properties["proj:code"] == "EPSG:32632" and item.properties["mpmgis:times"] == [0.0, 0.5, 1.0]


def test_times_and_links(item):
    assert item.common_metadata.end_datetime.second == 1 and item.datetime is None


def test_cogs_have_the_tags_of_their_layout(run):
    assert "cloud-optimized" in stac_item(run, cog=True)["assets"]["maxima"]["type"]
    assert json.loads((run.folder / "slide.stac.json").read_text()) == stac_item(run)


def test_a_local_frame_is_refused():
    with pytest.raises(GeoreferenceError, match="--stac needs a CRS"):
        require_stac(None)
