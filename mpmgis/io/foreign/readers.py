"""The readers of other codes' files, by name: to add one, write its module and add a row here."""

from ...errors import InputError
from . import matter

OWN = "mpmgis"
FOREIGN = {reader.name: reader for reader in (matter.READER,)}


def reader_of(path, asked=None):
    """Name of the reader for a file: as `asked` for, else by its contents, else our own.

    Raises
    ------
    InputError
        There is no reader of the name asked for.
    """
    if asked is not None:
        if asked != OWN and asked not in FOREIGN:
            raise InputError(f"--reader {asked}: there is no such reader; choose from {', '.join((OWN, *FOREIGN))}")
        return asked
    return next((name for name, reader in FOREIGN.items() if reader.recognises(path)), OWN)
