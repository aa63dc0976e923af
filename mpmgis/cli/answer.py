"""An answer in words or JSON: to stdout, or with `-o` into a file whose path goes to stdout."""

from pathlib import Path


def add_arguments(parser):
    """Declare -o and --overwrite."""
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write the answer here instead of stdout")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier file of that name")


def require_writable(arguments, asked_about):
    """Refuse, before the work, a file that is there and may not be replaced, and any that is itself asked about."""
    from ..errors import OutputError
    from ..io.atomic import refuse_existing
    from ..io.links import one_of

    if arguments.output is None:
        return
    refuse_existing(arguments.output, arguments.overwrite)
    if one_of(arguments.output, asked_about) is not None:
        raise OutputError(f"{arguments.output} is what is asked about; give another -o")


def give(text, arguments):
    """Print `text`, or write it whole to the file of -o and print that one's path."""
    if arguments.output is None:
        print(text)
        return
    from ..io.atomic import whole_file

    with whole_file(arguments.output) as part:
        part.write_text(text + "\n", encoding="utf-8", newline="\n")
    print(arguments.output)
