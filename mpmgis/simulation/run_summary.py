"""Text about the balances of a run, for the end of `mpmgis run` and for reports."""

from math import inf, sqrt

from ..laws.quantities import GRAVITY
from ..scene.point_effects import FEWEST_CELLS
from ..solvers.points.point_volume import PACKED, PACKED_SHARE
from .stage_end import CALM_SHARE

UNUSABLE = "unusable"  # first word of the message on points that have lost their volume
_KEPT = {"kept": True}
AIRBORNE_SHARE = 0.05  # [1] share of the mass that would leave the ground, above which a run of columns reports it
FLIGHT_SHARE = CALM_SHARE  # share of the mass in flight at the end of a stage of points, above which it is reported
LEFT_SHARE = 0.01  # of the mass beyond the edge of the terrain, above which the consequence is reported
SHOWN_SHARE = 1e-5  # of the mass that left at one location, above which the location is reported
SHOWN_PLACES = 4  # number of reported locations
CLIP_SHARE = 1e-4  # of the particle-steps, above which a clip is reported
CLIPPED = {  # names of clips in `balances`, as text
    "area_factor": "a column's area was limited to 0.1 to 10 times that of the previous step",
    "thinnest_column": "a column was limited to at least a thousandth of the grid's thickness",
    "thickness_clamp": "a column's thickness was limited to [numerics] clamp times the grid's",
    "speed_bound": "a column's speed was limited to that of its drop height",
    "held_at_walls": "a particle was stopped at a wall of the domain edge, or at the face of a barrier",
    "viscosity_capped": "the viscosity was limited to the largest stable value of the time step",
    "thinner_than_friction": "friction used at least a thousandth of the reference thickness",
    "erosion_of_a_step": "erosion of a step was limited to the mass of the flow",
    "weightless": "the centrifugal acceleration away from the ground was limited to gravity",
    "lifted_onto_ground": "a point more than a cell below the ground was moved back onto it",
    "affine_velocity": "the affine velocity of a point in a thin sheet was limited",
    "stretch_held": "a point's stretch was limited to the range of its material",
}
CLOSES = 1e-3  # of the energy input, above which the energy balance is reported as not closed
STILL_SPEED = {"columns": 0.05, "points": 0.5}  # [m s-1]; elastic solids oscillate while they settle
STILL_FALL = 0.05  # [m], largest mean drop of a mass at rest
STILL_SHALLOW = 0.03  # largest mean drop of a mass at rest, over its thickness
STILL_FROUDE = 0.04  # largest speed of a mass at rest, over sqrt(g h)


def stood_still(stages: list[dict]) -> str:
    """Return a message about a run in which nothing ever moved; '' for any other run.

    The test uses energy: the kinetic energy was always below that of the mass at STILL_SPEED, and the lost energy
    corresponds to a drop of less than STILL_FALL. So neither creep nor a slide between two frames counts as rest. In
    flows of laboratory size the limits of speed and drop are smaller: STILL_FROUDE and STILL_SHALLOW of the thickness.

    Parameters
    ----------
    stages : list of dict
        The balances at the end of each stage of the run.
    """
    fastest = 0.0
    for balances in stages:
        parts = [balances, *(part for part in [balances.get("outside_columns")] if part is not None)]
        mass = balances.get("mass_released", balances["mass_start"]) + balances.get("mass_entrained", 0.0)
        peak, lost = (sum(part.get(name, inf) for part in parts) for name in ("kinetic_energy_peak", "energy_lost"))
        thickness = max(part.get("thickness_max", inf) for part in parts)
        if not (mass > 0.0 and lost < mass * GRAVITY * min(STILL_FALL, STILL_SHALLOW * thickness)):
            return ""
        speed = sqrt(2.0 * peak / mass)
        limit = STILL_SPEED["points" if "elastic_energy" in balances else "columns"]
        if not speed < min(limit, STILL_FROUDE * sqrt(GRAVITY * thickness)):
            return ""
        fastest = max(fastest, speed)
    return (
        f"nothing ever moved: the mean speed of the mass was at most {fastest:.2g} m/s; the release is in equilibrium "
        "or the resistance exceeds the driving force; if this is not intended, check [friction], [material] and the "
        "slope under the release"
    )


def extremes(stages: list[dict]) -> dict:
    """Return place and time of the largest thickness and speed of a run, from the balances at the end of each stage.

    Parameters
    ----------
    stages : list of dict

    Returns
    -------
    dict
        "thickness" [m], vertical, and "speed" [m s-1] along the ground, each with `value`, `at` ([E, N], m), `time`
        [s] and `stage` (from 1); entries missing in the balances (of other versions) are omitted.
    """
    found = {}
    for number, balances in enumerate(stages, 1):
        parts = [balances, *(part for part in [balances.get("outside_columns")] if part is not None)]
        for name in ("thickness", "speed"):
            for part in parts:
                value, at, time = (part.get(f"{name}_max{suffix}") for suffix in ("", "_at", "_time"))
                if at is not None and value > found.get(name, {"value": 0.0})["value"]:
                    found[name] = {"value": value, "at": at, "time": time, "stage": number}
    return found


def extreme_lines(found: dict) -> list[str]:
    """Return lines of text about the `extremes` of all stages of a run.

    Parameters
    ----------
    found : dict
        Result of `extremes`.
    """
    words = {"thickness": ("vertical thickness", "m"), "speed": ("speed along the ground", "m/s")}
    return [
        f"largest {words[name][0]} of all stages: {one['value']:.2f} {words[name][1]} {_place(one['at'], one['time'])}"
        for name, one in found.items()
    ]


def peak_lines(found: dict | None) -> list[str]:
    """Return lines of text about the largest peaks recorded by the solvers; [] if none.

    Parameters
    ----------
    found : dict or None
        Result of `peaks.largest_peaks`.
    """
    if not found:
        return []
    areas = ", ".join(f"{one['area']:.4g} m2 in cells of {one['cell_size']:g} m" for one in found["reached"])
    return [
        f"peaks of every step, at the solver's nodes: thickness {found['thickness']:.2f} m; for flow over "
        f"{found['arrival_thickness']:g} m speed {found['speed']:.1f} m/s, pressure {found['pressure'] / 1e3:.4g} kPa; "
        f"reached area {areas}"
    ]


def _place(at, time):
    return f"at E {at[0]:.1f} N {at[1]:.1f}, t = {time:.1f} s"


def resolution_words(numbers: dict) -> str:
    """Return one sentence about the resolution of a 3D stage.

    Parameters
    ----------
    numbers : dict
        Of `Resolution.as_numbers`.
    """
    size = numbers["cell_size"]
    words = [
        f"the flow is {numbers['thickness']:.3g} m thick, {numbers['cells_over_depth']:.3g} cells of {size:g} m over "
        "its depth"
    ]
    if numbers.get("wall_height") is not None:
        words.append(f"{numbers['cells_over_wall']:.3g} over the lowest wall of {numbers['wall_height']:.3g} m")
    thin = f"{100 * numbers['thin_share']:.3g} % of the mass is thinner than {FEWEST_CELLS:g} cells"
    if not numbers["coarse"]:
        return f"{', '.join(words)}; {thin}"
    fix = "use a smaller cell_size, or solver = 'columns'"
    return f"{', '.join(words)}: too coarse, a 3D run needs {FEWEST_CELLS:g}; {thin}; {fix}"


def volume_words(numbers: dict) -> str:
    """Return one sentence about the volume of points.

    Parameters
    ----------
    numbers : dict
        Of `PointVolume.as_numbers`.
    """
    found = (
        f"volume of the points at t = {numbers['time']:.4g} s: {100 * numbers['packed_share']:.3g} % of the mass is "
        f"packed beyond {PACKED:g} times its density, {100 * numbers['hanging_share']:.3g} % hangs above the bed at "
        f"rest, space is missing for {100 * numbers['missing_share']:.3g} % of the volume, the material at rest is "
        f"{100 * numbers.get('loose_share', 0.0):.3g} % looser than its mass"
    )
    if numbers["kept"]:
        return f"{found}: conserved"
    cells = f"{numbers['cells_over_depth']:.2g} cells over the depth"
    fix = f"use smaller cells (a 3D run needs {FEWEST_CELLS:g} over the depth), or solver = 'columns'"
    if numbers["packed_share"] > PACKED_SHARE and numbers["cells_over_depth"] >= FEWEST_CELLS:
        fix = "smaller cells do not help; use a material with friction, an earlier end_time or solver = 'columns'"
    return f"{UNUSABLE}: {found}, at {cells}; do not use depths, deposits and loads of these points: {fix}"


def unusable_lines(record: dict) -> list[str]:
    """Return lines of text about stages of a run whose points have lost their volume; [] for a usable result.

    Parameters
    ----------
    record : dict
        Content of `run.json`, or its part with `volume`, or with `stages`.
    """
    stages = record.get("stages") or [record]
    lost = [(n, stage["volume"]) for n, stage in enumerate(stages, 1) if not stage.get("volume", _KEPT)["kept"]]
    return [f"stage {n}: {volume_words(one)}" if len(stages) > 1 else volume_words(one) for n, one in lost]


def flight_lines(stages: list[dict]) -> list[str]:
    """Return lines of text about stages of points that ended with mass in flight, which columns cannot represent.

    Parameters
    ----------
    stages : list of dict
        Of a run, as in `run.json`.
    """
    lines = []
    for number, stage in enumerate(stages, 1):
        switch = stage.get("switch", {})
        laid, whole = switch.get("laid_mass", 0.0), switch.get("before", {}).get("mass", 0.0)
        if laid > FLIGHT_SHARE * whole:
            lines.append(
                f"in flight: stage {number} ended at t = {stage['time']:.4g} s with {100 * laid / whole:.2g} % of the "
                "mass above the bed or moving across it; this mass was moved onto the bed, so that its place, depth "
                "and speed are not results of a model; end the stage later, or with until = {calm = 1} alone"
            )
    return lines


def account(balances: dict, solver: str, mass: dict | None = None) -> list[str]:
    """Return lines of text about a run's balances.

    Parameters
    ----------
    balances : dict
        Balances of the run's last solver, as in `run.json`.
    solver : {"columns", "points"}
    mass : dict, optional
        Mass balance of a run in several stages.
    """
    lines = [] if mass is None else [*_of_stages(mass), f"last stage, solver {solver}:"]
    if mass is not None and "left_places" in mass:  # of all stages, including the last one
        balances = {**balances, "left_places": []}
    return lines + (_of_points if solver == "points" else _of_columns)(balances)


def _of_stages(mass):
    """Return lines about mass and energy of a run in several stages."""
    lines = []
    total = mass["released"] + mass["entrained"]
    entrained = f" and {mass['entrained']:.6g} kg entrained" if mass["entrained"] else ""
    on, left, outside = (100 * mass[name] / total for name in ("on_terrain", "left_terrain", "outside_windows"))
    shares = f"{on:.2f} % on the terrain, {left:.2f} % left it, {outside:.2f} % stayed outside windows"
    released, error = f"{mass['released']:.6g} kg released{entrained}", f"error {mass['error_relative']:.1e}"
    lines.append(f"mass of all stages: {released}; {shares}, {error}")
    lines += _where_it_left(mass.get("left_places", ()), total)
    if "energy" in mass:
        energy = mass["energy"]
        lines.append(
            f"energy of all stages: {energy['lost_in_stages']:.4g} J lost within stages, "
            f"{energy['lost_at_switches']:.4g} J at conversions between columns and points"
        )
    return lines


def _clips(b):
    """Return one line for each clip that acted on more than CLIP_SHARE of the particle-steps."""
    steps = max(b.get("particle_steps", 0), 1)
    shares = {name: count / steps for name, count in b.get("clips", {}).items()}
    return [
        f"clipped: {CLIPPED.get(name, name)} in {100 * share:.2g} % of the particle-steps"
        for name, share in shares.items()
        if share > CLIP_SHARE
    ]


def _of_columns(b):
    """Return lines about the balances of a depth-averaged run."""
    lines = []
    total = max(b["mass_released"] + b["mass_entrained"], 1e-300)
    out = b["mass_out"] / total
    later = b["mass_released"] - b["mass_start"]
    came = f", {later:.6g} kg entered later" if later > 1e-9 * b["mass_released"] else ""
    mass = f"mass: {b['mass_start']:.6g} kg at the start{came}, {100 * out:.2f} % left the terrain"
    lines += [f"{mass}, error {b['mass_error_relative']:.1e}", *_where_it_left(b.get("left_places", ()), total)]
    lines += [*_truncated(out), *_energy_of_columns(b)]
    thickest = f"{b['thickness_max']:.2f} m {_place(b['thickness_max_at'], b['thickness_max_time'])}"
    lines.append(f"largest vertical thickness {thickest}; footprint {b['footprint_area'] / 1e4:.2f} ha")
    share = 100 * b["speed_bound_ratio"]
    bound = "limited to that of its drop height" if share > 100 else f"{share:.0f} % of that of its drop height"
    lines.append(f"{_fastest(b)}, {bound}")
    if share > 100:
        lines.append(
            f"outside the model: a column had {share:.0f} % of the largest possible speed of its drop height and was "
            "limited to 100 %; use smaller cells or a smaller cfl, or a 3D run at cliffs"
        )
    if b["speed_limited_share_max"] > 0:
        share = f"up to {100 * b['speed_limited_share_max']:.2g} % of the mass"
        lines.append(
            f"outside the model: {share} was limited to the speed of its drop height, where the ground is too steep "
            "for the cells or next to a flow many times as thick"
        )
    if b["airborne_share_max"] > AIRBORNE_SHARE:
        lines.append(
            f"outside the model: up to {100 * b['airborne_share_max']:.0f} % of the mass would have left the ground "
            "(the bed drops faster than free fall); use a 3D run"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N in a single step"
        over = f"{taken['overtopped_mass']:.3g} kg overtopped it"
        lines.append(
            f"barrier '{name}': impulse {impulse}, largest force {peak}, {over} (estimates; loads need a 3D run)"
        )
    lines += _clips(b)
    if b["mass_entrained"] > 0:
        share = b["mass_entrained"] / b["mass_released"]
        lines.append(f"entrained: {b['mass_entrained']:.6g} kg, {share:.2f} times the release")
    if "mass_detrained" in b:
        lines.append(
            f"forest: {b['mass_detrained']:.6g} kg stopped in it ({100 * b['mass_detrained'] / total:.3g} %), "
            f"{b['forest_broken_area'] / 1e4:.3g} of {b['forest_area'] / 1e4:.3g} ha broken; of the rest "
            f"{b['mass_flowing']:.6g} kg flows, {b['mass_at_rest']:.6g} kg is at rest"
        )
    return lines


def _energy_of_columns(b):
    """Return lines about energy input and losses of a depth-averaged run, and the error of the balance."""
    later, taken = b["energy_released_later"], b["energy_entrained"]
    put_in = b["energy_start"] + later + taken
    sources = [(later, "entered later"), (taken, "with eroded mass")]
    more = "".join(f", {joules:.4g} J {word}" for joules, word in sources if abs(joules) > 1e-9 * abs(put_in))
    takers = {
        "friction on the bed": "ground",
        "acceleration of eroded mass": "eroded_mass",
        "barriers": "barriers",
        **({"forest": "forest"} if "energy_lost_to_forest" in b else {}),
        "the speed limit": "speed_limit",
        "mixing and the grid": "mixing",
        "bends of the bed": "bends",
    }
    lines = [
        f"energy: {b['energy_start']:.4g} J at the start{more}; {_lost(b, takers)}; kinetic now "
        f"{b['kinetic_energy']:.3g} J; the balance closes to {abs(b['energy_error_relative']):.1g} of the input"
    ]
    if abs(b["energy_error_relative"]) > CLOSES:
        lines.append(
            f"the energy balance is off by {100 * b['energy_error_relative']:+.2g} % of the input; use a "
            "smaller [numerics] cfl or smaller cells"
        )
    return lines


def _lost(b, takers):
    """Return the lost energy and its sinks as text."""
    taken = {word: b[f"energy_lost_to_{name}"] for word, name in takers.items()}
    least, lost = 1e-6 * abs(b["energy_lost"]), f"{b['energy_lost']:.4g} J lost"
    to = ", ".join(f"{joules:.4g} J to {word}" for word, joules in taken.items() if abs(joules) > least)
    return f"{lost}: {to}" if to else lost


def _where_it_left(places, total):
    """Return lines on where mass left the terrain, largest first, and the remedy; `total` [kg] is all mass."""
    shown = [place for place in places if place["mass"] > SHOWN_SHARE * total]
    lines = [_left_at(place, total) for place in shown[:SHOWN_PLACES]]
    rest = sum(place["mass"] for place in shown[SHOWN_PLACES:])
    if rest:
        lines.append(f"  {100 * rest / total:.2g} % ({rest:.4g} kg) at {len(shown) - SHOWN_PLACES} more locations")
    return lines


def _left_at(place, total):
    at = f"at E {place['east']:.1f} N {place['north']:.1f}"
    much = f"  {100 * place['mass'] / total:.3g} % ({place['mass']:.4g} kg)"
    if place["where"] == "hole":
        return f"{much} flowed into a hole of the DTM {at}: set [terrain] fill_nodata = 'interpolate'"
    if place["where"] == "collar":
        return f"{much} flowed into the nodata around the DTM {at}: use a DTM with data there"
    if place["where"] == "elsewhere":
        return f"{much} at smaller locations, on average {at}"
    return f"{much} over the {place['where']} edge of the DTM {at}"


def _fastest(b):
    return f"largest speed {b['speed_max']:.1f} m/s {_place(b['speed_max_at'], b['speed_max_time'])}"


def _truncated(share):
    """Return the consequence of the loss of this `share` of the mass beyond the terrain, if it is not negligible."""
    if share <= LEFT_SHARE:
        return []
    return ["runout, maps and deposit are cut off where it left; at an edge, use a larger DTM or [terrain] window"]


def _volume_corrections(b):
    """Return one line on corrections of the volumes of a fluid, of more than CLIP_SHARE of the particle-steps."""
    count, energy = b.get("volume_corrections", 0), b.get("energy_of_volume_corrections", 0.0)
    if count <= CLIP_SHARE * max(b.get("particle_steps", 0), 1):
        return []
    share = 100.0 * abs(energy) / max(b["energy_start"], 1e-300)
    what = "supplied" if energy > 0.0 else "took"
    return [f"{count} corrections of volumes by the density of the grid {what} {share:.2g} % of the initial energy"]


def _of_points(b):
    """Return lines about the balances of a 3D run."""
    lines = []
    out = b["mass_out"] / max(b["mass_start"], 1e-300)
    mass = f"mass: {b['mass_start']:.6g} kg at the start, {100 * out:.2f} % left the terrain"
    errors = f"error {b['mass_error_relative']:.1e}; momentum error {b['momentum_error_relative']:.1e}"
    lines += [f"{mass}, {errors}", *_where_it_left(b.get("left_places", ()), max(b["mass_start"], 1e-300))]
    lines += _truncated(out)
    takers = {
        "the bed": "ground",
        "barriers": "barriers",
        "yielding": "yielding",
        "layers on each other": "layers",
        "the affine velocity limit": "affine_limit",
        "impacts, viscosity and the grid": "mixing",
    }
    lines.append(f"energy: {_lost(b, takers)}")
    lines.append(f"kinetic energy now {b['kinetic_energy']:.3g} J, elastic {b['elastic_energy']:.3g} J")
    thickest = f"{b['thickness_max']:.2f} m {_place(b['thickness_max_at'], b['thickness_max_time'])}"
    lines.append(f"largest vertical thickness {thickest} (mass / (density x cell area), in the frames)")
    share = 100 * b["speed_bound_ratio"]
    waves = f"{b['mach_max']:.2f} times the pressure wave speed"
    lines.append(f"{_fastest(b)}, {waves}, {share:.0f} % of the speed of its drop height")
    lines.append(
        f"99.9th percentile of the speed by mass: {b['speed_p999']:.1f} m/s at most, in the frame at "
        f"t = {b['speed_p999_time']:.1f} s"
    )
    if share > 100:
        lines.append(
            f"outside the model: the fastest point had {share:.0f} % of the speed that its drop height and the largest "
            "initial speed allow; this is possible only for single points where jets meet: compare the 99.9th "
            "percentile above, and use a smaller cfl"
        )
    if b["mass_lifted_onto_ground"] > 0:
        share = 100 * b["mass_lifted_onto_ground"] / b["mass_start"]
        lines.append(f"{share:.2g} % of the mass was more than a cell below the ground and was moved back onto it")
    lines += [*_clips(b), *_volume_corrections(b)]
    outside = b.get("outside_columns")
    if outside is not None:
        lines += _clips(outside)
        lines.append(
            f"outside the window: {outside['mass_now']:.6g} kg of columns; {outside['exchanged_columns']} columns with "
            f"{outside['exchanged_mass']:.6g} kg entered it and became points"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N in a single step"
        lines.append(
            f"barrier '{name}': impulse {impulse}, largest force {peak}, "
            f"{taken['overtopped_mass']:.3g} kg overtopped it"
        )
    return lines
