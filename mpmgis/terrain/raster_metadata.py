"""Metadata of rasters: symbol, unit, meaning and time."""

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
    """Symbol, unit and description of a band, for example "Ũt [m s-1]: slope-parallel speed, length of ..."."""
    head = f"{SYMBOLS.get(quantity.name, quantity.name)} [{quantity.unit}]"
    return f"{head}: {quantity.long_name}" if quantity.long_name else head


def dataset_metadata(quantities: Sequence[Quantity], tags: Mapping[str, object]) -> dict[str, str]:
    """Default metadata of a raster with one band for each of `quantities`; `tags["time"]` [s] is its simulated time."""
    described = "; ".join(dict.fromkeys(meaning(quantity) for quantity in quantities))
    time = {"time": time_text(tags["time"])} if "time" in tags else {}
    return {"TIFFTAG_SOFTWARE": f"mpmgis {__version__}", "TIFFTAG_IMAGEDESCRIPTION": described} | time


def band_metadata(quantity: Quantity, time: float | None = None) -> dict[str, str]:
    """Default metadata of a band; `time` [s] where the bands of its file are steps."""
    return {"meaning": meaning(quantity)} | ({} if time is None else {"time": time_text(time)})


def time_text(time: float) -> str:
    """Simulated time with its unit, for example "12.5 s"."""
    return f"{float(time):.12g} s"
