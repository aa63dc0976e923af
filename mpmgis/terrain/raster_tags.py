"""Metadata of rasters in GDAL's default domain, which GIS programs show: time, program, symbol, unit and meaning.

`gdalinfo`, the information panel of QGIS and the attributes of rioxarray show this domain; they do not show the
namespace `mpmgis`, in which programs find the exact values. Symbols are those of Vicari et al. (2025), NHESS 25:3897.
"""

from collections.abc import Mapping, Sequence

from .. import __version__
from ..laws.quantities import Quantity

SYMBOLS = {
    "Un": "Ũn",
    "Ut": "Ũt",
    "Ut_E": "Ũt,E",
    "Ut_N": "Ũt,N",
    "h_max": "h,max",
    "t_max": "t,max",
    "Un_max": "Ũn,max",
    "Un_min": "Ũn,min",
    "Ut_max": "Ũt,max",
    "p_max": "p,max",
}


def meaning(quantity: Quantity) -> str:
    """Return symbol, unit and description of a band, for example "Ũt [m s-1]: slope-parallel speed, length of ...".

    Of thicknesses and masses it says what their sum over the cells is.

    Parameters
    ----------
    quantity : Quantity
    """
    head = f"{SYMBOLS.get(quantity.name, quantity.name)} [{quantity.unit}]"
    described = "; ".join(filter(None, (quantity.long_name, quantity.total)))
    return f"{head}: {described}" if described else head


def dataset_metadata(quantities: Sequence[Quantity], tags: Mapping[str, object]) -> dict[str, str]:
    """Return the default metadata of a raster with one band for each of `quantities`.

    Parameters
    ----------
    quantities : sequence of Quantity
    tags : mapping of str to object
        Tags of the raster; ``time`` [s], where it is there, is the simulated time.
    """
    described = "; ".join(dict.fromkeys(meaning(quantity) for quantity in quantities))
    time = {"time": time_text(tags["time"])} if "time" in tags else {}
    return {"TIFFTAG_SOFTWARE": f"mpmgis {__version__}", "TIFFTAG_IMAGEDESCRIPTION": described} | time


def band_metadata(quantity: Quantity, time: float | None = None) -> dict[str, str]:
    """Return the default metadata of a band.

    Parameters
    ----------
    quantity : Quantity
    time : float, optional [s]
        Where the bands of the file are steps.
    """
    return {"meaning": meaning(quantity)} | ({} if time is None else {"time": time_text(time)})


def time_text(time: float) -> str:
    """Return the simulated time with its unit, for example "12.5 s".

    Parameters
    ----------
    time : float [s]
    """
    return f"{float(time):.12g} s"
