"""Run the verbs that write files: seed, convert, qgis-plugin."""

import argparse
import shutil
import sys
from pathlib import Path

from ...system.errors import InputError
from ..seed import DEFAULT_DENSITY, FOR_SOLVER, seeding_values
from ..verb import verb_of
from ..verb_calls import complete, made
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
    verb = verb_of("seed")
    values = complete(verb, values_of(arguments, verb))
    with terminal.notes_after_success():
        path, count, record = _seeded(values)
    if values["density"] is None:
        terminal.note(f"density: {DEFAULT_DENSITY:g} kg m-3 is assumed (--density sets another)")
    _print_seed(count, record)
    print(path)
    return 0


def _seeded(values):
    """Write the columns or the start folder of another solver: (path, number of columns, record of the seeding)."""
    if values["solver"] is not None:
        from ...conversion.start_folder import StartRequest, seed_for_solver

        written, count, record = seed_for_solver(made(StartRequest, values), **seeding_values(values))
        return written.path, count, record
    for name in FOR_SOLVER:
        if values[name] is not None:
            raise InputError(f"`{name}` requires `solver`; leave it out, or name the solver")
    from ...seeding.seeded_file import seed_file

    seeded = seed_file(**seeding_values(values), output=values["output"], overwrite=values["overwrite"])
    return seeded.path, seeded.count, seeded.record


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
    from ..convert import converted, started

    verb = verb_of("convert")
    values = complete(verb, values_of(arguments, verb))
    with terminal.notes_after_success():
        if values["solver"] is not None:
            paths = [started(values).path]
        else:
            written = converted(values)
            paths = [path for path in (written.path, written.rest) if path is not None]
    for path in paths:
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
    from ..qgis_plugin import VERB, qgis_plugin

    qgis_plugin(**values_of(arguments, VERB))
    terminal.note(
        "in QGIS: Plugins > Manage and Install Plugins > Install from ZIP, then Processing > Toolbox > mpmgis"
    )
    command = shutil.which("mpmgis", path=str(Path(sys.executable).parent))
    if command is not None:
        terminal.note(
            f"if QGIS does not find the command: set {command} in Settings > Options > Processing > Providers"
        )
    print(arguments.output)
    return 0
