"""The GeoPackage: outlines around exactly the wet cells, times, thinning, styles."""

import sqlite3

import geopandas
import numpy as np
import pytest
import qgis_run
import rasterio
import shapely
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pyproj import CRS
from rasterio.features import shapes
from scipy.ndimage import label
from shapely.geometry import shape

from mpmgis.maps.qgis.outlines import cells_outline, layer_names, mask_outline, thin, write_outlines
from mpmgis.system.errors import OutputError
from mpmgis.terrain.grid import Grid

UTM = CRS.from_epsg(32632)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = qgis_run.make_run(tmp_path_factory.mktemp("outlines"), UTM, times=np.arange(6) * 0.5)
    release = [shapely.Point(686160, 5211880).buffer(40), shapely.box(686300, 5211800, 686310, 5211810)]
    write_outlines(run, qgis_run.steps(run), release)
    return run


def read(run, layer):
    return geopandas.read_file(run.folder / run.outlines_file, layer=layer)


def test_layers(run):
    assert layer_names(run.folder / run.outlines_file) == ("outline", "envelope", "release", "particles")


@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
@settings(max_examples=60, deadline=None)
def test_outline_is_valid_and_has_the_area_of_its_cells(mask):
    outline = mask_outline(mask, Affine(2.0, 0, 100.0, 0, -2.0, 50.0))
    if not mask.any():
        assert outline is None
        return
    assert outline.is_valid
    assert outline.area == pytest.approx(4.0 * np.count_nonzero(mask))
    row, column = np.nonzero(mask)
    assert np.all(shapely.contains_xy(outline, 101.0 + 2.0 * column, 49.0 - 2.0 * row))
    assert len(outline.geoms) == label(mask)[1]  # cells that share a side belong together, a corner is not enough
    grid = Grid(UTM, Affine(2.0, 0, 100.0, 0, -2.0, 50.0), mask.shape)
    assert cells_outline(np.flatnonzero(mask), grid).equals_exact(outline)


@given(arrays(bool, st.tuples(st.integers(1, 14), st.integers(1, 14)), fill=st.booleans()), st.integers(2, 9))
@settings(max_examples=80, deadline=None)
def test_an_outline_leaves_out_small_parts_and_holes(mask, least):
    """Against the whole outline, ring by ring; if all parts are small, the largest one remains."""
    place = Affine(1.0, 0, 0.0, 0, -1.0, 0.0)
    whole, found = (mask_outline(mask, place, least=size) for size in (0, least))
    if not mask.any():
        assert found is None
        return
    shells = [shapely.Polygon(part.exterior) for part in whole.geoms]
    large = [part for part, shell in zip(whole.geoms, shells, strict=True) if shell.area >= least]
    kept = large or [max(whole.geoms, key=lambda part: shapely.Polygon(part.exterior).area)]
    holes = [[ring for ring in part.interiors if shapely.Polygon(ring).area >= least] for part in kept]
    parts = [shapely.Polygon(part.exterior, rings) for part, rings in zip(kept, holes, strict=True)]
    assert found.is_valid and found.equals(shapely.MultiPolygon(parts))


def test_outline_equals_gdal_polygonize():
    mask = np.random.default_rng(7).random((60, 80)) < 0.6
    transform = Affine(2.0, 0, 100.0, 0, -2.0, 50.0)
    gdals = [shape(part) for part, value in shapes(mask.astype("uint8"), mask=mask, transform=transform)]
    assert mask_outline(mask, transform).normalize().equals(shapely.MultiPolygon(gdals).normalize())


def test_outlines_are_written_in_batches_of_any_size(run, tmp_path, monkeypatch):
    again = qgis_run.make_run(tmp_path, UTM, times=np.arange(6) * 0.5)
    monkeypatch.setattr("mpmgis.maps.qgis.outlines.BATCH", 1)
    write_outlines(again, qgis_run.steps(again))
    assert read(again, "outline").equals(read(run, "outline"))


def test_outlines_of_steps(run):
    outline = read(run, "outline")
    assert outline.crs == UTM
    assert outline.geometry.is_valid.all()
    for k, file in enumerate(run.step_files):
        with rasterio.open(run.folder / file) as step:
            depth = step.read(1)
        row = outline[outline.step == k].iloc[0]
        assert row.t_s == run.times[k]
        assert row.area_m2 == pytest.approx(25.0 * np.count_nonzero(depth >= 0.05))
        assert row.geometry.area == pytest.approx(row.area_m2, rel=5e-3)
        assert row.h_max_m == pytest.approx(depth.max())
        assert str(row.t_qgis) == f"2000-01-01 00:0{k // 2}:{30 * (k % 2):02d}+00:00"
        assert (row.t_qgis_end - row.t_qgis).total_seconds() == 29


def test_envelope_contains_every_outline(run):
    (envelope,) = read(run, "envelope").geometry
    half_a_cell = 2.5  # both are smooth
    assert all(envelope.buffer(half_a_cell).contains(part) for part in read(run, "outline").geometry)


def test_release_as_given(run):
    release = read(run, "release")
    assert len(release) == 2
    assert release.area_m2.tolist() == pytest.approx([shapely.Point(0, 0).buffer(40).area, 100.0])


def test_release_from_the_first_step_at_time_zero(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    write_outlines(run, qgis_run.steps(run, count=0))
    (release,) = read(run, "release").geometry
    assert release.equals(read(run, "outline").geometry.iloc[0])
    assert "particles" not in layer_names(run.folder / run.outlines_file)


def test_no_release_from_a_first_step_that_is_not_the_start(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[5, 6])
    write_outlines(run, qgis_run.steps(run))
    assert "release" not in layer_names(run.folder / run.outlines_file)


def test_particles_are_few_and_the_same_at_all_steps(run):
    particles = read(run, "particles")
    groups = [set(group.id) for _, group in particles.groupby("step")]
    assert len(groups) == len(run.times)
    assert 200 < len(groups[0]) < 400
    assert all(group == groups[0] for group in groups)
    assert particles.geometry.has_z.all()
    assert np.allclose(particles.speed, np.sqrt(particles.v_E**2 + particles.v_N**2 + particles.v_up**2))


def test_thinning_is_independent_of_the_lattice():
    kept = np.flatnonzero(thin(np.arange(100_000), 100_000, wanted=1000))
    assert 850 < kept.size < 1150
    assert np.bincount(kept % 16, minlength=16).min() > 30
    assert np.all(thin(np.arange(50), 50, wanted=1000))


def test_default_layer_styles(run):
    with sqlite3.connect(run.folder / run.outlines_file) as database:
        rows = database.execute(
            "SELECT f_table_name, f_geometry_column, useAsDefault, styleQML FROM layer_styles"
        ).fetchall()
        columns = dict(database.execute("SELECT table_name, column_name FROM gpkg_geometry_columns").fetchall())
        listed = database.execute("SELECT data_type FROM gpkg_contents WHERE table_name = 'layer_styles'").fetchall()
    assert {name for name, *_ in rows} == set(columns)
    assert all(
        columns[name] == column and default == 1 and "<renderer-v2" in qml for name, column, default, qml in rows
    )
    assert listed == [("attributes",)]


def test_shallow_flow_has_no_outlines(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    object.__setattr__(run, "min_depth", 100.0)
    write_outlines(run, qgis_run.steps(run, count=0))
    assert layer_names(run.folder / run.outlines_file) == ()


def test_a_missing_folder_is_an_output_error(tmp_path):
    run = qgis_run.make_run(tmp_path, UTM, times=[0, 1])
    object.__setattr__(run, "name", "no/such/folder")
    kept = qgis_run.steps(run)
    with pytest.raises(OutputError, match="outline"):
        write_outlines(run, kept)
