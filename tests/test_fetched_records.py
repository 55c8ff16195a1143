"""Measured records that are fetched: checked, kept, and refused in one sentence where something is wrong."""

import hashlib
import threading
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from thermocorr import RecordError, RecordWarning
from thermocorr.datasets import _real, fetch_real_record, load_real_record

pytest.importorskip("pooch", reason="records are fetched by pooch: pip install '.[records]'")
ROWS = "time,recharge_mm,head_m,river,swedish_temp\n2000-01-27,-0.2,8.57,-0.138,1\n2000-01-28,-0.1,,-0.167,-4\n"


class Quiet(SimpleHTTPRequestHandler):
    """Says nothing on standard error."""

    def log_message(self, *_):
        pass


@pytest.fixture
def served(tmp_path, monkeypatch):
    """Address of a folder with one record; its checksum is known."""
    (tmp_path / "served" / "groundwater_heads").mkdir(parents=True)
    (tmp_path / "served" / "groundwater_heads" / "river.csv").write_text(ROWS)
    about = _real._RECORDS["groundwater_river"]
    known = replace(about, sha256=hashlib.sha256(ROWS.encode()).hexdigest())
    monkeypatch.setitem(_real._RECORDS, "groundwater_river", known)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path / "served")))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_record_is_fetched_once_and_kept(served, tmp_path, monkeypatch):
    record = fetch_real_record("groundwater_river", served, tmp_path / "kept")
    assert record["head_m"].iloc[0] == 8.57 and record.attrs["license"].startswith("MIT")
    again = fetch_real_record("groundwater_river", "http://127.0.0.1:9", tmp_path / "kept")  # nobody is there
    assert again.equals(record)
    monkeypatch.setenv("THERMOCORR_RECORDS", str(tmp_path / "kept"))
    assert load_real_record("groundwater_river").equals(record)


def test_another_file_is_refused_and_one_in_a_folder_is_warned_of(served, tmp_path):
    path = tmp_path / "served" / "groundwater_heads" / "river.csv"
    path.write_text(ROWS.replace("8.57", "8.58"))
    with pytest.raises(RecordError, match="SHA-256 is another one"):
        fetch_real_record("groundwater_river", served, tmp_path / "kept")
    assert not (tmp_path / "kept" / "groundwater_heads" / "river.csv").exists()
    with pytest.warns(RecordWarning, match="is not the file that the figures of the guide come from"):
        load_real_record("groundwater_river", tmp_path / "served")


def test_no_network_no_file_and_no_record_are_said(served, tmp_path):
    with pytest.raises(RecordError, match=r"cannot be fetched: .* Is there a network"):
        fetch_real_record("groundwater_river", "http://127.0.0.1:9", tmp_path / "kept")
    with pytest.raises(RecordError, match=r"cannot be fetched: 404"):
        fetch_real_record("groundwater_well", served, tmp_path / "kept")
    with pytest.raises(ValueError, match="The records are: vhd200_resistor"):
        fetch_real_record("newtown", served)
