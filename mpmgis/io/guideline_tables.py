"""Guidelines for intensity classes: the shipped table, and a user's own."""

import tomllib
from pathlib import Path

from ..errors import FormatError, InputError, one_line
from ..products.guidelines import parse_guidelines

SHIPPED = Path(__file__).with_name("guidelines.toml")


def read_guidelines(own=None):
    """Guideline by name: those of the shipped table, and of the file `own`, which replace them.

    Raises
    ------
    FormatError, InputError
        The file is not there, no TOML, or no table of guidelines.
    """
    guidelines = parse_guidelines(_tables(SHIPPED), SHIPPED.name)
    return guidelines if own is None else guidelines | parse_guidelines(_tables(own), own)


def _tables(path):
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FormatError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} is no TOML that can be read ({one_line(error)[:100]})") from error


def choose_guideline(name, own=None):
    """The Guideline called `name`.

    Raises
    ------
    FormatError, InputError
        There is none; those that there are are named.
    """
    guidelines = read_guidelines(own)
    if name not in guidelines:
        raise InputError(f"--guideline {name!r} is not known; there are {', '.join(guidelines)}")
    return guidelines[name]
