"""`mpmgis vertical` on a block of points: tables, plot, what it refuses."""

import PIL.Image
import pytest
from block_frames import DENSITY, MIDDLE, THICKNESS, table, write_block_run
from slope_site import SOUTH, WEST

from mpmgis.commands.shell.main import main
from mpmgis.laws.quantities import GRAVITY

SPEED = 6.0
AT = f"{WEST + 600},{SOUTH + MIDDLE}"  # on level ground


def test_a_block_has_the_force_of_its_momentum(tmp_path, capsys):
    run = write_block_run(tmp_path, (150.0, 600.0), (0.0, 10.0), (0.0, SPEED), dimension=3)
    assert main(["vertical", str(run), "--at", AT, "--at-times", "10", "--width", "40", "--layer", "0.5"]) == 0
    shown = capsys.readouterr().out.splitlines()
    folder = tmp_path / "run_vertical"
    assert shown[-3:] == [str(folder / name) for name in ("vertical.png", "vertical.csv", "loads.csv")]
    (load,) = table(folder / "loads.csv")
    assert float(load["momentum_flux_per_width_N_m"]) == pytest.approx(DENSITY * THICKNESS * SPEED**2, rel=1e-6)
    rows = table(folder / "vertical.csv")
    assert sum(float(row["density_kg_m3"]) * 0.5 for row in rows) == pytest.approx(DENSITY * THICKNESS, rel=1e-6)
    middles = [0.5 * (float(row["height_from_m"]) + float(row["height_to_m"])) for row in rows]
    weight = [GRAVITY * 0.5 * float(row["density_kg_m3"]) for row in rows]
    moment = sum(middle * part for middle, part in zip(middles, weight, strict=True))  # the integral of what lies above
    assert float(load["overburden_force_per_width_N_m"]) == pytest.approx(moment, rel=1e-6)
    assert float(rows[0]["overburden_Pa"]) == pytest.approx(sum(weight) - 0.5 * weight[0], rel=1e-6)
    held = [row for row in rows if row["Ut_m_s"]]
    assert all(float(row["Ut_m_s"]) == pytest.approx(SPEED) for row in held)
    assert sum(int(row["particles"]) for row in rows) == 8 * 8 * 4


def test_no_flow_is_reported(tmp_path, capsys):
    run = write_block_run(tmp_path, (150.0,), (0.0,), dimension=3)
    assert main(["vertical", str(run), "--at", AT, "-o", str(tmp_path / "loads.csv")]) == 0
    assert "no particle is within" in capsys.readouterr().err


@pytest.mark.thorough
def test_of_very_many_points_the_tables_hold_all_and_the_plot_the_first(tmp_path, capsys):
    """A row for each of them would be a picture of 100 000 pixels, which cannot be drawn."""
    run = write_block_run(tmp_path, (150.0,), (0.0,), dimension=3)
    places = [f"{WEST + 600 + k / 10},{SOUTH + MIDDLE}" for k in range(299)] + [f"{WEST + 150},{SOUTH + MIDDLE}"]
    options = [word for place in places for word in ("--at", place)]
    assert main(["vertical", str(run), *options, "-o", str(tmp_path / "v")]) == 0
    assert "and of 298 others at these times" in capsys.readouterr().err
    assert len(table(tmp_path / "v" / "loads.csv")) == 300
    with PIL.Image.open(tmp_path / "v" / "vertical.png") as picture:
        assert 3000 < picture.height < 4000  # ten rows


def test_columns_and_places_off_the_raster_are_refused(tmp_path, capsys):
    run = write_block_run(tmp_path, (150.0,), (0.0,), dimension=3)
    other = tmp_path / "columns"
    other.mkdir()
    columns = write_block_run(other, (150.0,), (0.0,))
    assert main(["export-raster", str(run), "--no-qgis"]) == 0
    for arguments, words in (
        ((columns, "--at", AT), 'run the scene with solver = "points"'),
        ((tmp_path / "run_gis", "--at", AT), "is an export"),
        ((run,), "no point is given"),
        ((run, "--at", f"{WEST - 5},{SOUTH + MIDDLE}"), "is outside"),
        (
            (run, "--at", f"{WEST + 5},{SOUTH + MIDDLE}", "--width", 20),
            "the cell of 20 m around point '400005,5100200'",
        ),
        ((run, "--at", f"{WEST + 150},{SOUTH + MIDDLE}", "--layer", 1e-4), "give a larger --layer"),
    ):
        capsys.readouterr()
        assert main(["vertical", *map(str, arguments)]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and words in said[0], said
    assert not (tmp_path / "run_vertical").exists()
