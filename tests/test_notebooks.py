"""Every notebook runs from top to bottom, shows its pictures, finds what it must, and is stored with its results."""

import os
import re
import sys
import textwrap
from pathlib import Path

import nbclient
import nbformat
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((REPOSITORY / "notebooks").glob("*.ipynb"))
LARGEST = 5e6  # [bytes] of all together


def test_the_guide_lists_every_notebook():
    assert NOTEBOOKS
    page = (REPOSITORY / "mpmgis" / "docs" / "guide" / "python.md").read_text(encoding="utf-8")
    linked = re.findall(r"/notebooks/(\w+)\.ipynb\)", page)
    assert linked == [path.stem for path in NOTEBOOKS]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_with_results(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            pictures = [output for output in cell.outputs if "image/png" in output.get("data", {})]
            assert len(pictures) == cell.source.count("plt.show()"), f"{path.name}: run it again: make notebooks"
            assert all(output.output_type != "error" and output.get("name") != "stderr" for output in cell.outputs)
            assert "/tmp/" not in str(cell.outputs), "names of folders of one machine"


def test_stored_results_are_small():
    assert sum(path.stat().st_size for path in NOTEBOOKS) < LARGEST


CHECKS = {  # what a notebook must have found, in its own names
    "00_first_map": """
        assert 5 < float(results.h_max.max()) < 30
        assert len(scene) == 5
    """,
    "01_seeding_and_its_error": """
        assert abs(slab.volume.sum() / exact - 1) < 1e-6
        assert abs(raster_error[1.25]) < 0.3 * abs(raster_error[2.5]) < 0.1 * abs(raster_error[5.0])
        assert all(noise["lattice"][k] < 0.02 * noise["random"][k] for k in (1, 2, 3)) and noise["lattice"][0] < 0.03
        for points in KINDS:
            for count in (1_000, 16_000):
                seeded = seed_heap(points=points, count=count)
                volume = mpmgis.read_frame(seeded.path).particles.volume.sum()
                assert abs(volume / seeded.record["reference_volume"] - 1) < 1e-9
        assert errors["thickness"] < 0.03 and errors["equal"] < 0.03 < 0.2 < errors["paper"]
    """,
    "02_depth_averaged_run": """
        assert abs(summary.balances["mass_error_relative"]) < 1e-12
        assert np.ptp(masses) < 1e-9 * masses[0]  # nothing left the terrain
        assert (np.diff(lost) > -1e-3 * lost[-1]).all()
        assert abs(1e9 * lost[-1] / summary.balances["energy_lost"] - 1) < 3e-3  # the solver counts c^2 h / 2
        assert reach[0.15] > reach[0.25] > reach[0.50]
    """,
    "03_columns_to_points_at_a_barrier": """
        assert abs(after["mass"] / before["mass"] - 1) < 1e-12
        assert abs(after["momentum"][0] / before["momentum"][0] - 1) < 1e-12
        assert 0 < moment[hit] / force[hit] < HEIGHT
        assert abs(change + gone - (ground - wall)) < 1e-4 * abs(change)
        assert balances["momentum_error_relative"] < 1e-9
    """,
    "04_accuracy_against_cost": """
        assert off < 0.02
        falling = by_size.error_with_reference.values
        assert falling[0] < falling[1] < falling[2] and 0.5 < order < 2.0
        assert len(compared) == 3
        ratio = compared["error estimated from a finer run"] / compared["exact error"]
        assert ratio.between(0.4, 1.5).all()
    """,
    "05_another_codes_results": """
        assert np.abs(of_mass / volume - 1).max() < 1e-5
        assert np.abs(of_surface / (volume * opened(time)) - 1).max() < 0.06
        assert np.allclose(speed, acceleration * time, rtol=1e-3, atol=1e-3)
        assert abs(same / volume - 1) < 1e-5
    """,
    "06_ensemble_to_probability_map": """
        assert sorted(np.floor((mu - 0.15) / 0.2 * 12).astype(int)) == list(range(12))  # one in each twelfth
        assert mu.corr(runout) < -0.5
        assert abs(share - mapped) < 1e-6
        assert set(bands("probability")) == {"P_h_0.25", "P_arrival"}
    """,
    "07_from_event_to_hazard_map": """
        assert low < TRUE_MU < high and high - low < 0.12
        reach = {name: int((mpmgis.open_results(name).h_max > 0.1).sum()) for name in ("open", "wooded")}
        assert reach["wooded"] < reach["open"] and 0.02 < balances["mass_detrained"] / balances["mass_start"] < 0.9
        assert 0 < balances["forest_broken_area"] < balances["forest_area"]
        assert list(footprints["number"]) == [1, 2, 3] and count.max() >= 2
        total = float((rioxarray.open_rasterio("map/hazard.tif", masked=True)[0] > 0).sum()) * PIXEL**2
        assert abs(sum(hazard.areas) / total - 1) < 0.01 and hazard.areas[-1] > 1e4
    """,
}


def test_every_notebook_is_checked():
    assert set(CHECKS) == {path.stem for path in NOTEBOOKS}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_shows_no_tests_and_uses_the_public_functions_alone(path):
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert "assert " not in cell.source
            assert not re.search(r"\bmpmgis\.\w+\.|from mpmgis", cell.source), cell.source
    first = nbformat.read(path, as_version=4).cells[0]
    assert first.cell_type == "markdown" and first.source.startswith("# ")


def test_the_first_notebook_is_short():
    cells = [cell for cell in nbformat.read(NOTEBOOKS[0], as_version=4).cells if cell.cell_type == "code"]
    statements = [line for cell in cells for line in cell.source.splitlines() if line.strip()]
    assert len(statements) <= 20


def marked(path):
    """`path`, for `make validate` if the notebook takes long and others run the same commands."""
    return pytest.param(path, marks=pytest.mark.slow) if path.stem[:2] in ("04", "07") else path


@pytest.mark.thorough
@pytest.mark.parametrize("path", [marked(path) for path in NOTEBOOKS], ids=lambda path: path.stem)
def test_runs_and_draws_what_it_promises(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")  # the command
    notebook = nbformat.read(path, as_version=4)
    cells = list(notebook.cells)
    notebook.cells.append(nbformat.v4.new_code_cell(textwrap.dedent(CHECKS[path.stem])))
    client = nbclient.NotebookClient(
        notebook, timeout=1200, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()  # raises with the cell and its traceback where one fails
    for cell in cells:
        if cell.cell_type != "code":
            continue
        pictures = [output for output in cell.outputs if "image/png" in output.get("data", {})]
        assert len(pictures) == cell.source.count("plt.show()"), cell.source
        warnings = [output.text for output in cell.outputs if output.get("name") == "stderr"]
        assert not warnings, cell.source
        if "!mpmgis" in cell.source:  # a failed command reports it in one line, which begins with its name
            told = "".join(output.get("text", "") for output in cell.outputs)
            assert not re.search(r"^mpmgis [\w-]+: ", told, re.MULTILINE), told
