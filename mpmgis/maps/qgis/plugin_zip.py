"""Pack the QGIS toolbox as a zip for installation in QGIS or for its plugin repository."""

import json
import zipfile
from pathlib import Path

from ... import __version__
from ...system.errors import InputError, OutputError
from ...system.whole_files import refuse_existing, whole_file

FOLDER = Path(__file__).parents[2] / "qgis_plugin" / "mpmgis_qgis"
FORMS_FILE = "forms.json"
SUFFIXES = (".py", ".txt", ".svg", "")  # no binaries; LICENSE has none
_TIME = (2000, 1, 1, 0, 0, 0)  # time of all files, for reproducible bytes


def write_plugin_zip(
    path: str | Path, forms: dict, homepage: str | None = None, email: str | None = None, overwrite: bool = False
) -> None:
    """Write the plugin as a zip, atomically.

    Parameters
    ----------
    path : str or Path
    forms : dict
        Forms of the verbs, as `qgis_plugin` makes them.
    homepage, email : str or None
        Of the publisher; required by the plugin repository, not by QGIS.
    overwrite : bool

    Raises
    ------
    OutputError
        `path` exists, cannot be written, or is not a .zip.
    InputError
        `homepage` is not a web address, or `email` is not an e-mail address.
    """
    path = Path(path)
    if path.suffix.lower() != ".zip":
        raise OutputError(f"{path}: QGIS installs plugins from a .zip; use -o with a name that ends in .zip")
    metadata = _metadata(homepage, email)
    refuse_existing(path, overwrite)
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        contents = {file.name: file.read_bytes() for file in plugin_files()}
        contents |= {"metadata.txt": metadata, FORMS_FILE: json.dumps(forms, indent=1) + "\n"}
        for name, content in sorted(contents.items()):
            entry = zipfile.ZipInfo(f"{FOLDER.name}/{name}", _TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content)


def plugin_files() -> list[Path]:
    """Return the paths of the plugin's files, sorted."""
    return sorted(file for file in FOLDER.iterdir() if file.is_file() and file.suffix in SUFFIXES)


def _metadata(homepage, email):
    """The plugin's metadata, with version and publisher."""
    lines = [f"version={__version__}"]
    if email is not None:
        if "@" not in email or any(letter.isspace() for letter in email):
            raise InputError(f"--email got {email!r}, expected an address, for example name@institute.org")
        lines.append(f"email={email}")
    if homepage is not None:
        if not homepage.startswith("https://") or any(letter.isspace() for letter in homepage):
            raise InputError(f"--homepage got {homepage!r}, expected an address that begins with https://")
        address = homepage.rstrip("/")
        lines += [f"homepage={address}", f"repository={address}", f"tracker={address}/issues"]
    return (FOLDER / "metadata.txt").read_text(encoding="utf-8") + "\n".join(lines) + "\n"
