"""Kinds of errors; every message is one line: what, where, got, expected, fix."""

import unicodedata


class MpmgisError(Exception):
    """Base of all errors that mpmgis raises on purpose; `exit_code` is what the command line returns."""

    exit_code = 2


class InputError(MpmgisError):
    """A file or value that the user gave cannot be used."""


class GeoreferenceError(InputError):
    """A CRS, unit or transform does not give metres on a map."""


class SceneError(InputError):
    """A scene contains an unknown name or an impossible value."""


class FormatError(InputError):
    """A file is missing, truncated, damaged, or of a newer format."""


class OutputError(MpmgisError):
    """Something cannot be written: it exists already, the folder is read-only, the disk is full."""


class UnphysicalError(MpmgisError):
    """A run left the range of its model and stopped; all earlier frames are complete."""

    exit_code = 3


def one_line(text: object) -> str:
    """Return a text, or the message of an error, with white space folded into one line.

    Parameters
    ----------
    text : object
        Often an error of another library.
    """
    return " ".join(str(text).split())


def innermost_reason(error: BaseException) -> str:
    """Return the message of the error that led to `error`: the first of a library, which has the cause.

    Parameters
    ----------
    error : BaseException
    """
    seen = []
    while error is not None and error not in seen:
        seen.append(error)
        error = error.__cause__ or error.__context__
    texts = [one_line(one) for one in seen]
    return next((text for text in reversed(texts) if text and "See previous exception" not in text), texts[0])


def has_control_characters(text: str) -> bool:
    """Return whether `text` contains control characters (line ends too) or bytes that are not text.

    Parameters
    ----------
    text : str
    """
    return any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text)
