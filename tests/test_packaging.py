"""Wheel, sdist and conda recipe: complete, made of this checkout alone, and what is installed from them works."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import numpy
import pytest
import yaml
from packaging.requirements import Requirement

import mpmgis
from mpmgis.maps.qgis.xml_markup import TEMPLATES

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHON_MIN = PROJECT["requires-python"].split(",")[0].removeprefix(">=")
RECIPE = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text(encoding="utf-8").replace("${{ python_min }}", PYTHON_MIN)
ON_CONDA = {  # names that differ on conda-forge
    "dask": "dask-core",
    "dask[distributed]": "dask",
    "geopandas": "geopandas-base",
    "matplotlib": "matplotlib-base",
    "imageio[ffmpeg]": "imageio",
    "netCDF4": "netcdf4",
}
OPTIONAL = (
    "animation",
    "cluster",
    "gpu",
    "parquet",
    "player",
    "pointcloud",
    "zarr",
)  # extras for users; the others are for work on mpmgis
NO_BACKEND = ("Could not find a version", "No matching distribution", "Connection", "Temporary failure", "Max retries")
IN_THE_WHEEL = (
    *("py.typed", "__init__.pyi", "docs/limits.md", "docs/tutorial.md", "docs/formats.md", "docs/theory.md"),
    *(
        "docs/api/index.md",
        "docs/guide/run-2d.md",
        "docs/reference/index.md",
        "results/hazard/guidelines.toml",
        "results/hazard/hazard_matrices.toml",
        "results/reports/flow_player.js",
    ),
    *("qgis_plugin/mpmgis_qgis/metadata.txt", "qgis_plugin/mpmgis_qgis/icon.svg", "qgis_plugin/mpmgis_qgis/LICENSE"),
    *("sample_data/lava_falls/scene.toml", "sample_data/lava_falls/lava_falls_release.shp"),
    "sample_data/lava_falls/lava_falls_dem_utm12n_10m.tif",
)
FOR_DEVELOPERS = {
    f"mpmgis/{name}"
    for name in ("ARCHITECTURE.md", *(f"docs/{name}.md" for name in ("contributing", "decisions", "index")))
}
FAST_TESTS = ("tests/conversion", "tests/qgis_plugin/test_own_environment.py")  # run from the sdist


# ------------------------------------------------------------------------------------------------------- the recipe


def on_conda(requirement):
    """A requirement of pyproject.toml as conda-forge writes it."""
    asked = Requirement(requirement)
    name = asked.name + (f"[{','.join(sorted(asked.extras))}]" if asked.extras else "")
    return ON_CONDA.get(name, asked.name), set(str(asked.specifier).split(","))


def of_recipe(line):
    """(name, set of ranges) of a line of the recipe."""
    name, _, ranges = line.partition(" ")
    return name, set(ranges.split(",")) if ranges else set()


def test_the_recipe_asks_for_what_the_package_asks_for():
    wanted = dict(on_conda(requirement) for requirement in PROJECT["dependencies"])
    wanted["python"] = set(PROJECT["requires-python"].split(","))
    lines = yaml.safe_load(RECIPE)["requirements"]["run"]
    assert dict(map(of_recipe, lines)) == wanted and len(lines) == len(wanted)


def test_the_recipe_constrains_what_the_extras_bring():
    extras = PROJECT["optional-dependencies"]
    wanted = dict(on_conda(some) for name in OPTIONAL if name != "gpu" for some in extras[name])
    assert dict(map(of_recipe, yaml.safe_load(RECIPE)["requirements"]["run_constraints"])) == wanted


def test_the_recipe_has_the_package_s_version_licence_command_and_builder():
    recipe = yaml.safe_load(RECIPE)
    assert re.search(r"^  version: (\S+)$", RECIPE, re.MULTILINE)[1] == mpmgis.__version__
    assert recipe["about"]["license"] == PROJECT["license"] and (ROOT / recipe["about"]["license_file"]).exists()
    (command,) = recipe["build"]["python"]["entry_points"]
    assert command == f"mpmgis = {PROJECT['scripts']['mpmgis']}"
    assert f'python_min: "{PYTHON_MIN}"' in RECIPE
    (backend,) = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert on_conda(backend) in [of_recipe(line) for line in recipe["requirements"]["host"]]


def test_the_recipe_has_what_the_linter_of_conda_forge_asks_for():
    recipe = yaml.safe_load(RECIPE)
    urls = {key: PROJECT["urls"][key.title()] for key in ("homepage", "repository", "documentation")}
    assert {key: recipe["about"][key] for key in urls} == urls
    assert recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["extra"]["recipe-maintainers"] and recipe["build"]["noarch"] == "python"
    assert f"python {PYTHON_MIN}.*" in recipe["requirements"]["host"]
    assert (
        recipe["tests"][0]["python"]["pip_check"]
        and recipe["tests"][0]["python"]["python_version"] == f"{PYTHON_MIN}.*"
    )
    order = ["schema_version", "context", "package", "source", "build", "requirements", "tests", "about", "extra"]
    assert list(recipe) == order


def test_addresses_have_one_place():
    """Where `.invalid` stands elsewhere, an address would be forgotten when the public ones are set."""
    placeholder = "mpmgis.invalid"
    holders = {
        path.relative_to(ROOT).as_posix()
        for pattern in ("*.md", "*.toml", ".ci/**/*", "mpmgis/**/*.py", "mpmgis/**/*.md", "mpmgis/**/*.txt")
        for path in ROOT.glob(pattern)
        if path.is_file() and placeholder.encode() in path.read_bytes()
    }
    assert holders <= {"pyproject.toml", ".ci/conda/recipe.yaml"}


def test_extras_are_what_messages_name_and_tests_have_all_of_them():
    from mpmgis.system.optional_libraries import LIBRARIES

    extras = PROJECT["optional-dependencies"]
    for extra, library in LIBRARIES.items():
        assert [some.split(">")[0] for some in extras[extra]] == [library]
    for extra in set(OPTIONAL) - {"gpu"}:
        assert set(extras[extra]) <= set(extras["test"])


def test_every_extra_is_named_where_users_install():
    assert set(PROJECT["optional-dependencies"]) - {"docs", "test", "test-gpu"} == set(OPTIONAL)
    for page in (ROOT / "README.md", ROOT / ".ci/package_page.md", ROOT / "mpmgis/docs/guide/install.md"):
        text = page.read_text(encoding="utf-8")
        assert not [extra for extra in OPTIONAL if f"mpmgis[{extra}]" not in text], page.name


def test_the_changelog_has_an_unreleased_part_and_dated_releases_with_the_version_on_top():
    heads = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert heads[0] == "Unreleased"
    released = [re.fullmatch(r"(\d+\.\d+\.\d+) - \d{4}-\d\d-\d\d", head) for head in heads[1:]]
    assert all(released)
    assert not released or released[0][1] == mpmgis.__version__


# ---------------------------------------------------------------------------------------------------- wheel and sdist


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of what git tracks, or would track, and nothing else."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listing.returncode:
        pytest.skip("no git checkout")
    folder = tmp_path_factory.mktemp("build") / "checkout"
    for name in listing.stdout.split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder


def built(source, output, kind):
    """The file that `python -m build` makes; skips where the backend cannot be had."""
    command = [sys.executable, "-m", "build", f"--{kind}", "--outdir", str(output), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    told = done.stdout + done.stderr
    if done.returncode and any(word in told for word in NO_BACKEND):
        pytest.skip("setuptools >= 77 is not to be had here: " + told.strip().splitlines()[-1][:150])
    assert done.returncode == 0, told[-3000:]
    (file,) = output.iterdir()
    return file


@pytest.fixture(scope="module")
def wheel(checkout):
    return built(checkout, checkout.parent / "wheel", "wheel")


@pytest.fixture(scope="module")
def sdist(checkout):
    return built(checkout, checkout.parent / "sdist", "sdist")


def contents(path):
    """Name -> bytes of every file in a wheel or sdist; of an sdist without its folder."""
    if path.suffix == ".whl":
        with zipfile.ZipFile(path) as archive:
            return {member.filename: archive.read(member) for member in archive.infolist() if not member.is_dir()}
    with tarfile.open(path) as archive:
        files = [member for member in archive.getmembers() if member.isfile()]
        return {member.name.partition("/")[2]: archive.extractfile(member).read() for member in files}


@pytest.mark.slow
def test_the_wheel_holds_all_that_the_package_is_and_names_no_machine(wheel, checkout):
    assert wheel.name == f"mpmgis-{mpmgis.__version__}-py3-none-any.whl"
    files = contents(wheel)
    modules = {path.relative_to(checkout).as_posix() for path in (checkout / "mpmgis").rglob("*.py")}
    pages = {path.relative_to(checkout).as_posix() for path in (checkout / "mpmgis").rglob("*.md")} - FOR_DEVELOPERS
    site = {f"mpmgis/sample_data/lava_falls/{path.name}" for path in (checkout / "sample_data/lava_falls").iterdir()}
    templates = {f"mpmgis/maps/qgis/templates/{path.name}" for path in TEMPLATES.iterdir()}
    assert modules | pages | site | templates | {f"mpmgis/{name}" for name in IN_THE_WHEEL} <= set(files)
    assert not FOR_DEVELOPERS & set(files)
    others = {name for name in files if not name.startswith("mpmgis/")}
    assert all(name.startswith(f"mpmgis-{mpmgis.__version__}.dist-info/") for name in others)
    assert any(name.endswith("/LICENSE") for name in others)
    for name, content in files.items():
        assert not name.endswith((".pyc", ".nbi", ".nbc")), name
        for place in (str(checkout.parent), str(ROOT), str(Path.home())):
            assert place == "/" or f"{place}/".encode() not in content, f"{name} names {place}"


@pytest.mark.slow
def test_the_sdist_makes_the_same_wheel(sdist, wheel, checkout):
    with tarfile.open(sdist) as archive:
        archive.extractall(checkout.parent / "unpacked", filter="data")
    (source,) = (checkout.parent / "unpacked").iterdir()
    again = built(source, checkout.parent / "again", "wheel")
    digests = [
        {name: hashlib.sha256(content).hexdigest() for name, content in contents(path).items()}
        for path in (wheel, again)
    ]
    assert digests[0] == digests[1]


@pytest.mark.slow
def test_the_sdist_has_all_of_the_repository_and_nothing_else(sdist, checkout):
    tracked = {path.relative_to(checkout).as_posix() for path in checkout.rglob("*") if path.is_file()}
    tracked = {name for name in tracked if not name.startswith(("build/", "mpmgis.egg-info/"))}
    made = {
        name for name in contents(sdist) if name in ("PKG-INFO", "setup.cfg") or name.startswith("mpmgis.egg-info/")
    }
    assert set(contents(sdist)) - made == tracked


@pytest.mark.slow
def test_tests_run_from_the_sdist(sdist, tmp_path):
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    environment = {**os.environ, "PYTHONPATH": str(source)}
    for words in (["--collect-only", "-q", "-m", ""], ["-q", "-p", "no:xdist", *FAST_TESTS]):
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *words]
        done = subprocess.run(command, cwd=source, env=environment, capture_output=True, text=True, timeout=280)
        assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.slow
def test_the_package_index_takes_wheel_and_sdist(wheel, sdist):
    pytest.importorskip("twine", reason="twine is not installed")
    command = [sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    (metadata,) = (
        content.decode() for name, content in contents(wheel).items() if name.endswith(".dist-info/METADATA")
    )
    for name, address in PROJECT["urls"].items():
        assert f"Project-URL: {name}, {address}\n" in metadata


@pytest.mark.slow
def test_the_installed_wheel_works(wheel, tmp_path):
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "venv")], check=True)
    python = tmp_path / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    install = ["pip", "--python", str(python), "install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", *install], check=True, capture_output=True)
    (site,) = (
        (tmp_path / "venv").glob("[Ll]ib*/**/site-packages")
        if os.name == "nt"
        else ((tmp_path / "venv" / "lib").glob("python*/site-packages"))
    )
    (site / "zz_libraries.pth").write_text(f"{Path(numpy.__file__).parents[1]}\n")

    def run(*words):
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(
            [str(python.with_name("mpmgis")), *words],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env=environment,
            timeout=280,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert run("--version") == f"mpmgis {mpmgis.__version__}\n"
    assert "sample site" in run("demo", "--help")
    place = subprocess.run(
        [str(python), "-c", "import mpmgis; print(mpmgis.__file__)"], capture_output=True, text=True, cwd=tmp_path
    )
    assert Path(place.stdout.strip()).is_relative_to(site)
    sample = site / "mpmgis" / "sample_data" / "lava_falls"
    dem, release = sample / "lava_falls_dem_utm12n_10m.tif", sample / "lava_falls_release.shp"
    written = run("seed", "--dem", str(dem), "--release", str(release), "--count", "500", "-o", "seed.h5")
    assert (tmp_path / written.strip()).stat().st_size > 10_000
    run("qgis-plugin", "-o", "mpmgis_qgis.zip")
    assert zipfile.ZipFile(tmp_path / "mpmgis_qgis.zip").testzip() is None
