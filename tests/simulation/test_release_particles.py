"""`[release] particles` takes every file that the readers take, with their declarations as keys."""

import json

import h5py
import numpy as np
import pyproj
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from third_party_writers import CODES, COUNT, DENSITY, MASS, TIMES, VOLUME, cloud

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import axis_matrix
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import Quantity
from mpmgis.scene import scene_from_tables, scene_text
from mpmgis.scene.scene_reading import read_toml
from mpmgis.simulation.mass_sources import columns_of, read_point_start
from mpmgis.simulation.release_particles import read_release_particles
from mpmgis.solvers.columns.node_grid import ColumnGrid
from mpmgis.system.errors import MpmgisError, SceneError
from mpmgis.system.messages import collected
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

EAST, NORTH, HEIGHT = ORIGIN = np.array([600000.0, 5170000.0, 900.0])
KEYS = {"--density": "density", "--particle-volume": "particle_volume", "--dt": "dt"}
MATERIAL = {"law": "DruckerPrager", "bulk_modulus": 6.7e6, "shear_modulus": 4e6, "friction_angle": 40, "cohesion": 1000}


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    """Flat ground at 998 m under EAST to EAST + 80 and NORTH to NORTH + 80."""
    path = tmp_path_factory.mktemp("ground") / "dtm.tif"
    grid = Grid.north_up(pyproj.CRS.from_epsg(32632), EAST, NORTH + 80.0, 2.0, (40, 40))
    write_geotiff(path, grid, [(Quantity("elevation", "m", ""), np.full((40, 40), HEIGHT + 98.0))], {})
    return read_terrain(path)


def tables(path, terrain, **release):
    return {
        "solver": "points",
        "terrain": {"dem": terrain.path},
        "release": {"particles": str(path), **release},
        "output": {"end_time": 5.0, "frame_interval": 1.0},
        "numerics": {"cell_size": 2.0},
        "material": MATERIAL,
    }


def start(path, terrain, **release):
    scene = scene_from_tables(tables(path, terrain, **release))
    return read_point_start(scene, terrain, ColumnGrid.on(terrain, 2.0))


def refused(path, terrain, **release):
    with pytest.raises(MpmgisError) as caught:
        start(path, terrain, **release)
    assert "\n" not in str(caught.value) and "--" not in str(caught.value)
    return str(caught.value)


def test_a_file_that_leads_elsewhere_names_the_option_that_run_has(tmp_path, terrain):
    """`--trust` is no key of [release]; without its dashes nobody could follow the message."""
    path = tmp_path / "cloud.h5"
    with h5py.File(path, "w") as file:
        for name in ("x", "y", "z"):
            file[name] = h5py.ExternalLink("/elsewhere/other.h5", name)
    with pytest.raises(MpmgisError, match="--trust"):
        start(path, terrain, reader="hdf5")


@pytest.mark.parametrize("name", CODES)
def test_every_reader_starts_a_run(name, tmp_path, terrain):
    reader, write, options = CODES[name]
    write(tmp_path)
    keys = {KEYS[option]: float(value) for option, value in zip(options[::2], options[1::2], strict=True)}
    keys |= {"axes": ["e", "n", "u"], "origin": ORIGIN.tolist()}
    (folder,) = {path.parent for path in tmp_path.rglob("*") if path.is_file() and path.suffix != ".json"}
    found = start(folder, terrain, **keys, at_time=TIMES[1])
    frame = found.frame
    order = np.argsort(frame.particles.id)
    place, _ = cloud(1)
    close = 1e-4 if reader[:5] == "mpm-g" else 1e-6
    np.testing.assert_allclose(frame.particles.position[order], place, rtol=close)
    mass = DENSITY * VOLUME if name in ("liggghts", "mpm-geomechanics") else MASS
    np.testing.assert_allclose(frame.particles.mass, mass, rtol=1e-6)
    assert frame.origin == (EAST, NORTH, HEIGHT) and frame.time == 0.0 and frame.dimension == 3
    assert frame.header["density"] == DENSITY and frame.crs == terrain.grid.crs
    assert found.vertical_stress is None and found.seen.dimension == 2
    assert found.seen.particles.mass.sum() == pytest.approx(COUNT * mass)


def test_one_frame_needs_no_time_and_coordinates_on_the_terrain_no_axes(tmp_path, terrain):
    place, velocity = cloud(0)
    np.savez(tmp_path / "slide.npz", x=place + ORIGIN, v=velocity, mass=np.full(COUNT, MASS))
    with collected() as notes:
        found = start(tmp_path / "slide.npz", terrain, density=DENSITY)
    (line,) = [note for note in notes if "coordinates lie on" in note]
    assert "axes e,n,u and origin 0,0,0 are assumed" in line
    np.testing.assert_allclose(found.frame.particles.position, place + ORIGIN)
    np.testing.assert_array_equal(found.frame.particles.velocity, velocity)
    assert "lacks: the directions of its axes" in refused(
        tmp_path / "slide.npz", terrain, density=DENSITY, origin=[EAST, 0, 0]
    )


def test_a_sidecar_beside_the_particles_or_named_is_used(tmp_path, terrain):
    place, velocity = cloud(0)
    turned = place[:, [0, 2, 1]] * [1, 1, -1]
    np.savez(tmp_path / "slide.npz", x=turned, v=velocity, m=np.full(COUNT, MASS))
    said = {"format": "mpmgis-georeference", "format_version": 1, "axes": ["e", "u", "-n"], "density": DENSITY}
    said |= {"origin": ORIGIN.tolist(), "columns": {"mass": "m"}}
    (tmp_path / "slide.georef.json").write_text(json.dumps(said))
    np.testing.assert_allclose(start(tmp_path / "slide.npz", terrain).frame.particles.position, place)
    (tmp_path / "slide.georef.json").rename(tmp_path / "other.json")
    found = start(
        tmp_path / "slide.npz", terrain, sidecar=str(tmp_path / "other.json"), origin=[EAST + 2, NORTH, HEIGHT]
    )
    assert found.frame.origin[0] == EAST + 2


@pytest.mark.parametrize(
    ("release", "word"),
    [
        ({}, "lacks: the density (density R"),
        ({"density": 1.0, "axes": ["e", "u", "n"]}, "axes e,u,n is left-handed"),
        ({"density": 1.0, "axes": ["e", "x", "n"]}, "'x' is not a direction"),
        ({"density": 1.0, "axes": ["e", "n"]}, "expected three words"),
        ({"density": 1.0, "axes": "e,n,u"}, "expected a list of words"),
        ({"density": 1.0, "axes": [1, 2, 3]}, "expected three words"),
        ({"density": 1.0, "origin": [1, 2]}, "expected three numbers"),
        ({"density": 1.0, "origin": ["a", 2, 3]}, "expected three numbers"),
        ({"density": 1.0, "columns": {"heat": "m"}}, "unknown quantity 'heat'"),
        ({"density": 1.0, "columns": {"mass": "nothing"}}, "unknown column"),
        ({"density": 1.0, "columns": {"mass": 3}}, "expected names"),
        ({"density": 1.0, "columns": "mass=m"}, 'expected a table like {mass = "m"}'),
        ({"density": 1.0, "reader": "matlab"}, "unknown reader"),
        ({"density": 1.0, "times": [1.0]}, "at_time"),
        ({"density": 1.0, "at_time": 1.0, "times": []}, "expected numbers"),
        ({"density": 1.0, "at_time": 1.0, "dt": 1.0, "fps": 1.0}, "all set the time"),
        ({"density": 1.0, "particle_volume": 0.0}, "expected above 0"),
        ({"density": 1.0, "sidecar": "nothing.json"}, "nothing.json"),
        ({"density": 1.0, "thickness": 1.0}, "particles have a thickness"),
    ],
)
def test_wrong_keys_are_refused_in_a_line(tmp_path, terrain, release, word):
    place, velocity = cloud(0)
    np.savez(tmp_path / "slide.npz", x=place + ORIGIN, v=velocity, mass=np.full(COUNT, MASS))
    assert word in refused(tmp_path / "slide.npz", terrain, **release)


def test_a_frame_of_a_series_is_chosen_by_its_time(tmp_path, terrain):
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for k, name in enumerate(("position", "velocity")):
            file[name] = np.stack([cloud(step)[k] for step in range(3)])
        file["mass"] = np.full(COUNT, MASS)
    keys = {"density": DENSITY, "axes": ["e", "n", "u"], "origin": ORIGIN.tolist()}
    assert "give times, dt or fps, and at_time" in refused(tmp_path / "all.h5", terrain, **keys)
    found = start(tmp_path / "all.h5", terrain, **keys, dt=2.0, at_time=4.0)
    np.testing.assert_array_equal(found.frame.particles.position, cloud(2)[0])
    found = start(tmp_path / "all.h5", terrain, **keys, times=[0.0, 7.0, 8.0], at_time=7)
    np.testing.assert_array_equal(found.frame.particles.position, cloud(1)[0])
    assert "the nearest frame is at 4 s" in refused(tmp_path / "all.h5", terrain, **keys, dt=2.0, at_time=9.0)
    with h5py.File(tmp_path / "all.h5", "a") as file:
        file["time"] = TIMES
    assert "3 frames, from 0 to 1 s; choose one with at_time" in refused(tmp_path / "all.h5", terrain, **keys)


def test_keys_of_other_codes_are_refused_for_frames_of_mpmgis_and_for_columns(tmp_path, terrain):
    place, velocity = cloud(0)
    particles = Particles(place, velocity, np.full(COUNT, MASS), np.full(COUNT, VOLUME))
    frame = Frame(particles, dimension=3, crs=terrain.grid.crs, origin=(EAST, NORTH, HEIGHT))
    write_frame(tmp_path / "own.h5", frame)
    assert len(start(tmp_path / "own.h5", terrain).frame.particles) == COUNT
    assert len(start(tmp_path / "own.h5", terrain, reader="mpmgis").frame.particles) == COUNT
    for key, value in (("density", 1000.0), ("axes", ["e", "n", "u"]), ("reader", "hdf5")):
        word = refused(tmp_path / "own.h5", terrain, **{key: value})
        assert f"remove {key} from [release]" in word or "is a file of mpmgis" in word
    np.savez(tmp_path / "slide.npz", x=place, v=velocity, mass=np.full(COUNT, MASS))
    with pytest.raises(MpmgisError, match=r"3D points of another code \(npz\), expected columns"):
        columns_of(tmp_path / "slide.npz", terrain, 1000.0)
    given = tables(tmp_path / "slide.npz", terrain, axes=["e", "n", "u"]) | {"solver": "columns"}
    del given["material"]
    with pytest.raises(SceneError, match="axes requires solver = 'points'"):
        scene_from_tables(given)
    given = tables("a.h5", terrain)
    given["release"] = {"source": "r.shp", "axes": ["e", "n", "u"]}
    with pytest.raises(SceneError, match="axes is used only with particles"):
        scene_from_tables(given)


def test_the_keys_come_back_from_text(tmp_path, terrain):
    keys = {"axes": ["e", "u", "-n"], "origin": [1.0, 2.0, 3.0], "columns": {"mass": "m", "position": "a/b c"}}
    keys |= {"at_time": 2.0, "times": [0.0, 2.0], "reader": "hdf5", "particle_volume": 0.5, "sidecar": "s.json"}
    scene = scene_from_tables(tables("a.h5", terrain, **keys))
    (tmp_path / "scene.toml").write_text(scene_text(scene))
    assert scene_from_tables(read_toml(tmp_path / "scene.toml")) == scene
    assert {"a.h5", "s.json"} <= set(scene.files())


@given(st.sampled_from(["e,n,u", "e,u,-n", "n,u,e", "n,-e,u", "-n,u,-e", "u,e,n"]), st.booleans(), st.booleans())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_coordinates_on_the_terrain_are_found_whatever_is_declared(tmp_path, terrain, axes, give_axes, shifted):
    """Only axes e,n,u are assumed; an origin of 0 is assumed for any declared axes."""
    words = tuple(axes.split(","))
    place, velocity = cloud(0)
    there = place + ORIGIN + ([0.0, 1000.0, 0.0] if shifted else [0.0, 0.0, 0.0])
    own = there @ axis_matrix(words).T
    np.savez(tmp_path / "slide.npz", x=own, v=velocity, mass=np.full(COUNT, MASS))
    keys = {"density": DENSITY} | ({"axes": list(words)} if give_axes else {})
    if not shifted and (give_axes or axes == "e,n,u"):
        frame = read_release_particles(scene_from_tables(tables(tmp_path / "slide.npz", terrain, **keys)), terrain)
        np.testing.assert_allclose(frame.particles.position, there, rtol=1e-12)
        assert frame.origin == (0.0, 0.0, 0.0)
    else:
        assert "its origin" in refused(tmp_path / "slide.npz", terrain, **keys)


def test_the_command_says_what_it_assumes(tmp_path, terrain, capsys):
    place, velocity = cloud(0)
    np.savez(tmp_path / "slide.npz", x=place + ORIGIN, v=velocity, mass=np.full(COUNT, MASS), t=0.0)
    words = [
        "export-raster",
        str(tmp_path / "slide.npz"),
        "--density",
        "1500",
        "-o",
        str(tmp_path / "gis"),
        "--no-qgis",
    ]
    assert main(words) == 2
    assert "--axes" in capsys.readouterr().err
    assert main([*words, "--dem", terrain.path, "--products", "t_vol"]) == 0
    said = capsys.readouterr().err
    assert said.count("axes e,n,u and origin 0,0,0 are assumed") == 1 and "60 particles, 180 kg" in said


@pytest.mark.parametrize("up", ["e,u,-n", "n,u,e"])
def test_small_local_coordinates_that_fit_in_two_ways_are_asked_for(tmp_path, up):
    grid = Grid.north_up(None, 0.0, 80.0, 2.0, (40, 40))
    write_geotiff(tmp_path / "dtm.tif", grid, [(Quantity("elevation", "m", ""), np.full((40, 40), 10.0))], {})
    ground = read_terrain(tmp_path / "dtm.tif", crs="local")
    place, velocity = cloud(0)
    np.savez(tmp_path / "slide.npz", x=place[:, [0, 1, 0]], v=velocity, mass=np.full(COUNT, MASS))
    assert "the directions of its axes" in refused(tmp_path / "slide.npz", ground, density=DENSITY)
