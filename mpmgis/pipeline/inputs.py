"""Which files a run is made from: those that a scene names, what lies beside them and belongs to them, itself."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ..errors import MpmgisError
from ..io.raster import raster_files

VIRTUAL = b"<VRTDataset"  # in the head of a raster whose pixels lie in other files


def input_files(given, scene, laws=None):
    """Yield the path of every file that is there and that a run of `scene` reads.

    Parameters
    ----------
    given : path or Mapping
        What the scene was read from.
    scene : Scene
    laws : path, optional
        File with laws of friction of the user's own.
    """
    if not isinstance(given, Mapping):
        yield Path(given)
    if laws is not None:
        yield Path(laws)
    for name in scene.files():
        yield from _with_what_belongs_to_it(scene.path(name.partition("|")[0]))


def _with_what_belongs_to_it(path):
    """`path`, the files in it if it is a folder, those beside it with its stem, and the sources of a virtual raster."""
    if path.is_dir():
        yield from (entry for entry in path.rglob("*") if entry.is_file())
        return
    if not path.exists():
        return
    yield path
    stem = path.name.partition(".")[0]
    yield from (entry for entry in path.parent.iterdir() if entry.name.startswith(f"{stem}.") and entry.is_file())
    with suppress(MpmgisError, OSError), open(path, "rb") as file:
        if VIRTUAL in file.read(1000):
            yield from raster_files(path)
