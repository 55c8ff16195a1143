"""The one writer: inputs and other people's files stay, outputs appear whole, a set of them together."""

import contextlib
import os
import stat
import threading
import time

import pytest

from thermocorr import RecordError
from thermocorr.files import AppendedFile, OutputError, Outputs, write_file
from thermocorr.files import writer as drafts
from thermocorr.files.writer import TEXT_MARK, Draft, Position, bears_mark, draft_name

named_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
OURS = f"{TEXT_MARK}\nold\n"


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def old(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(OURS)
    return path


def test_a_file_appears_at_the_end_and_not_before(old, tmp_path):
    with Outputs() as outputs:
        outputs.write(old, "new")
        outputs.write(tmp_path / "sub" / "b.txt", b"more")
        assert old.read_text() == OURS and not (tmp_path / "sub" / "b.txt").exists()
    assert old.read_text() == "new" and (tmp_path / "sub" / "b.txt").read_bytes() == b"more"
    assert names(tmp_path) == ["a.txt", "sub"] and names(tmp_path / "sub") == ["b.txt"]


def test_a_foreign_file_is_overwritten_where_that_is_asked_for_and_nowhere_else(tmp_path):
    path = tmp_path / "notes.txt"
    for write in (
        lambda: Outputs().write(path, "new"),
        lambda: write_file(path, "new"),
        lambda: AppendedFile.new(path),
    ):
        path.write_text("mine")
        with pytest.raises(OutputError, match="was not written by thermocorr"):
            write()
        assert path.read_text() == "mine"
    with Outputs(force=True) as outputs:
        outputs.write(path, "new")
    assert path.read_text() == "new"


def test_whatever_goes_wrong_leaves_no_trace(old, tmp_path):
    def interrupted():
        with Outputs() as outputs:
            outputs.write(old, "new")
            outputs.open(tmp_path / "b.txt").write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert old.read_text() == OURS and names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_a_set_takes_its_places_together_or_not_at_all(tmp_path, monkeypatch, failing):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path in paths[:2]:
        path.write_text(f"{OURS}{path.name}")
    replace, calls = os.replace, []

    def fail_once(source, target):
        calls.append(target)
        if len(calls) == failing + 1:
            raise OSError(5, "Input/output error")
        replace(source, target)

    monkeypatch.setattr(os, "replace", fail_once)
    outputs = Outputs()
    for path in paths:
        outputs.write(path, "new")
    with pytest.raises(OutputError, match="cannot be written: Input/output error"):
        outputs.commit()
    assert [path.read_text() for path in paths[:2]] == [f"{OURS}a", f"{OURS}b"]
    assert names(tmp_path) == ["a", "b"]


def test_inputs_are_refused_under_every_name(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("a\n1\n")
    (tmp_path / "link.csv").symlink_to(log)
    os.link(log, tmp_path / "hard.csv")
    for name in ("log.csv", "link.csv", "hard.csv", "./log.csv", "sub/../log.csv"):
        with pytest.raises(OutputError, match=r"is read by this command.*would destroy it"):
            Outputs([log], force=True).claim(tmp_path / name)
    assert log.read_text() == "a\n1\n"
    missing = tmp_path / "not yet"
    with pytest.raises(OutputError, match="is read by this command"):
        Outputs([missing]).claim(missing)


def test_no_file_is_written_twice_by_one_command(tmp_path):
    outputs = Outputs()
    outputs.claim(tmp_path / "x")
    for again in (tmp_path / "x", tmp_path / "sub" / ".." / "x"):
        with pytest.raises(OutputError, match="would be written twice"):
            outputs.claim(again)
    outputs.write(tmp_path / "x", "claimed early, written later")
    with pytest.raises(OutputError, match="would be written twice"):
        outputs.write(tmp_path / "x", "again")
    outputs.discard()


def test_foreign_files_are_overwritten_by_force_only(tmp_path):
    mine = tmp_path / "mine.c"
    mine.write_text("int main(void) { return 0; }\n")
    with pytest.raises(OutputError, match=r"was not written by thermocorr.*force=True"):
        write_file(mine, "new")
    assert mine.read_text().startswith("int main")
    write_file(mine, "new", force=True)
    assert mine.read_text() == "new"
    (tmp_path / "empty").write_text("")
    write_file(tmp_path / "empty", "new")  # nothing is lost


@pytest.mark.parametrize(
    ("content", "ours"),
    [
        (b'{"format": "thermocorr model", "version": 2', True),
        (b'{\n "format": "thermocorr model",\n "version": 1', True),
        (b'{"stream": {"format": "thermocorr stream 2"', True),
        (b'<!DOCTYPE html>\n<html lang="en"><head><meta name="generator" content="thermocorr">', True),
        (b"/* Made by thermocorr; see bridge.h. */\n", True),
        (b"time,temperature,reading,corrected,model,residual,flag\n1,2,3", True),
        (b"time,temperature,reading,corrected,model,residual,flag,u\n1,2,3", True),
        (b"time,T,corrected,bias,flag,smoothed,u,u_smoothed\n", True),
        (b"time,T,flag,corrected,bias,flag_thermocorr,smoothed,reference\r\n", True),
        (b"import thermocorr\n", False),
        (b"time,temperature,corrected,reading\n", False),
        (b"time,temperature,reading\ncorrected,bias,flag\n", False),
        (b'{"note": "made with thermocorr model"}', False),
        (b"<!DOCTYPE html><p>thermocorr</p>", False),
        (b"\x00\xff", False),
    ],
)
def test_marks(tmp_path, content, ours):
    (tmp_path / "f").write_bytes(content)
    assert bears_mark(tmp_path / "f") is ours


def test_links_stay_links_and_modes_stay(tmp_path):
    (tmp_path / "deep").mkdir()
    target, link = tmp_path / "deep" / "t.txt", tmp_path / "l.txt"
    target.write_text(OURS)
    target.chmod(0o600)
    link.symlink_to(target)
    write_file(link, "new")
    assert link.is_symlink() and target.read_text() == "new" and stat.S_IMODE(target.stat().st_mode) == 0o600
    assert names(tmp_path) == ["deep", "l.txt"] and names(tmp_path / "deep") == ["t.txt"]
    dangling = tmp_path / "dangling"
    dangling.symlink_to(tmp_path / "deep" / "made")
    write_file(dangling, "new")
    assert dangling.is_symlink() and (tmp_path / "deep" / "made").read_text() == "new"


@pytest.mark.parametrize(("umask", "mode"), [(0o027, 0o640), (0, 0o666)])
def test_a_new_file_has_the_mode_that_the_process_gives(umask, mode, tmp_path):
    before = os.umask(umask)
    try:
        write_file(tmp_path / "f", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "f").stat().st_mode) == mode


def test_everything_is_brought_to_the_disk_before_it_takes_its_place(old, monkeypatch):
    done = []
    sync, replace = os.fsync, os.replace
    monkeypatch.setattr(
        os, "fsync", lambda fd: (done.append("folder" if stat.S_ISDIR(os.fstat(fd).st_mode) else "file"), sync(fd))
    )
    monkeypatch.setattr(os, "replace", lambda a, b: (done.append("rename"), replace(a, b)))
    write_file(old, "new")
    assert done == ["file", "rename", "folder"]


@pytest.mark.skipif(not os.path.isdir("/dev/fd"), reason="no names for descriptors here")
def test_nothing_stays_open(old):
    before = len(os.listdir("/dev/fd"))
    write_file(old, "new")
    assert len(os.listdir("/dev/fd")) == before


@pytest.mark.skipif(not os.path.isdir("/dev/fd"), reason="no names for descriptors here")
def test_a_draft_that_another_process_swept_away_is_made_again(old, monkeypatch):
    answers = iter([False, True])
    monkeypatch.setattr(drafts, "lock", lambda descriptor: next(answers))
    before = len(os.listdir("/dev/fd"))
    write_file(old, "new")
    assert old.read_text() == "new" and len(os.listdir("/dev/fd")) == before and next(answers, None) is None


def test_drafts_of_killed_processes_are_removed_and_living_ones_stay(tmp_path):
    target = tmp_path / "f.txt"
    dead = draft_name(target)
    dead.write_text("half")
    other = tmp_path / ".f.txt.backup.draft"  # not named as drafts are
    other.write_text("mine")
    living = Draft(target)
    assert not dead.exists() and living.path.exists()
    write_file(target, "new")
    assert living.path.exists()
    living.close()
    assert names(tmp_path) == [".f.txt.backup.draft", "f.txt"]


def test_many_threads_may_save_one_path(tmp_path):
    path, wrong = tmp_path / "f.txt", []

    def save(k):
        for _ in range(40):
            write_file(path, f"{TEXT_MARK}\n" + str(k) * 10_000)
            text = path.read_text().split("\n")[1]
            if len(text) != 10_000 or len(set(text)) != 1:
                wrong.append(text[:9])

    threads = [threading.Thread(target=save, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == [] and names(tmp_path) == ["f.txt"]


@pytest.mark.parametrize("name", ["", "folder", "f.txt/x", "a\0b", "x" * 300])
def test_places_where_nothing_can_be_written(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "f.txt").write_text(OURS)
    with pytest.raises(OutputError, match="cannot be written"):
        write_file(f"{tmp_path}/{name}", "x")
    assert names(tmp_path) == ["f.txt", "folder"]


def test_errors_are_both_kinds(tmp_path):
    with pytest.raises(OSError):
        write_file(tmp_path, "x")
    with pytest.raises(RecordError):
        write_file(tmp_path, "x")


def test_devices_are_written_to_at_once(tmp_path):
    write_file("/dev/null", "x")
    if os.path.exists("/dev/full"):
        with pytest.raises(OutputError, match="No space left"):
            write_file("/dev/full", "x")


def test_rows_are_appended_and_taken_up_again(tmp_path):
    path = tmp_path / "rows.csv"
    file = AppendedFile.new(path)
    file.write(b"head\n1\n")
    at = file.commit()
    assert at.length == 7
    file.write(b"2\n3\n")
    file.close()
    with path.open("ab") as torn:
        torn.write(b"4,hal")
    again = AppendedFile.resumed(path, at)
    assert again.rows_behind(at.length) == [b"2\n", b"3\n"] and path.read_bytes() == b"head\n1\n2\n3\n"
    again.write(b"4\n")
    again.cut(at.length)
    again.write(b"5\n")
    again.close()
    assert path.read_bytes() == b"head\n1\n5\n"


def test_a_file_that_was_changed_since_is_refused(tmp_path):
    path = tmp_path / "rows.csv"
    file = AppendedFile.new(path)
    file.write(b"head\n1\n")
    at = file.commit()
    file.close()
    for content in (b"head\n", b"head\n2\n", b""):
        path.write_bytes(content)
        with pytest.raises(OutputError, match="not the file that the saved state goes with"):
            AppendedFile.resumed(path, at)
        assert path.read_bytes() == content
    assert not Position(3, "x").fits(tmp_path / "none")


def test_what_a_full_disk_cuts_short_is_taken_away(tmp_path, monkeypatch):
    file = AppendedFile.new(tmp_path / "rows.csv")
    file.write(b"head\n")
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: write(fd, data[:3]) if len(data) > 3 else _full())
    with pytest.raises(OutputError, match=r"No space left.*rows so far stand in it"):
        file.write(b"123\n456\n"[:6])
    monkeypatch.undo()
    assert (tmp_path / "rows.csv").read_bytes() == b"head\n"
    file.write(b"1\n")
    file.close()
    assert (tmp_path / "rows.csv").read_bytes() == b"head\n1\n"


def _full():
    raise OSError(28, "No space left on device")


def test_two_processes_do_not_write_one_file(tmp_path):
    pytest.importorskip("fcntl", reason="locks are those of Unix")
    file = AppendedFile.new(tmp_path / "rows.csv")
    file.write(b"head\n")
    with pytest.raises(OutputError, match="is being written by another process"):
        AppendedFile.resumed(tmp_path / "rows.csv", file.commit())
    file.close()


@pytest.fixture
def pipe(tmp_path):
    """A named pipe, and what its readers got: each reads to the end, then the next one comes."""
    path, got = tmp_path / "pipe", []
    os.mkfifo(path)

    def read():
        while path.exists():
            got.append(path.read_bytes())

    threading.Thread(target=read, daemon=True).start()
    yield path, got
    os.rename(path, tmp_path / "over")
    os.close(os.open(tmp_path / "over", os.O_RDWR))  # the last reader finds the end


@named_pipes
def test_a_named_pipe_is_opened_once(pipe, monkeypatch):
    """Who reads it takes the first closing for the end, and may be gone before it is opened again."""
    path, got = pipe
    opened = os.open

    def slowly(*given, **more):
        time.sleep(0.1)
        return opened(*given, **more)

    monkeypatch.setattr(os, "open", slowly)
    file = AppendedFile.new(path, first=b"head\n")
    file.write(b"1\n")
    assert file.commit() is None
    file.close()
    end = time.monotonic() + 10.0
    while not got and time.monotonic() < end:
        time.sleep(0.001)
    assert got[:1] == [b"head\n1\n"]


@pytest.mark.skipif(not os.path.isdir("/dev/fd"), reason="no names for descriptors here")
def test_a_pipe_without_a_name_in_a_folder_is_written_to():
    """As /dev/stdout, and as what a shell's >(...) stands for: the links there lead to no path."""
    reading, writing = os.pipe()
    write_file(f"/dev/fd/{writing}", "one\n")
    file = AppendedFile.new(f"/dev/fd/{writing}", first=b"head\n")
    file.close()
    assert os.read(reading, 100) == b"one\nhead\n"
    os.close(reading)
    os.close(writing)


def test_several_processes_may_write_to_one_device():
    with contextlib.closing(AppendedFile.new(os.devnull)), contextlib.closing(AppendedFile.new(os.devnull)) as second:
        second.write(b"1\n")
