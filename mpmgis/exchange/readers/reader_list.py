"""The readers of files of other codes, by name: to add one, write its module and add it here.

The format is detected in this order: specific codes first, general formats after them.
"""

from pathlib import Path

from ...system.errors import InputError
from . import (
    anura3d,
    cbgeo,
    delimited,
    general_hdf5,
    geotaichi,
    kratos,
    kratos_gid,
    lammps,
    matter,
    mpm_geomechanics,
    npz,
    parquet,
    ply,
    vtk,
)
from .mapped_files import unpacked_head

OWN = "mpmgis"
HEAD = 4096  # [bytes] of a file for the detection of its format
CODES = (matter, cbgeo, kratos, kratos_gid, geotaichi, anura3d, mpm_geomechanics, lammps)
FORMATS = (vtk, ply, npz, general_hdf5, delimited, parquet)
FOREIGN = {module.READER.name: module.READER for module in (*CODES, *FORMATS)}


def reader_of(path: str | Path, asked: str | None = None, lenient: bool = False) -> str:
    """Return the name of the reader for a file: `asked`, else detected from its content, else OWN.

    Parameters
    ----------
    path : str or Path
    asked : str, optional
    lenient : bool
        Accept a general format without particle columns, for files that must contain particles.

    Raises
    ------
    InputError
        `asked` is unknown.
    """
    if asked is not None:
        if asked != OWN and asked not in FOREIGN:
            raise InputError(f"--reader {asked}: unknown reader; choose from {', '.join((OWN, *FOREIGN))}")
        return asked
    path = Path(path)
    head = head_of(path)
    if general_hdf5.is_own(path, head):
        return OWN  # before the readers of other codes, which would open the file again, one after the other
    found = next((name for name, reader in FOREIGN.items() if reader.recognises(path, head)), None)
    if found is None and lenient:
        found = next((name for name, reader in FOREIGN.items() if reader.fits and reader.fits(path, head)), None)
    return found or OWN


def head_of(path: str | Path) -> bytes:
    """Read the first bytes of a file (.gz decompressed); b"" for other objects and unreadable files.

    Parameters
    ----------
    path : str or Path
    """
    try:
        if not Path(path).is_file():
            return b""
        with open(path, "rb") as file:
            return unpacked_head(file.read(HEAD), HEAD)
    except OSError:
        return b""
