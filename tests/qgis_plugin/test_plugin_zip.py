"""The zip of the toolbox, against what QGIS and its plugin repository ask for."""

import ast
import configparser
import io
import tomllib
import zipfile
from pathlib import Path

import pytest

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.maps.qgis import plugin_zip
from mpmgis.maps.qgis.plugin_zip import FOLDER, plugin_files

ROOT = Path(__file__).resolve().parents[2]
NEEDED_BY_QGIS = {"name", "qgisMinimumVersion", "description", "version", "author", "about"}
NEEDED_TO_PUBLISH = NEEDED_BY_QGIS | {"email", "homepage", "repository", "tracker", "license"}
CATEGORIES = {"Raster", "Vector", "Database", "Mesh", "Web"}  # menus of QGIS
PUBLIC = {
    "homepage": "https://example.org",
    "repository": "https://example.org/code",
    "tracker": "https://example.org/code/issues",
    "email": "a@example.org",
}
LARGEST = 25_000_000  # [bytes] that the repository takes
SUFFIXES = {".py", ".txt", ".svg", ".json", ""}
FORBIDDEN_CALLS = {"eval", "exec", "__import__", "import_module", "system", "popen", "Popen", "startDetached"}


def packed(path, *words):
    assert main(["qgis-plugin", "-o", str(path), "-q", *words]) == 0
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plugin_zip, "public_addresses", lambda: PUBLIC)
        archive = packed(tmp_path_factory.mktemp("zip") / "mpmgis_qgis.zip", "--publish")
    with archive:
        yield archive


def metadata(archive):
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str
    parser.read_file(io.TextIOWrapper(archive.open("mpmgis_qgis/metadata.txt"), encoding="utf-8"))
    return dict(parser["general"])


def test_all_files_are_in_one_folder_and_none_is_missing(archive):
    inside = {path.name for path in FOLDER.rglob("*") if path.is_file() and path.parent.name != "__pycache__"}
    assert set(archive.namelist()) == {f"mpmgis_qgis/{name}" for name in (*inside, "forms.json")}
    assert {"__init__.py", "metadata.txt", "LICENSE", "icon.svg"} <= inside


def test_no_binaries_and_not_large(archive):
    assert sum(entry.file_size for entry in archive.infolist()) < LARGEST
    for entry in archive.infolist():
        assert Path(entry.filename).suffix in SUFFIXES
        archive.read(entry).decode("utf-8")


def test_metadata_has_the_fields_of_the_repository(archive):
    said = metadata(archive)
    assert set(said) >= NEEDED_TO_PUBLISH and all(said[key].strip() for key in NEEDED_TO_PUBLISH)
    assert said["version"] == mpmgis.__version__
    assert (said["hasProcessingProvider"], said["supportsQt6"]) == ("yes", "yes")
    assert "External dependency" in said["about"]
    assert {key: said[key] for key in PUBLIC} == PUBLIC
    assert said["category"] in CATEGORIES
    assert f"mpmgis_qgis/{said['icon']}" in archive.namelist()
    assert "\n[" not in archive.read("mpmgis_qgis/metadata.txt").decode().split("[general]", 1)[1]


class Installed:
    """Metadata of an installed package, from pyproject.toml."""

    def __init__(self, urls, author):
        self.urls, self.author = urls, author

    def get_all(self, name):
        return [f"{key}, {address}" for key, address in self.urls.items()]

    def get(self, name):
        return f"{self.author['name']} <{self.author['email']}>"


def test_addresses_are_those_of_the_package(monkeypatch):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (author,), urls = project["authors"], project["urls"]
    assert set(plugin_zip.ADDRESSES.values()) <= set(urls) and "@" in author["email"]
    addresses = [*urls.values(), author["email"]]
    assert len({plugin_zip.PLACEHOLDER in address for address in addresses}) == 1  # all are public, or none is
    monkeypatch.setattr(plugin_zip.metadata, "metadata", lambda name: Installed(urls, author))
    assert bool(plugin_zip.public_addresses()) == (plugin_zip.PLACEHOLDER not in author["email"])
    public = {key: address.replace(".invalid", ".example") for key, address in urls.items()}
    named = {"name": "we", "email": "we@example.org"}
    monkeypatch.setattr(plugin_zip.metadata, "metadata", lambda name: Installed(public, named))
    assert plugin_zip.public_addresses() == {
        "homepage": public["Homepage"],
        "repository": public["Repository"],
        "tracker": public["Issues"],
        "email": "we@example.org",
    }


def test_without_public_addresses_it_installs_but_is_not_published(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(plugin_zip, "public_addresses", dict)
    with packed(tmp_path / "a.zip") as archive:
        assert NEEDED_TO_PUBLISH - set(metadata(archive)) == {"email", "homepage", "repository", "tracker"}
        assert set(metadata(archive)) >= NEEDED_BY_QGIS
    assert main(["qgis-plugin", "-o", str(tmp_path / "b.zip"), "--publish"]) == 2
    told = capsys.readouterr().err
    assert "--publish needs homepage, repository, tracker, email" in told and told.count("\n") == 1
    assert not (tmp_path / "b.zip").exists()


def test_the_licence_is_the_projects_and_goes_with_the_gpl(archive):
    assert archive.read("mpmgis_qgis/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert metadata(archive)["license"] == "BSD-3-Clause"


@pytest.mark.parametrize("path", [path for path in plugin_files() if path.suffix == ".py"], ids=lambda path: path.name)
def test_no_call_that_the_repositorys_scan_blocks(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert called not in FORBIDDEN_CALLS, f"{path.name}:{node.lineno} calls {called}"
            assert "shell" not in {keyword.arg for keyword in node.keywords}
        if isinstance(node, ast.Import | ast.ImportFrom):
            named = {getattr(node, "module", None), *(alias.name for alias in node.names)}
            assert not named & {"subprocess", "pickle", "ctypes", "socket", "mpmgis"}


def test_the_same_sources_make_the_same_bytes(tmp_path):
    for name in ("a.zip", "b.zip"):
        packed(tmp_path / name).close()
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_the_verb_reports_how_to_install_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["qgis-plugin"]) == 0
    told = capsys.readouterr()
    assert told.out == "mpmgis_qgis.zip\n"
    assert "Install from ZIP" in told.err
    assert main(["qgis-plugin"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["qgis-plugin", "--overwrite"]) == 0


@pytest.mark.parametrize(("words", "line"), [(["-o", "a.tgz"], "installs plugins from a .zip")])
def test_what_makes_no_plugin_is_refused_in_one_line(words, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["qgis-plugin", *words]) == 2
    told = capsys.readouterr().err
    assert line in told and told.count("\n") == 1
    assert not list(tmp_path.iterdir())
