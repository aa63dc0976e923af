"""The readers of other codes' files, by name: to add one, write its module and add a row here.

They are asked in this order whose a file is: codes first, formats that anybody uses after them.
"""

from pathlib import Path

from ...errors import InputError
from . import (
    anura3d,
    cbgeo,
    delimited,
    geotaichi,
    hdf5,
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
from .parsing import unpacked_head

OWN = "mpmgis"
HEAD = 4096  # bytes of a file that a reader sees before it opens it
CODES = (matter, cbgeo, kratos, kratos_gid, geotaichi, anura3d, mpm_geomechanics, lammps)
FORMATS = (vtk, ply, npz, hdf5, delimited, parquet)
FOREIGN = {module.READER.name: module.READER for module in (*CODES, *FORMATS)}


def reader_of(path, asked=None, lenient=False):
    """Name of the reader for a file: as `asked` for, else by its contents, else our own.

    `lenient` takes a file for one of particles by its format alone, where it must be of particles in any case.

    Raises
    ------
    InputError
        There is no reader of the name asked for.
    """
    if asked is not None:
        if asked != OWN and asked not in FOREIGN:
            raise InputError(f"--reader {asked}: there is no such reader; choose from {', '.join((OWN, *FOREIGN))}")
        return asked
    path = Path(path)
    head = head_of(path)
    found = next((name for name, reader in FOREIGN.items() if reader.recognises(path, head)), None)
    if found is None and lenient:
        found = next((name for name, reader in FOREIGN.items() if reader.fits and reader.fits(path, head)), None)
    return found or OWN


def head_of(path):
    """The first bytes of a file, of a .gz unpacked; none of what is no file or cannot be opened."""
    try:
        if not Path(path).is_file():
            return b""
        with open(path, "rb") as file:
            return unpacked_head(file.read(HEAD), HEAD)
    except OSError:
        return b""
