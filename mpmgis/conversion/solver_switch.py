"""Transfer of a flow from one solver to the other during a run, with its balances."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..frames.particles import Particles
from ..laws.quantities import GRAVITY
from ..system.errors import InputError
from .columns_to_points import columns_to_points, velocity_gradient
from .conserved_sums import NOTHING, Sums, bed_words, conservation_error, sums_of
from .conversion_options import LAY, ColumnOptions
from .points_to_columns import points_to_columns

if TYPE_CHECKING:
    import shapely

    from ..frames.particles import Frame
    from ..terrain.elevation import Terrain
    from .conversion_options import PointOptions


@dataclass(frozen=True)
class SwitchAccount:
    """Balance of a switch: sums over the flow before and after it.

    Parameters
    ----------
    before, after : Sums
        Of the flow of the solver before, and of the next one.
    outside : Sums
        Of the flow outside the window.
    off : Sums
        Of flow without ground or without a whole cell of the next solver below it, which has left the terrain.
    bed : Sums
        Of the motion across the bed, which the bed takes; without mass.
    laid : float [kg]
        Part of `after` that was above the bed, or moved across it, and was moved onto it.
    """

    before: Sums
    after: Sums
    outside: Sums = NOTHING
    off: Sums = NOTHING
    bed: Sums = NOTHING
    laid: float = 0.0

    def errors(self) -> tuple[float, float]:
        """Return the relative errors of mass and of horizontal momentum [1]."""
        return conservation_error(self.before, self.after, self.outside, self.off, self.bed)

    def as_numbers(self) -> dict:
        """Return the balance as plain numbers for a record."""
        mass, momentum = self.errors()
        sums = {name: getattr(self, name)._asdict() for name in ("before", "after", "outside", "off", "bed")}
        return {**sums, "laid_mass": self.laid, "mass_error_relative": mass, "momentum_error_relative": momentum}

    def lines(self, outside: str = "booked and gone") -> list[str]:
        """Return the lines of a report.

        Parameters
        ----------
        outside : str
            What happens to the part outside the window.
        """
        before, after, (mass, momentum) = self.before, self.after, self.errors()
        lines = [
            f"{before.count} particles became {after.count}; mass {before.mass:.9g} kg and horizontal momentum "
            f"({before.momentum[0]:.6g}, {before.momentum[1]:.6g}) kg m s-1 are kept to {mass:.1e} and {momentum:.1e}",
            f"vertical momentum {before.momentum[2]:.6g}, now {after.momentum[2]:.6g} kg m s-1; kinetic energy "
            f"{before.kinetic:.6g}, now {after.kinetic:.6g} J",
        ]
        parts = ((self.outside, f"outside the window, {outside}"), (self.off, "outside the terrain of the next solver"))
        for part, what in parts:
            if part.count:
                momentum = ", ".join(f"{value:.6g}" for value in part.momentum)
                lines.append(
                    f"{what}: {part.mass:.9g} kg ({100 * part.mass / before.mass:.3g} %), momentum ({momentum}) "
                    f"kg m s-1, kinetic energy {part.kinetic:.6g} J"
                )
        if self.bed.kinetic:
            lines.append(bed_words(self.bed))
        if self.laid:
            lines.append(f"{self.laid:.6g} kg above the bed, or moving across it, were moved onto it")
        return lines


@dataclass(frozen=True)
class Switched:
    """Start of a solver.

    Parameters
    ----------
    frame : Frame
    vertical_stress : float64[n] or None [Pa]
        Of points.
    gradient : float64[n, k, k] or None [s-1]
        Of the velocity; None: not known.
    rest : Frame or None
        Of columns outside the window; None without any.
    account : SwitchAccount
    """

    frame: "Frame"
    vertical_stress: np.ndarray | None
    gradient: np.ndarray | None
    rest: "Frame | None"
    account: SwitchAccount


def switch_to_points(
    frame: "Frame",
    terrain: "Terrain",
    options: "PointOptions",
    holds: Callable,
    window: "shapely.Geometry | None" = None,
) -> Switched:
    """Convert the columns of a frame to points on a terrain, for the next solver.

    Parameters
    ----------
    frame : Frame
    terrain : Terrain
    options : PointOptions
    holds : callable
        Frame -> bool[n]: particles on the next solver's grid.
    window : shapely.Geometry, optional
        Only columns inside; default: all.

    Returns
    -------
    Switched

    Raises
    ------
    InputError
        Nothing in the window, or on the terrain.
    """
    points, gravity = columns_to_points(frame, terrain, options, window), options.gravity
    kept, off = _parted(points.frame, holds, gravity)
    rest, bare = _on_ground(points.rest, terrain, gravity)
    outside = NOTHING if rest is None else _sums(rest, gravity)
    account = SwitchAccount(points.report.before, _sums(kept, gravity), outside, _together(off, bare))
    state = kept.state
    return Switched(replace(kept, state={}), state["vertical_stress"], state.get("affine"), rest, account)


def switch_to_columns(
    frame: "Frame",
    terrain: "Terrain",
    cell: float,
    holds: Callable,
    beside: "Frame | None" = None,
    gravity: float = GRAVITY,
    slopes: Callable | None = None,
) -> Switched:
    """Gather the points of a frame into columns on a terrain, for the next solver.

    Parameters
    ----------
    frame : Frame
    terrain : Terrain
    cell : float [m]
        Side of the columns' cells.
    holds : callable
        As in `switch_to_points`.
    beside : Frame, optional
        Columns that continue unchanged.
    gravity : float [m s-2]
        Of the energies in the account.
    slopes : callable, optional
        As in `points_to_columns`.

    Raises
    ------
    InputError
        Nothing on the terrain.
    """
    before, bare, bed, laid, frames = NOTHING, NOTHING, NOTHING, 0.0, []
    if len(frame.particles):
        options = ColumnOptions(by="cell", cell=cell, detached=LAY)
        gathered = points_to_columns(frame, terrain, options, gravity, slopes)
        report, frames = gathered.report, [gathered.frame]
        before, bare, bed, laid = report.before, report.outside, report.bed, report.laid
    if beside is not None and len(beside.particles):
        frames.append(replace(beside, state={"velocity_gradient": velocity_gradient(beside)}, maxima={}))
        before = _together(before, _sums(beside, gravity))
    kept, off = _parted(_one_frame(frames), holds, gravity)
    account = SwitchAccount(before, _sums(kept, gravity), off=_together(off, bare), bed=bed, laid=laid)
    return Switched(replace(kept, state={}), None, kept.state["velocity_gradient"], None, account)


def _one_frame(frames):
    """One Frame of the columns of all `frames`, renumbered, relative to the origin of the first."""
    first = frames[0]
    if len(frames) == 1:
        return first
    names = [name for name in first.particles.arrays() if name not in ("id", "parent")]
    moved = [
        replace(frame.particles, position=frame.particles.position + np.subtract(frame.origin, first.origin))
        for frame in frames
    ]
    arrays = {name: np.concatenate([getattr(particles, name) for particles in moved]) for name in names}
    gradient = np.concatenate([frame.state["velocity_gradient"] for frame in frames])
    ids = np.arange(len(gradient), dtype=np.uint64)
    return replace(first, particles=Particles(**arrays, id=ids), state={"velocity_gradient": gradient})


def _parted(frame, holds, gravity):
    """(`frame` with the particles on the grid of the next solver, Sums of the others)."""
    held = holds(frame)
    if held.all():
        return frame, NOTHING
    if not held.any():
        raise InputError("no flow is on the grid of the next [[stage]]; use a larger DTM")
    rows = {name: values[held] for name, values in frame.state.items() if np.shape(values)[:1] == held.shape}
    kept = replace(frame, particles=frame.particles.take(held), state=rows)
    return kept, _sums(replace(frame, particles=frame.particles.take(~held)), gravity)


def _on_ground(rest, terrain, gravity):
    """(those of the Frame `rest` with ground under them or None, Sums of the others)."""
    if rest is None:
        return None, NOTHING
    known = np.isfinite(terrain.sample(*rest.map_xy()))
    rows = {name: values[known] for name, values in rest.state.items()}
    kept = replace(rest, particles=rest.particles.take(known), state=rows)
    bare = NOTHING if known.all() else _sums(replace(rest, particles=rest.particles.take(~known)), gravity)
    return kept if known.any() else None, bare


def _sums(frame, gravity):
    particles = frame.particles
    middle = particles.position[:, 2] + frame.origin[2]
    if particles.thickness is not None:
        middle = middle + 0.5 * particles.thickness
    return sums_of(particles.mass, particles.velocity, middle, gravity)


def _together(one, other):
    momentum = tuple(a + b for a, b in zip(one.momentum, other.momentum, strict=True))
    return Sums(
        one.count + other.count,
        one.mass + other.mass,
        momentum,
        one.kinetic_horizontal + other.kinetic_horizontal,
        one.kinetic_vertical + other.kinetic_vertical,
        one.potential + other.potential,
    )
