"""One table of a scene from its dictionary: kinds, ranges and parameters of laws."""

import difflib
import math
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from ..laws import friction
from ..laws.own_law import NO_OWN_LAWS, OwnLaws
from ..system.errors import SceneError, has_control_characters
from .tables import CHECKS, FrictionTable, keys_of

KIND_WORDS = {float: "a number", int: "a whole number", str: "text", bool: "true or false", list: "a list of numbers"}
LONGEST = 80  # [characters] of a wrong value in a message
LEAST_SIMILAR = 0.67  # [1] share of equal letters from which a name is suggested


def made_table(
    kind: type,
    values: dict[str, Any],
    where: str,
    own_laws: OwnLaws = NO_OWN_LAWS,
    by_place: Collection[str] = (),
    instead: dict[str, tuple] | None = None,
) -> Any:
    """Make one table from its dictionary.

    Parameters
    ----------
    kind : type
        Class of the table.
    values : dict of str to Any
    where : str
        Name of the table in messages.
    own_laws : OwnLaws
    by_place : collection of str
        Parameters of the law that may be missing, because zones give them.
    instead : dict of str to (law, dict of str to Parameter), optional
        Laws of a solver that replace those of the table.

    Returns
    -------
    kind
        A table of this class.

    Raises
    ------
    SceneError
    """
    known = keys_of(kind)
    free = any("by_place" in f.metadata for f in fields(kind))
    metadata = next((f.metadata for f in fields(kind) if "parameters_of" in f.metadata), {})
    laws = instead or metadata.get("parameters_of")
    made, extra = {}, {}
    for name, value in values.items():
        if name in known:
            made[name] = checked_value(known[name].metadata, value, f"{where}: {name}")
        elif laws is None and not free:
            raise SceneError(f"{where}: unknown key {shown(name)}{meant(name, known)}; it takes {listed(known)}")
        else:
            extra[name] = value
    for name, f in known.items():
        if f.default is MISSING and name not in made:
            raise SceneError(f"{where}: {name} is missing ({f.metadata['doc']})")
    if laws is not None:
        if instead is not None and ":" in made["law"]:
            raise SceneError(f"{where}: the 3D solver takes no law from a Python file; expected {listed(laws)}")
        made["law"] = _law_name(laws, made["law"], own_laws, where, kind is FrictionTable and instead is None)
        if kind is FrictionTable:
            extra, made["written"] = _in_place_of(made["law"], extra, where)
        made["parameters"] = _parameters({**laws, **own_laws.laws}, made["law"], extra, where, by_place)
        if "contradiction" in metadata and len(made["parameters"]) == len({**laws, **own_laws.laws}[made["law"]][1]):
            _require_no_contradiction(metadata["contradiction"](made["law"], made["parameters"]), where)
    elif free:
        made["parameters"] = extra
    return kind(**made)


def _in_place_of(law: str, values: dict[str, Any], where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return (parameters of `law`, with alternatives converted; the alternatives as given)."""
    made, written = dict(values), {}
    for name, (parameter, metadata) in friction.given_instead(law).items():
        if name not in made:
            continue
        refuse_both(name, parameter, made, where)
        written[name] = checked_value(range_of(metadata, float), made.pop(name), f"{where}: {name}")
        made[parameter] = friction.turbulent_coefficient(written[name])
    if law == friction.SIZED_LAW and friction.SIZE in made:
        refuse_both(friction.SIZE, friction.replaced_by(friction.SIZE), made, where)
        checks = {**CHECKS, "kind": str, "choices": (*friction.SIZES, friction.BY_VOLUME)}
        size = checked_value(checks, made.pop(friction.SIZE), f"{where}: {friction.SIZE}")
        written[friction.SIZE], made["mu"] = size, friction.mu_of_size(size)
    return made, written


def refuse_both(name: str, parameter: str, values: Collection[str], where: str) -> None:
    """Refuse a key where the parameter that it replaces is given too.

    Parameters
    ----------
    name, parameter : str
        The key, and the parameter that it replaces.
    values : collection of str
        Keys that are given.
    where : str
        Name of the table in messages.

    Raises
    ------
    SceneError
    """
    if parameter in values:
        raise SceneError(f"{where}: {name} is in place of {parameter}, and both are given; take one of them out")


def range_of(parameter: friction.Parameter, kind: type | tuple[type, ...]) -> dict[str, Any]:
    """Return the checks of a value of a law's parameter, for `checked_value`.

    Parameters
    ----------
    parameter : Parameter
    kind : type or tuple of type
    """
    return {**CHECKS, "kind": kind, "low": parameter.smallest, "high": parameter.largest}


def _require_no_contradiction(words, where):
    if words:
        raise SceneError(f"{where}: {words}")


def _law_name(laws: dict[str, tuple], law: str, own_laws: OwnLaws, where: str, takes_own: bool) -> str:
    """Return the name of `law` in its table of laws; user-defined laws only from the file of --law."""
    if law in laws:
        return law
    file, _, name = law.rpartition(":")
    if not file.endswith(".py"):
        own = ", or 'my_law.py:MyLaw'" if takes_own else ""
        raise SceneError(f"{where}: law = {shown(law)}{meant(law, laws)}; expected {listed(laws)}{own}")
    if not own_laws.laws:
        raise SceneError(f"{where}: law = {shown(law)} is in a Python file; allow it to be run with --law {file}")
    own = f"{Path(file).name}:{name}"
    if own not in own_laws.laws:
        raise SceneError(f"{where}: law = {shown(law)}, but --law {own_laws.path} contains {listed(own_laws.laws)}")
    return own


def _parameters(
    laws: dict[str, tuple], law: str, values: dict[str, Any], where: str, by_place: Collection[str] = ()
) -> dict[str, Any]:
    """Return the parameters of `law`, each in its range.

    They are complete except those that vary in space; unknown ones are refused.
    """
    wanted = laws[law][1]
    takes = ", ".join(f"{name} [{unit}]" for name, (unit, *_) in wanted.items()) or "none"
    for name in values:
        if name not in wanted:
            raise SceneError(f"{where}: {law} has no parameter {shown(name)}{meant(name, wanted)}; it takes {takes}")
    made = {}
    for name, parameter in wanted.items():
        if name not in values and name in by_place:
            continue
        if name not in values and parameter.default is None:
            raise SceneError(f"{where}: {law} needs {name} [{parameter.unit}] ({parameter.meaning})")
        value = values.get(name, parameter.default)
        made[name] = checked_value(range_of(parameter, float), value, f"{where}: {name}")
    return made


def checked_value(checks: Mapping[str, Any], value: Any, where: str) -> Any:
    """Return a value after its checks.

    Parameters
    ----------
    checks : mapping of str to Any
        ``kind`` and CHECKS of a key (`tables`).
    value : Any
        As TOML gave it.
    where : str
        Table and key in messages.

    Returns
    -------
    Any
        A float for any number where floats are allowed, a tuple for a list.

    Raises
    ------
    SceneError
    """
    kinds = checks["kind"] if isinstance(checks["kind"], tuple) else (checks["kind"],)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise SceneError(f"{where} is a number of over 300 digits, expected one that can be computed with")
    if float in kinds and is_number(value):
        value = float(value)
        if not math.isfinite(value):
            raise SceneError(f"{where} = {value}, expected a finite number")
    elif not (isinstance(value, kinds) and isinstance(value, bool) == (bool in kinds)):
        raise SceneError(f"{where} = {shown(value)}, expected {' or '.join(_kind_words(k, checks) for k in kinds)}")
    if value == "" and (checks["file"] or float in kinds):
        names = "a file name" if float not in kinds else "a number or the name of a column or a file"
        raise SceneError(f"{where} is empty, expected {names}")
    if isinstance(value, str) and not checks["file"] and has_control_characters(value):
        raise SceneError(f"{where} = {shown(value)} contains control characters; write it without them, in one line")
    if checks["choices"] and value not in checks["choices"]:
        raise SceneError(
            f"{where} = {shown(value)}{meant(value, checks['choices'])}; expected {listed(checks['choices'])}"
        )
    if is_number(value):
        low, high = checks["low"], checks["high"]
        if low is not None and (value < low or (checks["above"] and value <= low)):
            raise SceneError(f"{where} = {value:g}, expected {'above' if checks['above'] else 'at least'} {low:g}")
        if high is not None and value > high:
            raise SceneError(f"{where} = {value:g}, expected at most {high:g}")
    if checks["entries"] is not None:
        _require_entries(checks["entries"], value, where)
    return tuple(value) if isinstance(value, list) else value


def _require_entries(entries, value, where):
    """Refuse a list or a table within a key with other entries."""
    for name in value if entries.names else ():
        if name not in entries.names:
            raise SceneError(f"{where} has no {shown(name)}; it takes {listed(entries.names)}")
    if not entries.words:
        return
    given = value.values() if isinstance(value, dict) else value
    of_length = isinstance(value, dict) or len(value) == (entries.length or len(value)) > 0
    if not of_length or not all(_is_entry(one, entries) for one in given):
        raise SceneError(f"{where} = {shown(value)}, expected {entries.words}")


def _is_entry(value, entries):
    if entries.kind is str:
        return isinstance(value, str) and value != ""
    return is_finite(value) and (entries.largest is None or abs(value) <= entries.largest)


def _kind_words(kind, checks):
    """The words for a kind of value, with the example of a key that takes words or a table."""
    if kind is list and checks["entries"].kind is str:
        return "a list of words"
    if kind is dict:
        words = (f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v:g}" for k, v in checks["example"].items())
        return f"a table like {{{', '.join(words)}}}"
    return KIND_WORDS[kind]


def shown(value: object) -> str:
    """Return a wrong value for a message, as Python writes it, shortened.

    Parameters
    ----------
    value : object
    """
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def is_finite(value: object) -> bool:
    """Return whether `value` is a number that is finite as a float.

    Parameters
    ----------
    value : object
    """
    return is_number(value) and abs(value) <= sys.float_info.max


def is_number(value: object) -> bool:
    """Return whether `value` is an int or a float, and not a bool.

    Parameters
    ----------
    value : object
    """
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def listed(names: Iterable[object]) -> str:
    """Return names as text, separated by commas.

    Parameters
    ----------
    names : iterable of object
    """
    return ", ".join(map(str, names))


def meant(name: object, known: Iterable[object]) -> str:
    """Return the end of a message that suggests the most similar known name.

    Short words differ by one letter and mean something else ("gpu" and "cpu"): two of three letters are not similar.

    Parameters
    ----------
    name : object
        The wrong name.
    known : iterable of object
        The valid names.

    Returns
    -------
    str
        Empty without a similar one.
    """
    close = difflib.get_close_matches(str(name), list(map(str, known)), 1, LEAST_SIMILAR)
    return f" (did you mean {close[0]!r}?)" if close else ""
