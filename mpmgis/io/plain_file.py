"""Input paths that can be opened: neither a pipe, which is waited for, nor a device."""

from pathlib import Path

from ..errors import FormatError


def require_file(path):
    """Refuse a pipe, a socket, a device or a folder; what is not there is for the caller to say.

    Raises
    ------
    FormatError
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise FormatError(f"{path} is no file but a {'folder' if path.is_dir() else 'device or pipe'}; name a file")


def require_file_or_folder(path):
    """As `require_file` where a folder may be meant, too.

    Raises
    ------
    FormatError
    """
    if not Path(path).is_dir():
        require_file(path)
