"""Workbenches without a screen, for tests: what brings them to rest, and what they show."""

import json

import pandas as pd

from thermocorr.workbench import Story
from thermocorr.workbench.state import state_of


def story_of_log(log, **given):
    """A story of a log, everything found out."""
    made = Story.open([log], **given)
    made.start()
    return settled(made)


def settled(story):
    while chore := story.next_chore():
        chore[1]()
    return story


def shown(story):
    return json.dumps(state_of(story), allow_nan=False)


def stretch(story, low, high):
    span = story.now.curves.timeline.span
    return low * span, high * span


def in_python(log):
    frame = pd.read_csv(log, index_col=0, parse_dates=[0])
    return frame.drop(columns="reading"), frame["reading"]
