"""A second language of the export is one file: Python, which stands beside the tests and is run here."""

import ast
from functools import cache
from pathlib import Path

import export_python
import numpy as np
import pytest
from export_python import Python
from firmware_runs import ALL_AT_ONCE, KINDS, PERIOD, fitted, later, start_of
from test_firmware import Twisted

from thermocorr import firmware
from thermocorr.effects import Covariate, Drift, Rate
from thermocorr.firmware.export import export_to

pytestmark = pytest.mark.newest

ROWS = 1500
TOLERANCE = 1e-12
"""Promised share of the range of the bias; what is added in another order than in Python moves it by some 1e-15."""
MODELS = KINDS | {
    "own formula": {"effects": [Twisted()]},
    "own formula, delayed": {"effects": [Twisted(100.0)]},
    "recorded columns": {"effects": [Covariate("humidity"), Rate(), Drift(True)]},
    "all at once": {"effects": [*ALL_AT_ONCE, *(KINDS[kind]["effects"][0] for kind in ("periodic", "step"))]},
}


@cache
def model_of(kind):
    """A fitted model and its record."""
    return fitted(**MODELS[kind])


def exported(model, folder, variable=False):
    """The export, and what its module defines."""
    period = "variable" if variable else PERIOD
    export = export_to(Python(), model, folder / "bias.py", "double", sampling_period=period)
    (path,) = export.paths
    defined = {}
    exec(compile(path.read_text(), path, "exec"), defined)
    return export, defined


@pytest.mark.long
@pytest.mark.newest
@pytest.mark.parametrize("variable", [False, True])
@pytest.mark.parametrize("kind", MODELS)
def test_python_gives_the_bias_of_the_model(kind, variable, tmp_path):
    if variable and "delay" in kind:
        pytest.skip("refused: a delay needs a fixed step")
    model, X = model_of(kind)
    export, defined = exported(model, tmp_path, variable)
    largest, wrong = defined["self_test"]()
    assert wrong == 0, largest

    kelvin = MODELS[kind].get("kelvin", False)
    new = later(model, X, ROWS, irregular=variable, kelvin=kelvin, single=False)
    takes_start = defined["Device"].__init__.__code__.co_argcount > 1
    device = defined["Device"](*([start_of(export, X, new)] if takes_start else []))
    ticks = new.index.astype("datetime64[ns]").asi8 // 1000
    steps = np.diff(ticks, prepend=ticks[0]).tolist()
    found = []
    for step, (_, row) in zip(steps, new.iterrows(), strict=True):
        columns = [[row[name] for name in export.columns]] if export.columns else []
        found.append(device.update(*([step] if variable else []), float(row["temperature"]), 1.0, *columns))
    bias, corrected, flags = map(np.array, zip(*found, strict=True))
    expected = model.bias(new).to_numpy()
    np.testing.assert_allclose(bias, expected, rtol=0, atol=TOLERANCE * np.ptp(expected))
    np.testing.assert_array_equal(corrected, 1.0 - bias)
    low, high = model.reading_.temperature_range
    outside = (new["temperature"] < low) | (new["temperature"] > high)
    np.testing.assert_array_equal((flags & 16) > 0, outside)
    washout = model.flags(new).to_numpy() == "washout"
    np.testing.assert_array_equal(flags & ~(16 | 128 | 256), np.where(washout, 8, 0))


def test_python_has_no_single_precision(tmp_path):
    with pytest.raises(ValueError, match="no single precision"):
        export_to(Python(), model_of("thermal_lag")[0], tmp_path, "float")
    assert not list(tmp_path.iterdir())


def test_the_self_test_can_fail(tmp_path):
    _, defined = exported(model_of("recorded columns")[0], tmp_path)
    assert defined["self_test"]()[1] == 0
    defined["SAMPLES"][7] = (defined["SAMPLES"][7][0], 0.0, 0)
    assert defined["self_test"]()[1] == 1


FILES = sorted(
    path
    for path in Path(firmware.__file__).parent.glob("*.py")
    if path.stem != "esphome" and "suffixes: tuple[str, ...] = (" not in path.read_text()  # the languages
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_no_other_file_writes_c(path):
    """Only `export_c` knows the file of C; no text but a docstring has a mark that stands in C alone."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    imported = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    assert ("c99" in imported) == (path.stem == "export")
    documented = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    texts = [node for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    said = [node.value for node in texts if id(node) not in documented]
    for mark in ("{", "}", "->", "++", "+=", "||", "&&", "/*", "#", "int32_t", "uint", "static ", "const ", "FLT_"):
        assert not [text for text in said if mark in text and not text.isidentifier()], mark


def test_the_second_language_needs_nothing_of_c():
    assert "c99" not in Path(export_python.__file__).read_text()
