"""`mpmgis effects`: the catalogue of effects; with a scene: which are on, and the number that decided."""

import json

from ..errors import InputError
from . import answer, talk

EXAMPLE = """
mpmgis effects
mpmgis effects scene.toml
mpmgis effects scene.toml --measure
mpmgis effects scene.toml --json -o effects.json
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument("scene", nargs="?", metavar="scene.toml", help="decide the effects of this scene")
    parser.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")
    parser.add_argument(
        "--measure",
        action="store_true",
        help="run the scene's first steps, and tell what share of the time goes into "
        "each effect; compiles a step without each, half a minute each where that is new",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    answer.add_arguments(parser)


def run(arguments):
    """Give the catalogue, or the decisions for a scene."""
    answer.require_writable(arguments, [path for path in (arguments.scene, arguments.law) if path])
    if arguments.scene is None:
        if arguments.law is not None:
            raise InputError("--law goes with a scene that names the law; give scene.toml")
        if arguments.measure:
            raise InputError("--measure wants a scene to measure; give scene.toml")
        from ..scene import catalogue

        entries = catalogue()
        words = json.dumps(entries, indent=1) if arguments.json else "\n".join(_entry(e) for e in entries)
        answer.give(words, arguments)
        return 0
    from ..workflows.run import decided, measured

    if arguments.measure:
        decisions, costs = measured(arguments.scene, arguments.law)
        stages = (("", decisions),)
        talk.say(
            f"a step of {costs.columns} columns at t = {costs.time:.3g} s takes {1e3 * costs.step_seconds:.3g} ms; "
            f"timed twice it differs by {100 * costs.noise:.1f} %: smaller costs are noise"
        )
    else:
        stages, costs = decided(arguments.scene, arguments.law), None
    words = json.dumps(_facts(stages, costs), indent=1) if arguments.json else _tables(stages, costs)
    answer.give(words, arguments)
    return 0


def _heading(entry):
    """Table and law of an entry of the catalogue, as the scene writes them."""
    return f"[{entry['table']}]" + (f" {entry['law']}" if entry["law"] else "")


def _entry(entry):
    parameters = ", ".join(f"{name} [{unit}]" for name, unit in entry["parameters"].items()) or "none"
    return f"{_heading(entry)}: {entry['what']}\n    parameters: {parameters}"


def _facts(stages, costs):
    """Decisions as plain dictionaries, with the share of a step that was measured, null where there is none.

    Of a scene in stages each says the number of its own.
    """
    facts = [
        decision._asdict() | ({"stage": number} if words else {})
        for number, (words, decisions) in enumerate(stages, 1) for decision in decisions
    ]  # fmt: skip
    if costs is None:
        return facts
    return [fact | {"cost_share": costs.shares.get(fact["effect"]), "cost_noise": costs.noise} for fact in facts]


def _tables(stages, costs):
    """The table of each stage, below its words where there are several."""
    tables = (
        (f"stage {number}: {words}\n" if words else "") + _table(decisions, costs)
        for number, (words, decisions) in enumerate(stages, 1)
    )
    return "\n\n".join(tables)


def _table(decisions, costs):
    """A row for each decision; with `costs` each has the share of a step that goes into the effect."""
    shares = None if costs is None else costs.shares
    head = (
        f"{'effect':<16} {'is':<4} {'by':<7} {'number':>9} {'on if':<8} {'runout':>8}{_cost('cost', shares)}  because"
    )
    return "\n".join([head, *(d.line(_cost(_percent(shares, d.effect), shares)) for d in decisions)])


def _cost(text, shares):
    """A cell of the column of costs, nothing where they were not measured."""
    return "" if shares is None else f" {text:>8}"


def _percent(shares, effect):
    return f"{100 * shares[effect]:.1f} %" if shares and effect in shares else ""
