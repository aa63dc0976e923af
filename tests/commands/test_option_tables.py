"""One table for each verb: the command and Python make the same request of it, and refuse the same values."""

import argparse
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Literal, Union, get_args, get_origin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpmgis.commands.shell.parser import OneLineParser, add_arguments, values_of
from mpmgis.commands.verb import all_verbs, verb_of
from mpmgis.commands.verb_calls import complete, with_flags, with_names
from mpmgis.system.errors import InputError
from mpmgis.system.option import PathLike, options_of
from mpmgis.system.option_values import checked, expected

VERBS = {verb.name: verb for verb in all_verbs()}
CASES = [pytest.param(verb.name, name, id=f"{verb.name}-{name}") for verb in VERBS.values() for name in verb.named()]
TEXT = st.text("abcxyz_", min_size=1, max_size=8)
GIVEN = {
    "frames": ["results"],
    "source": ["a.h5"],
    "files": ["a.h5"],
    "first": "a",
    "second": "b",
    "scene": "s.toml",
    "line": "l.gpkg",
    "section": "s.gpkg",
    "guideline": "g",
    "dem": "d.tif",
    "release": "r.gpkg",
    "table": "t.csv",
    "objects": "o.gpkg",
}


@cache
def parser_of(name):
    parser = OneLineParser(prog=f"mpmgis {name}")
    add_arguments(parser, VERBS[name])
    return parser


def number_in_range(option):
    low = option.above if option.above is not None else option.least if option.least is not None else -1e3
    high = option.below if option.below is not None else option.most if option.most is not None else low + 1e3
    return st.floats(low, high, exclude_min=option.above is not None, exclude_max=option.below is not None)


def of_kind(kind, option):
    """Strategy of (Python value, text of the command)."""
    origin, parts = get_origin(kind), get_args(kind)
    if kind == PathLike:
        return TEXT.map(lambda text: (text, text))
    if origin in (Union, UnionType):
        return st.one_of([of_kind(part, option) for part in parts if get_origin(part) is not dict])
    if origin is Literal:
        return st.sampled_from(parts).map(lambda word: (word, word))
    if origin is tuple:
        count = {} if parts[-1] is Ellipsis else {"min_size": len(parts), "max_size": len(parts)}
        if get_origin(parts[0]) is tuple and get_args(parts[0])[0] is str:
            pairs = st.lists(st.tuples(TEXT, TEXT), min_size=1, max_size=3)
            return pairs.map(lambda of: (tuple(of), ",".join(f"{name}={column}" for name, column in of)))
        ones = st.lists(of_kind(parts[0], option), **({"min_size": 1, "max_size": 4} | count))
        return ones.map(lambda of: (tuple(value for value, _ in of), ",".join(text for _, text in of)))
    if kind is float:
        return number_in_range(option).map(lambda value: (value, repr(value)))
    if kind is int:
        least = 1 if option.above == 0 else int(option.least or 0)
        return st.integers(least, 10**6).map(lambda value: (value, str(value)))
    return TEXT.map(lambda text: (text, text))


def words_of(option, text):
    """Words of the command that give an option as `text`."""
    return [text] if option.positional else [f"{option.flags[-1]}={text}"]


def needed(verb, name):
    """Words of all that must be given besides the option called `name`."""
    options = [option for option in verb.named().values() if option.name != name]
    must = [option for option in options if option.required or option.positional in ("one", "many")]
    texts = [(option, GIVEN[option.name]) for option in must]
    words = [
        word
        for option, text in texts
        for one in (text if isinstance(text, list) else [text])
        for word in words_of(option, one)
    ]
    return words, {option.name: tuple(text) if isinstance(text, list) else text for option, text in texts}


@pytest.mark.parametrize(("name", "option"), CASES)
@settings(max_examples=4, deadline=None, database=None)
@given(data=st.data())
def test_the_command_and_python_give_the_same_options(name, option, data):
    verb = VERBS[name]
    option = verb.named()[option]
    words, values = needed(verb, option.name)
    if option.type is bool:
        words, values = [*words, *option.flags[-1:]], values | {option.name: not option.turned_off}
    elif option.repeat or option.positional in ("many", "any"):
        kind = next(part for part in (option.type, *get_args(option.type)) if get_origin(part) is tuple)
        found = data.draw(st.lists(of_kind(get_args(kind)[0], option), min_size=1, max_size=3))
        words = words + [word for _, text in found for word in words_of(option, text)]
        values |= {option.name: tuple(value for value, _ in found)}
    else:
        value, text = data.draw(of_kind(option.type, option))
        if option.check is not None and option.check(value):
            return
        values |= {option.name: value}
        if option.positional == "one":  # in the order of the table
            order = [one.name for one in verb.named().values() if one.positional]
            given = {name: GIVEN[name] for name in order if name in values and name != option.name}
            texts = given | {option.name: text}
            words = [word for word in words if word.startswith("-")] + [texts[name] for name in order if name in texts]
        else:
            words = words + words_of(option, text)
    of_command = values_of(parser_of(name).parse_args(words), verb)
    assert complete(verb, of_command) == complete(verb, values)


WRONG = [
    ("export-raster", "cell_size", "0", 0),
    ("export-raster", "percentile", "101", 101),
    ("export-raster", "layout", "piles", "piles"),
    ("export-raster", "origin", "1,2", (1, 2)),
    ("runout", "threshold", "-1", -1.0),
    ("profile", "at_times", "1,x", (1, "x")),
    ("timeseries", "at", "1", ((1,),)),
    ("ensemble", "tolerate", "1", 1.0),
    ("study", "repeats", "0", 0),
    ("convert", "window", "3,2,1,4", (3, 2, 1, 4)),
    ("seed", "count", "1.5", 1.5),
]


@pytest.mark.parametrize(("name", "option", "text", "value"), WRONG)
def test_a_wrong_value_is_refused_by_its_name_in_both(name, option, text, value, capsys):
    verb = VERBS[name]
    option = verb.named()[option]
    words, _ = needed(verb, option.name)
    with pytest.raises(SystemExit) as ended:
        parser_of(name).parse_args([*words, *words_of(option, text)])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1 and option.flags[-1] in said
    with pytest.raises(InputError) as refused:
        complete(verb, {option.name: value})
    assert f"`{option.name}` is" in str(refused.value) and option.flags[-1] not in str(refused.value)
    if get_origin(option.type) is not Literal:
        assert (wrong := expected(option) if option.check is None else option.check(value)) in said
        assert wrong in str(refused.value)


def test_every_default_is_a_value_of_its_option():
    for verb in VERBS.values():
        for option in verb.named().values():
            if option.default not in (None, ()):
                assert checked(option.default, option) in (option.default, Path(str(option.default)))


def test_help_states_every_default_that_is_a_number():
    for verb in VERBS.values():
        for option in verb.named().values():
            if isinstance(option.default, (int, float)) and not isinstance(option.default, bool):
                assert option.words.count("(default: ") == 1, (verb.name, option.name)


def test_every_option_has_help_and_a_field_or_a_reason():
    for verb in VERBS.values():
        for option in verb.named().values():
            assert option.help and (not verb.forms or bool(option.label) != bool(option.no_form)), option.name


def test_keywords_of_python_are_options_of_the_command():
    for verb in VERBS.values():
        if verb.options is not None:
            of_python = options_of(verb.options)
            assert set(of_python) <= set(verb.named())
            assert all(verb.named()[name].default == option.default for name, option in of_python.items())


def test_messages_name_flags_in_the_command_and_parameters_in_python():
    verb = verb_of("export-raster")
    assert with_flags("take `cell_size=2` or `time_step`; `output`", verb) == "take --cs-e 2 or --dt-e; -o"
    assert with_flags("`unknown` stays", verb) == "`unknown` stays"
    assert with_names("give --cs-e 2, another -o, or --dem", verb) == "give `cell_size` 2, another `output`, or `dem`"
    assert with_names("rio edit-info FILE --crs EPSG:n", verb) == "rio edit-info FILE --crs EPSG:n"


def test_parsers_have_no_flag_twice():
    for verb in VERBS.values():
        parser = argparse.ArgumentParser()
        add_arguments(parser, verb)
        assert parser.format_help()
