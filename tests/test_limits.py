"""The page of limits against the code: every number in its tables is that of a constant."""

import importlib
import re
from pathlib import Path

import pytest

import mpmgis

PAGE = Path(mpmgis.__file__).parent / "docs" / "limits.md"
ROW = re.compile(r"^\| (?P<limit>[^|]+) \| (?P<number>[0-9.e+-]+)[^|]* \|", re.MULTILINE)
ROWS = {found["limit"]: float(found["number"]) for found in ROW.finditer(PAGE.read_text(encoding="utf-8"))}
# limit as on the page -> module.NAME, module.Class.field, or an entry of a tuple: module.NAME.0
PAIRS = (
    (
        "the ground falls away faster than the flow could fall: the flow would become airborne",
        "simulation.run_summary.AIRBORNE_SHARE",
    ),
    ("the same, before the run: speed squared times curvature over gravity", "scene.terrain_effects.FLIGHT_THRESHOLD"),
    (
        "columns faster than twice the speed that their drop height and one cell more allow",
        "solvers.columns.column_solver.WILD_STOP",
    ),
    ("unexplained energy", "simulation.run_summary.CLOSES"),
    ("a release on ground steeper than 80 degrees", "terrain.release_parts.CLIFF_SHARE"),
    ("elevation steeper than 85 degrees: mixed units", "terrain.dtm.STEEP_SHARE"),
    ("step between cells that is a wall around a constant region", "terrain.walled_regions.WALL_DEGREES"),
    ("height of such a wall, minimum", "terrain.walled_regions.LEAST_WALL"),
    ("height from which a step of 70 degrees is such a wall", "terrain.walled_regions.HIGH_WALL"),
    ("thickness of a release or of erodible ground, maximum", "terrain.mask_values.THICKEST"),
    ("different whole numbers of a mask, maximum", "terrain.mask_values.FEW"),
    ("a release of few cells: side of a square of its area", "seeding.implausible_values.FEWEST_ACROSS"),
    ("width of a cell on a printed hazard map", "results.hazard.hazard_map.LARGEST_ON_PAPER"),
    ("new snow of three days on release areas, maximum", "seeding.snow_slabs.slab_thickness.THICKEST_SNOW"),
    ("cells of a DTM in which release areas are searched, minimum", "seeding.snow_slabs.potential_areas.FINE_CELL"),
    ("cells of a DTM in which release areas are searched, maximum", "seeding.snow_slabs.potential_areas.COARSE_CELL"),
    ("mean thickness of a release, minimum", "seeding.implausible_values.THICKNESS.0"),
    ("mean thickness of a release, maximum", "seeding.implausible_values.THICKNESS.1"),
    ("density of a release, minimum", "seeding.implausible_values.DENSITY.0"),
    ("density of a release, maximum", "seeding.implausible_values.DENSITY.1"),
    ("friction coefficient mu of a run, maximum", "seeding.implausible_values.MOST_MU"),
    ("turbulent friction xi of a run, minimum", "seeding.implausible_values.LEAST_XI"),
    ("a release of few columns", "seeding.implausible_values.FEWEST_COLUMNS"),
    ("Courant number above which the scheme is unstable", "simulation.numerical_parameters.HIGHEST_CFL"),
    (
        "speed over the speed of pressure waves: the flow is compressed, impacts are too soft",
        "scene.point_effects.MACH_THRESHOLD",
    ),
    (
        "cells over the depth of the flow, or over the height of a wall: below it shear and run-up are not resolved",
        "scene.point_effects.FEWEST_CELLS",
    ),
    (
        "mass packed above 1.2 times its density at the end of a stage of points",
        "solvers.points.point_volume.PACKED_SHARE",
    ),
    (
        "volume that does not fit into the height of the points, over the volume of their mass",
        "solvers.points.point_volume.MISSING_SHARE",
    ),
    (
        "mass at rest in columns that hang off the bed, with a gap of more than half their thickness",
        "solvers.points.point_volume.HANGING_SHARE",
    ),
    (
        "space of the material at rest on the ground (layers of 0.9 cells and more), above the volume of its mass",
        "solvers.points.point_volume.LOOSE_SHARE",
    ),
    ("points more than a cell under the ground in a single step", "solvers.points.point_numerics.LEAK_STOP"),
    ("energy created since the last frame (columns too)", "frames.particle_store.GAIN_STOP"),
    ("median of points per cell after a conversion", "conversion.conversion_account.FEWEST_IN_CELL"),
    (
        "speed across the slope over that along it, in points that become columns",
        "conversion.points_to_columns.NORMAL_SHARE",
    ),
    ("mass in flight at the end of a stage of points, which becomes columns", "simulation.run_summary.FLIGHT_SHARE"),
    ("an invalid state: one of the above, or not finite", "simulation.step_retry.HALVINGS"),
    ("predicted time", "simulation.scene_run.ASK_SECONDS"),
    ("predicted memory over free memory", "simulation.memory_need.MEMORY_SHARE"),
    (
        "size of a DTM: a seed reads and checks only the part near its release; a run reports the memory "
        "that the DTM, or its `[terrain] window`, needs",
        "terrain.dtm.READ_WHOLE",
    ),
    ("mass that left the terrain", "simulation.run_summary.LEFT_SHARE"),
    ("a filled hole of the DTM, far from known ground", "terrain.nodata_fill.FAR_PIXELS"),
    ("predicted time of a study", "studies.accuracy_study.ASK_SECONDS"),
    ("particles under the DTM, as in results of grid-based 3D codes", "maps.averaging.frame_values.RESTING_BELOW"),
    ("velocities of flow shallower than", "maps.averaging.averaging_options.USUAL_DEPTH"),
    ("distance of the corners of rasters of one result (`_pft`, `_pfv`, `_ppr`)", "results.opened_results.SAME_CELLS"),
    (
        "eroded mass, or mass that stopped in forest, in the half cell beyond the edge of the DTM",
        "maps.export.bed_rasters.BEYOND_SHARE",
    ),
    ("share of the mass that is faster than 1 m/s, at the end of a run", "frames.flow_end.FLOWING_SHARE"),
    ("ground of the run-up above or below that at the wall", "results.barrier_loads.LEVEL_SHARE"),
    ("letters of the explanations on a hazard map", "results.hazard.hazard_legend.SIZES.3"),
    ("value below the limit of an intensity class", "results.hazard.guideline_classes.ROUNDING"),
    (
        "residuals of the best parameters over the errors (chi squared per degree of freedom); above 1 it "
        "multiplies all variances",
        "studies.calibration_result.FITS",
    ),
    ("effective draws of the posterior", "studies.calibration_result.SMALL_SAMPLE"),
    ("runs that finished in all events", "studies.gaussian_process.FEWEST"),
    ("release of the scene outside a mapped outline", "studies.event_comparison.RELEASE_MISSED"),
    ("area of a mapped outline without ground in the DTM", "studies.event_comparison.OUTSIDE_DTM"),
)
CONSTANTS = dict(PAIRS)


def value_of(constant):
    """The value of module.NAME, of a default of one of its classes (module.Class.name), or of one entry: NAME.0."""
    *path, name = constant.split(".")
    if name.isdigit():
        return value_of(".".join(path))[int(name)]
    owner = value_of(".".join(path)) if path[-1][0].isupper() else importlib.import_module("mpmgis." + ".".join(path))
    return getattr(owner, name)


@pytest.mark.parametrize("limit", CONSTANTS)
def test_a_limit_is_the_constant_in_the_code(limit):
    assert ROWS[limit] == float(value_of(CONSTANTS[limit]))


def test_every_number_in_a_table_of_limits_is_held():
    assert set(ROWS) == set(CONSTANTS) and len(CONSTANTS) >= 40
