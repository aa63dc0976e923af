"""The mesh: only wet cells, values of the rasters, simulated and stretched times, a CRS readable by QGIS."""

import json
from concurrent.futures import ThreadPoolExecutor

import netCDF4
import numpy as np
import pytest
import qgis_run
import rasterio
import shapely
import xarray
from pyproj import CRS

from mpmgis.maps.qgis.flow_mesh import write_mesh
from mpmgis.system.errors import OutputError

UTM = CRS.from_epsg(32632)
WRONG_OF_THE_CHECKER = (
    "azimuth is a required attribute for grid mapping oblique_mercator",  # CF: azimuth_of_central_line, which is there
    "When attribute scale_factor is of type double variable time must be of type byte, unsigned byte, short, unsigned "
    "short, int, or unsigned int",  # CF 8.1: or of the type of scale_factor, as it is; MDAL reads no integers
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("mesh"), UTM, times=np.arange(6) * 0.5)
    write_mesh(run, qgis_run.steps(run))
    return run


@pytest.fixture(scope="module")
def mesh(run):
    with xarray.open_dataset(run.folder / run.mesh_file, decode_times=False) as file:
        return file.load()


def face_polygons(mesh):
    nodes = np.stack([mesh.node_x, mesh.node_y], axis=1)
    return shapely.polygons(nodes[mesh.face_nodes.values.astype(int)])


def test_faces_are_the_cells_that_were_ever_wet(run, mesh):
    with rasterio.open(run.folder / run.maxima_file) as file:
        wet = file.read(1) != -9999
    polygons = face_polygons(mesh)
    assert len(polygons) == np.count_nonzero(wet)
    x, y = run.grid.xy(*np.nonzero(wet))
    assert np.allclose(shapely.get_coordinates(shapely.centroid(polygons)), np.stack([x, y], axis=1))
    assert np.allclose(shapely.area(polygons), 25.0)
    assert np.all(shapely.is_ccw(shapely.get_exterior_ring(polygons)))


def test_mesh_values_equal_the_rasters(run, mesh):
    centres = shapely.get_coordinates(shapely.centroid(face_polygons(mesh)))
    row, column = (np.rint(v).astype(int) for v in run.grid.rowcol(*centres.T))
    for k, file in enumerate(run.step_files):
        with rasterio.open(run.folder / file) as step:
            depth, speed = step.read(1), step.read(4)
        depth, speed = depth[row, column], speed[row, column]
        wet = depth > 0
        assert np.array_equal(mesh.h.values[k][wet], depth[wet])
        assert np.all(np.isnan(mesh.h.values[k][~wet]))
        moving = speed != -9999
        assert np.array_equal(mesh.Ut.values[k][moving], speed[moving])
        vector = np.hypot(mesh.Ut_E.values[k], mesh.Ut_N.values[k])
        assert np.allclose(vector[moving], speed[moving], rtol=1e-6)
        assert np.all(np.isnan(vector[~moving]))


def test_nodes_carry_the_terrain(run, mesh):
    x, y = mesh.node_x.values - run.grid.transform.c, mesh.node_y.values - run.grid.transform.f
    assert np.abs(mesh.node_z.values - qgis_run.hill(x, y)).max() < 1.0  # roughness of 100 m waves in 5 m cells


def test_times_are_simulated_seconds_and_qgis_reads_its_clock(run, mesh):
    """Readers of CF unpack the time; MDAL reads the packed integers."""
    assert np.allclose(mesh.t_s, np.arange(6) * 0.5, rtol=0, atol=0)
    assert np.allclose(mesh.time, np.arange(6) * 0.5, rtol=1e-14)
    assert mesh.time.units == "seconds since 2000-01-01 00:00:00"
    with xarray.open_dataset(run.folder / run.mesh_file) as file:
        assert np.array_equal(
            file.time.values, np.datetime64("2000-01-01", "ns") + np.arange(6) * np.int64(500_000_000)
        )
    with netCDF4.Dataset(run.folder / run.mesh_file) as file:
        file.set_auto_scale(False)
        assert file["time"][:].tolist() == [0, 30, 60, 90, 120, 150]


@pytest.mark.parametrize("crs", [UTM, CRS.from_epsg(2056), None], ids=["utm", "swiss", "local"])
def test_compliance_checker_finds_only_what_ugrid_asks_for(tmp_path, crs):
    """CF 9.5 reserves `cf_role` for discrete sampling geometries; UGRID, which CF-1.11 adopts, uses it for meshes."""
    runner = pytest.importorskip("compliance_checker.runner", reason="no compliance-checker (pip install it)")
    run = qgis_run.make_run(tmp_path, crs, times=[0.0, 0.2, 0.4])
    write_mesh(run, qgis_run.steps(run))
    runner.CheckSuite.load_all_available_checkers()
    report = tmp_path / "report.json"
    runner.ComplianceChecker.run_checker(
        str(run.folder / run.mesh_file), ["cf:1.11"], 0, "strict", output_filename=str(report), output_format="json"
    )
    found = json.loads(report.read_text())["cf:1.11"]
    told = [
        text for level in ("high_priorities", "medium_priorities") for part in found[level] for text in part["msgs"]
    ]
    told = [text for text in told if text not in WRONG_OF_THE_CHECKER]
    assert len(told) == 3 and all("cf_role" in text for text in told), told


def test_crs_is_ascii_text_for_qgis(run):
    with netCDF4.Dataset(run.folder / run.mesh_file) as file:
        system = file["projected_coordinate_system"]
        assert system.wkt.isascii()
        assert CRS.from_wkt(system.wkt).to_epsg() == 32632
        assert file["node_z"].grid_mapping == "projected_coordinate_system"
        assert file["Ut_E"].long_name.removesuffix("x-component") == file["Ut_N"].long_name.removesuffix("y-component")


def test_threads_write_the_same_values(run, mesh, tmp_path):
    again = qgis_run.make_run(tmp_path, UTM, times=np.arange(6) * 0.5)
    with ThreadPoolExecutor(3) as threads:
        write_mesh(again, qgis_run.steps(again), threads)
    with xarray.open_dataset(again.folder / again.mesh_file, decode_times=False) as file:
        assert file.identical(mesh)


def test_a_step_is_one_standard_deflate_chunk(run):
    with netCDF4.Dataset(run.folder / run.mesh_file) as file:
        assert file["h"].chunking() == [1, len(file.dimensions["face"])]
        assert file["h"].filters()["zlib"] and file["h"].filters()["shuffle"]
        assert len(file.dimensions["time"]) == len(run.times)


def test_library_errors_are_reported_in_one_line(tmp_path, monkeypatch):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])

    def fail(self, *arguments):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("mpmgis.maps.qgis.flow_mesh._write_times", fail)
    with pytest.raises(OutputError, match="HDF error"):
        write_mesh(run, qgis_run.steps(run))


def test_no_arrows_without_components(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    write_mesh(run, qgis_run.steps(run, arrows=False))
    with netCDF4.Dataset(run.folder / run.mesh_file) as file:
        assert "Ut_E" not in file.variables
        assert "Ut" in file.variables
