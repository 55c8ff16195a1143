"""Files that are to be read: there they are, or in one sentence why not."""

from __future__ import annotations

import stat
from os import PathLike
from pathlib import Path

from .errors import RecordError


def existing_file(path: str | PathLike[str]) -> Path:
    """The path of a file that can be read; RecordError where there is none, or only a folder or a device."""
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise RecordError(
            f"There is no file {path}. Check its name and the folder you are in ({Path.cwd()})."
        ) from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if stat.S_ISDIR(mode):
        raise RecordError(f"{path} is a folder. Name the log file in it.")
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        raise RecordError(f"{path} is a device, and may never end. Name a log file.")
    return path
