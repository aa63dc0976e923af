"""Folder of compiled kernels: private to the user, and one for each state of the sources.

The folder is named by a hash of the package's sources, because numba does not see that a law in another file was
edited. A user's own laws are in that hash too: the index of a folder names the classes of all its kernels, and could
not be read by a run without them.
"""

import atexit
import hashlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ..system import operating_system

PACKAGE = Path(__file__).resolve().parent.parent
CHOSEN = "MPMGIS_CHOSEN_CACHE_DIR"  # distinguishes it from a variable of the user in child processes
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
# in the head of a module: an import of the compiler's decorators, and any import from the package
_USES_JIT = re.compile(rb"jit import (?:\([^)]*|[^\n]*)\b(?:jit\w*|kernel_part|law_function|own_law_method)\b")
_IMPORT = re.compile(rb"^from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_NAME = re.compile(rb"\w+")
_private = []  # the temporary folder of this process, once it is made


def source_digest() -> str:
    """Return a hex digest of all sources that a kernel may be compiled from: users of `jit`, and what they import."""
    digest = hashlib.sha256()
    for path, source in sorted(_kernel_sources().items()):
        digest.update(os.path.relpath(path, PACKAGE).encode() + b"\0" + source)
    return digest.hexdigest()[:16]


def _kernel_sources():
    """Return the modules that use `jit`, or are imported by one that does, as {path: source}."""
    sources = {}
    for folder, _, names in os.walk(PACKAGE):
        for name in names:
            if name.endswith(".py"):
                path = os.path.join(folder, name)
                with open(path, "rb") as file:
                    sources[path] = file.read()
    left = [path for path, source in sources.items() if _USES_JIT.search(_head(source))]
    found = {}
    while left:
        path = left.pop()
        if path not in found and path in sources:
            found[path] = sources[path]
            left += _imported(path, sources[path])
    return found


def _head(source):
    """Return what stands above the first function or class of a module: two blank lines precede it."""
    return source.partition(b"\n\n\n")[0]


def _imported(path, source):
    """Yield the files of the package that a module may import at its top."""
    for dots, module, names in _IMPORT.findall(_head(source)):
        folder = path
        for _ in dots:
            folder = os.path.dirname(folder)
        base = os.path.join(folder, *module.decode().split("."))
        yield f"{base}.py"
        yield from (os.path.join(base, f"{name.decode()}.py") for name in _NAME.findall(names))


def cache_folder(own_laws: Iterable[str] = ()) -> Path:
    """Make the folder for compiled kernels: of this user, with mode 0700 and no link, else a private temporary one.

    A private one is removed when this process ends; its child processes use it too.

    Parameters
    ----------
    own_laws : iterable of str
        Digests of the files with users' own laws that this process has loaded.
    """
    root = os.environ.get("MPMGIS_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    root = Path(root) if root else operating_system.cache_root()
    name = source_digest()
    if own_laws:
        name += "-own-" + hashlib.sha256(" ".join(sorted(own_laws)).encode()).hexdigest()[:16]
    try:
        root.mkdir(parents=True, exist_ok=True)
        if _may_hold(root) and _own(root / "mpmgis") and _own(root / "mpmgis" / name, emptied=True):
            return root / "mpmgis" / name
    except OSError:
        pass
    folder = _private_folder() / name
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def is_own(folder: str | Path) -> bool:
    """Return whether a folder is this user's, is no link, and is not writable by others.

    Parameters
    ----------
    folder : path
    """
    found = os.lstat(folder)
    others = operating_system.modes_count() and found.st_mode & _OTHERS_WRITE
    return stat.S_ISDIR(found.st_mode) and _is_ours(found) and not others


def given_cache_folder() -> str | None:
    """Return the folder that the user set for numba; None without one, or if a parent process chose it.

    One that is another user's, or that others can write to, is not used either.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if not given or given == os.environ.get(CHOSEN):
        return None
    try:
        Path(given).mkdir(mode=0o700, parents=True, exist_ok=True)
        return given if is_own(os.path.realpath(given)) else None
    except OSError:
        return None


def choose(folder: str | Path) -> None:
    """Let numba keep compiled kernels in a folder: by the environment too, which it may read again at any time.

    Parameters
    ----------
    folder : path
    """
    os.environ["NUMBA_CACHE_DIR"] = os.environ[CHOSEN] = str(folder)


def _may_hold(root):
    """Whether the content of `root` is protected: others can write there only with the sticky bit."""
    if not operating_system.modes_count():
        return True
    found = os.stat(root)
    return not found.st_mode & stat.S_IWOTH or bool(found.st_mode & stat.S_ISVTX)


def _own(folder, emptied=False):
    """Make `folder` if it is not there; whether it is this user's, then with mode 0700, and writable.

    With `emptied` a folder that others could write to is emptied.
    """
    with suppress(FileExistsError):
        os.mkdir(folder, 0o700)
    found = os.lstat(folder)
    if not (stat.S_ISDIR(found.st_mode) and _is_ours(found)) or _is_junction(found):
        return False
    if operating_system.modes_count() and found.st_mode & 0o077:
        os.chmod(folder, 0o700)
        if emptied and found.st_mode & _OTHERS_WRITE:
            _empty(folder)
    return os.access(folder, os.W_OK)


def _is_ours(found):
    return not hasattr(os, "geteuid") or found.st_uid == os.geteuid()


def _is_junction(found):
    return bool(getattr(found, "st_reparse_tag", 0))


def _empty(folder):
    for entry in os.scandir(folder):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path)
        else:
            os.unlink(entry.path)


def _private_folder():
    """A new temporary folder of this process; in a process that it started the same one."""
    if not _private:
        parent = os.environ.get(CHOSEN)
        parent = Path(parent).parent if parent else None
        try:
            inherited = parent is not None and parent.name.startswith("mpmgis-private-") and is_own(parent)
        except OSError:
            inherited = False
        if not inherited:
            parent = Path(tempfile.mkdtemp(prefix="mpmgis-private-"))
            atexit.register(_remove, parent, os.getpid())
        _private.append(parent)
    return _private[0]


def _remove(folder, number):
    if os.getpid() == number:  # not in a process that was forked off
        shutil.rmtree(folder, ignore_errors=True)
