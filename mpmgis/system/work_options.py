"""Options of many verbs about files and machine, whatever the work."""

from typing import Annotated, TypedDict

from .option import Option

DASK = Option("use the Dask cluster with this scheduler", "ADDRESS", label="Dask cluster: address of its scheduler")


class OverwriteOptions(TypedDict, total=False):
    """Whether earlier files are replaced."""

    overwrite: Annotated[
        bool,
        Option(
            "replace earlier files of that name",
            default=False,
            folded=False,
            label="Replace earlier files of that name",
        ),
    ]
