"""The one writer of files: a draft, then a rename."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from ..records import RecordError
from ..records.errors import way

Name = str | PathLike[str]


class OutputError(OSError, RecordError):
    """A file cannot be written; the old one stays.

    It exists already, is an input, or the system refuses.
    """


class Outputs:
    """Output files of one command, written together.

    Whatever goes wrong before, nothing has changed; the file that is written last, a model, says that all are there.

    `inputs` (paths): Files that are read: none of them may be written. `force` (bool, default False): Overwrite files
    that are there already.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> with Outputs(inputs=["log.csv"]) as outputs:
    ...     outputs.write(folder / "a.txt", "one")
    ...     outputs.write(folder / "b.txt", "two")
    >>> sorted(path.name for path in folder.iterdir())
    ['a.txt', 'b.txt']
    """

    def __init__(self, inputs: Iterable[Name] = (), force: bool = False):
        self.force = force
        self._inputs = [Path(path) for path in inputs]
        self._claimed: dict[Path, Path] = {}
        self._drafts: list[tuple[BinaryIO, Path]] = []

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.commit()
        else:
            self.discard()

    def claim(self, path: Name) -> Path:
        """Announce a file: reasons against it are raised now.

        Raises OutputError for an input or another output under whatever name, a file that is there (unless forced), a
        folder in its place, a place that cannot be written to.
        """
        path = Path(path)
        with _said(path):
            target = Path(os.path.realpath(path))
            if any(_same(target, other) for other in self._inputs):
                raise OutputError(f"{path} is read by this command: its results would destroy it. Name another file.")
            if any(_same(target, other) for other in self._claimed):
                raise OutputError(f"{path} would be written twice by this command. Name another file for one of them.")
            if target.is_dir():
                raise OutputError(f"{path} is a directory and cannot be written. Name a file in it.")
            if target.exists() and not (self.force and target.is_file()):
                forced = way("--force", "force=True")
                raise OutputError(f"{path} is there already. Name another file, or overwrite it with {forced}.")
            target.parent.mkdir(parents=True, exist_ok=True)
            if not os.access(target.parent, os.W_OK):
                raise OutputError(f"{path} cannot be written: no permission. Choose another place.")
            self._claimed[target] = path
        return target

    def open(self, path: Name) -> BinaryIO:
        """A file to write to; it takes its place at `commit`."""
        target = Path(os.path.realpath(path))
        if target not in self._claimed:
            self.claim(path)
        draft = target.with_name(f".{target.name[:40]}.{secrets.token_hex(8)}.draft")
        with _said(Path(path)):
            file = draft.open("xb")
        self._drafts.append((file, target))
        return file

    def write(self, path: Name, content: str | bytes) -> None:
        """Write a whole file; it takes its place at `commit`."""
        file = self.open(path)
        with _said(Path(path)):
            file.write(content.encode("utf-8") if isinstance(content, str) else content)

    def commit(self) -> None:
        """Bring all drafts to disk, then rename them in order."""
        try:
            for file, target in self._drafts:
                with _said(self._claimed[target]):
                    file.flush()
                    os.fsync(file.fileno())
            while self._drafts:
                file, target = self._drafts[0]
                file.close()
                with _said(self._claimed[target]):
                    os.replace(file.name, target)
                del self._drafts[0]
        finally:
            self.discard()

    def discard(self) -> None:
        """Forget the drafts that have not taken their places."""
        while self._drafts:
            file, _ = self._drafts.pop()
            with contextlib.suppress(OSError):  # a full disk, which has been said
                file.close()
            Path(file.name).unlink(missing_ok=True)


def write_file(path: Name, content: str | bytes, *, inputs: Iterable[Name] = (), force: bool = False) -> Path:
    """Write one whole file; the old one stays on errors."""
    with Outputs(inputs, force) as outputs:
        outputs.write(path, content)
    return Path(path)


@contextlib.contextmanager
def _said(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into a sentence."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path} cannot be written: {reason}. What was there is unchanged.") from None


def _same(target: Path, other: Path) -> bool:
    """True if two names mean one file, through links too."""
    with contextlib.suppress(OSError):
        return target.samefile(other)
    return target == Path(os.path.realpath(other))
