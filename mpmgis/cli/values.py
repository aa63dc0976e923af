"""Values of options: text to number, with what was got and wanted where it is none."""

import argparse
import math


def number(text):
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted a finite number")
    return value


def positive(text):
    """A number above 0."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a number above 0")
    return value


def numbers(text):
    """Finite numbers with commas between them, as a tuple."""
    return tuple(number(part) for part in text.split(","))


def percentile(text):
    """A number above 0 and up to 100."""
    value = number(text)
    if not 0 < value <= 100:
        raise argparse.ArgumentTypeError(f"got {text}, wanted a number above 0 and up to 100")
    return value


def place(text):
    """Two numbers E,N [m] on the map, as a tuple."""
    found = numbers(text)
    if len(found) != 2:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted two numbers E,N")
    return found


def count(text):
    """A whole number above 0."""
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted a whole number above 0")
    return int(text)
