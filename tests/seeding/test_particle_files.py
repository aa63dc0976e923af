"""Every format of `mpmgis seed`, written and read back by the programs that are meant to read it."""

import json
import shutil
from collections import namedtuple
from xml.etree import ElementTree

import geopandas
import h5py
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pyogrio
import pytest
from seed_sites import PIXELS, area_of, grid_of, ring, two_islands

from mpmgis.frames.frame_files import read_frame
from mpmgis.frames.particle_files import UNITS, column_table, require_format, write_columns
from mpmgis.seeding.column_seeding import plan_seed
from mpmgis.system.errors import OutputError
from mpmgis.terrain.georeference import parse_crs
from mpmgis.terrain.synthetic_terrain import plane

SUFFIXES = [".h5", ".csv", ".json", ".gpkg", ".parquet", ".vtp"]


@pytest.fixture(scope="module")
def plan():
    terrain = plane(30.0, 110.0).terrain(grid_of(PIXELS["north_up"], crs=parse_crs("EPSG:32632")))
    return plan_seed(terrain, area_of(two_islands()), velocity=(1.0, -2.0), density=300.0)


def write(plan, path, slab=500):
    write_columns(path, plan.empty_frame(), plan.count, plan.slabs(slab))
    frame = plan.frame()
    return path, column_table(frame.particles, frame.origin), plan.record


def check(read, wanted, tolerance=0.0):
    assert set(read) == set(UNITS)
    for name, values in wanted.items():
        np.testing.assert_allclose(np.asarray(read[name], float), values.astype(float), rtol=tolerance, err_msg=name)


def test_h5_is_a_frame_in_slabs_as_in_one_piece(plan, tmp_path):
    path, _, record = write(plan, tmp_path / "p.h5")
    frame, whole = read_frame(path), plan.frame()
    assert frame.dimension == 2 and frame.time == 0.0 and frame.crs.to_epsg() == 32632
    assert frame.origin == whole.origin and frame.origin[2] == 0.0
    for name, values in whole.particles.arrays().items():
        assert np.array_equal(frame.particles.arrays()[name], values), name
    for name, value in record.items():
        got = frame.header[name]
        assert np.all(got == value), name
    with h5py.File(path) as file:
        assert file["particles/area"].attrs["units"] == "m2"


def test_csv(plan, tmp_path):
    path, wanted, _ = write(plan, tmp_path / "p.csv")
    check(pyarrow.csv.read_csv(path).to_pydict(), wanted)


def test_json(plan, tmp_path):
    path, wanted, record = write(plan, tmp_path / "p.json")
    content = json.loads(path.read_text())
    check(content["particles"], wanted)
    assert content["units"] == UNITS and content["count"] == plan.count
    assert content["header"]["reference_mass"] == record["reference_mass"]
    assert "32632" in content["header"]["crs"]


def test_gpkg(plan, tmp_path):
    path, wanted, record = write(plan, tmp_path / "p.gpkg")
    rows = geopandas.read_file(path)
    assert rows.crs.to_epsg() == 32632
    np.testing.assert_allclose(rows.geometry.x, wanted["x"])
    np.testing.assert_allclose(rows.geometry.y, wanted["y"])
    check({name: rows[name].to_numpy() for name in rows.columns if name != "geometry"}, wanted)
    notes = pyogrio.read_info(path)["dataset_metadata"]
    assert json.loads(notes["closure_factor"]) == record["closure_factor"]


def test_parquet(plan, tmp_path):
    path, wanted, record = write(plan, tmp_path / "p.parquet")
    rows = geopandas.read_parquet(path)
    assert rows.crs.to_epsg() == 32632
    np.testing.assert_array_equal(rows.geometry.x, wanted["x"])
    np.testing.assert_array_equal(rows.geometry.y, wanted["y"])
    check({name: rows[name].to_numpy() for name in rows.columns if name != "geometry"}, wanted)
    notes = json.loads(pyarrow.parquet.read_schema(path).metadata[b"mpmgis"])
    assert notes["density"] == record["density"] == 300.0


def test_vtp(plan, tmp_path):
    """Read as VTK does: offsets into the appended block, each array led by its size in bytes."""
    path, wanted, _ = write(plan, tmp_path / "p.vtp")
    head, _, tail = path.read_bytes().partition(b'<AppendedData encoding="raw">\n_')
    root = ElementTree.fromstring(head + b"</VTKFile>")
    piece = root.find("PolyData/Piece")
    assert int(piece.get("NumberOfPoints")) == int(piece.get("NumberOfVerts")) == plan.count
    arrays = {}
    for node in piece.iter("DataArray"):
        at = int(node.get("offset"))
        size = int(np.frombuffer(tail, "<u8", 1, at)[0])
        dtype = {"Float64": "<f8", "Int64": "<i8", "UInt64": "<u8"}[node.get("type")]
        values = np.frombuffer(tail, dtype, size // 8, at + 8)
        arrays[node.get("Name")] = values.reshape(-1, int(node.get("NumberOfComponents", 1))).squeeze()
    origin = [float(v) for v in root.find("PolyData/FieldData/DataArray[@Name='origin']").text.split()]
    x, y, z = arrays.pop("points").T + np.array(origin)[:, None]
    np.testing.assert_array_equal(arrays.pop("connectivity"), np.arange(plan.count))
    np.testing.assert_array_equal(arrays.pop("offsets"), np.arange(plan.count) + 1)
    u, v, w = arrays.pop("velocity").T
    np.testing.assert_allclose(z, wanted["z_bed"])
    check({**arrays, "x": x, "y": y, "u": u, "v": v, "w": w}, wanted, 1e-12)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_local_frame_has_no_crs(tmp_path, suffix):
    plan = plan_seed(plane(10.0).terrain(grid_of(PIXELS["north_up"])), area_of(ring()), count=50)
    path = write(plan, tmp_path / f"p{suffix}")[0]
    if suffix == ".h5":
        assert read_frame(path).crs is None
    elif suffix == ".parquet":
        assert geopandas.read_parquet(path).crs is None
    elif suffix == ".gpkg":
        assert len(geopandas.read_file(path)) == plan.count
    else:
        assert path.stat().st_size > 1000


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nothing_is_left_of_a_file_that_failed(plan, tmp_path, suffix):
    def broken():
        yield next(plan.slabs(500))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_columns(tmp_path / f"p{suffix}", plan.empty_frame(), plan.count, broken())
    assert list(tmp_path.iterdir()) == []


def test_formats_and_space_are_asked_first(plan, tmp_path, monkeypatch):
    with pytest.raises(OutputError, match=r"\.xyz is unknown, expected \.h5"):
        require_format(tmp_path / "p.xyz")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10, 9, 1))
    with pytest.raises(OutputError, match="MB are free"):
        write_columns(tmp_path / "p.h5", plan.empty_frame(), plan.count, plan.slabs())
    assert list(tmp_path.iterdir()) == []
