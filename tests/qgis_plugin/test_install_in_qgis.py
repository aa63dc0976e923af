"""The form *Install mpmgis* in QGIS: a wheel of the checkout, offline, with stand-ins for the libraries."""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy
import pytest
import rasterio
from packaging.requirements import Requirement
from qgis_python import report_of
from rasterio.transform import from_origin

import mpmgis
from mpmgis.commands.shell.main import main

pytestmark = [pytest.mark.qgis, pytest.mark.thorough]
HERE = Path(__file__).parent
ROOT = HERE.parents[1]
BUILT_FROM = (".ci", "mpmgis", "sample_data", "pyproject.toml", "README.md", "LICENSE")


def wheel_of_checkout(folder):
    """The wheel, built without network by the setuptools of the tests from a copy."""
    for name in BUILT_FROM:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(
            source,
            folder / "source" / name,
            **({"ignore": shutil.ignore_patterns("__pycache__")} if source.is_dir() else {}),
        )
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder)]
    done = subprocess.run([sys.executable, "-m", "pip", *words, str(folder / "source")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return next(folder.glob("mpmgis-*.whl"))


def stand_in(folder, requirement):
    """A wheel without modules that a requirement is content with."""
    asked = Requirement(requirement)
    version = next(part.version for part in asked.specifier if part.operator == ">=")
    name = asked.name.replace("-", "_")
    place = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as archive:
        archive.writestr(f"{place}/METADATA", f"Metadata-Version: 2.1\nName: {asked.name}\nVersion: {version}\n")
        archive.writestr(
            f"{place}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr(f"{place}/RECORD", "".join(f"{place}/{file},,\n" for file in ("METADATA", "WHEEL", "RECORD")))


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("install with space")
    (folder / "source").mkdir()
    (folder / "wheels").mkdir()
    wheel = wheel_of_checkout(folder)
    for requirement in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]:
        stand_in(folder / "wheels", requirement)
    assert main(["qgis-plugin", "-o", str(folder / "mpmgis_qgis.zip"), "-q"]) == 0
    zipfile.ZipFile(folder / "mpmgis_qgis.zip").extractall(folder / "plugins")
    dtm = {"driver": "GTiff", "height": 2, "width": 3, "count": 1, "dtype": "float32", "crs": "EPSG:32632"}
    with rasterio.open(folder / "dtm.tif", "w", transform=from_origin(0, 0, 10, 10), **dtm) as file:
        file.write(numpy.ones((2, 3), "float32"), 1)
    same = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    libraries = Path(numpy.__file__).parents[1]
    given = (folder / "plugins", folder / "profiles", wheel, folder / "wheels")
    found = report_of(
        HERE / "qgis_install_check.py",
        *given,
        libraries if same in str(libraries) else "",
        folder / "dtm.tif",
        timeout=600,
    )
    if not found["pythons"]:
        pytest.skip("no Python 3.11 or later with pip or ensurepip beside QGIS (Debian: apt-get install python3-venv)")
    return found


def test_a_missing_command_is_offered_and_nothing_is_made_unasked(report):
    text, *buttons = report["first_offer"]
    assert "the program mpmgis, which is not installed yet" in text and buttons[-1] == "Install mpmgis"
    assert report["menu"] == [["Install mpmgis"]]
    assert report["cannot"][0] is False and "Install mpmgis" in report["cannot"][1]
    assert report["nothing_made"]
    assert f"mpmgis {mpmgis.__version__} is not installed here" in report["first_state"]


def test_a_python_is_found_and_named(report):
    assert all(text.startswith("Python 3.") and "/" in text for text in report["pythons"])


def test_a_python_that_is_gone_is_an_error(report):
    assert (
        report["gone"]["said"].startswith("/nowhere/python does not start") and report["gone"]["begin"] == "Try again"
    )


def test_other_files_are_refused_before_anything_runs(report):
    assert "is not a wheel of mpmgis" in report["other_file"]["said"] and not report["other_file"]["lines"]


def test_missing_libraries_are_an_error_that_can_be_tried_again(report):
    found = report["no_libraries"]
    assert "for this Python; choose another Python or another source" in found["said"]
    assert found["begin"] == "Try again" and found["running"] == [False, True]


def test_cancelling_leaves_nothing(report):
    assert report["cancelled"]["said"] == "Cancelled"
    assert report["after_cancel"] == ["install.log"]


def test_mpmgis_is_installed_in_the_profile_and_is_used(report):
    assert report["done"]["said"].startswith("Done.") and report["done"]["bar"] == 1000
    assert "is installed</b> and fits" in report["done"]["state"]
    assert report["files"][-2:] == ["install.log", "installed.json"]
    assert "Successfully installed" in report["log"] and f"mpmgis {mpmgis.__version__}\n" in report["log"]
    assert report["can"] and report["fits"] == "" and report["second_offer"] == []
    if "used" in report:
        assert any("EPSG:32632" in line for line in report["used"])


def test_a_newer_plugin_offers_the_update(report):
    assert report["misfit"].endswith(f"is mpmgis {mpmgis.__version__}, and this toolbox needs 9.9")
    assert report["third_offer"][-1] == "Install mpmgis"
    assert "this toolbox needs 9.9" in report["update"][0] and report["update"][1] == "Update"
    assert "take both from one release" in report["other_version"]
    assert "is installed</b> and fits" in report["again"]
    assert len([name for name in report["files_again"] if name.isdigit()]) == 1


def test_it_is_removed_on_request_and_python_of_qgis_is_as_before(report):
    assert report["removed"] == ["mpmgis is removed.", False, False]
    assert report["as_before"]
    assert report["unloaded"] == [0, None]


def test_the_proxy_of_qgis_is_used(report):
    variables, line = report["proxy"]
    address = "http://me:a%40b@proxy.office:3128"
    assert variables == {"http_proxy": address, "https_proxy": address, "no_proxy": "inside.office"}
    assert "a@b" not in line and "a%40b" not in line
