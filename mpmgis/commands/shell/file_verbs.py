"""Run the verbs that write files: seed, convert, qgis-plugin."""

import argparse
import shutil
import sys
from pathlib import Path

from ..verb import module_of
from ..verb_calls import complete
from . import terminal
from .parser import values_of


def seed(arguments: argparse.Namespace) -> int:
    """Seed, write the particles, and print the path of the file.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    verb = module_of("seed")
    asked = complete(verb.VERB, values_of(arguments, verb.VERB))
    with terminal.notes_after_success():
        seeded = verb.work(asked)
    if asked["density"] is None:
        terminal.note(f"density: {verb.DEFAULT_DENSITY:g} kg m-3 is assumed (--density sets another)")
    _print_seed(seeded.count, seeded.record)
    print(seeded.path)
    return 0


def _print_seed(count, record):
    columns = "1 column" if count == 1 else f"{count} columns"
    thickness = "vertical" if record["thickness_mode"] == "vertical" else "normal to the bed"
    terminal.note(
        f"{columns} on {record['release_area']:.6g} m2: {record['reference_volume']:.6g} m3, "
        f"{record['reference_mass']:.6g} kg (thickness {thickness})"
    )
    terminal.note(
        f"closure factor k = {record['closure_factor']:.6f}; column masses from {record['lightest_column']:.4g} to "
        f"{record['heaviest_column']:.4g} kg"
    )


def convert(arguments: argparse.Namespace) -> int:
    """Convert, write the files, and print their paths.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    verb = module_of("convert")
    with terminal.notes_after_success():
        written = verb.work(complete(verb.VERB, values_of(arguments, verb.VERB)))
    for path in filter(None, (written.path, getattr(written, "rest", None))):
        print(path)
    return 0


def qgis_plugin(arguments: argparse.Namespace) -> int:
    """Write the zip, and print its path.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.
    """
    from ...maps.qgis.plugin_zip import public_addresses
    from ..qgis_plugin import VERB, qgis_plugin

    qgis_plugin(**values_of(arguments, VERB))
    if not public_addresses():
        terminal.note("for local use: the package has no public addresses, which the plugin repository requires")
    terminal.note(
        "in QGIS: Plugins > Manage and Install Plugins > Install from ZIP, then Plugins > mpmgis > Install mpmgis"
    )
    command = shutil.which("mpmgis", path=str(Path(sys.executable).parent))
    if command is not None:
        terminal.note(
            f"if QGIS does not find the command: set {command} in Settings > Options > Processing > Providers"
        )
    print(arguments.output)
    return 0
