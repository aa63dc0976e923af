"""The file beside particles that tells what their format cannot; and what the options say instead."""

import json

import numpy as np
import pyproj
import pytest
import rasterio
from third_party_writers import COUNT, MASS, csv_writer, table, write_kratos_gid, write_npz

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations, find_sidecar, read_sidecar, sidecar_path, write_sidecar
from mpmgis.exchange.frame_list import list_frames
from mpmgis.laws.quantities import Quantity
from mpmgis.system.errors import InputError, MpmgisError
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

UTM = pyproj.CRS.from_epsg(32632)
EAST, NORTH = 600000.0, 5170000.0
WHOLE = Declarations(
    crs=UTM,
    origin=(EAST, NORTH, 0.0),
    axes=("e", "n", "u"),
    density=1500.0,
    particle_volume=0.5,
    columns=(("mass", "m"), ("velocity", "U")),
    times=(0.0, 1.5),
    dem="dtm.tif",
)


def flat_dtm(path):
    """90 m of ground under 60 x 60 m, where the writers' particles lie."""
    grid = Grid.north_up(UTM, EAST, NORTH + 60.0, 1.0, (60, 60))
    write_geotiff(path, grid, [(Quantity("elevation", "m", ""), np.full((60, 60), 90.0))], {})


def test_what_is_written_is_read(tmp_path):
    path = sidecar_path(tmp_path / "slide.ply")
    assert path.name == "slide.georef.json"
    write_sidecar(path, WHOLE)
    said = read_sidecar(path)
    assert said.dem == str(tmp_path / "dtm.tif") and said.crs == UTM
    assert vars(said) == {**vars(WHOLE), "dem": said.dem}
    assert json.loads(path.read_text())["crs"] == "EPSG:32632"
    own = pyproj.CRS.from_proj4("+proj=tmerc +lat_0=46 +lon_0=11 +units=m")
    write_sidecar(path, Declarations(crs=own, frames_per_second=4.0))
    assert read_sidecar(path).crs == own and read_sidecar(path).frames_per_second == 4.0
    write_sidecar(path, Declarations())
    assert vars(read_sidecar(path)) == vars(Declarations())


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("orign", [0, 0, 0], "no key 'orign'"),
        ("origin", [0, 0], "2 numbers, expected three"),
        ("origin", [0, 0, "0"], "expected a list of numbers"),
        ("axes", "e,n,u", "three words"),
        ("axes", ["e", "u", "n"], "mirror image"),
        ("axes", ["e", "x", "n"], "not a direction"),
        ("crs", "EPSG:1", "no such EPSG"),
        ("crs", "somewhere", "expected EPSG:n, WKT or a PROJ string"),
        ("crs", 32632, "expected text"),
        ("density", -1, "above 0"),
        ("density", True, "above 0"),
        ("density", float("nan"), "above 0"),
        ("fps", 0, "above 0"),
        ("times", [], "list of numbers"),
        ("times", [float("inf")], "list of numbers"),
        ("columns", {"heat": "T"}, "unknown quantity 'heat'"),
        ("columns", [["mass", "m"]], "names and columns"),
        ("format", "other", "expected 'mpmgis-georeference'"),
        ("format_version", 2, "reads up to 1"),
        ("format_version", "1", "reads up to 1"),
    ],
)
def test_what_is_no_sidecar_is_refused_in_a_line(key, value, word, tmp_path):
    path = tmp_path / "georef.json"
    content = {"format": "mpmgis-georeference", "format_version": 1} | {key: value}
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=word) as caught:
        read_sidecar(path)
    assert "\n" not in str(caught.value) and "georef.json" in str(caught.value)


def test_times_are_declared_in_one_way(tmp_path):
    path = tmp_path / "georef.json"
    path.write_text(json.dumps({"format": "mpmgis-georeference", "format_version": 1, "fps": 2, "dt": 1}))
    with pytest.raises(InputError, match="all set the time"):
        read_sidecar(path)
    path.write_text("[[[")
    with pytest.raises(InputError, match="not readable JSON"):
        read_sidecar(path)


def test_a_sidecar_is_found_by_the_name_of_the_file_of_the_series_or_of_the_folder(tmp_path):
    for name in ("slide_000012.ply", "slide.post.res", "particles_f3.ply", "MPM_0_0.2000000.vtk", "other.csv"):
        path = tmp_path / name
        assert find_sidecar(path) is None
    series = {"slide": ("slide_000012.ply", "slide.post.res"), "MPM_0": ("MPM_0_0.2.vtk",)}
    for sidecar, names in (series | {"particles": ("particles_f3.ply",)}).items():
        write_sidecar(tmp_path / f"{sidecar}.georef.json", WHOLE)
        assert {find_sidecar(tmp_path / name).name for name in names} == {f"{sidecar}.georef.json"}
    write_sidecar(tmp_path / "georef.json", WHOLE)
    assert find_sidecar(tmp_path / "other.csv").name == "georef.json"
    write_sidecar(tmp_path / "slide_000012.georef.json", WHOLE)
    assert find_sidecar(tmp_path / "slide_000012.ply").name == "slide_000012.georef.json"


def test_an_export_needs_no_option_that_the_sidecar_has(tmp_path, capsys):
    flat_dtm(tmp_path / "dtm.tif")
    folder = tmp_path / "run"
    folder.mkdir()
    write_npz(folder)
    said = Declarations(crs=UTM, origin=(EAST, NORTH, 0.0), axes=("e", "n", "u"), density=1500.0, dem="../dtm.tif")
    write_sidecar(folder / "georef.json", said)
    assert main(["export-raster", str(folder), "-o", str(tmp_path / "gis"), "--no-qgis", "--products", "mass"]) == 0
    told = capsys.readouterr().err
    assert f"step1.npz: 0.5 s, 60 particles, {COUNT * MASS:g} kg, 0.12 m3 at 1500 kg m-3" in told
    with rasterio.open(tmp_path / "gis" / "rasters" / "run_0001.tif") as source:
        names = [word.split(" ")[0] for word in source.descriptions]
        mass = source.read(names.index("mass") + 1, masked=True)
        assert mass.sum() == pytest.approx(COUNT * MASS) and source.crs.to_epsg() == 32632
    assert main(["info", "--json", str(folder)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["to_be_told"] == [] and facts["crs"] == "EPSG:32632" and facts["bbox"][0] == EAST + 22.0
    assert main(["info", "--json", str(folder / "georef.json")]) == 0
    assert json.loads(capsys.readouterr().out)["origin"] == [EAST, NORTH, 0.0]


def test_options_override_the_sidecar(tmp_path):
    write_npz(tmp_path)
    write_sidecar(tmp_path / "georef.json", Declarations(**{**vars(WHOLE), "columns": (), "times": (0.0, 1.0, 2.0)}))
    said = Declarations(density=1000.0, axes=("n", "w", "u"), origin=(1.0, 2.0, 3.0), frame_step=7.0)
    entries = list_frames([tmp_path], said)
    assert [entry.time for entry in entries] == [0.0, 7.0, 14.0]
    assert entries[0].header.origin == (1.0, 2.0, 3.0) and entries[0].header.header["density"] == 1000.0
    first = entries[0].read().particles
    assert first.position[0].tolist() == [-30.0, 20.0, 100.0]  # the file's x points north, its y west
    assert first.volume[0] == 0.5  # what the options leave open
    assert entries[0].header.crs == UTM
    assert list_frames([tmp_path], Declarations.named({}, crs="local"))[0].header.crs is None


def test_columns_of_both_are_taken_together(tmp_path):
    columns = table(0)
    renamed = {"x": "E", "vx": "u", "mass": "m"}
    names = [renamed.get(name, name) for name in columns]
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "slide.csv").write_text("\n".join([",".join(names), *rows]))
    write_sidecar(tmp_path / "slide.georef.json", Declarations(columns=(("x", "E"), ("vx", "z"), ("mass", "m"))))
    said = Declarations(axes=("e", "n", "u"), origin=(0.0, 0.0, 0.0), density=1.0, columns=(("vx", "u"),))
    particles = list_frames([tmp_path / "slide.csv"], said)[0].read().particles
    assert particles.position[1, 0] == 21.0 and particles.velocity[1, 0] == 2.125 and particles.mass[0] == MASS
    assert main(["info", "-q", str(tmp_path / "slide.csv")]) == 0


def test_a_vector_can_be_declared_by_one_name(tmp_path, capsys):
    place, velocity = np.ones((3, 3)), np.full((3, 3), 2.0)
    np.savez(tmp_path / "a.npz", r=place, w=velocity)
    assert main(["info", "--json", str(tmp_path / "a.npz"), "--columns", "position=r,velocity=w"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["own_axes"]["x"] == [1.0, 1.0] and facts["max_speed"] == pytest.approx(np.sqrt(12))
    assert main(["info", str(tmp_path / "a.npz"), "--columns", "position=q"]) == 2
    assert "--columns x=q.x: unknown column" in capsys.readouterr().err


def test_several_sidecars_or_a_missing_one_are_refused(tmp_path):
    write_npz(tmp_path)
    write_sidecar(tmp_path / "step1.georef.json", WHOLE)
    write_sidecar(tmp_path / "step2.georef.json", WHOLE)
    with pytest.raises(MpmgisError, match="the files have different sidecars"):
        list_frames([tmp_path], Declarations())
    with pytest.raises(MpmgisError, match=r"gone\.json"):
        list_frames([tmp_path], Declarations(sidecar=tmp_path / "gone.json"))
    write_sidecar(tmp_path / "elsewhere.json", Declarations(**{**vars(WHOLE), "columns": (), "times": (0.0, 1.0, 2.0)}))
    assert len(list_frames([tmp_path], Declarations(sidecar=tmp_path / "elsewhere.json"))) == 3


def test_lost_particles_in_the_middle_of_a_file_are_reported(tmp_path, capsys):
    flat_dtm(tmp_path / "dtm.tif")
    write_kratos_gid(tmp_path)
    path = tmp_path / "slide.post.res"
    lines = path.read_text().splitlines()
    begin = max(k for k, line in enumerate(lines) if "MP_DISPLACEMENT" in line)
    gone = {line.split()[0] for line in lines[begin + 2 : begin + 12]}
    path.write_text("\n".join(line for k, line in enumerate(lines) if k < begin or line.split()[0] not in gone) + "\n")
    where = ("--axes", "e,n,u", "--origin", f"{EAST},{NORTH},0", "--crs", "EPSG:32632")
    words = ["export-raster", str(path), "--dem", str(tmp_path / "dtm.tif"), "-o", str(tmp_path / "gis"), "--no-qgis"]
    assert main([*words, *where]) == 0
    said = capsys.readouterr().err
    assert "slide.post.res: 0.5 s, 60 particles, 180 kg" in said and "slide.post.res: 1 s, 50 particles, 150 kg" in said
    assert "the last frame has 10 particles and 30 kg less than the first" in said
    assert main(["info", str(path)]) == 0
    assert "lost" in capsys.readouterr().out


def test_times_can_be_declared_for_the_frames_of_one_file(tmp_path):
    (path,) = csv_writer()(tmp_path)
    said = {"axes": ("e", "n", "u"), "origin": (0.0, 0.0, 0.0), "density": 1.0}
    entries = list_frames([path], Declarations(**said, times=(5.0, 6.0, 8.0)))
    assert [entry.time for entry in entries] == [5.0, 6.0, 8.0]
    np.testing.assert_allclose(entries[2].read().particles.position[0], [22.0, 29.0, 99.5])
    with pytest.raises(InputError, match="2 times for 3 frames"):
        list_frames([path], Declarations(**said, times=(5.0, 6.0)))
