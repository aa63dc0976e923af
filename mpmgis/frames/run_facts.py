"""State the parameters of a run or ensemble from its record: release, volume, friction, and how it ended."""

from pathlib import Path

from ..laws.friction import parameter_words
from .headline_numbers import error_words

FRICTION_SKIPPED = ("law", "use")  # keys of [friction] that are no parameters


def record_facts(record: dict) -> dict[str, str]:
    """Return name and text of the parameters in a record; empty for a record without a scene.

    Parameters
    ----------
    record : dict
        Of a run or ensemble, as its folder has it.

    Returns
    -------
    dict of str to str
        With the names release, thickness or vertical thickness, volume, density, friction, varied, ended, digest and
        numerical errors, as far as they are known.
    """
    if not isinstance(record.get("scene"), dict):
        return {}
    release, friction = (_table(record["scene"].get(name)) for name in ("release", "friction"))
    thickness, density = release.get("thickness"), release.get("density")
    law = str(friction.get("law", ""))
    given = {name: value for name, value in friction.items() if name not in FRICTION_SKIPPED}
    numbers = ", ".join(f"{name} {parameter_words(law, name, value)}" for name, value in given.items())
    varied = _table(_table(record.get("plan")).get("vary"))
    found = {
        "release": Path(str(release["source"])).name if release.get("source") else "",
        "thickness": f"{thickness:g} m" if isinstance(thickness, int | float) else "",
        "vertical thickness": "" if isinstance(thickness, int | float) else _measured(record, thickness),
        "volume": _volume(record, density),
        "density": f"{density:g} kg/m3" if isinstance(density, int | float) else "",
        "friction": f"{law} {numbers}".strip(),
        "varied": ", ".join(map(str, varied)),
        "ended": record.get("reason") or "",
        "digest": str(record.get("digest") or "")[:8],
        "numerical errors": error_words(record.get("companion")) or "",
    }
    return {name: text for name, text in found.items() if text}


def _table(value):
    return value if isinstance(value, dict) else {}


def _measured(record, source):
    """Thickness that a run took from a column or a raster; "" of a version without its record."""
    found = _table(record.get("release"))
    mean, largest = found.get("mean_thickness"), found.get("largest_thickness")
    if not (isinstance(mean, int | float) and isinstance(largest, int | float)):
        return ""
    named = f"from {Path(str(source)).name!r} " if source else ""
    return f"{named}{mean:.3g} m on average, {largest:.3g} m at most"


def _volume(record, density):
    """Volume of the release: as recorded, else released mass over density; "" of an ensemble."""
    volume = _table(record.get("release")).get("volume")
    mass = _table(record.get("balances")).get("mass_released")
    if not isinstance(volume, int | float) and isinstance(mass, int | float) and isinstance(density, int | float):
        volume = mass / density if density > 0 else None
    return f"{volume:.0f} m3" if isinstance(volume, int | float) else ""
