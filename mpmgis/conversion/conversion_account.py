"""Report of a conversion: conserved and changed quantities, and the errors of the printed algorithm."""

from typing import TYPE_CHECKING

from .columns_to_points import OVERLAP
from .conserved_sums import bed_words, conservation_error

if TYPE_CHECKING:
    from .columns_to_points import PointsReport
    from .conversion_options import ColumnOptions, PointOptions
    from .points_to_columns import ColumnsReport

FEWEST_IN_CELL = 4  # [points] median in a cell of the 3D grid, below which it is badly sampled
_SEEN = 0.01  # [m] shift of a bed up to which nothing is reported


def account_of_points(report: "PointsReport", options: "PointOptions") -> list[str]:
    """Return the lines of a report about a conversion to points.

    Parameters
    ----------
    report : PointsReport
    options : PointOptions
        Of the conversion.
    """
    after, low, median, high = report.after, *report.points_per_column
    lines = [
        f"{report.before.count} columns became {after.count} points, {low} to {high} above each other (median "
        f"{median:g}), {report.spacing:g} m apart as requested, {report.largest_gap:.3g} m at most"
    ]
    lines += _balance(report.before, after, report.outside, report.deleted)
    lines.append(
        f"vertical momentum {after.momentum[2]:.6g} kg m s-1 (columns: {report.before.momentum[2]:.6g}); kinetic "
        f"energy {after.kinetic_horizontal:.6g} J horizontal, {after.kinetic_vertical:.6g} J vertical (columns: "
        f"{report.before.kinetic_horizontal:.6g} and {report.before.kinetic_vertical:.6g})"
    )
    if report.outside.count:
        lines.append(_left_out(report.outside, report.before, "columns have no ground under them and are left out"))
    if report.bed_shift > _SEEN:
        lines.append(
            f"the beds of the columns are up to {report.bed_shift:.2g} m off the DTM; points are on the DTM, with "
            "the columns' thickness"
        )
    lines += _sideways(report, options)
    return lines + (_printed(report) if options.deletes_single_points else [])


def _balance(before, *after):
    mass, momentum = conservation_error(before, *after)
    return [
        f"mass {before.mass:.9g} kg and horizontal momentum ({before.momentum[0]:.6g}, {before.momentum[1]:.6g}) "
        f"kg m s-1 are kept to {mass:.1e} and {momentum:.1e}"
    ]


def _left_out(part, whole, what):
    return f"{part.count} {what}: {part.mass:.6g} kg ({100 * part.mass / whole.mass:.2g} % of the mass)"


def _sideways(report, options):
    """Lines about the horizontal arrangement of points."""
    if options.cell is None:
        return [
            f"stacks of points are up to {report.widest:.3g} m apart: a 3D grid with smaller cells would see "
            "curtains with gaps between them (--cell M splits columns for cells of M metres)"
        ]
    low, median, high = report.points_per_cell
    lines = [
        f"columns are cut into up to {report.pieces_per_column} stacks; cells of {options.cell:g} m contain {low} to "
        f"{high} points, median {median:g}"
    ]
    if median < FEWEST_IN_CELL:
        lines.append(
            f"fewer than {FEWEST_IN_CELL} points in the median cell sample it badly; take a smaller --spacing, or "
            "larger cells"
        )
    if report.raised:
        lines.append(
            f"{report.raised} stacks where columns overlapped (density up to {100 * report.overlap:.3g} % too "
            "high) were raised to the height of their mass"
        )
    elif report.overlap > OVERLAP - 1.0:
        lines.append(
            f"columns overlap: density is up to {100 * report.overlap:.3g} % too high in places "
            "(--relevel raises them to the height of their mass)"
        )
    return lines


def _printed(report):
    """Defects of the algorithm as printed in MOX report 15/2025, with the figures of this conversion."""
    before, after, deleted = report.before, report.after, report.deleted
    lines = ["every choice as MOX report 15/2025 prints it, with these defects:"]
    if deleted.count:
        lines.append(
            "  Eq (2) is 0/0 in columns of one point, which 'eliminate NaN' deletes: "
            + _left_out(deleted, before, "columns are lost")
        )
    lines += [
        f"  Eq (2) puts points on the bed and on the surface: the second moment of a column's mass is "
        f"{100 * (report.second_moment - 1):.2g} % too large",
        f"  floor in Eq (1) leaves points up to {report.largest_gap:.3g} m apart where {report.spacing:g} m were "
        "asked for",
        f"  vertical velocity 0 (Eq 3) is not along the slope: the flow takes off at up to {report.launch:.3g} "
        f"m/s, kinetic energy is {after.kinetic:.6g} J (columns: {before.kinetic:.6g} J)",
        "  Eq (3)'s horizontal accelerations are left out: an explicit MPM computes them in every step",
        "  no initial stress: layers first drop until their elasticity carries them",
        f"  columns up to {report.widest:.3g} m wide are not split sideways",
        f"  Eq (4) gives eps_m = {report.mass_scatter:.4g} kg and {report.momentum_scatter:.4g} kg m s-1: the "
        "scatter of particle masses, which falls with particle size whether or not mass is conserved",
    ]
    return lines


def account_of_columns(report: "ColumnsReport", options: "ColumnOptions") -> list[str]:
    """Return the lines of a report about a conversion to columns.

    Parameters
    ----------
    report : ColumnsReport
    options : ColumnOptions
        Of the conversion.
    """
    how = "of one parent" if report.by == "parent" else f"of a cell of {report.cell_area:g} m2"
    columns = "1 column" if report.after.count == 1 else f"{report.after.count} columns, each"
    lines = [f"{columns} of the points {how}, from {report.before.count} points"]
    lines += _balance(report.before, report.after, report.outside, report.detached, report.bed)
    lines.append(f"{bed_words(report.bed)}; {report.kinetic_lost:.4g} J of the motion within columns are lost")
    if report.by == "parent" and options.cell is not None:
        lines.append(f"cells of {options.cell:g} m were not used: the points have parents (--by cell enforces cells)")
    if report.apart and report.by == "cell":
        lines.append(
            f"columns with {100 * report.apart:.2g} % of the mass have moved apart since their conversion, so that "
            "cells were used instead (--by parent enforces parents)"
        )
    if report.outside.count:
        lines.append(_left_out(report.outside, report.before, "points with no ground under them stay points"))
    if report.detached.count:
        lines.append(_left_out(report.detached, report.before, "points clear of the bed or leaving it stay points"))
    return lines
