"""`mpmgis demo`: the whole chain on the shipped site."""

from . import talk
from .progress import frame_progress, interruptible, run_progress

EXAMPLE = """
mpmgis demo -o demo
"""


def add_arguments(parser):
    """Declare the verb's options."""
    parser.add_argument("-o", "--output", metavar="DIR", default="mpmgis_demo", help="folder (default: mpmgis_demo)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier demo in that folder")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads (default: by the particles)")


def run(arguments):
    """Seed, run, export, draw; prints the QGIS project and the picture."""
    from ..errors import InputError

    if arguments.threads is not None and arguments.threads < 1:
        raise InputError(f"--threads {arguments.threads}, wanted 1 or more")
    from ..io.atomic import refuse_existing
    from ..workflows.demo import demo
    from .run import tell

    refuse_existing(arguments.output, arguments.overwrite)
    talk.say("Lava Falls, Grand Canyon: seed, run, export (the first time also compiles, some 40 seconds)")
    # what comes after the last frame, project and picture, has no watch: asked to stop then, it stops at the end
    with run_progress() as shown, interruptible(shown, frame_progress, done=False) as (watch, progress):
        summary, project, picture = demo(
            arguments.output,
            overwrite=arguments.overwrite,
            threads=arguments.threads,
            watch=watch,
            progress=progress,
        )
    tell(summary)
    talk.say("open the project in QGIS (double-click), then press play in the Temporal Controller")
    print(project)
    print(picture)
    return 0
