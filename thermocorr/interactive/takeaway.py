"""What can be taken away from the workbench, each written by the one writer of all files."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..files import Outputs, write_file
from ..files.model_file import content_of
from ..files.result_files import write_corrected
from ..firmware.export import export_c
from ..pages import Findings
from ..pages.report import report_text
from .bench import Bench
from .learning import Fitted, quietly
from .script import notebook, script
from .session_file import session_text


class Kind(NamedTuple):
    """Something to take away."""

    file: str
    media: str
    what: str
    write: Callable[[Bench, Fitted, Path], None]


def taken(bench: Bench, kind: str, folder: Path) -> Path:
    """Write one of `KINDS` to a new folder inside of a folder; whoever took it away removes that.

    Raises
    ------
    ValueError
        For a kind that there is not, and where there is no model yet.
    OutputError
        Where it cannot be written.
    """
    if kind not in KINDS:
        raise ValueError(f"{kind!r} cannot be taken away. There are: {', '.join(KINDS)}.")
    found = bench.current
    if found is None:
        raise ValueError("There is no model yet: say first which column is the temperature and which the reading.")
    path = Path(tempfile.mkdtemp(prefix="take-", dir=folder)) / KINDS[kind].file
    quietly(lambda: KINDS[kind].write(bench, found, path))
    return path


def _script(bench: Bench, found: Fitted, path: Path) -> None:
    write_file(path, script(bench.source, found, bench.acts, bench.own_file))


def _notebook(bench: Bench, found: Fitted, path: Path) -> None:
    write_file(path, notebook(bench.source, found, bench.acts, bench.own_file))


def _model(bench: Bench, found: Fitted, path: Path) -> None:
    write_file(path, content_of(found.model, data=(found.data.X, found.data.learned)))


def _corrected(bench: Bench, found: Fitted, path: Path) -> None:
    evaluated = found.model.evaluate(found.data.X, found.data.y, return_std=True)
    with Outputs(bench.source.files) as outputs:
        write_corrected(outputs, path.parent, bench.source.table.as_it_came(), evaluated, _has_index(bench))


def _has_index(bench: Bench) -> bool:
    return bench.source.frame.index.name is not None or bench.source.frame.index.dtype.kind in "mM"


def _report(bench: Bench, found: Fitted, path: Path) -> None:
    findings = Findings(
        diagnosis=found.diagnosis,
        unjudged=found.said.get("diagnosis", "Not judged yet." if found.diagnosis is None else ""),
        source=bench.source.name,
        command="thermocorr workbench",
    )
    write_file(path, report_text(found.model, found.data.X, found.data.y, findings))


def _firmware(bench: Bench, found: Fitted, path: Path) -> None:
    folder = path.with_suffix("")
    export_c(found.model, folder)
    with Outputs() as outputs, zipfile.ZipFile(outputs.open(path), "w", zipfile.ZIP_DEFLATED) as packed:
        for part in sorted(folder.iterdir()):
            packed.write(part, part.name)


def _session(bench: Bench, found: Fitted, path: Path) -> None:
    write_file(path, session_text(bench))


KINDS = {
    "script": Kind("session.py", "text/x-python", "Python script", _script),
    "notebook": Kind("session.ipynb", "application/x-ipynb+json", "Notebook", _notebook),
    "model": Kind("model.json", "application/json", "model.json", _model),
    "corrected": Kind("corrected.csv", "text/csv", "corrected.csv", _corrected),
    "report": Kind("report.html", "text/html", "Report page", _report),
    "firmware": Kind("firmware.zip", "application/zip", "C source", _firmware),
    "session": Kind("session.json", "application/json", "Session file", _session),
}
