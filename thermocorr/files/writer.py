"""The one writer: inputs are never touched, and files appear whole, all of a set or none."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from ..records import RecordError
from .drafts import KEPT, Draft, draft_name, sync_folder
from .marks import bears_mark
from .uninterrupted import uninterrupted

Name = str | PathLike[str]


class OutputError(OSError, RecordError):
    """A file cannot be written, or must not be; what stood there before stands there still."""


class Outputs:
    """A set of output files that take their places together.

    Each file is written as a draft in its own folder, brought to the disk, and renamed when the whole set is ready:
    whatever goes wrong before, nothing has changed. Renaming follows links, and keeps mode and owner. (A process that
    is killed between two renamings leaves whole files, some of them new.)

    Parameters
    ----------
    inputs : paths
        Files that are read: none of them may be written.
    force : bool, default False
        Overwrite files that thermocorr did not write.

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
        self._opened: set[Path] = set()
        self._drafts: list[Draft] = []
        self._devices: list[BinaryIO] = []

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.commit()
        else:
            self.discard()

    def claim(self, path: Name) -> Path:
        """Say early that a file will be written: its folder is made, and all reasons against it are raised now.

        Raises
        ------
        OutputError
            For an input or another output under whatever name, a file without thermocorr's mark (unless forced), a
            folder in its place, a place that cannot be written to.
        """
        path = Path(path)
        with _said(path):
            target = _target(path)
            self._refuse_same(path, target)
            if target.is_dir():
                raise OutputError(f"{path} is a directory and cannot be written. Name a file in it.")
            if target.exists() and _regular(target) and not self.force and not bears_mark(target):
                raise OutputError(
                    f"{path} is there already and was not written by thermocorr. Name another file, or overwrite it "
                    "with --force (in Python: force=True)."
                )
            target.parent.mkdir(parents=True, exist_ok=True)
            if not os.access(target if target.exists() and not _regular(target) else target.parent, os.W_OK):
                raise OutputError(f"{path} cannot be written: no permission. Choose another place.")
            self._claimed[target] = path
        return target

    def open(self, path: Name) -> BinaryIO:
        """A file to write to; it takes its place at `commit`. Devices and pipes are written to at once."""
        with _said(Path(path)):
            target = _target(path)
            if target not in self._claimed:
                self.claim(path)
            elif target in self._opened:
                raise OutputError(f"{path} would be written twice by this command. Name another file for one of them.")
            self._opened.add(target)
            if target.exists() and not _regular(target):
                self._devices.append(target.open("wb"))
                return self._devices[-1]
            with uninterrupted():
                self._drafts.append(Draft(target))
            return self._drafts[-1].file

    def write(self, path: Name, content: str | bytes) -> None:
        """Write a whole file; it takes its place at `commit`."""
        data = content.encode("utf-8") if isinstance(content, str) else content
        file = self.open(path)
        with _said(Path(path)):
            file.write(data)
            file.flush()

    def commit(self) -> None:
        """Let all files take their places; if one cannot, none does."""
        try:
            self._close_devices()
            for draft in self._drafts:
                with _said(self._claimed[draft.target]):
                    draft.finish()
            with uninterrupted():
                self._replace(self._drafts)
        finally:
            self._close_drafts()

    def discard(self) -> None:
        """Forget what was written."""
        self._close_drafts()
        with contextlib.suppress(OSError):
            self._close_devices()

    def _close_drafts(self) -> None:
        with uninterrupted():
            while self._drafts:
                self._drafts.pop().close()

    def _close_devices(self) -> None:
        while self._devices:
            self._devices.pop().close()

    def _replace(self, drafts: list[Draft]) -> None:
        kept: dict[Path, Path | None] = {}
        replaced: list[Path] = []
        try:
            for draft in drafts if len(drafts) > 1 else ():  # all that needs space, before anything changes
                with _said(self._claimed[draft.target]):
                    kept[draft.target] = _kept(draft.target)
            for draft in drafts:
                with _said(self._claimed[draft.target]):
                    draft.replace()
                replaced.append(draft.target)
        except BaseException:
            for target in reversed(replaced):
                before = kept.pop(target)
                with contextlib.suppress(OSError):  # what cannot be brought back stays beside its place
                    target.unlink(missing_ok=True) if before is None else os.replace(before, target)
            raise
        finally:
            for before in kept.values():
                if before is not None:
                    before.unlink(missing_ok=True)
            for folder in {draft.target.parent for draft in drafts}:
                sync_folder(folder)

    def _refuse_same(self, path: Path, target: Path) -> None:
        for other in self._inputs:
            if _same(target, other):
                raise OutputError(
                    f"{path} is read by this command ({other}): its results would destroy it. Name another file."
                )
        for other in self._claimed:
            if _same(target, other):
                raise OutputError(f"{path} would be written twice by this command. Name another file for one of them.")


def write_file(path: Name, content: str | bytes, *, inputs: Iterable[Name] = (), force: bool = False) -> Path:
    """Write one file as a whole, see `Outputs`; whatever goes wrong, the one that was there before stays."""
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
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path} cannot be written: {reason}. What was there is unchanged.") from None


def _kept(target: Path) -> Path | None:
    """A second name for what is to be replaced, to bring it back; None where there is nothing."""
    if not target.exists():
        return None
    kept = draft_name(target, KEPT)
    try:
        os.link(target, kept)
    except OSError:  # file systems without links
        try:
            shutil.copy2(target, kept)
        except BaseException:
            kept.unlink(missing_ok=True)
            raise
    return kept


def _target(path: Name) -> Path:
    """Where a file stands or will, through links. A device keeps its name: the pipe behind /dev/stdout has no other."""
    path = Path(path)
    return path if path.exists() and not _regular(path) else Path(os.path.realpath(path))


def _regular(path: Path) -> bool:
    return stat.S_ISREG(path.stat().st_mode)


def _same(target: Path, other: Path) -> bool:
    """Whether two names mean one file, through links too."""
    with contextlib.suppress(OSError):
        return target.samefile(other)
    return target == Path(os.path.realpath(other))
