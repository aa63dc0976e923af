"""List the catalogue of effects; with a scene the effects that are on, and the deciding numbers: `mpmgis effects`."""

from typing import TYPE_CHECKING, Annotated, Any, TypedDict

from ..simulation.simulation_options import LAW
from ..system.option import Option, PathLike
from . import shared_options
from .verb import Form, Verb
from .verb_calls import python_words

if TYPE_CHECKING:
    from ..scene.decision_rules import Decision


class AnswerArguments(TypedDict, total=False):
    """Output of an answer in words or JSON."""

    output: Annotated[
        PathLike,
        Option(
            "write the answer to this file instead of stdout",
            "FILE",
            short="-o",
            no_form="the answer is in the log, which can be saved",
        ),
    ]
    overwrite: Annotated[
        bool, Option("replace an earlier file of that name", default=False, no_form="there is no file")
    ]


class Arguments(AnswerArguments, total=False):
    """Options of the command."""

    scene: Annotated[
        PathLike,
        Option(
            "list the effects of this scene",
            "scene.toml",
            positional="maybe",
            folded=False,
            label="Scene",
            usual="the catalogue",
            files=shared_options.TOML,
        ),
    ]
    measure: Annotated[
        bool,
        Option(
            "run the scene's first steps and print the share of the time of each effect; the first time this "
            "compiles a step without each effect, half a minute each",
            default=False,
            folded=False,
            label="Measure the share of the computing time of each effect",
        ),
    ]
    law: Annotated[PathLike, LAW]
    json: Annotated[bool, Option("print JSON", default=False, no_form="for programs; the answer is in the log")]


VERB = Verb(
    name="effects",
    place=31,
    line="the catalogue of effects; with a scene: which are on, and why",
    arguments=Arguments,
    example="""
mpmgis effects
mpmgis effects scene.toml
mpmgis effects scene.toml --measure
mpmgis effects scene.toml --json -o effects.json
""",
    forms=(
        Form(
            "Show effects of a scene",
            "Simulate",
            "Lists the effects (curvature, entrainment, barriers, ...) that are on in a scene, and the deciding "
            "numbers. The answer is in the log, and as a table in the Results Viewer. Without a scene: the "
            "catalogue of all effects.",
            prints=True,
            table=True,
        ),
    ),
)


def scene_effects(scene: PathLike, *, laws: PathLike | None = None) -> "list[tuple[str, list[Decision]]]":
    """Return the effects of a scene and the numbers that decide them, as `mpmgis effects scene.toml`.

    Parameters
    ----------
    scene : path
    laws : path, optional
        Python file with your own law of friction; it is run as a program.

    Returns
    -------
    list of (str, list of Decision)
        For each stage, its description ("" of a scene without stages) and its decisions: effect, state, number, reason.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> ((_, decisions),) = mpmgis.scene_effects("scene.toml")  # doctest: +SKIP
    >>> pandas.DataFrame(decision._asdict() for decision in decisions)  # doctest: +SKIP
    """
    from ..simulation.scene_effects import scene_decisions

    with python_words(VERB):
        return [(words, list(decisions)) for words, decisions in scene_decisions(scene, laws)]


def effect_catalogue() -> list[dict[str, Any]]:
    """Return every effect with its table, law, parameters and their units, as `mpmgis effects`.

    Examples
    --------
    >>> pandas.DataFrame(mpmgis.effect_catalogue())  # doctest: +SKIP
    """
    from ..scene import catalogue

    found: list[dict[str, Any]] = catalogue()
    return found
