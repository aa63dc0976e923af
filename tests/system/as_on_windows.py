"""The rules of Windows, emulated on the Linux that the tests run on: files, locks, names, modules and signals.

An emulation, not Windows: what is refused here is what Microsoft documents to be refused there. Its limits stand in
mpmgis/docs/limits.md.
"""

import contextlib
import errno
import fcntl
import functools
import os
import re
import shutil
import signal
import stat
import sys
import uuid
from pathlib import Path

import filelock
import psutil  # noqa: F401 (itself wants modules that Windows has not)

from mpmgis.system import operating_system

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "posix_ipc")
ABSENT = {
    os: (
        *("O_NOFOLLOW", "O_DIRECTORY", "O_CLOEXEC", "O_NONBLOCK", "O_SYNC", "O_PATH"),
        *("getuid", "geteuid", "getgid", "getegid", "getgroups", "setuid", "setsid", "killpg", "getpgid", "getpgrp"),
        *("fork", "forkpty", "wait", "uname", "fchmod", "fchown", "chown", "lchown", "mkfifo", "mknod"),
        *("statvfs", "fstatvfs", "sysconf", "sched_getaffinity", "sched_yield", "getloadavg", "nice"),
        *("posix_fallocate", "posix_fadvise", "pread", "pwrite", "fdatasync", "sendfile"),
    ),
    signal: ("SIGHUP", "SIGKILL", "SIGPIPE", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGCHLD", "alarm", "setitimer"),
}
PATCHED = ("replace", "rename", "unlink", "open", "fsync", "read", "close")
DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


class WindowsFileLock:
    """`filelock.FileLock` as it is on Windows: the file is removed once it is closed."""

    def __init__(self, lock, path, timeout, on_acquired):
        self._lock, self._path, self._on_acquired, self._handle = lock, path, on_acquired, None

    def acquire(self):
        handle = os.open(self._path, os.O_RDWR | os.O_CREAT)
        if not self._lock(handle):
            os.close(handle)
            raise filelock.Timeout(str(self._path))
        self._on_acquired(handle)
        self._handle = handle

    def release(self):
        os.close(self._handle)
        with contextlib.suppress(OSError):
            os.unlink(self._path)


class Windows:
    """What is refused below the folder `root`, by a monkeypatch's `patch`.

    Attributes
    ----------
    refused : list of (str, str)
        What was refused: the function's name and the path; for tests that want to see the rules at work.
    """

    def __init__(self, patch, root):
        self.root, self.refused = os.path.realpath(root), []
        self._real = {name: getattr(os, name) for name in PATCHED}
        self._locked = {}  # (device, number) of a file -> the descriptor through which it is locked
        usage = shutil.disk_usage(root)
        patch.setattr(shutil, "disk_usage", lambda path: usage)
        patch.setattr(shutil, "_use_fd_functions", False)
        patch.setattr(shutil, "_USE_CP_SENDFILE", False)
        for module, names in ABSENT.items():
            for name in names:
                patch.delattr(module, name, raising=False)
        for name in MODULES:
            patch.setitem(sys.modules, name, None)
        patch.setattr(os, "kill", self._kill)
        patch.setattr(uuid, "getnode", lambda: 0x0123456789AB)
        for name in PATCHED:
            patch.setattr(os, name, getattr(self, f"_{name}"))
        patch.setattr(os, "remove", self._unlink)
        patch.setattr(filelock, "FileLock", functools.partial(WindowsFileLock, self._lock))
        patch.setattr(operating_system, "WINDOWS", True)
        patch.setattr(operating_system, "PROCESSES", Path(root) / "no processes")
        patch.setattr(operating_system, "PATIENCE_SECONDS", 0.05)
        patch.setenv("LOCALAPPDATA", str(Path(root) / "AppData" / "Local"))

    # ---------------------------------------------------------------------------------------------------------- files

    def open_files(self):
        """Paths below the root that this process has open or mapped."""
        found = set()
        for number in os.listdir("/proc/self/fd"):
            try:
                found.add(os.readlink(f"/proc/self/fd/{number}"))
            except OSError:
                continue
        with open("/proc/self/maps", encoding="utf-8") as maps:
            found.update(line.split(None, 5)[-1].rstrip("\n") for line in maps if self.root in line)
        return {path for path in found if path.startswith(self.root + os.sep) and not os.path.isdir(path)}

    def _refuse(self, function, path):
        self.refused.append((function, os.fspath(path)))
        raise PermissionError(errno.EACCES, "The process cannot access the file because another one has it open", path)

    def _require_free(self, function, *paths):
        """Refuse where a file is open, or a file in a folder that is to be renamed."""
        held = self.open_files()
        for path in paths:
            real = os.path.join(os.path.realpath(os.path.dirname(os.path.abspath(path))), os.path.basename(path))
            if real in held or any(file.startswith(real + os.sep) for file in held):
                self._refuse(function, path)

    def _require_name(self, path):
        name = os.path.basename(os.fspath(path))
        if DEVICES.fullmatch(name) or re.search(r'[<>:"|?*\x00-\x1f]', name) or name.endswith((" ",)):
            raise OSError(errno.EINVAL, "The filename, directory name, or volume label syntax is incorrect", path)

    def _below(self, path):
        return os.path.realpath(os.path.dirname(os.path.abspath(path))).startswith(self.root)

    def _replace(self, source, target, **none):
        assert not none, "no dir_fd on Windows"
        if self._below(target):
            self._require_name(target)
            self._require_free("replace", source, target)
            if os.path.isdir(target):
                self._refuse("replace", target)
        return self._real["replace"](source, target)

    def _rename(self, source, target, **none):
        assert not none, "no dir_fd on Windows"
        if self._below(target):
            self._require_name(target)
            self._require_free("rename", source)
            if os.path.lexists(target) and not os.path.samefile(source, target):
                raise FileExistsError(errno.EEXIST, "Cannot create a file when that file already exists", target)
        return self._real["rename"](source, target)

    def _unlink(self, path, *, dir_fd=None):
        assert dir_fd is None, "no dir_fd on Windows"
        if self._below(path):
            self._require_free("unlink", path)
            if not os.path.islink(path) and os.path.exists(path) and not os.stat(path).st_mode & stat.S_IWUSR:
                self._refuse("unlink", path)
        return self._real["unlink"](path)

    def _open(self, path, flags, mode=0o777, *, dir_fd=None):
        assert dir_fd is None, "no dir_fd on Windows"
        if isinstance(path, str | bytes | os.PathLike) and self._below(os.fsdecode(path)):
            if os.path.isdir(path):
                self._refuse("open", path)
            self._require_name(os.fsdecode(path))
        return self._real["open"](path, flags, mode)

    def _fsync(self, descriptor):
        if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, "Bad file descriptor")
        self._real["fsync"](descriptor)

    # ---------------------------------------------------------------------------------------------------------- locks

    def _lock(self, descriptor):
        """LockFileEx on the first byte: for others it can be neither locked nor read, a file without it neither."""
        file = self._file(descriptor)
        if file in self._locked:
            return False
        self._locked[file] = descriptor
        return True

    def _read(self, descriptor, count):
        holder = self._locked.get(self._file(descriptor))
        if holder not in (None, descriptor) and os.lseek(descriptor, 0, os.SEEK_CUR) == 0:
            raise PermissionError(errno.EACCES, "Permission denied")
        return self._real["read"](descriptor, count)

    def _close(self, descriptor):
        self._locked = {file: holder for file, holder in self._locked.items() if holder != descriptor}
        self._real["close"](descriptor)

    @staticmethod
    def _file(descriptor):
        found = os.fstat(descriptor)
        return found.st_dev, found.st_ino

    # ------------------------------------------------------------------------------------------------------ processes

    @staticmethod
    def _kill(number, what):
        raise AssertionError(f"os.kill({number}, {what}) ends a process on Windows, or all of a console")
