"""Build backend: setuptools, with the list of what an sdist contains beside the package from .ci/sdist.in.

setuptools reads this list from MANIFEST.in at the top level only, where the project has a fixed list of files.
"""

from pathlib import Path
from shutil import copyfile

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  (all other hooks are those of setuptools)

TEMPLATE = Path("MANIFEST.in")


def build_sdist(sdist_directory: str, config_settings: dict | None = None) -> str:
    """Build an sdist; the template exists while this runs.

    Parameters
    ----------
    sdist_directory : str
    config_settings : dict, optional

    Returns
    -------
    str
        Name of the file.
    """
    copyfile(Path(__file__).with_name("sdist.in"), TEMPLATE)
    try:
        return build_meta.build_sdist(sdist_directory, config_settings)
    finally:
        TEMPLATE.unlink()
