"""Checks on several keys or tables of a scene together."""

from dataclasses import fields

from ..laws import friction
from ..system.errors import SceneError
from .forest_effect import check_forest
from .key_checks import checked_value, listed, meant, range_of, refuse_both, shown
from .scene import Scene
from .solver_checks import check_points
from .stage_checks import check_stages
from .tables import OF_PARTICLES, ReleaseTable, keys_of

MOST_FRAMES = 1e6  # of a run; more is a typing error


def check_together(scene: Scene, where: str) -> None:
    """Refuse keys and tables that contradict each other.

    Parameters
    ----------
    scene : Scene
    where : str
        Name of the scene in messages.

    Raises
    ------
    SceneError
    """
    numerics, output = scene.numerics, scene.output
    _check_sources(scene, where)
    _check_window(scene.terrain.window, where)
    _check_needs(scene, where)
    check_stages(scene, where)
    if "points" in scene.solvers:
        check_points(scene, where)
    elif numerics.precision != "float64":
        raise SceneError(
            f"{where} [numerics]: precision = {numerics.precision!r} requires solver = 'points'; columns are "
            "computed in float64 (float32 would save 5 % of the time): remove it"
        )
    if numerics.companion:
        _check_companion(scene, where)
    _check_material(scene, where)
    _check_zones(scene, where)
    _check_places(scene, where)
    check_forest(scene, where)
    if 0.0 < numerics.clamp < 1.0:
        raise SceneError(f"{where} [numerics]: clamp = {numerics.clamp:g} allows no thickness; use at least 1, or 0")
    if output.frame_interval > output.end_time:
        raise SceneError(
            f"{where} [output]: frame_interval = {output.frame_interval:g} is longer than end_time = "
            f"{output.end_time:g}; take a shorter one"
        )
    if output.end_time / output.frame_interval > MOST_FRAMES:
        raise SceneError(
            f"{where} [output]: end_time = {output.end_time:g} and frame_interval = {output.frame_interval:g} give "
            "more than a million frames; take an earlier end_time or a longer frame_interval"
        )
    if numerics.form == "swe" and scene.curvature is not None and scene.curvature.use not in ("auto", "off"):
        use = scene.curvature.use
        raise SceneError(f"{where} [curvature]: use = {use!r} requires form = 'slope'; remove the table")
    if numerics.form != "swe" and scene.still_water is not None and scene.still_water.use != "off":
        raise SceneError(f"{where} [still_water]: a lake at rest needs [numerics] form = 'swe'")


def _check_needs(scene: Scene, where: str) -> None:
    """Refuse keys that have no use without another key of their table."""
    for name, table in scene.tables():
        for key, f in keys_of(type(table)).items():
            needed = f.metadata["needs"]
            if needed and getattr(table, key) != f.default and not getattr(table, needed):
                words = f"{needed} = true" if keys_of(type(table))[needed].metadata["kind"] is bool else needed
                raise SceneError(f"{where} [{name}]: {key} is used only with {words}; add it, or take it out")


def _check_companion(scene: Scene, where: str) -> None:
    """Refuse a companion run that has nothing to compare."""
    if len(scene.stage) > 1:
        raise SceneError(f"{where} [numerics]: companion = true is for runs of one solver; remove it")
    if "points" in scene.solvers and not scene.output.maxima:
        raise SceneError(
            f"{where} [numerics]: companion = true compares the largest thickness of a 3D run, which is kept only with "
            "[output] maxima = true; add it, or remove companion"
        )


def _check_sources(scene: Scene, where: str) -> None:
    """Check what starts to move: mass from an area, from particles or through an inlet."""
    release, inflow = scene.release, scene.hydrograph
    if release is None and (inflow is None or inflow.use == "off"):
        raise SceneError(
            f"{where}: the table [release] is missing, and there is no [hydrograph] with inflow; "
            "`mpmgis run --template` shows both"
        )
    if release is None:
        return
    if (release.source is None) == (release.particles is None):
        got = "both" if release.source else "none"
        raise SceneError(f"{where} [release]: expected either source or particles, got {got}")
    if release.particles is not None:
        declared = ("density", *OF_PARTICLES) if scene.solver == "points" else ()
        _refuse_unused(release, ("source", "particles", "window", *declared), f"{where} [release]")
        _check_declarations(release, f"{where} [release]")
    if release.speed is not None and any(release.velocity):
        raise SceneError(f"{where} [release]: speed and velocity exclude each other; take one of them out")


def _check_declarations(release: ReleaseTable, where: str) -> None:
    """Check the keys about particles of another code that depend on each other."""
    if release.at_time is None and (release.times or release.dt or release.fps):
        raise SceneError(f"{where}: times, dt and fps are for at_time, which chooses a frame; add it, or remove them")


def _check_window(window: tuple | None, where: str) -> None:
    """Refuse a window whose numbers are not in their order."""
    if window is not None and not (window[0] < window[2] and window[1] < window[3]):
        raise SceneError(
            f"{where} [terrain]: window = {shown(list(window))}, expected west below east and south below north, in "
            "this order"
        )


def _check_material(scene: Scene, where: str) -> None:
    """Refuse values of resistance that contradict each other."""
    table = scene.earth_pressure
    if table is not None and table.use != "off" and scene.bed_friction_angle() > table.friction_angle:
        of_mu = "" if table.bed_friction_angle is not None else " (atan of the friction coefficient)"
        raise SceneError(
            f"{where} [earth_pressure]: the bed's friction angle, {scene.bed_friction_angle():.4g} degrees{of_mu}, is "
            f"above friction_angle = {table.friction_angle:g}; give bed_friction_angle, at most that"
        )
    table = scene.viscosity
    if table is not None and table.viscosity == 0.0 and table.yield_stress == 0.0:
        raise SceneError(f"{where} [viscosity]: viscosity and yield_stress are both 0; give one, or take the table out")


def _check_zones(scene: Scene, where: str) -> None:
    """Check that zones give parameters of the law that [friction] names: numbers in their range, columns or rasters."""
    if not scene.zones:
        return
    if scene.friction is None:
        raise SceneError(f"{where} [[zones]]: zones need [friction] with its law; write it before the zones")
    law = scene.friction.law
    instead = friction.given_instead(law)
    wanted = scene.laws[law][1] | {name: parameter for name, (_, parameter) in instead.items()}
    for number, zone in enumerate(scene.zones, 1):
        here = f"{where} [[zones]] number {number}"
        if not zone.parameters:
            raise SceneError(f"{here}: it has no parameter of {law}; expected {listed(wanted)}")
        for name, value in zone.parameters.items():
            if law == friction.SIZED_LAW and name == friction.SIZE:
                sizes = ", ".join(f"{mu:g} ({size})" for size, mu in friction.SIZES.items())
                raise SceneError(
                    f"{here}: {name} = {shown(value)} is only for [friction], expected {listed(wanted)}; give the mu "
                    f"of a size: {sizes}, or the column size in the table of `mpmgis friction-map`"
                )
            if name not in wanted:
                raise SceneError(
                    f"{here}: {law} has no parameter {shown(name)}{meant(name, wanted)}; it takes {listed(wanted)}"
                )
            zone.parameters[name] = checked_value(range_of(wanted[name], (float, str)), value, f"{here}: {name}")
            if name in instead:
                refuse_both(name, instead[name][0], zone.parameters, here)
        if zone.source is None and all(not isinstance(value, str) for value in zone.parameters.values()):
            raise SceneError(
                f"{here}: without source, numbers would apply everywhere; give source (polygons), "
                f"or put them in [friction]"
            )


def _check_places(scene: Scene, where: str) -> None:
    """Check the keys of barriers and lakes that depend on each other."""
    for number, barrier in enumerate(scene.barrier, 1):
        if (barrier.height is None) == (barrier.crest is None):
            got = "none" if barrier.height is None else "both"
            raise SceneError(f"{where} [[barrier]] number {number}: expected either height or crest, got {got}")
    lake = scene.still_water
    if lake is not None and isinstance(lake.level, str) and lake.source is None:
        raise SceneError(
            f"{where} [still_water]: level = {lake.level!r} is a column, but there is no source with columns; give "
            "source, or level a number of metres"
        )


def _refuse_unused(release: ReleaseTable, used: tuple[str, ...], where: str) -> None:
    """Refuse keys of [release] that particles from a file replace."""
    for f in fields(release):
        if f.name in used or getattr(release, f.name) == f.default:
            continue
        if f.name in OF_PARTICLES:
            raise SceneError(f"{where}: {f.name} is for a run that begins with solver = 'points'; remove it")
        raise SceneError(f"{where}: particles have a {f.name}; remove {f.name}")
