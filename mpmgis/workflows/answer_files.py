"""Where an answer about results goes: a folder of files, or the one of them that the suffix of -o asks for."""

import re
from dataclasses import dataclass, fields
from pathlib import Path

from ..errors import InputError, OutputError
from ..io.atomic import refuse_existing, whole_folder
from ..io.links import is_above
from .export import ExportRequest
from .opened_results import result_name

FILE_SUFFIX = re.compile(r"\.[A-Za-z]{2,5}")  # of a file, not of a folder called run_1.5


@dataclass(frozen=True, kw_only=True)
class AnswerRequest:
    """What every question about results says: `results` (ExportRequest: which, and how their cells are averaged),
    where the answer goes, and whether it replaces an earlier one."""

    results: ExportRequest
    output: Path | None = None
    overwrite: bool = False


def answer_output(request, word, files):
    """Path to write to: the one asked for, else the folder `<name>_<word>` beside the results.

    Parameters
    ----------
    request : AnswerRequest
    word : str
    files : sequence of str
        Names of the files that the answer is made of.

    Raises
    ------
    InputError, OutputError
        A suffix that none of the files has; it exists; it holds the results, or another file that is asked with.
    """
    frames, output = request.results.frames, request.output
    if output is None:
        path = Path(str(frames[0]))
        folder = path if path.is_dir() else path.parent
        folder = folder if folder.name not in ("", "..") else folder.resolve()
        output = folder.parent / f"{result_name(request.results)}_{word}"
    return checked_output(output, files, request.overwrite, (*frames, *_files_asked_with(request)))


def checked_output(output, files, overwrite, read):
    """`output` as a Path, checked before any work.

    Parameters
    ----------
    output : path
        A folder for all `files`, or one file with the suffix of one of them.
    files : sequence of str
        Names of the files that the answer is made of.
    overwrite : bool
    read : iterable of path
        What the answer is made from.

    Raises
    ------
    InputError, OutputError
        A suffix that none of the files has; it exists; it holds something of what is read.
    """
    output = Path(output)
    suffixes = list(dict.fromkeys(Path(name).suffix for name in files))
    if output.suffix.lower() not in suffixes and FILE_SUFFIX.fullmatch(output.suffix):
        raise InputError(f"-o {output}: wanted {', '.join(suffixes)} or a folder for all of {', '.join(files)}")
    refuse_existing(output, overwrite)
    for path in read:
        if is_above(output, Path(path).resolve()):
            raise OutputError(f"{output} holds {path}, which is asked about, and would be replaced; give another -o")
    return output


def _files_asked_with(request):
    """Paths of the lines, points, guidelines, ... of a question, and of the DTM."""
    values = [getattr(request, field.name) for field in fields(request) if field.name != "output"]
    return [value for value in (*values, request.results.dem, request.results.sidecar) if isinstance(value, Path)]


def write_answer(request, output, writers):
    """Write the files of an answer, all or none.

    Parameters
    ----------
    request : AnswerRequest or another that says `overwrite`
    output : Path
        As `answer_output` or `checked_output` gives it.
    writers : dict of str to callable
        File name -> function of the path to write; where `output` is one file, the first of its suffix is written.

    Returns
    -------
    tuple of Path
    """
    suffix = output.suffix.lower()
    single = next((write for name, write in writers.items() if Path(name).suffix == suffix), None)
    if single is not None:
        single(output)
        return (output,)
    with whole_folder(output, request.overwrite) as folder:
        for name, write in writers.items():
            write(folder / name)
    return tuple(output / name for name in writers)
