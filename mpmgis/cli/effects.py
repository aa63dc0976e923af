"""`mpmgis effects`: the catalogue of effects; with a scene: which are on, and the number that decided."""

import json

from ..errors import InputError
from . import talk

EXAMPLE = """
mpmgis effects
mpmgis effects scene.toml
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument("scene", nargs="?", metavar="scene.toml", help="decide the effects of this scene")
    parser.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments):
    """Print the catalogue, or the decisions for a scene."""
    if arguments.scene is None:
        if arguments.law is not None:
            raise InputError("--law goes with a scene that names the law; give scene.toml")
        from ..scene import catalogue

        entries = catalogue()
        print(json.dumps(entries, indent=1) if arguments.json else "\n".join(_entry(e) for e in entries))
        return 0
    from ..pipeline.prepare import prepare

    decisions = prepare(arguments.scene, talk.detail, arguments.law).decisions
    print(json.dumps([d._asdict() for d in decisions], indent=1) if arguments.json else _table(decisions))
    return 0


def _heading(entry):
    """Table and law of an entry of the catalogue, as the scene writes them."""
    return f"[{entry['table']}]" + (f" {entry['law']}" if entry["law"] else "")


def _entry(entry):
    parameters = ", ".join(f"{name} [{unit}]" for name, unit in entry["parameters"].items()) or "none"
    return f"{_heading(entry)}: {entry['what']}\n    parameters: {parameters}"


def _table(decisions):
    head = f"{'effect':<16} {'is':<4} {'by':<7} {'number':>9} {'on if':<8} {'runout':>8}  because"
    return "\n".join([head, *(decision.line() for decision in decisions)])
