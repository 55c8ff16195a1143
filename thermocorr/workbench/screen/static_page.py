"""The workbench as static files that compute in the browser."""

from __future__ import annotations

import importlib.util
import io
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

from ...output.writer import OutputError, Outputs
from ...records import RecordError
from ...records.errors import way
from . import page_assets

NEEDED = ("numpy", "scipy", "pandas", "scikit-learn", "matplotlib")
"""Packages that Pyodide brings compiled; what they depend on comes with them."""
OWN = ("thermocorr", "jinja2", "markupsafe")
"""Packages that are packed as they are installed here, as far as they are Python."""
CORE = ("pyodide.mjs", "pyodide.asm.wasm", "python_stdlib.zip")
PROGRAMS = ("pyodide.asm.mjs", "pyodide.asm.js")
"""Pyodide's own program, by its name in new and in older versions."""
LOCK = "pyodide-lock.json"
HINT = "Open a log: it is read in this browser, and nothing leaves this machine."
POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self' blob:; connect-src 'self'; "
    "style-src 'self'; img-src data:; base-uri 'none'; form-action 'none'"
)
"""The page may load from its own folder alone, and send nothing anywhere."""
WHERE = (
    "Name the folder of a Pyodide distribution with --pyodide: what pyodide-<version>.tar.bz2 holds, of "
    "https://github.com/pyodide/pyodide/releases."
)


def write_static(folder: str | Path, pyodide: str | Path, force: bool = False) -> Path:
    """Write the page, and what it needs of Pyodide.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    pyodide : path
        Folder of a Pyodide distribution.
    force : bool, default False
        Overwrite files that are there already.

    Returns
    -------
    Path
        The page, ``index.html``. Browsers load it from a web server, such as ``python -m http.server -d FOLDER``.

    Raises
    ------
    RecordError
        For a folder that is no distribution.
    OutputError
        For files that cannot be written, or must not be.
    """
    folder, pyodide = Path(folder), Path(pyodide)
    lock, wheels = _chosen(pyodide)
    if pyodide.resolve().is_relative_to(folder.resolve()):
        raise RecordError(f"{pyodide} lies in {folder}, which is written to. Name another folder with --static.")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "index.html").exists() and not force:
        raise OutputError(
            f"{folder} has other files. Name another folder, or write into it with {way('--force', 'force=True')}."
        )
    with Outputs((), force) as outputs:
        outputs.write(folder / "index.html", page())
        outputs.commit()
    for name in (*page_assets.STATIC, "desk_worker.mjs"):
        (folder / name).write_text(page_assets.asset_text(name), encoding="utf-8")
    (folder / "packages.zip").write_bytes(packages())
    (folder / "pyodide").mkdir(exist_ok=True)
    (folder / "pyodide" / LOCK).write_text(json.dumps(lock), encoding="utf-8")
    for name in (*CORE, *(name for name in PROGRAMS if (pyodide / name).exists()), *wheels):
        shutil.copyfile(pyodide / name, folder / "pyodide" / name)
    return folder / "index.html"


def page() -> str:
    """The page, which is the same for every log."""
    body = page_assets.template("body.html").replace(
        '<p data-part="source" class="soft"></p>', f'<p data-part="source" class="soft">{HINT}</p>'
    )
    return page_assets.filled("static.html", body, page_assets.STATIC, policy=POLICY)


def packages() -> bytes:
    """The packages of `OWN` as one zip."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in OWN:
            found = importlib.util.find_spec(name)
            assert found is not None and found.submodule_search_locations is not None
            root = Path(next(iter(found.submodule_search_locations)))
            for path in sorted(root.rglob("*")):
                if path.is_file() and path.suffix in (".py", ".js", ".mjs", ".css", ".html", ".csv", ".json", ".txt"):
                    packed.write(path, path.relative_to(root.parent).as_posix())
    return out.getvalue()


def _chosen(pyodide: Path) -> tuple[dict[str, Any], list[str]]:
    """Pyodide's lock and files, reduced to the needed."""
    try:
        lock = json.loads((pyodide / LOCK).read_text(encoding="utf-8"))
        known = {_plain(name): package for name, package in lock["packages"].items()}
        names: list[str] = []
        waiting = [_plain(name) for name in NEEDED]
        while waiting:
            name = waiting.pop()
            if name not in names:
                names.append(name)
                waiting += [_plain(other) for other in known[name]["depends"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise RecordError(f"{pyodide} is no distribution of Pyodide. {WHERE}") from None
    wheels = [known[name]["file_name"] for name in names]
    lost = [name for name in (*CORE, *wheels) if not (pyodide / name).is_file()]
    if lost or not any((pyodide / name).is_file() for name in PROGRAMS):
        raise RecordError(f"{pyodide} has no {(lost or PROGRAMS)[0]}: it is not a full distribution. {WHERE}")
    kept = {name: package for name, package in lock["packages"].items() if _plain(name) in names}
    return {**lock, "packages": kept}, wheels


def _plain(name: str) -> str:
    return name.lower().replace("_", "-")
