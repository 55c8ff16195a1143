"""The clean log that the cases of the corpus spoil, its model, and what `thermocorr correct` makes of a log."""

import csv
import io
import warnings

import numpy as np
import pandas as pd
import pytest

from thermocorr import DynamicBiasRegressor, RecordWarning, load_model, save_model
from thermocorr.command.cli import main
from thermocorr.datasets import make_record
from thermocorr.effects import Covariate

HEADER = ["time", "temperature", "humidity", "reading"]
FITTED, ROWS = 40, 60


def rows_of_text():
    """A clean log as cells of text."""
    record = make_record(ROWS, seed=4)
    stamps = record.index.strftime("%Y-%m-%dT%H:%M:%S")
    numbers = [[repr(float(value)) for value in record[name]] for name in HEADER[1:]]
    return [list(row) for row in zip(stamps, *numbers, strict=True)]


CLEAN = rows_of_text()


def text_of(rows, header=HEADER):
    file = io.StringIO()
    csv.writer(file, lineterminator="\n").writerows([header, *rows])
    return file.getvalue().encode()


def frame_of(rows):
    frame = pd.DataFrame(rows, columns=HEADER)
    frame["time"] = pd.to_datetime(frame["time"])
    return frame.astype(dict.fromkeys(HEADER[1:], float))


def save_fitted(path):
    """A model of the first rows, with a recorded column."""
    frame = frame_of(CLEAN[:FITTED])
    model = DynamicBiasRegressor("temperature", [600.0, 7200.0], time="time", effects=[Covariate("humidity")])
    return save_model(model.fit(frame[HEADER[:3]], frame["reading"]), path)


class Shown:
    """What `thermocorr correct -` did with the lines of a log."""

    def __init__(self, folder, content, options, model, capsys):
        (folder / "log.csv").write_bytes(content)
        with warnings.catch_warnings(), (folder / "log.csv").open() as file, pytest.MonkeyPatch.context() as patch:
            warnings.simplefilter("error", RecordWarning)  # it would be a stray line on standard error
            patch.setattr("sys.stdin", file)
            self.status = main(["correct", "--model", str(model), "-", *map(str, options)])
        printed = capsys.readouterr()
        self.err = printed.err
        self.header, *self.rows = list(csv.reader(io.StringIO(printed.out, newline=""))) or [[]]
        self.named = [int(line.split()[2]) for line in self.err.splitlines() if line.startswith("thermocorr: line ")]
        assert all(line.startswith("thermocorr: ") for line in self.err.splitlines())


def check(shown, rows, model_path):
    """Rows that were shown are these, with the numbers that the model gives for them."""
    assert [row[: len(HEADER)] for row in shown.rows] == rows
    frame = frame_of([[float("nan") if cell.strip() in ("", "NA") else cell.strip() for cell in row] for row in rows])
    expected = load_model(model_path).correct(frame[HEADER[:3]], frame["reading"])
    got = [float(row[len(HEADER)] or "nan") for row in shown.rows]
    np.testing.assert_allclose(got, expected, rtol=1e-12)
