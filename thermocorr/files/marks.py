"""How a file shows that thermocorr wrote it: only such files are overwritten without being told to."""

from __future__ import annotations

import re
from pathlib import Path

HEAD = 1 << 16
"""Bytes of a file that are looked at; the header line of a wide log is long."""
TEXT_MARK = "# Written by thermocorr"
"""First line of a text file."""
_MARKS = (
    re.compile(rb'\{\s*"format": "thermocorr '),  # model file
    re.compile(rb'\{\s*"nbformat": 4,.{0,2000}thermocorr', re.DOTALL),  # notebook of the workbench
    re.compile(rb'\{"stream": \{"format": "thermocorr stream'),  # state of a live correction
    re.compile(rb'<!DOCTYPE html>.{0,4000}<meta name="generator" content="thermocorr">', re.DOTALL),  # report
    re.compile(rb"/\*.{0,2000}Made by thermocorr", re.DOTALL),  # C source
    re.compile(re.escape(TEXT_MARK.encode())),
    re.compile(  # corrected log: its last columns
        rb"[^\n]*\bcorrected(_thermocorr)?,(model(_thermocorr)?,residual(_thermocorr)?|bias(_thermocorr)?),"
        rb"flag(_thermocorr)?(,smoothed(_thermocorr)?)?(,reference(_thermocorr)?)?(,u(_thermocorr)?)?"
        rb"(,u_smoothed(_thermocorr)?)?\r?\n"
    ),
)


def bears_mark(path: Path) -> bool:
    """Whether thermocorr wrote this file, or nothing is in it."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    return not head or any(mark.match(head) for mark in _MARKS)
