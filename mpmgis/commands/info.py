"""Describe any file that mpmgis reads or writes on one screen: `mpmgis info`."""

from typing import Annotated, Any, Unpack

from ..exchange.frame_source import THIRD_PARTY, ThirdPartyOptions
from ..system.option import Option, PathLike
from ..system.trusted_files import trusting
from .effects import AnswerArguments
from .verb import Form, Verb
from .verb_calls import complete, python_words


class _Arguments(AnswerArguments, total=False):
    files: Annotated[
        tuple[PathLike, ...],
        Option(
            "any file or folder of the workflow",
            "FILE",
            positional="many",
            kind="file",
            field="FILE",
            folded=False,
            label="File",
            also=(
                {
                    "name": "FOLDER",
                    "kind": "folder",
                    "label": "or: folder",
                    "help": "A run, an export, another code's files.",
                },
            ),
        ),
    ]
    json: Annotated[
        bool,
        Option(
            "print one JSON object for each file, one a line, in SI units",
            default=False,
            folded=False,
            label="As JSON, in SI units",
        ),
    ]


class Arguments(_Arguments, ThirdPartyOptions, total=False):
    """Options of the command."""


VERB = Verb(
    name="info",
    place=30,
    line="one screen about any file of the workflow",
    options=ThirdPartyOptions,
    arguments=Arguments,
    trust=True,
    groups=((THIRD_PARTY, ThirdPartyOptions),),
    example="""
mpmgis info dtm.tif release.shp
mpmgis info results/
mpmgis info --json seed.h5 -o seed.json
mpmgis info particles_f0.ply --axes e,u,-n --origin 600000,5170000,0 --density 1500
""",
    forms=(
        Form(
            "Show information about a file",
            "Maps and answers",
            "One screen in the log about any file or folder of the workflow: terrain, release, seed, frame, run, "
            "export.",
            prints=True,
            one_of=("FILE", "FOLDER"),
        ),
    ),
)


def info(file: PathLike, *, trust: bool = False, **options: Unpack[ThirdPartyOptions]) -> dict[str, Any]:
    """Return facts about any file or folder of the workflow, as `mpmgis info --json`.

    Parameters
    ----------
    file : path
    trust : bool
        Follow links of the file to the network and to other files.
    **options
        `ThirdPartyOptions`, for another code's particle files.

    Returns
    -------
    dict
        In SI units, with the key `kind`.

    Raises
    ------
    MpmgisError
        The file cannot be read.

    Examples
    --------
    >>> mpmgis.info("results")["end_time"]  # doctest: +SKIP
    """
    from ..results.reports.file_facts import inspect

    with python_words(VERB), trusting(trust):
        facts: dict[str, Any] = inspect(file, terms(complete(VERB, options)))
    return facts


def terms(values: dict[str, Any]) -> Any:
    """Return declarations for files of another code from options by name.

    Parameters
    ----------
    values : dict
        All options of the verb, from `complete`.

    Returns
    -------
    Declarations
    """
    from ..exchange.declarations import Declarations

    return Declarations.named(values, values["crs"])
