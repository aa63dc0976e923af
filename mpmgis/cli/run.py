"""`mpmgis run`: simulate a scene."""

import sys

from . import talk
from .progress import interruptible, run_progress

AIRBORNE_SHARE = 0.05  # of the mass that would have left the ground, from which a depth-averaged run says so
EXAMPLE = """
mpmgis run --template > scene.toml
mpmgis run scene.toml -o results
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument("scene", nargs="?", metavar="scene.toml", help="the scene to simulate")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for frames (default: results/ beside the scene)")
    parser.add_argument("--overwrite", action="store_true", help="replace the frames of an earlier run in that folder")
    parser.add_argument("--resume", action="store_true", help="go on after the last whole frame in that folder")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads (default: all); same result")
    parser.add_argument("--yes", action="store_true", help="do not ask about predicted time and memory")
    parser.add_argument("--law", metavar="FILE.py", help="Python file with your own law of friction; it will be run")
    parser.add_argument("--template", action="store_true", help="print a commented scene and stop")


def run(arguments):
    """Run the scene, or print the template."""
    if arguments.template:
        from ..scene import template

        print(template(), end="")
        return 0
    from ..errors import InputError

    if arguments.scene is None:
        raise InputError("which scene? give scene.toml, or --template to see one")
    if arguments.threads is not None and arguments.threads < 1:
        raise InputError(f"--threads {arguments.threads}, wanted 1 or more")
    if arguments.resume and arguments.overwrite:
        raise InputError("--resume and --overwrite contradict each other; give one of them")
    from ..pipeline.run import run as run_scene

    with run_progress() as shown, interruptible(shown) as watch:
        summary = run_scene(
            arguments.scene,
            arguments.output,
            overwrite=arguments.overwrite,
            resume=arguments.resume,
            threads=arguments.threads,
            laws=arguments.law,
            confirm=lambda question: arguments.yes or asked(question),
            say=talk.say,
            watch=watch,
        )
    tell(summary)
    print(summary.folder)
    return 0


def asked(question):
    """Ask on a terminal; elsewhere nobody can answer, so it is no."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    print(f"{question}; go on? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def tell(summary):
    """The balances and the cost of a run, on stderr."""
    talk.say(f"ended: {summary.reason}")
    talk.say(f"t = {summary.time:.1f} s after {summary.steps} steps, {summary.frames} frames")
    if summary.mass is not None:
        _tell_mass(summary.mass)
        talk.say(f"of the last stage, of {summary.solver}:")
    (_tell_points if summary.solver == "points" else _tell_columns)(summary.balances)
    if summary.result_digest:
        talk.say(f"digest of the result: {summary.result_digest}")
    if not summary.wall_seconds:
        return
    rate = summary.particle_steps_per_second / 1e6
    foreseen = "" if summary.predicted_seconds is None else f" (predicted {summary.predicted_seconds:.2g} s)"
    talk.say(f"wall time {summary.wall_seconds:.1f} s{foreseen}, {rate:.1f} million particle-steps a second")


def _tell_mass(mass):
    """Where the mass of a run in several stages is."""
    come = mass["released"] + mass["entrained"]
    entrained = f" and {mass['entrained']:.6g} kg entrained" if mass["entrained"] else ""
    on, left, outside = (100 * mass[name] / come for name in ("on_terrain", "left_terrain", "outside_windows"))
    shares = f"{on:.2f} % on the terrain, {left:.2f} % left it, {outside:.2f} % stayed outside windows"
    talk.say(f"mass of all stages: {mass['released']:.6g} kg released{entrained}; {shares}, error "
             f"{mass['error_relative']:.1e}")  # fmt: skip


def _tell_columns(b):
    """Balances of a depth-averaged run."""
    out = b["mass_out"] / max(b["mass_released"] + b["mass_entrained"], 1e-300)
    later = b["mass_released"] - b["mass_start"]
    came = f", {later:.6g} kg came in later" if later > 1e-9 * b["mass_released"] else ""
    mass = f"mass: {b['mass_start']:.6g} kg at the start{came}, {100 * out:.2f} % left the terrain"
    talk.say(f"{mass}, error {b['mass_error_relative']:.1e}")
    talk.say(f"energy: {b['energy_lost']:.4g} J lost to the bed and to mixing, kinetic now {b['kinetic_energy']:.3g} J")
    bound = f"largest speed {100 * b['speed_bound_ratio']:.0f} % of what its drop in height allows"
    talk.say(f"largest thickness {b['thickness_max']:.2f} m, {bound}, footprint {b['footprint_area'] / 1e4:.2f} ha")
    if b["speed_limited_share_max"] > 0:
        share = f"up to {100 * b['speed_limited_share_max']:.2g} % of the mass"
        talk.say(f"beyond the model: on ground too steep for its cells {share} was held to the speed its drop allows")
    if b["airborne_share_max"] > AIRBORNE_SHARE:
        talk.say(
            f"beyond the model: up to {100 * b['airborne_share_max']:.0f} % of the mass would have left the ground "
            "(the bed falls away faster than it falls); a 3D run would follow it"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N"
        over = f"{taken['overtopped_mass']:.3g} kg went over it"
        talk.say(f"barrier '{name}': impulse {impulse}, peak force {peak}, {over} (screening only; loads need 3D)")
    if b["mass_entrained"] > 0:
        share = b["mass_entrained"] / b["mass_released"]
        talk.say(f"entrained: {b['mass_entrained']:.6g} kg, {share:.2f} times the release")


def _tell_points(b):
    """Balances of a 3D run."""
    out = b["mass_out"] / max(b["mass_start"], 1e-300)
    mass = f"mass: {b['mass_start']:.6g} kg at the start, {100 * out:.2f} % left the terrain"
    talk.say(f"{mass}, error {b['mass_error_relative']:.1e}; momentum error {b['momentum_error_relative']:.1e}")
    takers = {"the bed": "ground", "barriers": "barriers", "yielding": "yielding"}
    taken = {word: b[f"energy_lost_to_{name}"] for word, name in takers.items()}
    to = ", ".join(f"{joules:.4g} J to {word}" for word, joules in taken.items() if joules > 1e-6 * b["energy_lost"])
    rest = f"{b['energy_lost'] - sum(taken.values()):.3g} J to blows, viscosity and the grid"
    talk.say(f"energy: {b['energy_lost']:.4g} J lost: {to + ', ' if to else ''}{rest}")
    talk.say(f"kinetic energy now {b['kinetic_energy']:.3g} J, elastic {b['elastic_energy']:.3g} J")
    talk.say(f"largest speed {b['speed_max']:.1f} m/s, {b['mach_max']:.2f} times that of pressure waves")
    if b["mass_lifted_onto_ground"] > 0:
        share = 100 * b["mass_lifted_onto_ground"] / b["mass_start"]
        talk.say(f"{share:.2g} % of the mass came more than a cell under the ground and was laid back on it")
    outside = b.get("outside_columns")
    if outside is not None:
        talk.say(
            f"outside the window: {outside['mass_now']:.6g} kg of columns; {outside['exchanged_columns']} columns with "
            f"{outside['exchanged_mass']:.6g} kg came into it and became points"
        )
    for name, taken in b["barriers"].items():
        impulse, peak = f"{taken['normal_impulse']:.3g} N s", f"{taken['peak_normal_force']:.3g} N in a single step"
        talk.say(f"barrier '{name}': impulse {impulse}, peak {peak}, {taken['overtopped_mass']:.3g} kg went over it")
