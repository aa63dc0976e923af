"""What the command says: lines out of the bytes that come, progress and errors out of the lines."""

from __future__ import annotations

import re

_TIME, _FRAME = re.compile(r"t = ([\d.]+) of ([\d.]+)"), re.compile(r"frame (\d+) of (\d+)")
_MEMBER = re.compile(r"run (\d+) of (\d+)")
_SETTING = re.compile(r"(\d+) of (\d+): ")  # begins now: one less is done
# verb -> its lines that tell how far it is: (what they look like, done before the first counts, share of the bar)
_USUAL = ((_TIME, 0, (0.0, 1.0)), (_FRAME, 0, (0.0, 1.0)))
_OF_VERB = {
    "demo": ((_TIME, 0, (0.0, 0.7)), (_FRAME, 0, (0.7, 1.0))),
    "ensemble": ((_MEMBER, 0, (0.0, 1.0)),),
    "study": ((_SETTING, 1, (0.0, 1.0)),),
}


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


def progress(line, verb):
    """Share (0 to 1) of the work of `verb` that `line` tells of, or None where it tells of none."""
    for pattern, earlier, (begin, end) in _OF_VERB.get(verb, _USUAL):
        found = pattern.match(line)
        if found is not None and float(found[2]) > 0:
            return begin + min((float(found[1]) - earlier) / float(found[2]), 1.0) * (end - begin)
    return None


def error_line(lines, verb, code):
    """The one line with which the command `verb` ended: its own if it said one, else its last, else the exit code."""
    own = [line for line in lines if line.startswith(f"mpmgis {verb}: ")]
    return (own or lines or [f"mpmgis {verb}: ended with exit code {code} and said nothing"])[-1]
