"""Pack the QGIS toolbox as a zip for installation in QGIS or for its plugin repository."""

import json
import zipfile
from importlib import metadata
from pathlib import Path

from ... import __version__
from ...system.errors import InputError, OutputError
from ...system.whole_files import refuse_existing, whole_file

FOLDER = Path(__file__).parents[2] / "qgis_plugin" / "mpmgis_qgis"
FORMS_FILE = "forms.json"
SUFFIXES = (".py", ".txt", ".svg", "")  # no binaries; LICENSE has none
ADDRESSES = {
    "homepage": "Homepage",
    "repository": "Repository",
    "tracker": "Issues",
}  # key of the plugin: of the package
PLACEHOLDER = ".invalid"  # no address with this end exists
_TIME = (2000, 1, 1, 0, 0, 0)  # time of all files, for reproducible bytes


def write_plugin_zip(path: str | Path, forms: dict, publish: bool = False, overwrite: bool = False) -> None:
    """Write the plugin as a zip, atomically.

    Parameters
    ----------
    path : str or Path
    forms : dict
        Forms of the verbs, as `qgis_plugin` makes them.
    publish : bool
        Refuse a zip without the addresses that the plugin repository requires, but not QGIS.
    overwrite : bool

    Raises
    ------
    OutputError
        `path` exists, cannot be written, or is not a .zip.
    InputError
        `publish`, and the package has no public addresses.
    """
    path = Path(path)
    if path.suffix.lower() != ".zip":
        raise OutputError(f"{path}: QGIS installs plugins from a .zip; use -o with a name that ends in .zip")
    of_plugin = plugin_metadata(public_addresses(), publish)
    refuse_existing(path, overwrite)
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        contents = {file.name: file.read_bytes() for file in plugin_files()}
        contents |= {"metadata.txt": of_plugin, FORMS_FILE: json.dumps(forms, indent=1) + "\n"}
        for name, content in sorted(contents.items()):
            entry = zipfile.ZipInfo(f"{FOLDER.name}/{name}", _TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content)


def plugin_files() -> list[Path]:
    """Return the paths of the plugin's files, sorted."""
    return sorted(file for file in FOLDER.iterdir() if file.is_file() and file.suffix in SUFFIXES)


def public_addresses() -> dict[str, str]:
    """Return homepage, repository, tracker and email of the installed package, as pyproject.toml has them.

    Placeholders are left out.
    """
    try:
        of_package = metadata.metadata("mpmgis")
    except metadata.PackageNotFoundError:  # a checkout that is not installed
        return {}
    urls = dict(line.split(", ", 1) for line in of_package.get_all("Project-URL") or ())
    found = {key: urls.get(name, "") for key, name in ADDRESSES.items()}
    found["email"] = (of_package.get("Author-email") or "").rpartition("<")[2].rstrip(">")
    return {key: address for key, address in found.items() if address and not _is_placeholder(address)}


def _is_placeholder(address):
    return address.removeprefix("https://").partition("/")[0].endswith(PLACEHOLDER)


def plugin_metadata(addresses: dict[str, str], publish: bool) -> str:
    """Return the text of the plugin's metadata.txt, with version and addresses.

    Parameters
    ----------
    addresses : dict of str to str
    publish : bool
        Refuse where an address is missing.

    Returns
    -------
    str

    Raises
    ------
    InputError
    """
    missing = [key for key in (*ADDRESSES, "email") if key not in addresses]
    if publish and missing:
        raise InputError(
            f"--publish needs {', '.join(missing)}, and the package has no public ones; set them in [project.urls] and "
            "authors of pyproject.toml, and install it again"
        )
    lines = [f"version={__version__}", *(f"{key}={address}" for key, address in addresses.items())]
    return (FOLDER / "metadata.txt").read_text(encoding="utf-8") + "\n".join(lines) + "\n"
