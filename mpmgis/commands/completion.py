"""Declare `mpmgis completion`: what a shell needs to complete verbs, options and file names."""

from typing import Annotated, Literal, TypedDict

from ..system.option import Option
from .verb import Verb


class Arguments(TypedDict, total=False):
    """Options of the command."""

    shell: Annotated[Literal["bash", "zsh", "fish"], Option("shell to complete in", positional="one")]


VERB = Verb(
    name="completion",
    place=34,
    line="a script for the completion of commands, options and file names in bash, zsh or fish",
    arguments=Arguments,
    example="""
mpmgis completion bash > ~/.local/share/bash-completion/completions/mpmgis
mpmgis completion zsh > ~/.zfunc/_mpmgis
mpmgis completion fish > ~/.config/fish/completions/mpmgis.fish
""",
    no_form="it is for shells",
)
