"""Damaged and forged model files and saved states."""

import copy
import json
import math
import random
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from thermocorr import DynamicBiasRegressor, RecordError, load_model
from thermocorr.effects import Covariate, Delay, Hinge, Hysteresis, Interaction, LaggedCovariate, Periodic, Rate, Step
from thermocorr.files.model_file import content_of, signed

from .logs import shown_by
from .mutations import of_bytes
from .outcomes import OTHER, REFUSED, RIGHT, WRONG, Done, Found, Room, refused, run
from .subjects import FITTED, HEADER, Subject, frame_of, text_of

HOSTILE: list[Any] = [
    None, True, False, -1, 0, 1, 2, 10**12, 2**53 + 1, 2**62, 2**63 - 1, -(2**63) + 1, 0.0, -0.0, -1.5, 1.0, 1e39, 1e41,
    1e119, 1e121, 1e300, 1.7e308, -1e308, 1e-320, 5e-324, "", "x", "auto", "nan", "0", "1e9999", "\x00\x1b[2J\u202e",
    "9" * 9999, "\ud800", "2024-03-04", [], [1], [[]], [[[[]]]], [0.0] * 3, [0.0] * 5000, [None] * 50, {}, {"": 0},
    {"$float": "nan"}, {"$float": "inf"}, {"$float": "x"}, {"$float": 1}, {"$tuple": [1]}, {"$tuple": []},
    {"$array": []}, {"$array": [1.0, {"$float": "inf"}]}, {"$array": [1.0], "shape": [10**9, 10**9]},
    {"$array": [], "shape": [0, 2**39]}, {"$array": [], "shape": [0]}, {"$array": [1.0], "shape": []},
    {"$array": [1], "dtype": "int32"}, {"$array": [2**40], "dtype": "int32"}, {"$array": ["a"], "dtype": "object"},
    {"$array": [True], "dtype": "bool"}, {"$state": "LagState", "values": [{"$array": [0.0]}, 1.0]},
    {"$state": "DelayState", "values": []}, {"$date": "soon"}, {"$date": "9999-01-01"}, {"$date": "2024"},
    {"$date": "now"}, {"$date": "NaT"}, {"$day": "2024-03-04"}, {"$day": "x"}, {"$day": "NaT"}, {"$span": 10**18},
    {"$span": -1}, {"$span": 2**63 - 1}, {"$span": True},
    {"$effect": {"kind": "drift", "parameters": {"removed_by_correct": True}}}, {"$effect": {}}, {"$effect": []},
    {"$effect": {"kind": "x", "import": "os.system", "parameters": {}}}, {"$dict": [[1, 2], [1, 3]]},
    {"$dict": [[1, 2]]}, {"$dict": [[[], 1]]}, {"$": 1}, {"$x": 1}, {"import": "os"},
    {"$effect": {"kind": "periodic", "parameters": {"period": 1.0, "harmonics": 10**9, "removed_by_correct": True}}},
]  # fmt: skip
TEXTS = [
    b"NaN", b"Infinity", b"1e999", b"-1e999", b"9" * 5000, b"[" * 3000, b'"\\ud800"', b"{}", b"tru", b"1.", b"01",
    b"0x1", b"1e5", b"//", b"'a'", b"\xff", b"\xef\xbb\xbf", b"\x00", b" ", b",", b'"', b"1_0",
]  # fmt: skip


NUMBER, KEY = rb"-?[0-9][0-9.e+-]*", rb'": ?'
LARGE: dict[str, Callable[[], bytes]] = {
    "lists": lambda: b"[" + b"[]," * 10_000_000 + b"[]]",
    "numbers": lambda: b"[" + b"1," * 15_000_000 + b"1]",
    "brackets": lambda: b"[" * 100_000 + b"]" * 100_000,
    "the same key": lambda: b"{" + b",".join(b'"a": 1' for _ in range(2_000_000)) + b"}",
    "keys, one of them twice": lambda: b"{" + b",".join(b'"k%d": 1' % (k or 1) for k in range(600_000)) + b"}",
    "escapes": lambda: b'{"format": "' + b"\\u0000" * 5_000_000 + b'"}',
    "blanks": lambda: b" " * 34_000_000,
    "a whole number": lambda: b'{"version": ' + b"1" * 30_000_000 + b"}",
}
"""Contents of tens of megabytes."""


def victims(made: dict[str, Subject], folder: Any) -> dict[str, tuple[Subject, dict[str, Any]]]:
    """A model file for each subject, with few kept rows, and one that has many effects."""
    rich = copy.copy(made["dates"])
    frame = frame_of(rich.cells, rich.roles)[:FITTED]
    effects = [
        Covariate("humidity", 2), Delay("5 min"), Hinge(21.7, "below", ["10 min"]), Hysteresis(0.5), Rate("3 min"),
        LaggedCovariate("humidity", ["20 min"]), Periodic("30 min", 2), Interaction("humidity"),
        Step("2024-03-04T00:30:00"),
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = DynamicBiasRegressor("temperature", [600.0], time="time", products=True, effects=effects, max_gap="1 h")
        rich.model = model.fit(frame.drop(columns="reading"), frame["reading"])
    rich.name, rich.path = "rich", folder / "rich.json"
    found = {}
    for subject in (*made.values(), rich):
        content = content_of(subject.model, history_rows=12)
        path = folder / f"small-{subject.name}.json"
        path.write_bytes(content)
        small = copy.copy(subject)
        small.path, small.model = path, load_model(path)
        found[subject.name] = (small, json.loads(content))
    return found


# ---- mutations -------------------------------------------------------------------------------------------------------
def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a JSON value."""
    yield path
    if isinstance(node, dict | list):
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            yield from places(node[key], (*path, key))


def mutated(node: Any, rng: random.Random, under: str) -> tuple[Any, str]:
    """The value with something else at one place or two below the key `under`, and what was done."""
    node, said = copy.deepcopy(node), []
    for _ in range(rng.choice([1, 1, 1, 2])):
        everywhere = [place for place in places(node) if len(place) > 1 and place[0] == under]
        plain = [place for place in everywhere if not {"ticks", "values", "$array"} & set(place)] or everywhere
        if everywhere:
            said.append(_mutate(node, rng.choice(everywhere if rng.random() < 0.25 else plain), rng))
    return node, "; ".join(said)


def _mutate(node: Any, path: tuple[Any, ...], rng: random.Random) -> str:
    *above, last = path
    parent = node
    for key in above:
        parent = parent[key]
    value, kind = parent[last], rng.randrange(8)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind == 0 and isinstance(parent, dict):
        del parent[last]
        return f"no {path}"
    if kind == 1 and isinstance(parent, list):
        parent.insert(last, copy.deepcopy(value))
    elif kind in (2, 3) and number:
        parent[last] = rng.choice([-value, 0 * value, value * 1.5, value * 10**15, value + 1, float(value), int(value)])
    elif kind == 4 and isinstance(value, list):
        rng.shuffle(value)
    elif kind == 5 and isinstance(parent, list):
        del parent[last]
        return f"no {path}"
    elif kind == 6 and isinstance(value, dict):
        value[rng.choice(["$a", "x", ""])] = 1
    else:
        parent[last] = copy.deepcopy(rng.choice(HOSTILE))
    shown = parent[last] if isinstance(parent, dict) or last < len(parent) else None
    return f"{path} = {str(shown)[:80]!r}"


def scrambled(content: bytes, rng: random.Random) -> bytes:
    """One way of damaging bytes: anywhere, a number, or the value of a key."""
    if rng.random() < 0.6:
        return of_bytes(content, rng)
    number = rng.random() < 0.5
    begin, end = rng.choice([found.span() for found in re.finditer(NUMBER if number else KEY, content)])
    return content[: begin if number else end] + rng.choice(TEXTS) + (b"" if number else b", ") + content[end:]


def large(rng: random.Random, room: Room) -> str:
    """A large file, refused at once and in little memory: `outcomes.watched` looks at both."""
    subject, _ = room.subjects["victims"]["rich"]
    what, content = rng.choice(list(LARGE.items()))
    room.said.append(what)
    path, log = room.write("large.json", content()), _log(subject, room)
    if rng.random() < 0.5:
        return REFUSED if run("correct", "--model", path, log).status == 2 else RIGHT
    done = run("correct", "--model", subject.path, log, "--state", path)
    return REFUSED if done.status == 2 else RIGHT


# ---- model files -----------------------------------------------------------------------------------------------------
def model_bytes(rng: random.Random, room: Room) -> str:
    """A model file with damaged bytes: refused, or the same numbers."""
    subject, _ = room.subjects["victims"][rng.choice(list(room.subjects["victims"]))]
    content = subject.path.read_bytes()
    damaged = scrambled(content, rng)
    room.said.append(subject.name)
    path = room.write("model.json", damaged)
    done = run("correct", "--model", path, _log(subject, room))
    if done.status == 2:
        return REFUSED
    if done.out != run("correct", "--model", subject.path, room.folder / "log.csv").out:
        raise Found(WRONG, "a damaged model file gives other numbers")
    return RIGHT


def model_forged(rng: random.Random, room: Room) -> str:
    """A model file with other content and a digest that fits: refused, or a model that computes."""
    subject, node = room.subjects["victims"][rng.choice(list(room.subjects["victims"]))]
    forged, said = mutated(node, rng, "model")
    room.said.append(f"{subject.name}: {said}")
    try:
        content = signed({key: value for key, value in forged.items() if key not in ("format", "version", "digest")})
    except ValueError:  # NaN among the values
        return REFUSED
    path, log = room.write("model.json", content), _log(subject, room)
    done = run("correct", "--model", path, log)
    try:
        model = load_model(path)
    except Exception as error:
        if done.status != 2:
            raise Found(WRONG, "correct takes a model that load_model refuses") from None
        return refused(error)
    again = json.loads(content_of(model, history_rows=None))
    if not _same_json(again["model"], forged["model"]):
        raise Found(WRONG, "read as another model")
    if forged["model"] == node["model"]:
        if done.out != run("correct", "--model", subject.path, log).out:
            raise Found(WRONG, "the same model gives other numbers")
        return RIGHT
    _check_numbers(done)
    _check_python(model, subject)
    return OTHER


def _check_python(model: Any, subject: Subject) -> None:
    frame = frame_of(subject.cells, subject.roles)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            model.evaluate(frame.drop(columns="reading"), frame["reading"])
            model.coef_table(), model.equation()
    except RecordError:
        pass  # it needs other columns, say
    except ValueError as error:
        if "feature" not in str(error):  # scikit-learn's words for other columns
            refused(error)


def _same_json(a: Any, b: Any) -> bool:
    """Whether two values are the same, whole floats as integers."""
    if isinstance(a, dict) and isinstance(b, dict):
        tags = {"$date", "$day", "$array"} & set(a)  # several ways to write one thing
        return bool(tags & set(b)) or (a.keys() == b.keys() and all(_same_json(a[key], b[key]) for key in a))
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same_json, a, b))
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    if isinstance(a, float) and isinstance(b, int):
        return a == float(b)
    return bool(a == b)


def _check_numbers(done: Done) -> None:
    """Results are numbers or nothing."""
    if done.status == 2:
        return
    names, *rows = shown_by(done)
    for row in rows:
        for cell in row[len(HEADER) :]:
            if re.fullmatch(r"[-+0-9.einfa]+", cell) and not math.isfinite(float(cell)):
                raise Found(WRONG, f"a result is {cell}: {dict(zip(names, row, strict=True))}")


def _log(subject: Subject, room: Room) -> Any:
    return room.write("log.csv", text_of(HEADER, subject.cells[50:80]))


# ---- states ----------------------------------------------------------------------------------------------------------
def state(rng: random.Random, room: Room) -> str:
    """A saved state with other values, or damaged bytes: refused, or a stream that goes on."""
    subject = room.subjects[rng.choice([name for name in room.subjects if name != "victims"])]
    good = json.dumps(subject.state).encode()
    if rng.random() < 0.3:
        content, said = scrambled(good, rng), "bytes"
    else:
        forged, said = mutated({"$": subject.state}, rng, "$")
        content = json.dumps(forged["$"]).encode()  # 1.5 times what is forged already may be infinite
    room.said.append(f"{subject.name}: {said}")
    log, outs = room.write("log.csv", text_of(HEADER, subject.cells[FITTED - 3 :])), []
    for name, saved in (("state.json", content), ("good.json", good)):
        path = room.write(name, saved)
        done = run("correct", "--model", subject.path, log, "--state", path, "--average", 3, "--track", "2h")
        if done.status == 2:
            if path.read_bytes() != saved:
                raise Found(WRONG, "a state that was refused is overwritten")
            return REFUSED
        outs.append(done)
    _check_numbers(outs[0])
    again = run("correct", "--model", subject.path, log, "--state", room.folder / "state.json")
    if again.status == 2:
        raise Found(WRONG, f"the state that was saved then is refused: {again.said[-1]}")
    return RIGHT if outs[0].out == outs[1].out else OTHER
