"""Another code's particle files through the commands: a tiny run in Matter's form, and the real one where it is."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import rasterio
from exporting import CRS, write_run

from mpmgis.commands.shell.main import main
from mpmgis.exchange.declarations import Declarations, axis_matrix
from mpmgis.exchange.frame_list import list_frames
from mpmgis.laws.quantities import Quantity
from mpmgis.system.errors import FormatError, InputError
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff

WEST, SOUTH, COUNT, VOLUME, DENSITY = 600000.0, 5170000.0, 400, 0.25, 1500.0
COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "p", "q", "Je", "eps_pl_dev")
TOLD = ("--crs", "EPSG:32632", "--origin", "600000,5170000,0", "--axes", "e,u,-n", "--density", "1500")
DATA = Path(__file__).parents[2] / "../shared/data/matter_terrain"
with_data = pytest.mark.skipif(not DATA.is_dir(), reason="no third-party data: ../shared/data/matter_terrain")


def particles(number, count=COUNT):
    """float64[count, 10] in Matter's axes: a sheet that moves 4 m east and 1 m north a frame, 2 of 5 under the bed."""
    k = np.arange(count)
    east, north = 20.0 + (k % 20) + 4.0 * number, 30.0 + (k // 20) + 1.0 * number
    up = 100.0 - 0.3 * east + np.where(k % 5 < 2, -0.4, 0.8)
    flow = np.tile([8.0, -2.4, -2.0], (count, 1))  # vx, vy (up), vz (south)
    return np.column_stack([east, up, -north, flow, np.zeros((count, 4))])


def write_ply(path, rows, columns=COLUMNS, order="<", kind="double"):
    """A PLY as Matter writes it."""
    word = "little" if order == "<" else "big"
    head = [f"ply\nformat binary_{word}_endian 1.0\nelement vertex {len(rows)}"]
    head += [f"property {kind} {name}" for name in columns] + ["end_header\n"]
    path.write_bytes("\n".join(head).encode() + rows.astype(f"{order}f{8 if kind == 'double' else 4}").tobytes())


@pytest.fixture
def site(tmp_path):
    """A plane of 0.3 under 100 x 80 m, three frames and an info.txt."""
    grid = Grid.north_up(CRS, WEST, SOUTH + 80.0, 2.0, (40, 50))
    x, _ = grid.xy(*np.indices(grid.shape))
    write_geotiff(tmp_path / "dtm.tif", grid, [(Quantity("elevation", "m", ""), 100.0 - 0.3 * (x - WEST))], {})
    folder = tmp_path / "matter"
    folder.mkdir()
    for number in (0, 3, 10):  # numbers are not padded: 10 comes last, not between 0 and 3
        write_ply(folder / f"particles_f{number}.ply", particles(number / 3))
    (folder / "info.txt").write_text(f"10\n2\n1.0\n{COUNT}\n{VOLUME}\n")
    return tmp_path


def export(site, *options, frames=("matter",)):
    words = [str(site / name) for name in frames]
    return main(
        ["export-raster", *words, "--dem", str(site / "dtm.tif"), "-o", str(site / "gis"), "--overwrite", *options]
    )


def refused(capsys, site, *options, frames=("matter",)):
    """The one line that an export is refused with; nothing may be left behind."""
    assert export(site, *options, frames=frames) == 2
    said = capsys.readouterr()
    assert not said.out and not (site / "gis").exists() and len(said.err.strip().splitlines()) == 1
    return said.err


def band(site, file, name):
    with rasterio.open(site / "gis" / "rasters" / file) as source:
        names = [description.split(" ")[0] for description in source.descriptions]
        return source.read(names.index(name) + 1, masked=True), source.tags(ns="mpmgis")


def test_axes_times_mass_and_place_come_out_on_the_map(site, capsys):
    assert export(site, *TOLD, "--products", "t_vol,Ut_E,Ut_N", "--cs-e", "2", "--no-qgis") == 0
    said = capsys.readouterr().err
    for number, time in ((0, 0), (3, 1.5), (10, 5)):  # two frames a second, as info.txt says
        line = f"particles_f{number}.ply: {time:g} s, 400 particles, 150000 kg, 100 m3 at 1500 kg m-3; 40 % of the mass"
        assert line in said
    thickness, tags = band(site, "matter_0001.tif", "t_vol")
    assert float(tags["time"]) == 1.5 and float(tags["density"]) == DENSITY
    upright = 1 / np.sqrt(1 + 0.3**2)
    assert thickness.sum() * 4.0 / upright == pytest.approx(COUNT * VOLUME, rel=1e-6)
    row, column = np.nonzero(thickness > 0)
    with rasterio.open(site / "gis" / "rasters" / "matter_0001.tif") as source:
        east, north = np.array(source.xy(row, column))
    assert (east.min() - WEST, east.max() - WEST) == (25.0, 43.0)
    assert (north.min() - SOUTH, north.max() - SOUTH) == (31.0, 49.0)
    wet = thickness > 0
    np.testing.assert_allclose(band(site, "matter_0001.tif", "Ut_E")[0][wet], 8.0, rtol=1e-5)
    np.testing.assert_allclose(band(site, "matter_0001.tif", "Ut_N")[0][wet], 2.0, rtol=1e-5)


def test_the_standoff_moves_the_surface_and_the_share_below_the_dtm_is_reported(site, capsys):
    assert export(site, *TOLD, "--standoff", "auto", "--no-qgis") == 0
    said = capsys.readouterr().err
    assert "--standoff auto: -0.383 m" in said  # 0.4 m, along the normal
    assert "40 % of the mass below the DTM" in said
    depth, _ = band(site, "matter_0001.tif", "h")
    assert depth.max() == pytest.approx(1.2 / np.sqrt(1.09), rel=1e-5)


def test_all_missing_declarations_are_listed_in_one_line(site, capsys):
    line = refused(capsys, site)
    for option in ("--density", "--axes e,u,-n", "--origin"):
        assert option in line
    assert "--particle-volume" not in line and "--fps" not in line  # info.txt says them
    (site / "matter" / "info.txt").unlink()
    assert "--particle-volume" in refused(capsys, site, *TOLD)
    assert "--fps F" in refused(capsys, site, *TOLD, "--particle-volume", "0.25")


@pytest.mark.parametrize(
    ("option", "times"),
    [(("--fps", "4"), (0, 0.75, 2.5)), (("--dt", "3"), (0, 9, 30)), (("--times", "5,6,8"), (5, 6, 8))],
)
def test_the_user_can_declare_the_times(site, capsys, option, times):
    assert export(site, *TOLD, *option, "--no-qgis") == 0
    assert [float(band(site, f"matter_{k:04d}.tif", "h")[1]["time"]) for k in range(3)] == list(times)


def test_volume_density_and_columns_can_be_declared(site, capsys):
    assert export(site, *TOLD[:-1], "1000", "--particle-volume", "0.5", "--no-qgis") == 0
    assert "200000 kg, 200 m3 at 1000 kg m-3" in capsys.readouterr().err
    renamed = ("x", "y", "z", "u", "v", "w", "p", "q", "Je", "vx", "vy", "m")
    rows = np.column_stack([particles(0)[:, :9], np.zeros((COUNT, 2)), np.full(COUNT, 3.0)])
    write_ply(site / "matter" / "particles_f0.ply", rows, renamed)
    told = "vx=u,vy=v,vz=w,mass=m"
    assert export(site, *TOLD, "--columns", told, "--no-qgis", frames=("matter/particles_f0.ply",)) == 0
    assert "1200 kg" in capsys.readouterr().err
    speed, _ = band(site, "matter_0000.tif", "Ut")
    assert speed.max() == pytest.approx(np.sqrt(8.0**2 + 2.0**2 + 2.4**2), rel=1e-5)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--axes", "e,u,n"), "mirror image"),
        (("--axes", "e,e,n"), "orthogonal"),
        (("--axes", "e,x,n"), "not a direction"),
        (("--origin", "0,0"), "three numbers"),
        (("--times", "1,2"), "2 times for 3 frames"),
        (("--fps", "2", "--dt", "1"), "give only one"),
        (("--columns", "mass=m"), "unknown column"),
        (("--columns", "heat=p"), "unknown quantity 'heat'"),
        (("--columns", "mass"), "NAME=COL"),
        (("--reader", "mattr"), "choose from mpmgis, matter"),
        (("--reader", "mpmgis"), "no frame (*.h5)"),
        (("--origin", "0,0,0"), "none of its 400 particles"),
    ],
)
def test_nonsense_is_refused_in_one_line(site, capsys, options, word):
    try:
        line = refused(capsys, site, *TOLD, *options)
    except SystemExit as stopped:  # argparse
        assert stopped.code == 2
        line = capsys.readouterr().err
    assert word in line and "Traceback" not in line


def test_options_of_other_codes_are_refused_for_our_own_frames(tmp_path, capsys):
    write_run(tmp_path / "run", times=(0.0,))
    assert main(["export-raster", str(tmp_path / "run"), "--axes", "e,n,u"]) == 2
    assert "--axes is only for files of other codes" in capsys.readouterr().err
    assert main(["info", str(tmp_path / "run"), "--fps", "2"]) == 2
    assert "--fps requires one" in capsys.readouterr().err


def test_an_unknown_file_is_refused_with_the_known_formats(tmp_path, capsys):
    (tmp_path / "grid.mdpa").write_text("Begin Properties 0\nEnd Properties\n")
    assert main(["export-raster", str(tmp_path / "grid.mdpa")]) == 2
    said = capsys.readouterr().err
    assert "neither a frame of mpmgis" in said and "cbgeo, kratos" in said and said.count("\n") == 1


def test_two_codes_at_once_are_refused(site, capsys, tmp_path):
    write_run(tmp_path / "run", times=(0.0,))
    assert "the frames of one code" in refused(capsys, site, *TOLD, frames=("matter", "run"))


def write_flat(path):
    """Particles of a run in two dimensions: no z."""
    kept = [0, 1, 3, 4, 6, 7, 8]
    write_ply(path, particles(0)[:, kept], [COLUMNS[k] for k in kept])


@pytest.mark.parametrize(
    ("damage", "word"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-100]), "truncated"),
        (
            lambda path: path.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n1 2 3\n"),
            "lacks format",
        ),
        (lambda path: path.write_bytes(b"ply\nformat binary_pdp\nend_header\n"), "format binary_pdp"),
        (lambda path: path.write_bytes(b"ply\nformat\nend_header\n"), "is incomplete"),
        (lambda path: path.write_bytes(b"solid"), "not a PLY"),
        (write_flat, "two-dimensional"),
        (lambda path: write_ply(path, particles(0)[:, :6], (*COLUMNS[:5], "mass")), "lacks Je"),
        (lambda path: write_ply(path, particles(0)[:0]), "no particle"),
        (lambda path: write_ply(path, particles(0)[:50]), "info.txt has 400 particles"),
        (lambda path: (path.parent / "info.txt").write_text("1 2 3"), "five numbers"),
    ],
)
def test_damaged_files_are_refused_by_name(site, damage, word):
    path = site / "matter" / "particles_f0.ply"
    damage(path)
    with pytest.raises(FormatError, match=word):
        list_frames([path], Declarations(reader="matter"))


def test_values_that_are_not_finite_are_named(site, capsys):
    rows = particles(0)
    rows[17, 4] = np.nan
    write_ply(site / "matter" / "particles_f0.ply", rows)
    assert "1 values of vy are NaN or infinite, the first in row 17" in refused(capsys, site, *TOLD)


def test_particles_that_a_code_lost_are_reported(site, capsys):
    write_ply(site / "matter" / "particles_f10.ply", particles(10 / 3, COUNT - 40))
    (site / "matter" / "info.txt").unlink()
    assert export(site, *TOLD, "--fps", "2", "--particle-volume", "0.25", "--no-qgis") == 0
    assert "the last frame has 40 particles and 1.5e+04 kg less than the first" in capsys.readouterr().err


@pytest.mark.parametrize(("order", "kind"), [("<", "double"), (">", "double"), ("<", "float")])
def test_byte_orders_and_precisions_read_the_same(site, order, kind):
    path = site / "matter" / "particles_f0.ply"
    write_ply(path, particles(0), order=order, kind=kind)
    terms = Declarations(origin=(WEST, SOUTH, 0.0), axes=("e", "u", "-n"), density=DENSITY)
    frame = list_frames([path], terms)[0].read()
    x, y, z = particles(0)[:, :3].T
    np.testing.assert_allclose(frame.particles.position, np.column_stack([x, -z, y]), atol=1e-5)
    np.testing.assert_allclose(frame.particles.velocity[0], [8.0, 2.0, -2.4], rtol=1e-6)
    assert frame.header["cell_size"] == 1.0 and frame.dimension == 3


def test_axes_are_rotations_and_may_be_named_by_either_side():
    np.testing.assert_array_equal(axis_matrix(("e", "u", "-n")), axis_matrix(("-w", "-d", "s")))
    assert np.linalg.det(axis_matrix(("e", "u", "-n"))) == pytest.approx(1.0)
    with pytest.raises(InputError, match="mirror"):
        axis_matrix(("n", "e", "u"))


def test_info_prints_present_and_missing_quantities(site, capsys):
    path = str(site / "matter" / "particles_f3.ply")
    assert main(["info", "--json", path]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["reader"], facts["n"], facts["time"], facts["volume"]) == ("matter", COUNT, 1.5, 100.0)
    assert facts["mass"] is facts["bbox"] is facts["crs"] is None
    assert facts["own_axes"]["x"] == [24.0, 43.0] and len(facts["to_be_told"]) == 3
    assert main(["info", "--json", path, str(site / "matter"), *TOLD]) == 0
    file, folder = map(json.loads, capsys.readouterr().out.splitlines())
    assert file["mass"] == 150000.0 and file["crs"] == "EPSG:32632" and not file["to_be_told"]
    assert file["bbox"] == [WEST + 24, SOUTH + 31, WEST + 43, SOUTH + 50]
    assert (folder["kind"], folder["frames"], folder["first_time"], folder["time"]) == ("results", 3, 0.0, 5.0)
    assert main(["info", path]) == 0
    assert re.search(r"to be told +the density", capsys.readouterr().out)


def test_a_run_of_columns_that_goes_on_as_points_is_exported_as_one(tmp_path, capsys):
    columns = write_run(tmp_path / "run", times=(0.0, 1.0), dimension=2)
    points = write_run(tmp_path / "more", times=(2.0, 3.0), dimension=3, count=900)
    for step, path in enumerate(points, start=2):
        path.rename(columns[0].parent / f"frame_{step:06d}.h5")
    assert main(["export-raster", str(tmp_path / "run"), "-o", str(tmp_path / "gis"), "--products", "n"]) == 0
    said = capsys.readouterr().err
    assert "frames up to frame_000001.h5 are columns, frame_000002.h5 is points" in said
    numbers = [band(tmp_path, f"run_{k:04d}.tif", "n")[0].sum() for k in range(4)]
    assert numbers == [300, 300, 900, 900]


@with_data
def test_the_real_run_keeps_its_volume_and_lies_under_its_dtm(tmp_path, capsys):
    told = ("--crs", "EPSG:32632", "--origin", "600000,5170000,0", "--axes", "e,u,-n", "--density", "1500")
    dem = str(DATA / "terrain_epsg32632.asc")
    words = ["export-raster", str(DATA), "--dem", dem, "-o", str(tmp_path / "gis"), *told, "--products", "t_vol"]
    assert main([*words, "--no-qgis"]) == 0
    said = capsys.readouterr().err
    for number, share in ((0, 0), (9, 23), (18, 44), (30, 47)):
        line = re.search(rf"particles_f{number}.ply: {number} s, 38853 particles, .* 18732.6 m3 .*; (\d+) % of", said)
        assert abs(int(line[1]) - share) <= (1 if number in (0, 30) else 40)
    assert "info.txt" not in said
