"""A log behind the rows of a fitted model, line by line, and what a file of results holds of it."""

from thermocorr import DynamicBiasRegressor, save_model
from thermocorr.datasets import make_record


def model_and_lines(folder):
    """The model's file, and lines of a log behind the fitted rows, the header first."""
    log = make_record(300, seed=5).reset_index()
    log["time"] = log["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    model = DynamicBiasRegressor(time="time", time_constants=[600.0]).fit(log[:200], log["reading"][:200])
    return save_model(model, folder / "model.json"), log[200:].to_csv(index=False).splitlines(keepends=True)


def rows_of(path):
    """Fields of the log in a file of results: those before the results."""
    return [line.rsplit(",", 3)[0] for line in path.read_text().splitlines()[1:]]


def plain(lines):
    return [line.rstrip("\n") for line in lines]
