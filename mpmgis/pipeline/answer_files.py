"""Where an answer about results goes: a folder of files, or the one of them that the suffix of -o asks for."""

import re
from pathlib import Path

from ..errors import InputError, OutputError
from ..io.atomic import refuse_existing, whole_folder
from .opened_results import result_name

_FILE_SUFFIX = re.compile(r"\.[A-Za-z]{2,5}")  # of a file, not of a folder called run_1.5


def answer_output(request, output, overwrite, word, files):
    """Path to write to: `output`, else the folder `<name>_<word>` beside the results.

    Parameters
    ----------
    request : ExportRequest
        Names the results, which must not lie in what would be replaced.
    output : Path or None
    overwrite : bool
    word : str
    files : sequence of str
        Names of the files that the answer is made of.

    Raises
    ------
    InputError, OutputError
        A suffix that none of the files has; it exists; it holds the results.
    """
    if output is None:
        path = Path(str(request.frames[0]))
        folder = path if path.is_dir() else path.parent
        folder = folder if folder.name not in ("", "..") else folder.resolve()
        output = folder.parent / f"{result_name(request)}_{word}"
    output = Path(output)
    suffixes = list(dict.fromkeys(Path(name).suffix for name in files))
    if output.suffix.lower() not in suffixes and _FILE_SUFFIX.fullmatch(output.suffix):
        raise InputError(f"-o {output}: wanted {', '.join(suffixes)} or a folder for all of {', '.join(files)}")
    refuse_existing(output, overwrite)
    for path in request.frames:
        if Path(path).resolve().is_relative_to(output.resolve()):
            raise OutputError(f"{output} holds {path}, which is asked about, and would be replaced; give another -o")
    return output


def write_answer(output, overwrite, writers):
    """Write the files of an answer, all or none.

    Parameters
    ----------
    output : Path
        As `answer_output` gives it.
    overwrite : bool
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
    with whole_folder(output, overwrite) as folder:
        for name, write in writers.items():
            write(folder / name)
    return tuple(output / name for name in writers)
