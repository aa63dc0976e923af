"""Read the events of a calibration with the files of their observations."""

from dataclasses import dataclass, replace
from pathlib import Path

from ..scene.scene_reading import read_toml
from ..system.errors import InputError
from ..terrain.raster_input import read_raster
from ..terrain.undeclared_nodata import THICKNESS
from ..terrain.vector_table import read_table
from .calibration_options import AskedCalibration

EVENT_KEYS = ("scene", "observed", "points", "deposit", "volume", "line")


@dataclass(frozen=True)
class Event:
    """Files of one event; at least one of observed, points, deposit and volume is given.

    Parameters
    ----------
    name : str
    scene : Path
    observed : Path or None
        Outline of the whole flow.
    points : Path or None
        Values at points.
    deposit : Path or None
        Raster of the vertical thickness.
    volume : (float, float) or None [m3]
        Of the deposit, and its standard deviation.
    line : Path or None
        Path of the flow.
    """

    name: str
    scene: Path
    observed: Path | None = None
    points: Path | None = None
    deposit: Path | None = None
    volume: tuple | None = None
    line: Path | None = None

    @property
    def needs_deposit(self) -> bool:
        """Whether runs must keep their deposit."""
        return self.deposit is not None or self.volume is not None

    def require_readable(self) -> None:
        """Read the observations once, so that wrong files are refused before the first run.

        Raises
        ------
        FormatError, InputError
        """
        for path, kind in ((self.observed, "Polygon"), (self.points, "Point"), (self.line, "LineString")):
            if path is not None:
                read_table(path, kind, "")
        if self.deposit is not None:
            read_raster(self.deposit, THICKNESS)


def events_of(asked: AskedCalibration) -> list[Event]:
    """Return the event of a calibration and those of its event files.

    Parameters
    ----------
    asked : AskedCalibration

    Raises
    ------
    InputError, SceneError
    """
    volume = volume_of(asked["volume"], asked["value_error"], "`volume`")
    first = Event(
        Path(asked["scene"]).stem,
        Path(asked["scene"]),
        asked["observed"],
        asked["points"],
        asked["deposit"],
        volume,
        asked["line"],
    )
    found = [first, *(_read_event(Path(path), asked) for path in asked["event"])]
    for event in found:
        if not any((event.observed, event.points, event.deposit, event.volume)):
            raise InputError(
                f"{event.scene}: nothing observed is given; give `observed`, `points`, `deposit`, `volume`"
            )
        if event.deposit is not None and event.observed is None and event.line is None:
            raise InputError(f"{event.deposit}: a deposit needs `observed` or `line` for the path of the flow")
        event.require_readable()
    numbers = dict.fromkeys((event.name for event in found), 0)
    if len(numbers) == len(found):
        return found
    return [replace(event, name=f"{k}_{event.name}") for k, event in enumerate(found, 1)]


def _read_event(path, asked):
    """Return the Event in a TOML file; its paths are relative to it."""
    tables = read_toml(path)
    wrong = [key for key in tables if key not in EVENT_KEYS]
    if wrong or "scene" not in tables:
        problem = f"unknown key {wrong[0]!r}" if wrong else "no key scene"
        raise InputError(f"{path}: {problem}; expected {', '.join(EVENT_KEYS)}")
    files = {key: path.parent / str(tables[key]) for key in EVENT_KEYS if key in tables and key != "volume"}
    volume = tables.get("volume")
    volume = volume_of(None if volume is None else str(volume), asked["value_error"], f"{path}: volume")
    return Event(path.stem, **files, volume=volume)


def volume_of(text: str | None, error: float, where: str) -> tuple[float, float] | None:
    """Read a volume with its standard deviation from VOLUME or VOLUME:SD.

    Parameters
    ----------
    text : str or None
    error : float [1]
        Standard deviation over the volume, where it is not given.
    where : str
        Origin of the text, for messages.

    Returns
    -------
    (float, float) [m3] or None
        None for None.

    Raises
    ------
    InputError
        Other text, or numbers that are not above 0.
    """
    if text is None:
        return None
    try:
        value, *given = map(float, str(text).split(":"))
    except ValueError:
        value, given = float("nan"), []
    deviation = given[0] if given else error * value
    if len(given) > 1 or not (0 < value < float("inf") and 0 < deviation < float("inf")):
        raise InputError(f"{where} is {text!r}, expected VOLUME or VOLUME:SD in m3, above 0")
    return value, deviation
