"""Print the catalogue of effects; with a scene the effects that are on, and the deciding numbers."""

import argparse
import json

from ...system.errors import InputError
from . import answers, terminal


def run(arguments: argparse.Namespace) -> int:
    """Print the catalogue, or the decisions for a scene.

    Parameters
    ----------
    arguments : argparse.Namespace

    Returns
    -------
    int
        Exit code.

    Raises
    ------
    InputError
        An option that requires a scene, without one.
    """
    answers.require_writable(arguments, [path for path in (arguments.scene, arguments.law) if path])
    if arguments.scene is None:
        if arguments.law is not None:
            raise InputError("`law` requires a scene that names the law; give scene.toml")
        if arguments.measure:
            raise InputError("`measure` requires a scene; give scene.toml")
        from ...scene import catalogue

        entries = catalogue()
        words = json.dumps(entries, indent=1) if arguments.json else "\n".join(_entry(e) for e in entries)
        answers.print_or_write(words, arguments)
        return 0
    from ...simulation.scene_effects import scene_decisions, scene_effect_costs

    if arguments.measure:
        decisions, costs = scene_effect_costs(arguments.scene, arguments.law)
        stages = (("", decisions),)
        terminal.note(
            f"a step of {costs.columns} columns at t = {costs.time:.3g} s takes {1e3 * costs.step_seconds:.3g} ms; "
            f"two measurements differ by {100 * costs.noise:.1f} %: smaller costs are noise"
        )
    else:
        stages, costs = scene_decisions(arguments.scene, arguments.law), None
    words = json.dumps(_facts(stages, costs), indent=1) if arguments.json else _tables(stages, costs)
    answers.print_or_write(words, arguments)
    return 0


def _heading(entry):
    """Table and law of an entry of the catalogue, as in a scene."""
    return f"[{entry['table']}]" + (f" {entry['law']}" if entry["law"] else "")


def _entry(entry):
    parameters = ", ".join(f"{name} [{unit}]" for name, unit in entry["parameters"].items()) or "none"
    return f"{_heading(entry)}: {entry['what']}\n    parameters: {parameters}"


def _facts(stages, costs):
    """Decisions as plain dictionaries, with the measured share of a step or null, and the stage's number if any."""
    facts = [
        decision._asdict() | ({"stage": number} if words else {})
        for number, (words, decisions) in enumerate(stages, 1)
        for decision in decisions
    ]
    if costs is None:
        return facts
    return [fact | {"cost_share": costs.shares.get(fact["effect"]), "cost_noise": costs.noise} for fact in facts]


def _tables(stages, costs):
    """The table of each stage, with a heading where there are several."""
    tables = (
        (f"stage {number}: {words}\n" if words else "") + _table(decisions, costs)
        for number, (words, decisions) in enumerate(stages, 1)
    )
    return "\n\n".join(tables)


def _table(decisions, costs):
    """A row for each decision; with `costs` also the share of a step that the effect takes."""
    shares = None if costs is None else costs.shares
    head = (
        f"{'effect':<16} {'is':<4} {'by':<7} {'number':>9} {'on if':<8} {'runout':>8}{_cost('cost', shares)}  because"
    )
    return "\n".join([head, *(d.line(_cost(_percent(shares, d.effect), shares)) for d in decisions)])


def _cost(text, shares):
    """A cell of the column of costs; "" where costs were not measured."""
    return "" if shares is None else f" {text:>8}"


def _percent(shares, effect):
    return f"{100 * shares[effect]:.1f} %" if shares and effect in shares else ""
