"""What seldom happens at the doors: systems that refuse, logs that cannot be read."""

import errno
import os
import sys

import pandas as pd
import pytest

from thermocorr import RecordError
from thermocorr.records import files
from thermocorr.records.files import read_table


@pytest.fixture
def log(tmp_path):
    pd.DataFrame({"temperature": range(100), "reading": range(100)}).to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def refuse(*_, **__):
    raise OSError(errno.EACCES, os.strerror(errno.EACCES))


def test_a_table_that_cannot_be_read_is_said(log, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(type(log), "read_bytes", refuse)
        with pytest.raises(RecordError, match=r"log\.csv cannot be read: Permission denied"):
            read_table(log)
    monkeypatch.setattr(files, "check_lines", lambda *given: (99, len(given[0])))
    with pytest.raises(RecordError, match="99 lines gave 100 rows"):
        read_table(log)


def test_parquet_without_its_reader_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordError, match=r"log\.parquet is Parquet.*pip install pyarrow"):
        read_table(tmp_path / "log.parquet")
