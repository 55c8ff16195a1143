"""Workbenches without a screen, for tests: what brings them to rest, and what they show."""

import json

import pandas as pd

from thermocorr.interactive.acts import guessed
from thermocorr.interactive.bench import Bench
from thermocorr.interactive.snapshots import snapshot
from thermocorr.interactive.source import opened
from thermocorr.interactive.tiles import Store


def bench_of_log(log, folder):
    """A bench with a log on it, everything found out."""
    made = Bench(source := opened([log]), Store(folder), roles=guessed(source.frame))
    made.start()
    return settled(made)


def settled(bench):
    while chore := bench.next_chore():
        chore[1]()
    return bench


def shown(bench):
    return json.dumps(snapshot(bench), allow_nan=False)


def stretch(bench, low, high):
    axis = snapshot(bench)["fitted"]["axis"]
    span = axis["high"] - axis["low"]
    return {"low": axis["low"] + low * span, "high": axis["low"] + high * span}


def in_python(log):
    frame = pd.read_csv(log, index_col=0, parse_dates=[0])
    return frame.drop(columns="reading"), frame["reading"]
