"""Write the toolbox for QGIS as a zip: `mpmgis qgis-plugin`."""

from pathlib import Path
from typing import Annotated, TypedDict

from ..system.option import Option, PathLike
from .verb import Verb
from .verb_calls import complete, python_words


class PublisherOptions(TypedDict, total=False):
    """For the plugin repository."""

    homepage: Annotated[str, Option("address of the source code; its issues are at URL/issues", "URL")]
    email: Annotated[str, Option("of the publisher of the plugin", "ADDRESS")]


class Arguments(PublisherOptions, total=False):
    """Options of the command."""

    output: Annotated[PathLike, Option("zip to write", "FILE.zip", short="-o", default=Path("mpmgis_qgis.zip"))]
    overwrite: Annotated[bool, Option("replace an earlier file of that name", default=False)]


VERB = Verb(
    name="qgis-plugin",
    place=32,
    line="the toolbox for QGIS as a zip, to be installed there",
    arguments=Arguments,
    groups=(("for the plugin repository", PublisherOptions),),
    example="""
mpmgis qgis-plugin
mpmgis qgis-plugin -o toolbox/mpmgis_qgis.zip
""",
    no_form="it creates this toolbox",
)


def qgis_plugin(
    output: PathLike = "mpmgis_qgis.zip",
    *,
    overwrite: bool = False,
    homepage: str | None = None,
    email: str | None = None,
) -> Path:
    """Write the toolbox for QGIS as a zip, as `mpmgis qgis-plugin`.

    Parameters
    ----------
    output : path
        The zip.
    overwrite : bool
        Replace an earlier file of that name.
    homepage, email : str, optional
        Of the publisher, for the plugin repository.

    Returns
    -------
    Path
        The zip.

    Raises
    ------
    MpmgisError

    Examples
    --------
    >>> mpmgis.qgis_plugin("mpmgis_qgis.zip")  # doctest: +SKIP
    """
    from ..maps.qgis.plugin_zip import write_plugin_zip
    from ..results.hazard.guideline_files import read_guidelines
    from ..results.hazard.hazard_files import read_matrices
    from .plugin_forms import plugin_forms

    given = {"output": output, "overwrite": overwrite, "homepage": homepage, "email": email}
    with python_words(VERB):
        values = complete(VERB, given)
        forms = plugin_forms(tuple(read_guidelines()), tuple(read_matrices()))
        write_plugin_zip(forms=forms, path=values.pop("output"), **values)
    return Path(output)
