"""Options of everything that simulates: laws of the user, threads."""

from ..system.option import Option

LAW = Option(
    "Python file with your own friction law; it is executed",
    "FILE.py",
    files="Python (*.py)",
    label="Your own friction law: Python file, which is executed",
)
THREADS = Option(
    "number of processor threads; the result does not depend on it",
    "N",
    above=0,
    usual="one for every 10 000 particles, at most all",
    label="Processor threads",
)
