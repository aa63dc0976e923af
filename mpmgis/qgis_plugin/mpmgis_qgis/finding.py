"""Where the command `mpmgis` is, and in which environment it is called."""

from __future__ import annotations

import os
import shutil

COMMAND = "mpmgis"
SETTING = "MPMGIS_COMMAND"
SETTING_PLACE = "Settings > Options > Processing > Providers > mpmgis"
# What QGIS sets for its own Python and libraries; another Python with its own PROJ and GDAL would stumble over it.
OF_QGIS = (
    *("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "PYTHONSTARTUP"),
    *("PROJ_LIB", "PROJ_DATA", "GDAL_DATA", "GDAL_DRIVER_PATH"),
)


class CommandMissing(Exception):
    """The command is not where it was looked for; the message is one line with the cure."""


def find_command(setting):
    """Absolute path of the command: the one that `setting` names, else on PATH, else where pipx puts it.

    Raises
    ------
    CommandMissing
        With how to install it, or where to set its path.
    """
    named = (setting or "").strip().strip('"')
    if named:
        found = shutil.which(os.path.expanduser(named))
        if found is None:
            raise CommandMissing(
                f"the command mpmgis is not at {named}; set its path in {SETTING_PLACE} (empty: look on PATH)"
            )
        return os.path.abspath(found)
    found = shutil.which(COMMAND) or shutil.which(COMMAND, path=os.path.join(os.path.expanduser("~"), ".local", "bin"))
    if found is None:
        raise CommandMissing(
            "the command mpmgis is not on PATH; install it in an environment of its own, never in QGIS' Python "
            f"(pipx install mpmgis, or pip install in a virtual environment), and set its path in {SETTING_PLACE}"
        )
    return os.path.abspath(found)


def environment(of_qgis):
    """Dictionary: QGIS' environment `of_qgis` without what is meant for QGIS' own Python and libraries."""
    kept = {name: value for name, value in of_qgis.items() if name not in OF_QGIS}
    return {**kept, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}
