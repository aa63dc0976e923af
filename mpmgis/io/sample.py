"""Where the shipped sample site lies, in a checkout as in an installed wheel."""

from pathlib import Path

from ..errors import InputError

SITE = "lava_falls"
_PACKAGE = Path(__file__).resolve().parents[1]
# A wheel carries the data inside the package (pyproject.toml maps them there); a checkout has them beside it.
_PLACES = (_PACKAGE / "sample_data", _PACKAGE.parent / "sample_data")


def sample_folder(site=SITE):
    """The folder of the sample site: DTM, releases, `scene.toml` and the README with the credit.

    Raises
    ------
    InputError
        The data are not there: a stripped installation.
    """
    for place in _PLACES:
        if (place / site / "scene.toml").is_file():
            return place / site
    raise InputError(f"sample site {site!r} is not in {_PLACES[0]} nor in {_PLACES[1]}; reinstall mpmgis")
