"""The mesh: only wet cells, values of the rasters, simulated and stretched times, a CRS readable by QGIS."""

from concurrent.futures import ThreadPoolExecutor

import netCDF4
import numpy as np
import pytest
import qgis_run
import rasterio
import shapely
import xarray
from pyproj import CRS

from mpmgis.errors import OutputError
from mpmgis.gis.mesh import write_mesh

UTM = CRS.from_epsg(32632)


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


def test_times(mesh):
    assert np.allclose(mesh.t_s, np.arange(6) * 0.5)
    assert np.allclose(mesh.time, np.arange(6) * 30.0)
    assert mesh.time.units == "seconds since 2000-01-01 00:00:00"


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

    monkeypatch.setattr("mpmgis.gis.mesh._write_times", fail)
    with pytest.raises(OutputError, match="HDF error"):
        write_mesh(run, qgis_run.steps(run))


def test_no_arrows_without_components(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    write_mesh(run, qgis_run.steps(run, arrows=False))
    with netCDF4.Dataset(run.folder / run.mesh_file) as file:
        assert "Ut_E" not in file.variables
        assert "Ut" in file.variables
