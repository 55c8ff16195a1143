"""A session in a file: the log's fingerprint, the steps and the model; it opens again where it ended."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any

from ..effects.protocol import Effect
from ..files.codec import ModelFileError, fields, items, parse, read_bytes, render, text
from ..files.model_file import content_of
from ..foreign import HowToRead
from ..records import RecordError
from .acts import act_of, folded
from .arrangement import Settings
from .bench import Bench
from .source import Source, built_in, opened
from .tiles import Store
from .trial_records import SAMPLES

FORMAT, VERSION = "thermocorr session", 1


def session_text(bench: Bench) -> str:
    """A session as JSON."""
    found = bench.current
    settings = asdict(bench.settings)
    if isinstance(settings["time_constants"], tuple):
        settings["time_constants"] = list(settings["time_constants"])
    node = {
        "format": FORMAT,
        "version": VERSION,
        "log": bench.source.node(),
        "settings": settings,
        "steps": [act.node() for act in bench.acts],
        "undone": [[act.node() for act in acts] for acts in bench.versions[bench.at + 1 : bench.at + 2]],
        "model": None if found is None else content_of(found.model, data=(found.data.X, found.data.learned)).decode(),
    }
    return render(node) + "\n"


def is_session(path: str | Path) -> bool:
    """Whether a file is a session, by its name and its first characters."""
    path = Path(path)
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return f'"format": "{FORMAT}"'.encode() in file.read(200)


def reopened(path: str | Path, store: Store, own: Sequence[type[Effect]] = ()) -> Bench:
    """The bench of a session file, at its last step, not yet fitted.

    Raises
    ------
    ModelFileError
        For a file that is damaged, or no session.
    RecordError
        Where the log has gone, or is another one than it was.
    """
    try:
        node = fields(
            parse(read_bytes(path)), "$", ("format", "version", "log", "settings", "steps", "undone", "model")
        )
        if node["format"] != FORMAT or node["version"] != VERSION:
            raise ModelFileError(f"it says {node['format']!r}, version {node['version']!r}: not one of this program")
        source = _source(node["log"], Path(path).parent)
        bench = Bench(source, store, settings=_settings(node["settings"]), own=own)
        return with_steps(bench, node["steps"], node["undone"])
    except ModelFileError as error:
        raise ModelFileError(f"{path} is no session that can be opened: {error}.") from None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None


def with_steps(bench: Bench, steps: Any, undone: Any = ()) -> Bench:
    """A bench on which these steps stand, as JSON of a session has them."""
    label = lambda node, where: bench.codec.unpack(node, where, learned=False).label()  # noqa: E731
    done = tuple(act_of(step, f"$.steps[{i}]", label) for i, step in enumerate(items(steps, "$.steps")))
    bench.versions = [done[:count] for count in range(1, len(done) + 1)] or [()]
    bench.at = len(bench.versions) - 1
    for number, version in enumerate(undone):
        acts = (act_of(step, f"$.undone[{number}]", label) for step in items(version, "$.undone"))
        bench.versions.append(tuple(acts))
    for version in bench.versions:
        folded(version, bench.settings)
    return bench


def _source(node: Any, folder: Path) -> Source:
    node = fields(node, "$.log", (), ("built_in", "files", "how", "join", "sha256"))
    if "built_in" in node:
        if node["built_in"] not in SAMPLES:
            raise RecordError(
                "This session was held on data in memory, which are not in its file. Open a log's session."
            )
        return built_in(node["built_in"])
    paths = [_there(text(name, "$.log.files"), folder) for name in items(node["files"], "$.log.files")]
    known = {item.name for item in fields_of(HowToRead)}
    how = HowToRead(**fields(node["how"], "$.log.how", (), tuple(known)))
    source = opened(paths, how, join=bool(node["join"]))
    if source.digest != node["sha256"]:
        raise RecordError(
            f"{source.name} is not the log of this session any more: its content has changed since. Open the log "
            "itself to begin anew."
        )
    return source


def _there(name: str, folder: Path) -> str:
    """A log where it was, or beside the session's file."""
    return name if Path(name).exists() or not (folder / Path(name).name).exists() else str(folder / Path(name).name)


def _settings(node: Any) -> Settings:
    given = fields(node, "$.settings", tuple(item.name for item in fields_of(Settings)))
    if isinstance(given["time_constants"], list):
        given["time_constants"] = tuple(given["time_constants"])
    return Settings(**given)


def model_in(path: str | Path) -> str | None:
    """The model of a session file, as `save_model` writes it; None where there was none."""
    model: str | None = json.loads(read_bytes(path))["model"]
    return model
