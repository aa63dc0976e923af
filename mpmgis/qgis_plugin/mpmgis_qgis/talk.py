"""What the command says: lines out of the bytes that come, progress and errors out of the lines."""

from __future__ import annotations

import re

_PROGRESS = re.compile(r"(?:^t = |^frame )([\d.]+) of ([\d.]+)")


class Lines:
    """Bytes in, as they come; whole lines of text out."""

    def __init__(self):
        self._rest = b""

    def add(self, data):
        """List of the lines that `data` completes; one that is overwritten (carriage return) counts as ended."""
        *whole, self._rest = (self._rest + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        return [line.decode("utf-8", "replace") for line in whole if line.strip()]

    def end(self):
        """List of what is left without an end of line: at most one line."""
        return self.add(b"\n")


def progress(line):
    """Share (0 to 1) of the work that `line` tells of, or None where it tells of none."""
    found = _PROGRESS.match(line)
    if found is None:
        return None
    done, total = float(found[1]), float(found[2])
    return min(done / total, 1.0) if total > 0 else None


def error_line(lines, verb, code):
    """The one line with which the command `verb` ended: its own if it said one, else its last, else the exit code."""
    own = [line for line in lines if line.startswith(f"mpmgis {verb}: ")]
    return (own or lines or [f"mpmgis {verb}: ended with exit code {code} and said nothing"])[-1]
