"""Write the answer of a verb about results: a folder of files, or one file chosen by the suffix of -o."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from ..system.csv_rows import write_columns
from ..system.errors import InputError, OutputError
from ..system.links import is_above
from ..system.whole_files import refuse_existing, whole_folder
from .opened_results import result_name
from .question_options import FrameQuestion, Question

Found = TypeVar("Found", bound=Any)  # an answer
FILE_SUFFIX = re.compile(r"\.[A-Za-z]{2,5}")  # of a file, not of a folder named run_1.5


def answer_output(asked: FrameQuestion | Question, word: str, files: Sequence[str]) -> Path:
    """Return the output path: the one asked for, else the folder `<name>_<word>` beside the results.

    Parameters
    ----------
    asked : FrameQuestion or Question
        Every path among its options is an input.
    word : str
        End of the name of the default folder.
    files : sequence of str
        Names of the output files.

    Returns
    -------
    Path

    Raises
    ------
    InputError, OutputError
        None of the files has the suffix of the output; the output exists; it contains an input.
    """
    frames, output = asked["frames"], asked["output"]
    if output is None:
        path = Path(str(frames[0]))
        folder = path if path.is_dir() else path.parent
        folder = folder if folder.name not in ("", "..") else folder.resolve()
        output = folder.parent / f"{result_name(frames)}_{word}"
    own = [value for name, value in asked.items() if isinstance(value, Path) and name != "output"]
    return checked_output(output, files, asked["overwrite"], (*frames, *own))


def checked_output(output: str | Path, files: Sequence[str], overwrite: bool, read: Iterable[str | Path]) -> Path:
    """Return `output` as a Path, checked before any work.

    Parameters
    ----------
    output : path
        A folder for all `files`, or one file with the suffix of one of them.
    files : sequence of str
        Names of the output files.
    overwrite : bool
    read : iterable of path
        The inputs.

    Returns
    -------
    Path

    Raises
    ------
    InputError, OutputError
        None of the files has this suffix; the output exists; it contains an input.
    """
    output = Path(output)
    suffixes = list(dict.fromkeys(Path(name).suffix for name in files))
    if output.suffix.lower() not in suffixes and FILE_SUFFIX.fullmatch(output.suffix):
        raise InputError(f"`output={output}`: expected {', '.join(suffixes)} or a folder for all of {', '.join(files)}")
    refuse_existing(output, overwrite)
    for path in read:
        if is_above(output, Path(path).resolve()):
            raise OutputError(f"{output} contains the input {path} and would be replaced; give another `output`")
    return output


def write_answer(output: Path, overwrite: bool, writers: dict[str, Callable[[Path], Any]]) -> tuple[Path, ...]:
    """Write the output files, all or none.

    Parameters
    ----------
    output : Path
        From `answer_output` or `checked_output`.
    overwrite : bool
    writers : dict of str to callable
        File name -> function of the path to write; if `output` is one file, the first with its suffix is called.

    Returns
    -------
    tuple of Path
        The files written.
    """
    suffix = output.suffix.lower()
    single = next((write for name, write in writers.items() if Path(name).suffix == suffix), None)
    if single is not None:
        single(output)
        return (output,)
    with whole_folder(output, overwrite) as folder:
        for name, write in writers.items():
            write(folder / name)
    return tuple(output / name for name in writers)


def write_rows(path: Path, found: Any) -> None:
    """Write the rows of an answer as CSV.

    Parameters
    ----------
    path : Path
    found : object
        With `columns()`, (name, unit) of each, and `rows()`.
    """
    write_columns(path, found.columns(), found.rows())


def finite_or_none(value: float) -> float | None:
    """Return a number for JSON; None where it is not finite.

    Parameters
    ----------
    value : float
    """
    return value if math.isfinite(value) else None


def four_digits(value: float) -> str:
    """Return a number with four digits as text; a dash where it is not finite.

    Parameters
    ----------
    value : float
    """
    return f"{value:.4g}" if math.isfinite(value) else "-"


def short_number(value: float) -> str:
    """Return a number as text, from 1000 on without decimals, else with four digits; a dash where it is not finite.

    Parameters
    ----------
    value : float
    """
    return f"{value:.0f}" if math.isfinite(value) and abs(value) >= 1000 else four_digits(value)


def with_files(found: Found, output: Path, overwrite: bool, writers: dict[str, Callable[[Path, Found], Any]]) -> Found:
    """Write the output files of an answer, all or none, and return the answer with their paths.

    Parameters
    ----------
    found : dataclass with `files`
    output : Path
        From `answer_output`.
    overwrite : bool
    writers : dict of str to callable
        File name -> function of the path to write and of `found`.

    Returns
    -------
    dataclass with `files`
    """
    own = {name: partial(_written, write, found) for name, write in writers.items()}
    return replace(found, files=write_answer(output, overwrite, own))


def _written(write, found, path):
    write(path, found)
