"""Files of compiled kernels, each with a checksum that is checked before it is loaded.

Numba 0.68 has two faults in its cache on disk, and no interface to replace the class of its files
(`IndexDataCacheFile`). The class of the object in a kernel's cache is therefore replaced.

Numba unpickles what it finds: a file that is cut off ends every later run in an error, and one that is damaged may run
as broken machine code. Here each file begins with a checksum of its name and of the rest. A file that does not fit it
is removed, and the kernel is compiled again.

Numba numbers the files of a kernel by the index as it last read it. Of two processes that compile for other laws at a
time both then take the same number, and the code of one law remains under the name of the other: in 3 of 12 starts of 8
processes (numba 0.68, measured 2026-11-22). Here every compiled form has a file of a name that no other process can
take. Now the worst is an entry that is lost and compiled again.

`tests/compiled/test_checked_cache.py` fails when numba no longer needs this, or no longer allows it.
"""

import hashlib
import os
import pickle
from contextlib import suppress
from typing import Any
from uuid import uuid4

from numba.core.caching import IndexDataCacheFile

_LENGTH = hashlib.sha256().digest_size


def keep_checked(kernel: Any) -> None:
    """Let a kernel that has a cache keep and read its compiled forms as CheckedFiles.

    Parameters
    ----------
    kernel : numba dispatcher
    """
    kernel._cache._cache_file.__class__ = CheckedFiles


def is_kept(kernel: Any, given: tuple) -> bool:
    """Return whether the cache has a kernel compiled for these types and this processor.

    Parameters
    ----------
    kernel : numba dispatcher
    given : tuple of numba types
        Of its arguments.
    """
    kept = kernel._cache
    return kept._index_key(given, kernel.targetctx.codegen()) in kept._cache_file.kept_keys()


def has_any(kernel: Any) -> bool:
    """Return whether the cache has a kernel compiled for any types and this processor.

    Parameters
    ----------
    kernel : numba dispatcher
    """
    processor = kernel.targetctx.codegen().magic_tuple()
    return any(key[1] == processor for key in kernel._cache._cache_file.kept_keys())


class CheckedFiles(IndexDataCacheFile):
    """The index of a kernel's compiled forms, and a file for each of them."""

    def kept_keys(self) -> set:
        """Return the keys of all compiled forms in the index."""
        return set(self._load_index())

    def save(self, key: tuple, data: tuple) -> None:
        """Keep the compiled form `data`; do nothing where the disk does not take it.

        Parameters
        ----------
        key : tuple
            Signature and processor, as numba makes it.
        data : tuple
        """
        with suppress(OSError):
            super().save(key, data)

    def _data_name(self, number):
        return f"{self._index_name.removesuffix('.nbi')}.{uuid4().hex[:16]}.nbc"

    def _load_index(self):
        kept = self._checked(self._index_path)
        if not (isinstance(kept, tuple) and kept[:2] == (self._version, self._source_stamp)):
            return {}
        return kept[2]

    def _save_index(self, overloads):
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name):
        kept = self._checked(self._data_path(name))
        if kept is None:
            raise OSError(f"{name} is not there, or not whole")  # numba compiles then
        return kept

    def _save_data(self, name, data):
        self._write(self._data_path(name), data)

    def _write(self, path, what):
        data = self._dump(what)
        with self._open_for_write(path) as file:
            file.write(_checksum(path, data))
            file.write(data)

    @staticmethod
    def _checked(path):
        """Content of the file at `path`; None if it does not exist or has changed, and then it is removed."""
        try:
            with open(path, "rb") as file:
                content = file.read()
        except OSError:
            return None
        data = content[_LENGTH:]
        if _checksum(path, data) == content[:_LENGTH]:
            with suppress(Exception):  # it names a class or function that is not there in this process
                return pickle.loads(data)
        with suppress(OSError):
            os.unlink(path)
        return None


def _checksum(path, data):
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + data).digest()
