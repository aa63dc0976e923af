"""VTK files of Kratos' MPMApplication: `<ModelPart>_<rank>_<label>.vtk` for each step or time.

Legacy VTK, one vertex per material point, MP_* in fields of the cells. The label is a time where it has decimals, else
the number of a step, which `ProjectParameters.json` (same or parent folder) converts to a time. The materials file of
the settings (`ParticleMaterials.json`) has the density. MP_VOLUME and MP_DENSITY are current values.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...system.errors import FormatError
from ..declarations import Declarations
from .array_columns import column_names
from .reader_interface import (
    Reader,
    ThirdPartyFrame,
    frames_of_pieces,
    read_settings,
    same_density,
    setting,
    setting_above_zero,
)
from .vtk_legacy import MAGIC, POINTS, legacy_frame, read_layout

COLUMN_MAP = {
    **dict(zip("xyz", column_names(POINTS, 3), strict=True)),
    **dict(zip(("vx", "vy", "vz"), column_names("MP_VELOCITY", 3), strict=True)),
    "mass": "MP_MASS",
    "id": "KRATOS_ELEMENT_ID",
}
DENSITY_HINT = ", or the materials' json in its folder; its volumes and densities are current ones"
_NAME = re.compile(r"(.+)_(\d{1,9})_(\d{1,15})(\.\d{1,15})?")


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file is legacy VTK with fields of material points.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file.
    """
    if not head.startswith(MAGIC):
        return False
    try:
        return any(name.startswith("MP_") for name in read_layout(path).arrays)
    except FormatError:
        return False


def frames(paths: Iterable[Path], terms: Declarations) -> list[ThirdPartyFrame]:
    """Describe the frames in files; the files of all ranks form one frame.

    Parameters
    ----------
    paths : iterable of Path
    terms : Declarations

    Raises
    ------
    FormatError
    """
    return frames_of_pieces(paths, _pieces, open_file)


def _pieces(path: Path) -> list[Path]:
    """Return the files of all ranks with the label of this one."""
    match = _NAME.fullmatch(path.stem)
    if match is None:
        return [path]
    found = {
        int(piece[2]): other
        for other in path.parent.glob("*.vtk")
        if (piece := _NAME.fullmatch(other.stem)) and (piece[1], piece[3], piece[4]) == (match[1], match[3], match[4])
    }
    lacking = [rank for rank in range(len(found)) if rank not in found]
    if lacking:
        raise FormatError(
            f"{path}: found ranks {', '.join(map(str, sorted(found)))}, {lacking[0]} is missing; put them into "
            "one folder"
        )
    return [found[rank] for rank in sorted(found)]


def open_file(path: str | Path) -> ThirdPartyFrame:
    """Describe the frame of one rank.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        No legacy VTK, damaged, no material points.
    """
    path = Path(path)
    layout = read_layout(path)
    if not any(name.startswith("MP_") for name in layout.arrays):
        raise FormatError(f"{path} has no fields MP_*; it is not a file of Kratos' material points")
    settings, folder = project_settings(path)
    match = _NAME.fullmatch(path.stem)
    is_time = match is not None and match[4] is not None
    step = None if match is None or is_time else int(match[3])
    return legacy_frame(
        path,
        layout,
        column_map=COLUMN_MAP,
        number=step,
        time=float(match[3] + match[4]) if is_time else _time_of(settings, step),
        density=materials_density(settings, folder),
        density_hint=DENSITY_HINT,
    )


def _time_of(settings: dict[str, Any], label: int | None) -> float | None:
    """Return the time [s] of an integer label, which is a step unless the settings declare labels as times."""
    if label is None:
        return None
    outputs = setting(settings, "output_processes")
    outputs = [p for group in outputs.values() if isinstance(group, list) for p in group] if outputs else []
    kinds = {
        setting(process, "Parameters", "output_control_type")
        for process in outputs
        if setting(process, "python_module") == "mpm_vtk_output_process"
    }
    if kinds == {"time"}:
        return float(label)
    step = setting_above_zero(settings, "solver_settings", "time_stepping", "time_step")
    return label * step if kinds == {"step"} and step is not None else None


def project_settings(path: str | Path) -> tuple[dict[str, Any], Path | None]:
    """Read `ProjectParameters.json` in the folder of a file or its parent.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    settings : dict of str to Any
    folder : Path or None
        That of the settings; {} and None where there are none.

    Raises
    ------
    FormatError
    """
    folder = Path(path).resolve().parent
    for place in (folder, folder.parent):
        settings = read_settings(place / "ProjectParameters.json")
        if settings:
            return settings, place
    return {}, None


def materials_density(settings: dict[str, Any], folder: Path | None) -> float | None:
    """Return the DENSITY of all materials in the settings of a run.

    Parameters
    ----------
    settings, folder : dict of str to Any, Path or None
        As `project_settings` returns them.

    Returns
    -------
    float or None [kg m-3]
        None where it is missing or not unique.

    Raises
    ------
    FormatError
    """
    name = setting(settings, "solver_settings", "material_import_settings", "materials_filename")
    if folder is None or not isinstance(name, str):
        return None
    materials = setting(read_settings(folder / name), "properties")
    if not isinstance(materials, list):
        return None
    return same_density(setting_above_zero(material, "Material", "Variables", "DENSITY") for material in materials)


READER = Reader("kratos", recognises, frames)
