"""The balances of a run in plain words: what `mpmgis run` says at its end and a report keeps."""

from math import inf, sqrt

from ..fields import GRAVITY
from ..scene.points import FEWEST_CELLS
from .point_volume import PACKED

AIRBORNE_SHARE = 0.05  # of the mass that would have left the ground, from which a depth-averaged run says so
LEFT_SHARE = 0.01  # of the mass beyond the edge of the terrain, from which it is said what that means
STILL_SPEED = {"columns": 0.05, "points": 0.3}  # [m s-1], of the mass as a whole; solids swing as they settle
STILL_FALL = 0.05  # [m] that the mass as a whole may have come down for all that


def stood_still(stages):
    """What to say of a run in which nothing ever moved; '' of any other.

    By energy: that of motion was never that of the mass at STILL_SPEED, and what was lost lets it come down by less
    than STILL_FALL, so that neither creep nor a slide between two frames is taken for rest.

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
        if not (mass > 0.0 and lost < mass * GRAVITY * STILL_FALL):
            return ""
        speed = sqrt(2.0 * peak / mass)
        if not speed < STILL_SPEED["points" if "elastic_energy" in balances else "columns"]:
            return ""
        fastest = max(fastest, speed)
    return (
        f"nothing ever moved: the mass as a whole was never faster than {fastest:.2g} m/s, for what resists holds it "
        "where it lies; if that is not meant, look at [friction] and [material], and at the slope under the release"
    )


def resolution_words(numbers):
    """One sentence about a Resolution `as_numbers`."""
    size = numbers["cell_size"]
    words = [
        f"the flow is {numbers['thickness']:.3g} m thick, {numbers['cells_over_depth']:.2g} cells of {size:g} m over "
        "its depth"
    ]
    if numbers.get("wall_height") is not None:
        words.append(f"{numbers['cells_over_wall']:.2g} over the lowest wall of {numbers['wall_height']:.3g} m")
    thin = f"{100 * numbers['thin_share']:.3g} % of the mass is thinner than {FEWEST_CELLS:g} cells"
    if not numbers["coarse"]:
        return f"{', '.join(words)}; {thin}"
    cure = "take a smaller cell_size, or solver = 'columns'"
    return f"{', '.join(words)}: too coarse, a 3D run wants {FEWEST_CELLS:g}; {thin}; {cure}"


def volume_words(numbers):
    """One sentence about a PointVolume `as_numbers`."""
    found = (
        f"volume of the points at t = {numbers['time']:.4g} s: {100 * numbers['packed_share']:.3g} % of the mass is "
        f"packed beyond {PACKED:g} times its density, {100 * numbers['hanging_share']:.3g} % hangs off the bed at rest"
    )
    if numbers["kept"]:
        return f"{found}: kept"
    cells = f"{numbers['cells_over_depth']:.2g} cells over the depth"
    return (
        f"{found}: not kept, at {cells}; depths and deposits are wrong there, take smaller cells (a 3D run wants "
        f"{FEWEST_CELLS:g} over the depth), or solver = 'columns'"
    )


def account(balances, solver, mass=None):
    """Lines of text about a run's balances.

    Parameters
    ----------
    balances : dict
        As the run's last solver gives them and `run.json` holds them.
    solver : {"columns", "points"}
    mass : dict, optional
        Where the mass of a run in several stages is.

    Returns
    -------
    list of str
    """
    lines = [] if mass is None else [*_of_stages(mass), f"of the last stage, of {solver}:"]
    return lines + (_of_points if solver == "points" else _of_columns)(balances)


def _of_stages(mass):
    """Where the mass of a run in several stages is."""
    lines = []
    come = mass["released"] + mass["entrained"]
    entrained = f" and {mass['entrained']:.6g} kg entrained" if mass["entrained"] else ""
    on, left, outside = (100 * mass[name] / come for name in ("on_terrain", "left_terrain", "outside_windows"))
    shares = f"{on:.2f} % on the terrain, {left:.2f} % left it, {outside:.2f} % stayed outside windows"
    lines.append(f"mass of all stages: {mass['released']:.6g} kg released{entrained}; {shares}, error "
             f"{mass['error_relative']:.1e}")  # fmt: skip
    return lines


def _of_columns(b):
    """Balances of a depth-averaged run."""
    lines = []
    out = b["mass_out"] / max(b["mass_released"] + b["mass_entrained"], 1e-300)
    later = b["mass_released"] - b["mass_start"]
    came = f", {later:.6g} kg came in later" if later > 1e-9 * b["mass_released"] else ""
    mass = f"mass: {b['mass_start']:.6g} kg at the start{came}, {100 * out:.2f} % left the terrain"
    lines += [f"{mass}, error {b['mass_error_relative']:.1e}", *_lost_to_sight(out)]
    lines.append(
        f"energy: {b['energy_lost']:.4g} J lost to the bed and to mixing, kinetic now {b['kinetic_energy']:.3g} J"
    )
    bound = f"largest speed {100 * b['speed_bound_ratio']:.0f} % of what its drop in height allows"
    lines.append(f"largest thickness {b['thickness_max']:.2f} m, {bound}, footprint {b['footprint_area'] / 1e4:.2f} ha")
    if b["speed_limited_share_max"] > 0:
        share = f"up to {100 * b['speed_limited_share_max']:.2g} % of the mass"
        lines.append(
            f"beyond the model: on ground too steep for its cells {share} was held to the speed its drop allows"
        )
    if b["airborne_share_max"] > AIRBORNE_SHARE:
        lines.append(
            f"beyond the model: up to {100 * b['airborne_share_max']:.0f} % of the mass would have left the ground "
            "(the bed falls away faster than it falls); a 3D run would follow it"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N"
        over = f"{taken['overtopped_mass']:.3g} kg went over it"
        lines.append(f"barrier '{name}': impulse {impulse}, peak force {peak}, {over} (screening only; loads need 3D)")
    if b["mass_entrained"] > 0:
        share = b["mass_entrained"] / b["mass_released"]
        lines.append(f"entrained: {b['mass_entrained']:.6g} kg, {share:.2f} times the release")
    return lines


def _lost_to_sight(share):
    """What it means that this `share` of the mass left the terrain, where it is more than a rim."""
    if share <= LEFT_SHARE:
        return []
    return ["runout, maps and deposit end at the edge that it left by; take a larger DTM or [terrain] window"]


def _of_points(b):
    """Balances of a 3D run."""
    lines = []
    out = b["mass_out"] / max(b["mass_start"], 1e-300)
    mass = f"mass: {b['mass_start']:.6g} kg at the start, {100 * out:.2f} % left the terrain"
    errors = f"error {b['mass_error_relative']:.1e}; momentum error {b['momentum_error_relative']:.1e}"
    lines += [f"{mass}, {errors}", *_lost_to_sight(out)]
    takers = {"the bed": "ground", "barriers": "barriers", "yielding": "yielding"}
    taken = {word: b[f"energy_lost_to_{name}"] for word, name in takers.items()}
    to = ", ".join(f"{joules:.4g} J to {word}" for word, joules in taken.items() if joules > 1e-6 * b["energy_lost"])
    rest = f"{b['energy_lost'] - sum(taken.values()):.3g} J to blows, viscosity and the grid"
    lines.append(f"energy: {b['energy_lost']:.4g} J lost: {to + ', ' if to else ''}{rest}")
    lines.append(f"kinetic energy now {b['kinetic_energy']:.3g} J, elastic {b['elastic_energy']:.3g} J")
    lines.append(f"largest speed {b['speed_max']:.1f} m/s, {b['mach_max']:.2f} times that of pressure waves")
    if b["mass_lifted_onto_ground"] > 0:
        share = 100 * b["mass_lifted_onto_ground"] / b["mass_start"]
        lines.append(f"{share:.2g} % of the mass came more than a cell under the ground and was laid back on it")
    outside = b.get("outside_columns")
    if outside is not None:
        lines.append(
            f"outside the window: {outside['mass_now']:.6g} kg of columns; {outside['exchanged_columns']} columns with "
            f"{outside['exchanged_mass']:.6g} kg came into it and became points"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N in a single step"
        lines.append(
            f"barrier '{name}': impulse {impulse}, peak {peak}, {taken['overtopped_mass']:.3g} kg went over it"
        )
    return lines
