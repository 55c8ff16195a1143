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
        assert all(line.startswith("thermocorr: ") for line in self.err.splitlines())


def check(shown, rows, model_path):
    """Rows that got a result are those with a reading, with the numbers that the model gives for them."""
    frame = frame_of(rows)
    known = frame["reading"].notna().to_numpy()
    expected = load_model(model_path).correct(frame[HEADER[:3]], frame["reading"])[known]
    good = [row for row in shown.rows if row[len(HEADER)]]
    assert [pd.Timestamp(row[0]) for row in good] == frame["time"][known].tolist()
    numbers = np.array([row[1 : len(HEADER) + 1] for row in good], float)
    np.testing.assert_allclose(numbers[:, :-1], frame[HEADER[1:]][known], rtol=1e-15)
    np.testing.assert_allclose(numbers[:, -1], expected, rtol=1e-12)
