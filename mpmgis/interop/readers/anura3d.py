"""VTK files of Anura3D: `<project>_MPVector_<step>.vtk` and `_MPScalar_` beside it.

Legacy VTK, text or binary; each holds the places. `<step>` is the load step (three digits) and maybe the time step
(six more), of quasi-static runs the time step alone. `<project>.CPS_<load step>` tells at which time a load step begins
and how long it lasts; files are written at its end, those of step 000 at the very beginning.
`virtual_material_point` is the kind of a point: 1 of the material, 2 or 3 only there to fill elements, -1 taken out; of
them only the first is read. `mass_solid` is weight over gravity, kN over m s-2, so in tonnes, and of the dry solid.
`velocity_solid` is 0 in points of a liquid, which has `velocity_liquid`. `integration_weight` is the volume now.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import FormatError
from ...io.input_files import require_file
from .base import ForeignReader, beside
from .parsing import column_names
from .vtk_legacy import MAGIC, POINTS, legacy_frame, read_layout

VIRTUAL, REAL = "virtual_material_point", "real_material_point"  # the second is ours: 1 where the first is one of
REAL_KINDS = (1, 0)  # of the material, and of no kind yet
TONNES, MASS = "mass_solid", "mass_solid_kg"  # the second is ours
MEANT = {
    **dict(zip("xyz", column_names(POINTS, 3), strict=True)),
    **dict(zip(("vx", "vy", "vz"), column_names("velocity_solid", 3), strict=True)),
    "mass": MASS, "id": "material_point_id", "active": REAL,
}  # fmt: skip
OURS = {REAL: VIRTUAL, MASS: TONNES}  # our column, and the code's that it is made of
KINDS = ("MPVector", "MPScalar")
SIGNATURE = {"velocity_solid", VIRTUAL, "displacement_solid"}
_NAME = re.compile(r"(.+)_(MPScalar|MPVector|MPTensor)_(\d{3}(?=\d{6}$|$))?(\d{6})?")


def recognises(path, head):
    """True for legacy VTK with the scalars or vectors of material points."""
    if not head.startswith(MAGIC):
        return False
    try:
        return bool(SIGNATURE & set(read_layout(path).arrays))
    except FormatError:
        return False


def frames(paths, terms):
    """The ForeignFrames in some files, each named by its vectors, its scalars, or both."""
    groups = {}
    for path in map(Path, paths):
        match = _NAME.fullmatch(path.stem)
        if match is None:
            raise FormatError(f"{path}: wanted a name as Anura3D gives it, <project>_MPVector_<step>.vtk")
        groups.setdefault((path.parent, match[1], _label(match)), match)
    load_steps = [(*key[:2], match[3]) for key, match in groups.items()]
    alone = {step for step in load_steps if load_steps.count(step) == 1}
    return [
        open_step(folder, match, step in alone)
        for ((folder, _, _), match), step in zip(groups.items(), load_steps, strict=True)
    ]


def _label(match):
    """The digits at the end of a name."""
    return (match[3] or "") + (match[4] or "")


def open_step(folder, match, alone=True):
    """The ForeignFrame of a step, of all files there are of it; `alone` where no other is of the same load step.

    Raises
    ------
    FormatError
        Damaged, or files that do not hold as many points.
    """
    label = _label(match)
    there = [path for kind in KINDS if (path := folder / f"{match[1]}_{kind}_{label}.vtk").is_file()]
    if not there:
        raise FormatError(f"{folder}: neither {match[1]}_MPVector_{label}.vtk nor _MPScalar_; bring them together")
    number, time = (int(match[3]), _time_of(folder, match)) if match[3] and alone else (None, None)
    if match[3] is None:
        number = int(match[4])
    frame = beside([legacy_frame(path, number=number, time=time, meant=MEANT) for path in there])
    word = "; its volumes are those of now, which do not tell it"
    ours = tuple(name for name, source in OURS.items() if source in frame.columns)
    return replace(frame, columns=(*frame.columns, *ours), read=partial(_read, frame.read), density_word=word)


def _read(read, names):
    """Columns by name, OURS made of the code's own."""
    found = read(tuple(dict.fromkeys(OURS.get(name, name) for name in names)))
    made = {REAL: lambda kind: np.isin(kind, REAL_KINDS).astype(np.float64), MASS: lambda tonnes: 1000.0 * tonnes}
    return {name: made[name](found[OURS[name]]) if name in OURS else found[name] for name in names}


def _time_of(folder, match):
    """At step 000 the time at which the first load step begins, else that at which the file's own ends."""
    load_step = int(match[3])
    said = _read_cps(folder / f"{match[1]}.CPS_{max(load_step, 1):03d}")
    if "TOTAL_TIME" not in said or (load_step > 0 and "TIME_PER_LOADSTEP" not in said):
        return None
    return said["TOTAL_TIME"] + (said["TIME_PER_LOADSTEP"] if load_step > 0 else 0.0)


def _read_cps(path):
    """Numbers under the keys of a CPS file that tell the time; {} where it is not there."""
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
                raise FormatError(f"{path}: $${key} is no number; mend it or give --times") from None
            if not 0 <= found[key] < np.inf:
                raise FormatError(f"{path}: $${key} is {found[key]:g}, wanted seconds")
    return found


READER = ForeignReader("anura3d", recognises, frames)
