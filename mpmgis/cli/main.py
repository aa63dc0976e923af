"""The command `mpmgis`: one verb a module, imported only when it is called."""

import argparse
import difflib
import gc
import importlib
import os
import sys

from .. import __version__, system
from ..errors import MpmgisError, one_line
from ..io.trust import trusting
from ..machine import address_space_lack
from . import talk
from .progress import ended_by_signals

DESCRIPTION = "Landslides, debris flows, snow and ice avalanches on real terrain with the Material Point Method."
# verb -> (module, one line of help); a module offers EXAMPLE, add_arguments(parser) and run(arguments) -> exit code
VERBS = {
    "demo": ("demo", "the whole chain on the shipped sample site, in under two minutes"),
    "seed": ("seed", "particles from a DTM and release areas (Algorithm 1 of MOX report 15/2025)"),
    "convert": ("convert", "columns to 3D points, and back (Algorithm 2 of that report)"),
    "run": ("run", "simulate a scene"),
    "export-raster": ("export_raster", "frames of particles to GeoTIFF bands and a QGIS project"),
    "study": ("study", "what accuracy costs in time: work-precision table and plot"),
    "runout": ("runout", "how far a flow ran, its drop, the angles of energy line and centre of mass"),
    "profile": ("profile", "depth, thickness and velocities along a line at chosen times"),
    "timeseries": ("timeseries", "depth, thickness, velocities and pressure at points over time"),
    "hydrograph": ("hydrograph", "volume and mass through a section over time"),
    "report": ("report", "one HTML file about a run: maps, runout, balances, parameters, effects, warnings"),
    "intensity": ("intensity", "intensity classes of a named guideline, as raster and polygons"),
    "vertical": ("vertical", "density, velocities and pressure over the height above the bed, of 3D frames"),
    "ensemble": ("ensemble", "many runs over parameter ranges: probability and percentile rasters"),
    "compare": ("compare", "two results, or a result and an observed outline, in numbers and on a map"),
    "info": ("info", "one screen about any file of the chain"),
    "effects": ("effects", "the catalogue of effects; with a scene: which are on, and why"),
    "qgis-plugin": ("qgis_plugin", "the toolbox for QGIS as a zip, to be installed there"),
}

TRUSTING = ("seed", "convert", "run", "export-raster", "info")  # verbs with --trust

# how `mpmgis --help` sorts the verbs; what no group names stands under the last one
GROUPS = {
    "from a terrain to a map": ("demo", "seed", "convert", "run", "export-raster"),
    "answers from results": (
        *("runout", "profile", "timeseries", "hydrograph", "vertical"),
        *("intensity", "compare", "report"),
    ),
    "many runs": ("study", "ensemble"),
    "what is what": ("info", "effects", "qgis-plugin"),
}


class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line and exit code 2."""

    def error(self, message):
        talk.complain(f"{self.prog}: {one_line(message)}; see {self.prog} --help")
        raise SystemExit(2)

    def parse_known_args(self, args=None, namespace=None):
        """As argparse's; but what this parser does not know it refuses itself, so that its own help is named."""
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(unknown[0])}")
        return namespace, unknown

    def _meant(self, word):
        near = difflib.get_close_matches(word.partition("=")[0], self._option_string_actions, 1, cutoff=0.75)
        return f"; did you mean {near[0]}?" if near else ""


def command():
    """What the console script calls: `main` without the collector's work at start and end, a third of a short command.

    Importing makes objects by the hundred thousand that all stay; looking them through for garbage finds none.
    """
    gc.set_threshold(100_000)
    code = main()
    gc.freeze()
    return code


def main(argv=None):
    """Run the command line; returns the exit code (0 done, 2 bad input, 3 unphysical, 130 or 143 interrupted)."""
    argv = list(sys.argv[1:] if argv is None else argv)
    talk.use_any_terminal()
    parser = OneLineParser(
        prog="mpmgis",
        description=DESCRIPTION + "\n\n" + verbs_by_group(),
        epilog="mpmgis VERB --help tells more, with an example.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"mpmgis {__version__}")
    verbs = parser.add_subparsers(
        dest="verb", metavar="VERB", help="one of the above", required=True, parser_class=OneLineParser
    )
    asked = next((word for word in argv if word in VERBS), None)
    if asked is None and argv and not argv[0].startswith("-"):
        near = difflib.get_close_matches(argv[0], VERBS, 1)
        parser.error(f"unknown verb {argv[0]!r}" + (f"; did you mean {near[0]}?" if near else ""))
    for verb, (module_name, line) in VERBS.items():
        if verb != asked:  # only the verb asked for is imported: the others need no more than their line of help
            verbs.add_parser(verb, add_help=False)
            continue
        module = importlib.import_module(f".{module_name}", __package__)
        sub = verbs.add_parser(
            verb,
            description=line[0].upper() + line[1:] + ".",
            epilog="example:\n  " + module.EXAMPLE.strip().replace("\n", "\n  "),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(sub)
        talk.add_arguments(sub)
        if asked in TRUSTING:
            talk.add_trust(sub)
        sub.set_defaults(run=module.run)
    arguments = parser.parse_args(argv)
    talk.show_messages()
    talk.set_volume(arguments)
    return _guarded(arguments)


def verbs_by_group():
    """Lines of text: every verb and what it does, sorted as GROUPS says."""
    grouped = {verb for verbs in GROUPS.values() for verb in verbs}
    last = list(GROUPS)[-1]
    lines = []
    for title, verbs in GROUPS.items():
        more = [verb for verb in VERBS if verb not in grouped] if title == last else []
        lines += [f"{title}:"] + [f"  {verb:<15}{VERBS[verb][1]}" for verb in (*verbs, *more) if verb in VERBS]
    return "\n".join(lines)


def _guarded(arguments):
    """Run the verb; every error and every wish to stop becomes one line on stderr and the contract's exit code."""
    name = f"mpmgis {arguments.verb}"
    if lack := address_space_lack(system.address_space_limit()):
        talk.complain(f"{name}: {lack}; raise the limit (ulimit -v)")
        return 2
    try:
        with ended_by_signals(), trusting(getattr(arguments, "trust", False)):
            return arguments.run(arguments) or 0
    except MpmgisError as error:
        talk.complain(f"{name}: {one_line(error)}")
        return error.exit_code
    except KeyboardInterrupt as error:
        talk.complain(f"{name}: interrupted")
        return getattr(error, "exit_code", 130)
    except MemoryError:
        talk.complain(f"{name}: not enough memory; use larger cells, fewer particles or a smaller DTM")
        return 2
    except OSError as error:
        if system.is_unread(sys.stdout, error):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        talk.complain(f"{name}: {one_line(error)}")
        return 2
    except Exception as error:
        if talk.volume > 0:
            raise
        kind = type(error).__name__
        talk.complain(f"{name}: internal error, please report it: {kind}: {one_line(error)} (-v shows where)")
        return 1
