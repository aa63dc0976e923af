"""VTK files of Anura3D: `<project>_MPVector_<step>.vtk` and `<project>_MPScalar_<step>.vtk`.

Legacy VTK, text or binary, both with the positions. `<step>` is the load step (three digits), optionally followed by
the time step (six digits); quasi-static runs have only the time step. `<project>.CPS_<load step>` has start time and
duration of a load step; files are written at its end, those of step 000 at the start of the run.
`virtual_material_point` is the type of a point: 1 material, 2 or 3 virtual, -1 removed; only type 1 is read.
`mass_solid` is weight over gravity, kN over m s-2, thus in tonnes, of the dry solid. `velocity_solid` is 0 in points of
a liquid, which has `velocity_liquid`. `integration_weight` is the current volume.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...system.errors import FormatError
from ...system.trusted_files import require_file
from ..declarations import Declarations
from .array_columns import column_names
from .reader_interface import Reader, ThirdPartyFrame, beside
from .vtk_legacy import MAGIC, POINTS, legacy_frame, read_layout

VIRTUAL, REAL = "virtual_material_point", "real_material_point"  # the second is derived: 1 for REAL_KINDS
REAL_KINDS = (1, 0)  # material, not yet typed
TONNES, MASS = "mass_solid", "mass_solid_kg"  # the second is derived
COLUMN_MAP = {
    **dict(zip("xyz", column_names(POINTS, 3), strict=True)),
    **dict(zip(("vx", "vy", "vz"), column_names("velocity_solid", 3), strict=True)),
    "mass": MASS,
    "id": "material_point_id",
    "active": REAL,
}
DERIVED = {REAL: VIRTUAL, MASS: TONNES}  # derived column, its source column
KINDS = ("MPVector", "MPScalar")
SIGNATURE = {"velocity_solid", VIRTUAL, "displacement_solid"}
_NAME = re.compile(r"(.+)_(MPScalar|MPVector|MPTensor)_(\d{3}(?=\d{6}$|$))?(\d{6})?")


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is legacy VTK with the scalars or vectors of material points.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not head.startswith(MAGIC):
        return False
    try:
        return bool(SIGNATURE & set(read_layout(path).arrays))
    except FormatError:
        return False


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in files; each frame is given by its vectors, its scalars, or both.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
    """
    groups = {}
    for path in map(Path, paths):
        match = _NAME.fullmatch(path.stem)
        if match is None:
            raise FormatError(f"{path}: expected a file name of Anura3D, <project>_MPVector_<step>.vtk")
        groups.setdefault((path.parent, match[1], _label(match)), match)
    load_steps = [(*key[:2], match[3]) for key, match in groups.items()]
    alone = {step for step in load_steps if load_steps.count(step) == 1}
    return [
        open_step(folder, match, step in alone)
        for ((folder, _, _), match), step in zip(groups.items(), load_steps, strict=True)
    ]


def _label(match: re.Match[str]) -> str:
    """Return the digits at the end of a name."""
    return (match[3] or "") + (match[4] or "")


def open_step(folder: Path, match: re.Match[str], alone: bool = True) -> ThirdPartyFrame:
    """Describe the frame of a step from all its files.

    Parameters
    ----------
    folder : Path
    match : re.Match
        Of the name of one of the files.
    alone : bool
        The step is the only one of its load step.

    Raises
    ------
    FormatError
        Damaged, or files with different numbers of points.
    """
    label = _label(match)
    there = [path for kind in KINDS if (path := folder / f"{match[1]}_{kind}_{label}.vtk").is_file()]
    if not there:
        raise FormatError(f"{folder}: neither {match[1]}_MPVector_{label}.vtk nor _MPScalar_; put them into one folder")
    number, time = (int(match[3]), _time_of(folder, match)) if match[3] and alone else (None, None)
    if match[3] is None:
        number = int(match[4])
    frame = beside([legacy_frame(path, number=number, time=time, column_map=COLUMN_MAP) for path in there])
    hint = "; current volumes do not give it"
    derived = tuple(name for name, source in DERIVED.items() if source in frame.columns)
    return replace(frame, columns=(*frame.columns, *derived), read=partial(_read, frame.read), density_hint=hint)


def _read(read: Callable, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return columns by name, with the DERIVED ones."""
    found = read(tuple(dict.fromkeys(DERIVED.get(name, name) for name in names)))
    derive = {REAL: lambda kind: np.isin(kind, REAL_KINDS).astype(np.float64), MASS: lambda tonnes: 1000.0 * tonnes}
    return {name: derive[name](found[DERIVED[name]]) if name in DERIVED else found[name] for name in names}


def _time_of(folder: Path, match: re.Match[str]) -> float | None:
    """Return the start time of the first load step for step 000, else the end time of the load step of the file."""
    load_step = int(match[3])
    times = _read_cps(folder / f"{match[1]}.CPS_{max(load_step, 1):03d}")
    if "TOTAL_TIME" not in times or (load_step > 0 and "TIME_PER_LOADSTEP" not in times):
        return None
    return times["TOTAL_TIME"] + (times["TIME_PER_LOADSTEP"] if load_step > 0 else 0.0)


def _read_cps(path: Path) -> dict[str, float]:
    """Return the values of the time keys of a CPS file; {} where it does not exist."""
    require_file(path)
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    except OSError:
        return {}
    found = {}
    for key in ("TOTAL_TIME", "TIME_PER_LOADSTEP"):
        if f"$${key}" in lines[:-1]:
            word = lines[lines.index(f"$${key}") + 1].split()
            try:
                found[key] = float(word[0].upper().replace("D", "E"))
            except (ValueError, IndexError):
                raise FormatError(f"{path}: $${key} is not a number; correct it or give --times") from None
            if not 0 <= found[key] < np.inf:
                raise FormatError(f"{path}: $${key} is {found[key]:g}, expected seconds")
    return found


READER = Reader("anura3d", recognises, frames)
