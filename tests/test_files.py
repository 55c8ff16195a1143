"""The writer: whole files or none, nothing overwritten that was not meant."""

import errno
import os
import stat

import pytest

from thermocorr.output.writer import OutputError, Outputs, write_file


def refusing(number=errno.EACCES):
    """A function of the system that refuses."""

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    return refuse


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_there_whole_with_the_usual_mode_and_what_is_there_stays(tmp_path):
    before = os.umask(0o022)
    try:
        assert write_file(tmp_path / "new" / "f.txt", "one") == tmp_path / "new" / "f.txt"
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new" / "f.txt").stat().st_mode) == 0o644
    with pytest.raises(OutputError, match=r"is there already\. Name another file, or overwrite it with force=True"):
        write_file(tmp_path / "new" / "f.txt", "two")
    assert (tmp_path / "new" / "f.txt").read_text() == "one"
    write_file(tmp_path / "new" / "f.txt", b"two", force=True)
    assert (tmp_path / "new" / "f.txt").read_text() == "two" and names(tmp_path / "new") == ["f.txt"]


def test_nothing_has_changed_where_a_set_fails_before_its_end(tmp_path):
    (tmp_path / "a").write_text("old")
    outputs = Outputs(force=True)
    outputs.write(tmp_path / "a", "new")
    with pytest.raises(ZeroDivisionError), outputs:
        raise ZeroDivisionError
    assert names(tmp_path) == ["a"] and (tmp_path / "a").read_text() == "old"


def test_files_take_their_places_in_the_order_in_which_they_were_written(tmp_path, monkeypatch):
    replaced, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda one, other: (replaced.append(other.name), replace(one, other)))
    with Outputs() as outputs:
        for name in ("corrected.csv", "model.json"):
            outputs.write(tmp_path / name, name)
        assert not replaced
    assert replaced == ["corrected.csv", "model.json"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_system_that_refuses_is_said_and_leaves_no_draft(call, tmp_path, monkeypatch):
    monkeypatch.setattr(os, call, refusing(errno.ENOSPC))
    with pytest.raises(OutputError, match=r"f\.txt cannot be written: No space left on device. What was there"):
        write_file(tmp_path / "f.txt", "x")
    assert names(tmp_path) == []


def test_a_place_without_permission_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match=r"f\.txt cannot be written: no permission"), Outputs() as outputs:
        outputs.claim(tmp_path / "f.txt")


@pytest.mark.parametrize("link", [False, True])
def test_what_is_read_is_never_written_under_whatever_name(link, tmp_path):
    (tmp_path / "log.csv").write_text("1")
    path = tmp_path / "sub" / ".." / "log.csv"
    (tmp_path / "sub").mkdir()
    if link:
        path = tmp_path / "link.csv"
        path.symlink_to(tmp_path / "log.csv")
    with pytest.raises(OutputError, match="is read by this command"):
        write_file(path, "2", inputs=[tmp_path / "log.csv"], force=True)
    assert (tmp_path / "log.csv").read_text() == "1"


def test_one_file_is_not_written_twice_and_a_folder_not_at_all(tmp_path):
    outputs = Outputs()
    outputs.claim(tmp_path / "a")
    with pytest.raises(OutputError, match="would be written twice"):
        outputs.claim(tmp_path / "." / "a")
    with pytest.raises(OutputError, match="is a directory and cannot be written"):
        write_file(tmp_path, "x", force=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_file(tmp_path / "file" / "f", "x")
