"""A DTM with nodata: reported before and after the run, filled on request; 3D needs ground in reach."""

import json

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_files import read_frame
from mpmgis.simulation.preparation import prepare
from mpmgis.system.errors import SceneError
from mpmgis.system.messages import collected

WEST, SOUTH, LENGTH, WIDTH, PIXEL = 600_000.0, 5_200_000.0, 400.0, 120.0, 5.0
IN_THE_PATH, BESIDE, ABOVE = (200.0, 60.0), (200.0, 8.0), (10.0, 60.0)
SCENE = """
[terrain]
dem = "dtm.tif"{fill}
[release]
source = "release.gpkg"
thickness = 2.0
density = 2000
[friction]
law = "Voellmy"
mu = 0.15
xi = 1000
[numerics]
cell_size = {cell}
[output]
end_time = 20
frame_interval = 5
"""
FILL = '\nfill_nodata = "interpolate"'


def write_site(folder, holes=(), collar=0.0):
    """A valley that falls eastwards by 20 degrees, a release in its west, holes of 6 x 12 cells around map offsets."""
    rows, columns = int(WIDTH / PIXEL), int(LENGTH / PIXEL)
    x, y = np.meshgrid((np.arange(columns) + 0.5) * PIXEL, WIDTH - (np.arange(rows) + 0.5) * PIXEL)
    height = 300.0 + np.tan(np.radians(20)) * (LENGTH - x) + 0.004 * (y - 0.5 * WIDTH) ** 2
    for east, north in holes:
        half = 30.0 if (east, north) == IN_THE_PATH else 4.0
        height[(np.abs(x - east) < 15.0) & (np.abs(y - north) < half)] = np.nan
    height[x > LENGTH - collar] = np.nan
    transform = Affine(PIXEL, 0, WEST, 0, -PIXEL, SOUTH + WIDTH)
    with rasterio.open(
        folder / "dtm.tif",
        "w",
        driver="GTiff",
        height=rows,
        width=columns,
        count=1,
        dtype="float64",
        crs="EPSG:32632",
        transform=transform,
        nodata=np.nan,
    ) as file:
        file.write(height, 1)
    box = shapely.box(WEST + 40, SOUTH + 40, WEST + 80, SOUTH + 80)
    geopandas.GeoDataFrame(geometry=[box], crs="EPSG:32632").to_file(folder / "release.gpkg")
    return height


def run(folder, capsys, fill="", cell=PIXEL):
    (folder / "scene.toml").write_text(SCENE.format(fill=fill, cell=cell))
    code = main(["run", str(folder / "scene.toml"), "--overwrite"])
    record = folder / "results" / "run.json"
    return code, capsys.readouterr().err, json.loads(record.read_text()) if record.exists() else None


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0, 3.0])
def test_a_hole_in_the_path_is_reported_before_the_run_and_what_it_took_after_it(tmp_path, capsys, share):
    write_site(tmp_path, [IN_THE_PATH])
    code, err, record = run(tmp_path, capsys, cell=share * PIXEL)
    assert code == 0
    before, after = err.split("ended:")
    assert "the flow can reach nodata amid the DTM: 72 cells around E 600" in before
    assert "[terrain] fill_nodata = 'interpolate'" in before and "into a hole of the DTM at E 600" in after
    (hole,) = (place for place in record["balances"]["left_places"] if place["where"] == "hole")
    assert hole["mass"] > 0.3 * record["balances"]["mass_start"]
    half = 15.0 + share * PIXEL
    assert abs(hole["east"] - WEST - 200.0) <= half + PIXEL and abs(hole["north"] - SOUTH - 60.0) <= 30.0
    (told,) = record["nodata"]["in_reach"]["holes"]
    assert told["cells"] == 72 and abs(told["east"] - WEST - 200.0) <= 3.0
    assert record["nodata"]["filled"] is None
    assert abs(record["balances"]["energy_error_relative"]) <= 1e-3


def test_a_filled_hole_is_flowed_over_and_kept_in_the_terrain_of_the_run(tmp_path, capsys):
    height = write_site(tmp_path, [IN_THE_PATH, BESIDE], collar=20.0)
    code, err, record = run(tmp_path, capsys, FILL)
    assert code == 0
    assert "filled 78 cells without elevation in 2 holes of the DTM, up to 15 m from known cells" in err
    assert "96 nodata cells connected to the edge of the DTM are kept" in err
    assert "into a hole" not in err and "nodata amid the DTM:" not in err
    filled = record["nodata"]["filled"]
    assert (filled["cells"], filled["holes"], filled["left"], filled["distance"]) == (78, 2, 96, 15.0)
    with rasterio.open(tmp_path / "results" / "terrain.tif") as file:
        kept = file.read(1)
    collar = np.zeros(height.shape, bool)
    collar[:, -4:] = True
    assert np.array_equal(np.isnan(kept), collar)
    known = np.isfinite(height)
    assert np.array_equal(kept[known], height[known])
    assert 'fill_nodata = "interpolate"' in (tmp_path / "results" / "scene.toml").read_text()
    frame = read_frame(tmp_path / "results" / "frame_000004.h5")
    x, y = frame.map_xy()
    inside = (np.abs(x - WEST - 200.0) < 15.0) & (np.abs(y - SOUTH - 60.0) < 30.0)
    assert inside.any() or (x - WEST > 215.0).mean() > 0.5


def test_a_run_cannot_resume_its_filled_run(tmp_path, capsys):
    write_site(tmp_path, [BESIDE])
    digests = {run(tmp_path, capsys, fill)[2]["digest"] for fill in ("", FILL)}
    assert len(digests) == 2


def test_a_collar_is_reported_as_the_end_of_the_dtm(tmp_path, capsys):
    write_site(tmp_path, collar=150.0)
    _, err, record = run(tmp_path, capsys)
    assert "the flow can reach the nodata around the DTM: " in err and "larger DTM" in err
    places = record["balances"]["left_places"]
    assert places and {place["where"] for place in places} == {"collar"}
    assert abs(places[0]["east"] - WEST - 250.0) <= 2 * PIXEL
    assert "flowed into the nodata around the DTM at E 600" in err


def test_the_report_reports_where_mass_left(tmp_path, capsys):
    write_site(tmp_path, [IN_THE_PATH])
    run(tmp_path, capsys)
    assert main(["report", str(tmp_path / "results"), "-o", str(tmp_path / "report")]) == 0
    text = next((tmp_path / "report").glob("*.html")).read_text()
    assert "flowed into a hole of the DTM at E 600" in text and "energy:" in text


def scene_of(folder, **more):
    tables = {
        "terrain": {"dem": str(folder / "dtm.tif")},
        "output": {"end_time": 5.0, "frame_interval": 1.0},
        "release": {"source": str(folder / "release.gpkg"), "thickness": 2.0, "density": 2000.0},
    }
    return {name: {**tables.get(name, {}), **more.get(name, {})} for name in {**tables, **more}}


def in_3d(folder, **more):
    return {
        "solver": "points",
        **scene_of(folder, numerics={"cell_size": 4.0}, **more),
        "friction": {"law": "Coulomb", "mu": 0.6},
        "material": {"law": "Fluid", "viscosity": 100.0, "bulk_modulus": 1e6},
    }


def test_3d_needs_no_ground_where_no_point_can_get(tmp_path):
    """Refused is a hole in reach; filled, or behind the release, it is none, and a collar is an edge."""
    write_site(tmp_path, [IN_THE_PATH])
    with pytest.raises(SceneError, match=r"the 3D solver needs ground without holes where .*72 cells .*fill_nodata"):
        prepare(in_3d(tmp_path))
    assert prepare(in_3d(tmp_path, terrain={"fill_nodata": "interpolate"})).fill.cells == 72
    write_site(tmp_path, [ABOVE], collar=20.0)
    with collected() as said:
        assert prepare(in_3d(tmp_path)).stages[0].nodata.holes == ()
    assert not any("amid the DTM" in line for line in said)


def test_walls_at_the_edges_need_ground_where_the_flow_can_get(tmp_path):
    write_site(tmp_path, collar=20.0)
    walled = scene_of(tmp_path, friction={"law": "Coulomb", "mu": 0.1}, numerics={"edges": "wall"})
    with pytest.raises(SceneError, match=r"edges = 'wall' needs a DTM without nodata around it"):
        prepare(walled)
    write_site(tmp_path)
    assert prepare(walled).stages[0].nodata.collar is None


def test_the_key_takes_its_choices_and_effects_reports_it(tmp_path, capsys):
    write_site(tmp_path, [IN_THE_PATH])
    (tmp_path / "scene.toml").write_text(SCENE.format(fill='\nfill_nodata = "guess"', cell=5))
    assert main(["effects", str(tmp_path / "scene.toml")]) == 2
    assert "fill_nodata = 'guess'" in capsys.readouterr().err
    (tmp_path / "scene.toml").write_text(SCENE.format(fill=FILL, cell=5))
    assert main(["effects", str(tmp_path / "scene.toml")]) == 0
    assert "nodata amid" not in capsys.readouterr().out
    (tmp_path / "scene.toml").write_text(SCENE.format(fill="", cell=5))
    assert main(["effects", str(tmp_path / "scene.toml")]) == 0
    assert "72 cells of nodata inside the DTM are in reach, around E 600" in capsys.readouterr().out
    assert main(["run", "--template"]) == 0
    assert 'fill_nodata = "interpolate"' in capsys.readouterr().out


def test_a_seed_over_a_hole_is_refused_and_made_on_filled_ground(tmp_path, capsys):
    write_site(tmp_path, [(60.0, 60.0)])
    seed = ["seed", "--dem", str(tmp_path / "dtm.tif"), "--release", str(tmp_path / "release.gpkg"), "--thickness", "2"]
    seed += ["-o", str(tmp_path / "seed.h5")]
    assert main(seed) == 2
    assert "--fill-nodata interpolate" in capsys.readouterr().err
    assert main([*seed, "--fill-nodata", "interpolate"]) == 0
    assert "filled 12 cells" in capsys.readouterr().err
    particles = read_frame(tmp_path / "seed.h5").particles
    assert np.isfinite(particles.position).all() and particles.volume.sum() > 1600.0 * 2.0


@settings(max_examples=8, deadline=None, derandomize=True)
@given(east=st.floats(100.0, 380.0), north=st.floats(10.0, 110.0), share=st.floats(0.5, 3.0), mu=st.floats(0.05, 0.5))
def test_whatever_a_hole_takes_was_reported_before(tmp_path_factory, east, north, share, mu):
    """Small holes anywhere below the release, on cells of half to three times the DTM's."""
    folder = tmp_path_factory.mktemp("hole")
    write_site(folder, [(east, north)])
    friction, cells = {"law": "Voellmy", "mu": mu, "xi": 1000.0}, {"cell_size": share * PIXEL}
    prepared = prepare(scene_of(folder, friction=friction, numerics=cells, curvature={"use": "on"}))
    solver = prepared.solver()
    solver.advance(20.0)
    taken = [place for place in solver.balances()["left_places"] if place["where"] == "hole"]
    assert not taken or prepared.stages[0].nodata.holes
    for place in taken:
        assert np.hypot(place["east"] - WEST - east, place["north"] - SOUTH - north) <= 20.0 + 2.0 * share * PIXEL
