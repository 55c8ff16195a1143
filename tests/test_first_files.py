"""`thermocorr analyze FILE` on a first file: right at once, or asked back with an option that works."""

import argparse
import warnings

import numpy as np
import pytest
from corpus.first_files import ASKED, FIRST
from corpus.foreign_logs import N, T, U

from thermocorr import RecordError
from thermocorr.command import analyze
from thermocorr.command.loading import load_log
from thermocorr.records.errors import as_command
from thermocorr.records.read import Layout, read_record


def loaded(*words):
    """Temperature, reading and seconds since the first row, as the command takes them; and the log."""
    parser = argparse.ArgumentParser()
    analyze.add_arguments(parser)
    with warnings.catch_warnings(), as_command():
        warnings.simplefilter("ignore")
        log = load_log(parser.parse_args([str(word) for word in words]))
        X, y = log.columns()
        T_, U_ = X[log.model.temperature].to_numpy(float), y.to_numpy(float)
        known = np.isfinite(T_) & np.isfinite(U_)
        record = read_record(X[known], Layout(log.model.temperature, log.model.time), quiet=True)
    seconds = np.concatenate([block.seconds for block in record.blocks()])
    return T_[known], U_[known], seconds, log


@pytest.mark.parametrize("name", FIRST)
def test_the_first_file_is_right_at_once(name, written):
    content, options = FIRST[name] if isinstance(FIRST[name], tuple) else (FIRST[name], [])
    path = written(content)
    if options and name != "a number for no value":  # the model finds such ones by itself
        with pytest.raises(RecordError, match=options[0].split("=")[0]):
            loaded(path)
    T_, U_, seconds, _ = loaded(path, *options)
    step = 10.0 if name in ("no header, blanks", "temperature and resistance by letters", "LabVIEW") else 60.0
    np.testing.assert_array_equal(T_, T)
    np.testing.assert_array_equal(U_, U)
    late = np.arange(N) / 100.0 if "fractions" in name else 0.0
    np.testing.assert_allclose(seconds, step * np.arange(N) + late, atol=2e-3)


@pytest.mark.parametrize("name", ASKED)
def test_what_a_first_file_does_not_tell_is_asked(name, written):
    content, words = ASKED[name]
    with pytest.raises(RecordError, match=words):
        loaded(written(content))
