"""`thermocorr workbench`: a log on a screen in the browser."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import threading
import webbrowser
from collections.abc import Callable

from ..records import RecordError
from ..records.errors import existing_file
from .loading import (
    add_column_options,
    add_table_options,
    add_time_constants,
    check_time_constants,
    how_to_read,
    parse_time_constants,
)

NEEDS = "The workbench needs the packages starlette, uvicorn and matplotlib: pip install starlette uvicorn matplotlib."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `thermocorr workbench`."""
    parser.add_argument(
        "log", nargs="*", help="a log as for analyze; without one, a built-in record with a hidden effect"
    )
    add_table_options(parser)
    add_column_options(parser)
    add_time_constants(parser)
    parser.add_argument("--effects", metavar="FILE", help="Python file with effects of your own, to be suspects too")
    serving = parser.add_argument_group("page")
    serving.add_argument("--port", type=int, default=0, help="on 127.0.0.1 (default: a free one)")
    serving.add_argument("--keep", action="store_true", help="keep running without the page; Ctrl-C ends it")
    serving.add_argument("--no-browser", action="store_true", help="print the address only")
    static = parser.add_argument_group("page that computes in the browser, to be served by any web server")
    static.add_argument("--static", metavar="FOLDER", help="write it there, and end")
    static.add_argument("--pyodide", metavar="FOLDER", help="a Pyodide distribution, which is copied too")
    static.add_argument("--force", action="store_true", help="overwrite what is there already")


def run(options: argparse.Namespace, say: Callable[[str], None], progress: Callable[[str], None]) -> None:
    """Serve it until the page is closed, or Ctrl-C."""
    if options.static is not None:
        _write_static(options, say)
        return
    try:
        import matplotlib  # noqa: F401

        from ..workbench.screen import server
    except ModuleNotFoundError as error:
        if str(error.name).split(".")[0] not in ("starlette", "uvicorn", "matplotlib"):
            raise
        raise ImportError(NEEDS) from None
    from ..workbench.screen.desk import Opening

    check_time_constants(options)
    for path in (*options.log, *([options.effects] if options.effects else [])):
        existing_file(path)
    if len(options.temperature or ()) > 1:
        raise RecordError(
            "The workbench begins with one --temperature. Add further thermometers on its page: columns that act late."
        )
    taus = parse_time_constants(options.time_constants)
    opening = Opening(
        paths=tuple(options.log),
        how=how_to_read(options),
        roles={
            role: value[0] if isinstance(value, list) else value
            for role in ("temperature", "reading", "reference", "run")
            if (value := getattr(options, role)) is not None
        },
        model={
            "time_constants": None if taus == "auto" else taus,
            "sampling_period": options.sampling_period,
            "max_gap": options.max_gap,
        },
        effects_file=options.effects or "",
    )

    def ready(address: str) -> None:
        say(f"Workbench: {address}\nIt works in one browser on this machine. Close the page or press Ctrl-C to end.")
        if not options.no_browser and _has_screen():
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    server.run(opening, port=options.port, keep=options.keep, ready=ready)


def _write_static(options: argparse.Namespace, say: Callable[[str], None]) -> None:
    """Write the page that needs no server of its own."""
    from ..workbench.screen.static_page import WHERE, write_static

    if options.pyodide is None:
        raise RecordError(f"--static needs Pyodide, the Python that runs in a browser. {WHERE}")
    index = write_static(options.static, options.pyodide, options.force)
    say(f"Written: {index}\nServe the folder, for example: python -m http.server -d {shlex.quote(str(index.parent))}")


def _has_screen() -> bool:
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
