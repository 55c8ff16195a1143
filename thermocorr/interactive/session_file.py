"""A session in a file: the log's fingerprint, the steps and the model; it opens again where it ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..effects.protocol import Effect
from ..files.codec import ModelFileError, fields, integer, items, parse, read_bytes, render, text
from ..files.effect_nodes import ImportNotAllowedError
from ..files.model_file import content_of
from ..foreign import HowToRead
from ..records import RecordError
from .acts import Act, Past, act_of, products_of
from .arrangement import ModelSettings
from .bench import Bench
from .source import ReadLog, built_in, fingerprint, opened
from .tiles import Store
from .trial_records import SAMPLES

FORMAT, VERSION = "thermocorr session", 1
SWITCHES = ("sort",)
LISTS = ("no_times",)
"""What is true or false in `HowToRead`, and what is a list; all else is text."""
OWN = "Give the file of your own effects, as you did before: --effects my_effects.py"


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
        "past": past_node(bench.past),
        "model": None if found is None else content_of(found.model, data=(found.data.X, found.data.learned)).decode(),
    }
    return render(node) + "\n"


def past_node(past: Past) -> dict[str, Any]:
    """All that was done, each act once: ``acts``, ``versions`` (numbers of acts) and which of them stands, ``at``."""
    numbers: dict[Act, int] = {}
    versions = [[numbers.setdefault(act, len(numbers)) for act in acts] for acts in past.versions]
    return {"acts": [act.node() for act in numbers], "versions": versions, "at": past.at}


def with_past(bench: Bench, node: Any) -> Bench:
    """A bench on which all that was done stands again."""
    node = fields(node, "$.past", ("acts", "versions", "at"))

    def label(effect: Any, where: str) -> str:
        try:
            return bench.codec.unpack(effect, where, learned=False).label()
        except ImportNotAllowedError:
            raise ModelFileError(OWN) from None

    acts = [act_of(act, f"$.past.acts[{i}]", label) for i, act in enumerate(items(node["acts"], "$.past.acts"))]
    versions = tuple(
        tuple(acts[integer(k, f"$.past.versions[{i}]", 0, len(acts) - 1)] for k in items(version, "$.past.versions"))
        for i, version in enumerate(items(node["versions"], "$.past.versions"))
    )
    if not versions:
        raise ModelFileError("$.past.versions holds nothing")
    bench.past = Past(versions, integer(node["at"], "$.past.at", 0, len(versions) - 1))
    return bench


def is_session(path: str | Path) -> bool:
    """Whether a file is a session, by its name and its first characters."""
    path = Path(path)
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return f'"format": "{FORMAT}"'.encode() in file.read(200)


def reopened(path: str | Path, store: Store, own: Sequence[type[Effect]] = (), own_file: str = "") -> Bench:
    """The bench of a session file, at its last step, not yet fitted.

    Raises ModelFileError for a file that is damaged, or no session. Raises RecordError where the log has gone, or is
    another one than it was.
    """
    try:
        node = fields(parse(read_bytes(path)), "$", ("format", "version", "log", "settings", "past", "model"))
        if node["format"] != FORMAT or node["version"] != VERSION:
            raise ModelFileError(f"it says {node['format']!r}, version {node['version']!r}: not one of this program")
        settings = _settings(node["settings"])
        bench = Bench(_source(node["log"], Path(path).parent), store, settings=settings, own=own, own_file=own_file)
        return with_past(bench, node["past"])
    except ModelFileError as error:
        raise ModelFileError(f"{path} is no session that can be opened: {error}.") from None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}.") from None


def _source(node: Any, folder: Path) -> ReadLog:
    node = fields(node, "$.log", (), ("built_in", "files", "how", "join", "sha256"))
    if "built_in" in node:
        if node["built_in"] not in SAMPLES:
            raise RecordError(
                "This session was held on data in memory, which are not in its file. Open a log's session."
            )
        return built_in(node["built_in"])
    node = fields(node, "$.log", ("files", "how", "join", "sha256"))
    names = [text(name, "$.log.files") for name in items(node["files"], "$.log.files")]
    if not names or any(name.startswith(("\\\\", "//")) for name in names):
        raise ModelFileError("$.log.files names no file of this machine")
    if len(set(names)) < len(names):
        raise ModelFileError("$.log.files names a file twice")
    paths = [_there(name, folder) for name in names]
    if fingerprint(paths) != node["sha256"]:  # before anything in the file is looked at
        raise RecordError(
            f"{', '.join(names)} is not the log of this session any more: its content has changed since. Open the log "
            "itself to begin anew."
        )
    known = tuple(item.name for item in dataclasses.fields(HowToRead))
    given = fields(node["how"], "$.log.how", (), known)
    for name, value in given.items():
        if name in LISTS:
            given[name] = tuple(text(item, f"$.log.how.{name}") for item in items(value, f"$.log.how.{name}"))
        elif (type(value) is not bool) if name in SWITCHES else (value is not None and not isinstance(value, str)):
            raise ModelFileError(f"$.log.how.{name} holds {value!r}, which does not belong there")
    return opened(paths, HowToRead(**given), join=bool(node["join"]))


def _there(name: str, folder: Path) -> str:
    """A log where it was, or beside the session's file."""
    return name if Path(name).exists() or not (folder / Path(name).name).exists() else str(folder / Path(name).name)


def _settings(node: Any) -> ModelSettings:
    given = fields(node, "$.settings", tuple(item.name for item in dataclasses.fields(ModelSettings)))
    taus = given["time_constants"]
    if isinstance(taus, list):
        given["time_constants"] = tuple(taus)
    elif taus != "auto":
        integer(taus, "$.settings.time_constants", 1, 64)
    integer(given["degree"], "$.settings.degree", 0, 9)
    if type(given["screen"]) is not bool:
        raise ModelFileError("$.settings.screen is neither true nor false")
    products_of(given["products"], "$.settings")
    for name in ("sampling_period", "max_gap"):
        if given[name] is not None and not isinstance(given[name], int | float | str):
            raise ModelFileError(f"$.settings.{name} is no span of time")
    return ModelSettings(**given)
