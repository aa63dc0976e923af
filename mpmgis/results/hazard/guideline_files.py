"""Read intensity guidelines from TOML files: the shipped ones and those of the user."""

import tomllib
from pathlib import Path

from ...system.errors import FormatError, InputError, one_line
from .guideline_classes import Guideline, parse_guidelines

SHIPPED = Path(__file__).with_name("guidelines.toml")


def read_guidelines(own: Path | None = None) -> dict[str, Guideline]:
    """Return guidelines by name: of the shipped table, and of the file `own`, which have priority.

    Parameters
    ----------
    own : Path, optional

    Returns
    -------
    dict of str to Guideline

    Raises
    ------
    FormatError, InputError
        The file is missing, not TOML, or not a table of guidelines.
    """
    guidelines = parse_guidelines(read_tables(SHIPPED), SHIPPED.name)
    return guidelines if own is None else guidelines | parse_guidelines(read_tables(own), own)


def read_tables(path: Path) -> dict:
    """Read the tables of a TOML file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError
        It is missing, or not TOML.
    """
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FormatError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path} is not a readable TOML file ({one_line(error)[:100]})") from error


def choose_guideline(name: str, own: Path | None = None) -> Guideline:
    """Return the Guideline called `name`.

    Parameters
    ----------
    name : str
    own : Path, optional
        A file of the user.

    Raises
    ------
    FormatError, InputError
        Unknown name; the message lists the known ones.
    """
    guidelines = read_guidelines(own)
    if name not in guidelines:
        raise InputError(f"--guideline {name!r} is unknown; choose from {', '.join(guidelines)}")
    return guidelines[name]
