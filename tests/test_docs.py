"""The pages of mpmgis/docs against the code: names that exist, words that docstrings say, modules that are shown."""

import dataclasses
import importlib
import importlib.util
import inspect
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import geopandas
import h5py
import pytest
import rasterio
import shapely

import mpmgis
from mpmgis.commands.demo_site import sample_folder
from mpmgis.commands.verb import verb_names
from mpmgis.exchange.declarations import KEYS
from mpmgis.frames.run_folder import BARRIER_FILE, FRAME_PATTERN, RECORD_FILE, SCENE_FILE, TERRAIN_FILE
from mpmgis.laws.quantities import BAND, PARTICLE
from mpmgis.scene.tables import TABLES

PACKAGE = Path(mpmgis.__file__).parent
DOCS = PACKAGE / "docs"
THEORY = (DOCS / "theory.md").read_text(encoding="utf-8")
ROLE = re.compile(r"\{py:(?P<kind>func|class|meth|mod)\}`~?(?P<name>[\w.]+)`(?:: \*(?P<words>(?:\\\*|[^*])+)\*)?")
NOT_ON_PAGES = (("commands", "shell"), ("qgis_plugin",), ("__main__",))
FORMATS = (DOCS / "formats.md").read_text(encoding="utf-8")
LINKS = list(ROLE.finditer(THEORY))


def found(name):
    """(the thing of a dotted name, its module)."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        thing = module
        for part in parts[cut:]:
            thing = getattr(thing, part)
        return thing, module
    raise AssertionError(f"no module of {name}")


def plain(words):
    return " ".join(words.replace("\\*", "*").replace("\\|", "|").split())


@pytest.mark.parametrize("link", LINKS, ids=lambda link: link["name"])
def test_docstrings_contain_the_quotes_of_the_theory_page(link):
    thing, module = found(link["name"])
    assert link["words"], f"{link['name']} stands there without its own words"
    said = plain(f"{inspect.getdoc(thing)} {module.__doc__}")
    assert plain(link["words"]) in said, f"{link['name']} says: {said}"


def test_all_links_of_the_theory_page_are_looked_at():
    assert len(LINKS) == THEORY.count("{py:") >= 70


@pytest.mark.skipif(shutil.which("make") is None, reason="no make here")
def test_make_has_a_target_for_the_pages():
    told = subprocess.run(["make", "-n", "docs"], cwd=PACKAGE.parent, capture_output=True, text=True, timeout=60)
    assert told.returncode == 0, told.stderr
    assert ".ci/docs/build.py docs" in told.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The website; any warning fails."""
    for library in ("sphinx", "myst_nb", "pydata_sphinx_theme", "latex2mathml"):
        pytest.importorskip(library, reason="the extra `docs` is not installed")
    folder = tmp_path_factory.mktemp("site") / "html"
    script = PACKAGE.parent / ".ci" / "docs" / "build.py"
    built = subprocess.run([sys.executable, str(script), str(folder)], capture_output=True, text=True, timeout=900)
    assert built.returncode == 0, built.stderr
    return folder


def test_stored_reference_pages_are_those_of_the_program():
    script = PACKAGE.parent / ".ci" / "docs" / "pages.py"
    specification = importlib.util.spec_from_file_location("pages_of_the_site", script)
    specification.loader.exec_module(pages := importlib.util.module_from_spec(specification))
    for name, part in pages.stored_pages().items():
        text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        assert text == pages.with_part(text, part), f"{name}.md is older than the program: python .ci/docs/pages.py"


def modules_by_page():
    """Page of the API -> names of the modules that it must show: all but the command line and the toolbox."""
    pages = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if not any(parts[: len(left)] == left for left in NOT_ON_PAGES) and parts[-1] != "__init__":
            pages.setdefault(".".join(parts[:-1]), set()).add(".".join(parts))
    return pages


@pytest.mark.thorough
def test_the_site_shows_every_module_and_links_the_theory_to_functions(site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count('<a class="reference internal" href="api/') >= len(LINKS)
    for name, modules in modules_by_page().items():
        page = (site / "api" / f"{name}.html").read_text(encoding="utf-8")
        assert set(re.findall(r'id="module-mpmgis\.([\w.]+)"', page)) == modules


@pytest.mark.thorough
def test_the_site_shows_every_public_name_verb_and_scene_table(site):
    api = (site / "api" / "index.html").read_text(encoding="utf-8")
    assert all(re.search(rf"\b{name}\b", api) for name in mpmgis.__all__)
    for verb in verb_names():
        assert (site / "reference" / "commands" / f"{verb}.html").is_file()
    seed = (site / "reference" / "commands" / "seed.html").read_text(encoding="utf-8")
    assert all(option in seed for option in ("--dem", "--thickness-mode", "--for"))
    scene = (site / "reference" / "scene.html").read_text(encoding="utf-8")
    for name, kind in TABLES.items():
        assert f"[{name}]" in scene
        assert all(f">{f.name}<" in scene for f in dataclasses.fields(kind) if "kind" in f.metadata)


@pytest.mark.thorough
def test_the_site_loads_nothing_from_the_network(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=\"(?:https?:)?//", text), page
        assert "mathjax" not in text.lower(), page


@pytest.mark.thorough
def test_the_site_draws_formulas_and_shows_text_beside_hits_of_the_search(site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count('<div class="formula"><math') == len(re.findall("^```math$", THEORY, re.MULTILINE))
    assert "Section Navigation" not in theory
    texts = (site / "_static" / "page_texts.js").read_text(encoding="utf-8")
    sections = dict(json.loads(texts.removeprefix("var PAGE_TEXTS = ").rstrip(";\n"))["guide/region"])
    assert "energy line" in sections["windows"]
    assert 'src="_static/page_texts.js' in (site / "search.html").read_text(encoding="utf-8")


def table_rows(heading):
    """Rows of the tables under a heading of the page of formats: lists of cells."""
    after = FORMATS.split(f"\n## {heading}", 1)[1].split("\n## ", 1)[0]
    rows = [line[1:-1].split("|") for line in after.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row] for row in rows]


def names(heading):
    """What stands in backticks in the first cells under a heading."""
    return {name for row in table_rows(heading) for name in re.findall(r"`([^`]+)`", row[0])}


@pytest.mark.parametrize("heading, quantities", [("A frame", PARTICLE), ("An export", BAND)])
def test_quantities_stand_on_the_page_as_the_code_has_them(heading, quantities):
    rows = {row[0]: row for row in table_rows(heading)}
    for quantity in quantities.values():
        assert rows[f"`{quantity.name}`"][-2:] == [quantity.unit, quantity.long_name]


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """The sample site for four seconds, exported, with its runout and a profile: the folder."""
    folder = tmp_path_factory.mktemp("formats")
    site = sample_folder()
    scene = tomllib.loads((site / "scene.toml").read_text(encoding="utf-8"))
    scene["terrain"]["dem"] = str(site / scene["terrain"]["dem"])
    scene["release"]["source"] = str(site / scene["release"]["source"])
    scene["output"] |= {"end_time": 4.0, "frame_interval": 2.0}
    mpmgis.run(scene, folder / "results")
    mpmgis.export_raster(folder / "results", products=("t_vol",))
    with rasterio.open(scene["terrain"]["dem"]) as dtm:
        middle, crs = (dtm.bounds.bottom + dtm.bounds.top) / 2, dtm.crs
        line = shapely.LineString([(dtm.bounds.left + 100, middle), (dtm.bounds.right - 100, middle)])
    geopandas.GeoDataFrame(geometry=[line], crs=crs).to_file(folder / "line.gpkg")
    for words in (["runout"], ["profile", "--line", str(folder / "line.gpkg")]):
        command = [sys.executable, "-m", "mpmgis", *words, str(folder / "results"), "-q"]
        subprocess.run(command, check=True, timeout=200)
    return folder


def test_root_attributes_of_a_frame(chain):
    with h5py.File(chain / "results" / "frame_000001.h5") as file:
        assert set(file.attrs) <= names("A frame")
        assert set(file["particles"]) <= names("A frame")
        assert {"time", "origin", "dem", "digest", "content_sha256", "result_sha256"} <= set(file.attrs)


def test_files_and_record_of_a_run(chain):
    told = names("A run")
    record = json.loads((chain / "results" / "run.json").read_text(encoding="utf-8"))
    assert set(record) <= told
    for path in (chain / "results").iterdir():
        assert path.name.startswith(".") or any(path.match(name) for name in told), path.name
    assert {FRAME_PATTERN, SCENE_FILE, RECORD_FILE, TERRAIN_FILE, BARRIER_FILE} <= told


def test_files_and_tags_of_an_export(chain):
    told = names("An export")
    for name in ("0000", "max", "last"):
        with rasterio.open(chain / "results_gis" / "rasters" / f"results_{name}.tif") as raster:
            assert set(raster.tags(ns="mpmgis")) <= told
            assert {band.split(" [")[0] for band in raster.descriptions} <= told
    for name in ("results.qgz", "results.nc", "results.gpkg", "dtm.tif", "results_h.vrt"):
        assert name in told and (chain / "results_gis" / name).is_file()


def test_keys_of_a_sidecar():
    assert set(KEYS) | {"format", "format_version"} == names("Other codes' particles")


def test_columns_of_tables(chain):
    rows = {}
    for name, of, columns in table_rows("Tables"):
        rows[name.strip("`"), of.strip("`")] = re.findall(r"`(\w+)`", columns)
    for command, name, of in (
        ("runout", "runout.csv", "mpmgis runout"),
        ("runout", "mass_over_time.csv", ""),
        ("runout", "profile.csv", ""),
        ("profile", "profile.csv", "mpmgis profile"),
    ):
        header = (chain / f"results_{command}" / name).read_text(encoding="utf-8").splitlines()[0]
        assert header.split(",") == rows[name, of]
