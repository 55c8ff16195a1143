"""The workbench's server as a process: who may talk to it, what it refuses, and that it leaves nothing behind."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time

import pytest
from visitors import LONG, Client, News, running, settled, until, visitor

from thermocorr.datasets import make_record

pytest.importorskip("starlette", reason="the workbench needs starlette: pip install '.[workbench]'")
pytest.importorskip("uvicorn", reason="the workbench needs uvicorn: pip install '.[workbench]'")
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals and process groups of POSIX")

UNDO = '{"what": "do", "given": {"do": "undo"}}'


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    make_record(2000, effects={"covariate": 2.0}, seed=3).to_csv(path)
    return path


@pytest.fixture(scope="module")
def bench(log, tmp_path_factory):
    with running(log, "--keep", folder=tmp_path_factory.mktemp("tmp")) as (_, port, token):
        client = visitor(port, token)
        yield client, token


def test_nobody_passes_without_the_cookie_or_under_another_name(bench):
    client, token = bench
    stranger = Client(client.port)
    for path in ("/", "/events", "/api/say", "/assets/workbench.js", "/nothing"):
        assert stranger.ask("GET", path)[0] == 403
    assert stranger.ask("GET", "/?token=wrong")[0] == 403
    assert stranger.ask("GET", f"/?token={token}")[0] == 403  # good for one visit
    assert stranger.ask("GET", f"/events?token={token}")[0] == 403
    assert Client(client.port, f"thermocorr-{client.port}=guess").ask("GET", "/")[0] == 403
    assert stranger.ask("POST", "/api/say", "{}")[0] == 403
    for host in ("evil.example", f"evil.example:{client.port}", "127.0.0.1", f"0.0.0.0:{client.port}", None):
        assert client.ask("GET", "/", Host=host or "")[0] in (400, 403)
    assert client.ask("GET", "/")[0] == client.ask("GET", "/", Host=f"localhost:{client.port}")[0] == 200
    assert client.ask("GET", f"/?token={token}")[0] == 303  # who has the cookie is let in again


def test_another_site_can_do_nothing_even_with_the_cookie(bench):
    client, _ = bench
    for origin in (
        "http://evil.example",
        "null",
        f"https://127.0.0.1:{client.port}",
        f"http://127.0.0.1:{client.port}1",
    ):
        assert client.ask("POST", "/api/say", UNDO, Origin=origin)[0] == 403
        assert client.ask("POST", "/api/cancel", Origin=origin)[0] == 403
        assert client.ask("GET", "/events", Origin=origin)[0] == 403
    assert client.ask("POST", "/api/say", UNDO, Origin=None)[0] == 403  # a form of an old browser
    for site in ("cross-site", "same-site"):
        assert client.ask("POST", "/api/say", UNDO, Sec_Fetch_Site=site)[0] == 403
    form = "application/x-www-form-urlencoded"
    assert client.ask("POST", "/api/say", "what=do", Content_Type=form)[0] == 400


def test_every_answer_is_sealed(bench):
    client, _ = bench
    for path in ("/", "/assets/workbench.js", "/nothing", "/api/say"):
        _, headers, _ = client.ask("GET", path)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff" and headers["Referrer-Policy"] == "no-referrer"
        assert "no-store" in headers["Cache-Control"]


@pytest.mark.parametrize(
    "path",
    [
        "/assets/../guard.py", "/assets/%2e%2e/guard.py", "/assets/..%2fguard.py", "/assets/%2fetc%2fpasswd",
        "/../../etc/passwd", "/assets/", "/api/say/../../etc/passwd", "/api/open?name=../../x",
    ],
)  # fmt: skip
def test_no_path_leads_anywhere(bench, path):
    client, _ = bench
    status, _, content = client.ask("GET", path)
    assert 400 <= status < 500 and b"root:" not in content and b"import" not in content


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"[]", b"null", b'"undo"', b"\xff\xfe", b'{"do": NaN}', b"[" * 30_000, b'{"do": {"do": 1}}',
        b'{"do": "add", "place": 1e999}', b'{"do": "add", "place": ' + b"9" * 400 + b"}", b'{"do": "__init__"}',
        b'{"do": "preview", "place": true}', b'{"do": "leave_out", "low": [], "high": {}}',
        b'{"do": "drop", "step": -1}', b'{"do": "assign", "temperature": 5, "reading": {}}', b"x" * 70_000,
        b'{"do": "shape", "time_constants": [[[]]], "degree": 2, "products": false}',
        b'{"do": "shape", "time_constants": 6, "degree": 1e9, "products": false}',
        b'{"do": "leave_out", "low": -1e308, "high": 1e308, "more": 1}',
    ],
)  # fmt: skip
def test_a_hostile_request_is_refused_in_one_sentence(bench, body):
    client, _ = bench
    for sent in (body, b'{"what": "do", "given": ' + body + b"}"):
        status, _, content = client.ask("POST", "/api/say", sent)
        assert 400 <= status < 500
        problem = json.loads(content)["problem"]
        assert 10 < len(problem) < 400 and "Traceback" not in problem


@pytest.mark.parametrize(
    "message",
    [
        {"what": "open", "given": {"path": "/etc/passwd"}}, {"what": "take", "given": {"kind": "../x"}},
        {"what": "take"},
        {"what": "ready", "given": {}}, {"what": ["do"], "given": {}}, {"what": "__init__", "given": {}},
    ],
)  # fmt: skip
def test_a_page_says_nothing_else_to_the_desk(bench, message):
    client, _ = bench
    status, _, content = client.ask("POST", "/api/say", json.dumps(message))
    assert status in (400, 422) and "root:" not in content.decode() and json.loads(content)["problem"]


@pytest.mark.parametrize(
    "query",
    [
        {}, {"name": "x"}, {"name": "time", "low": "nan", "high": 1.0}, {"name": "time", "low": -1e308, "high": 1e308},
        {"name": "time", "width": "wide"}, {"name": "time", "width": 1e308}, {"name": "time", "columns": [{}, [], 1]},
        {"name": "time", "columns": 5}, {"name": "time", "versus": -3}, {"name": "time", "versus": {}},
        {"name": "against", "column": "__class__"}, {"name": "against", "column": ["a"]}, {"name": "../../etc"},
        {"name": "against", "column": "temperature", "low": [], "high": {}}, {"name": {"a": 1}}, {"more": 1},
        {"name": "errors", "promised": "much"}, {"name": "errors", "promised": 1e400},
    ],
)  # fmt: skip
def test_a_hostile_question_for_a_picture_is_answered_or_refused(bench, query):
    client, _ = bench
    status, said = client.say("picture", query)
    assert status in (200, 422) and (status == 200 or 10 < len(said["problem"]) < 300)
    assert status == 422 or "<script" not in said["svg"]


def test_a_hostile_upload_is_refused_and_the_log_stays(bench):
    client, _ = bench
    news = News(client)
    before = settled(news)
    for name, content, status in (
        ("x.exe", b"MZ", 422),
        ("../../../etc/cron.d/x.csv", b"", 422),
        ("empty.csv", b"", 422),
        ("zeros.csv", b"\0" * 5000, 422),
        ("not.zip", b"PK\3\4broken", 422),
        ("not.parquet", b"PAR1broken", 422),
        ("noise.csv", os.urandom(20_000), 422),
        ("<img src=x onerror=alert(1)>.csv", b"one,two\n", 422),
    ):
        path = "/api/open?name=" + "".join(f"%{byte:02x}" for byte in name.encode())
        answer, _, said = client.ask("POST", path, content, Content_Type="application/octet-stream")
        assert answer == status, (name, said)
        assert "Traceback" not in said.decode() and "/tmp/" not in said.decode(), said
    large = {"Content_Length": str(1 << 40), "Content_Type": "application/octet-stream"}
    assert client.ask("POST", "/api/open?name=large.csv", b"", **large)[0] == 413
    assert news.state["source"] == before["source"] and news.state["fitted"]["key"] == before["fitted"]["key"]
    news.close()


@pytest.mark.long
def test_names_with_markup_come_through_as_text(bench, log):
    client, _ = bench
    news = News(client)
    settled(news)
    hostile = log.read_bytes().replace(b"humidity", b"<script>alert(1)</script>", 1)
    answer = client.ask("POST", "/api/open?name=%3Cb%3E.csv", hostile, Content_Type="application/octet-stream")
    assert answer[0] == 200
    state = news.until(lambda s: s["source"]["name"] == "_b_.csv" and s["judged"])
    assert "<script>alert(1)</script>" in [column["name"] for column in state["columns"]]
    settled(news)
    assert b"&lt;script&gt;" in client.take("report")[1]
    assert client.ask("POST", "/api/open?name=log.csv", log.read_bytes(), Content_Type="text/csv")[0] == 200
    settled(news)
    news.close()


def test_two_pages_agree_and_an_act_on_an_old_state_is_refused(bench):
    client, _ = bench
    one, other = News(client), News(client)
    state = settled(one)
    status, _ = client.do(do="add", place=0, revision=state["revision"])
    assert status == 200
    assert client.do(do="undo", revision=state["revision"])[0] == 409
    until(lambda: one.state["revision"] > state["revision"] and one.state == other.state)
    settled(one)
    until(lambda: one.state == other.state)
    assert len(other.state["history"]) == 2 and other.state["history"][1]["db"]["value"] < 0
    assert client.do(do="undo", revision=one.state["revision"])[0] == 200
    one.close(), other.close()


def test_cancel_leaves_everything_as_it_was(bench):
    client, _ = bench
    news = News(client)
    before = settled(news)
    done = []
    acting = threading.Thread(target=lambda: done.append(client.do(do="add", place=0)))
    acting.start()
    for _ in range(20):
        client.ask("POST", "/api/cancel")
        time.sleep(0.002)
    acting.join()
    status, said = done[0]
    assert status == 200 or (status == 422 and "as it was" in said["problem"])
    if status == 200:
        assert client.do(do="undo")[0] == 200
    client.do(do="judge")
    assert {**settled(news), "revision": 0, "can_redo": False} == {**before, "revision": 0, "can_redo": False}
    news.close()


@pytest.mark.parametrize("kind", ["script", "model", "corrected", "report"])
def test_everything_can_be_taken_away(bench, kind):
    client, _ = bench
    news = News(client)
    settled(news)
    status, content = client.take(kind)
    assert status == 200 and len(content) > 500
    news.close()


@pytest.mark.long
@POSIX
def test_a_killed_computation_begins_again_from_the_steps(log, tmp_path):
    with running(log, "--keep", folder=tmp_path) as (process, port, token):
        client = visitor(port, token)
        news = News(client)
        settled(news)
        assert client.do(do="add", place=0)[0] == 200
        before = settled(news)
        (child,) = children(process.pid)
        os.kill(child, signal.SIGKILL)
        news.until(lambda s: s["trouble"])
        after = until(lambda: news.state if not news.state.get("trouble") and news.state.get("judged") else None)
        settled(news)
        after = news.state
        assert [row["text"] for row in after["history"]] == [row["text"] for row in before["history"]]
        assert after["fitted"] == before["fitted"] and after["judged"] == before["judged"]
        news.close()


def children(pid):
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    lines = [line for line in listed.stdout.splitlines() if not re.search("resource_tracker|defunct", line)]
    assert len(lines) == 1, lines
    return [int(line.split()[0]) for line in lines]


@pytest.mark.long
@POSIX
@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_an_end_leaves_no_process_and_no_file(log, tmp_path, how):
    with running(log, folder=tmp_path) as (process, port, token):
        news = News(visitor(port, token))
        news.until(lambda s: s["fitted"])
        pids = children(process.pid)
        assert pids and list(tmp_path.iterdir())
        process.send_signal(getattr(signal, how))
        process.wait(20)
        until(lambda: news.ended)
        news.close()
        until(lambda: not any(alive(pid) for pid in pids), 20)
        until(lambda: not list(tmp_path.iterdir()), 20)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.long
def test_it_ends_with_the_last_page_and_stays_through_a_reload(log, tmp_path):
    with running(log, folder=tmp_path) as (process, port, token):
        client = visitor(port, token)
        for _ in range(2):  # a page, and the page again
            news = News(client)
            news.until(lambda s: s["fitted"])
            news.close()
            time.sleep(0.5)
        assert process.poll() is None
        assert process.wait(40) == 0
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nothing.csv"], "There is no file"),
        (["--effects", "nothing.py"], "There is no file"),
        (["--sep", "x"], "--sep"),
    ],
)
def test_what_cannot_be_opened_is_said_on_the_terminal(arguments, sentence, tmp_path):
    command = [sys.executable, "-m", "thermocorr", "workbench", "--no-browser", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False, timeout=LONG)
    assert done.returncode == 2 and sentence in done.stderr and done.stderr.count("\n") == 1


def test_a_log_that_is_none_is_said_on_the_page_and_another_can_be_opened(tmp_path, log):
    bad = tmp_path / "bad.csv"
    bad.write_text("one\n")
    with running(bad, "--keep", folder=tmp_path) as (_, port, token):
        client = visitor(port, token)
        news = News(client)
        until(lambda: news.state.get("trouble"))
        assert client.ask("POST", "/api/open?name=log.csv", log.read_bytes(), Content_Type="text/csv")[0] == 200
        settled(news)
        news.close()


def test_a_log_that_must_be_mended_has_a_button_that_mends_it(bench, log):
    client, _ = bench
    lines = log.read_text().splitlines()
    doubled = "\n".join([*lines[:900], *lines[880:]]) + "\n"  # rows that were written twice
    path = "/api/open?name=doubled.csv"
    status, _, said = client.ask("POST", path, doubled.encode(), Content_Type="text/csv")
    news = News(client)
    remedy = json.loads(said)["remedy"] if status == 422 else news.until(lambda s: s["remedy"])["remedy"]
    assert remedy.startswith("Leave bad rows out")
    assert client.ask("POST", "/api/open?remedy=1", b"")[0] == 200
    state = news.until(lambda s: s["source"]["name"] == "doubled.csv" and s["judged"] and not s["trouble"])
    assert state["source"]["rows"] == len(lines) - 1 and not state["problem"] and not state["remedy"]
    assert client.ask("POST", "/api/open?name=log.csv", log.read_bytes(), Content_Type="text/csv")[0] == 200
    settled(news)
    news.close()


def test_acts_at_once_on_one_state_are_done_once(bench):
    client, _ = bench
    news = News(client)
    state = settled(news)
    wide = state["fitted"]["span"]
    answers = []

    def act(k):
        low = k * wide / 10
        mark = {"do": "leave_out", "low": low, "high": low + wide / 20}
        answers.append(client.do(revision=state["revision"], **mark)[0])

    acting = [threading.Thread(target=act, args=(k,)) for k in range(4)]
    [thread.start() for thread in acting]
    [thread.join() for thread in acting]
    assert sorted(answers) == [200, 409, 409, 409]
    assert client.do(do="undo")[0] == 200
    settled(news)
    news.close()


def test_the_same_thing_can_be_taken_away_twice_and_by_several_at_once(bench):
    client, _ = bench
    news = News(client)
    settled(news)
    found = []
    taking = [threading.Thread(target=lambda: found.append(client.take("model"))) for _ in range(4)]
    [thread.start() for thread in taking]
    [thread.join() for thread in taking]
    assert [status for status, _ in found] == [200] * 4
    news.close()


OWN = """
from thermocorr.effects import Effect

class Broken(Effect):
    kind = "broken"
    @classmethod
    def candidates(cls, record, columns=None):
        return [cls()]
    def names(self):
        return ["broken"]
    def signals(self, x):
        raise KeyError("what I wanted")
"""


def test_an_effect_of_one_s_own_that_fails_is_said_and_nothing_dies(log, tmp_path):
    (tmp_path / "broken_effect.py").write_text(OWN)
    with running(log, "--effects", tmp_path / "broken_effect.py", "--keep", folder=tmp_path) as (_, port, token):
        news = News(visitor(port, token))
        state = news.until(lambda s: s["lacking"])
        assert "KeyError" in state["lacking"] and state["fitted"] and not state["trouble"]
        news.close()


@pytest.mark.long
@POSIX
def test_what_was_undone_survives_the_computation(log, tmp_path):
    with running(log, "--keep", folder=tmp_path) as (process, port, token):
        client = visitor(port, token)
        news = News(client)
        settled(news)
        assert client.do(do="add", place=0)[0] == 200
        settled(news)
        assert client.do(do="undo")[0] == 200
        before = settled(news)
        assert before["can_redo"] and before["source"]["name"] == log.name
        for death in range(3):
            (child,) = children(process.pid)
            os.kill(child, signal.SIGKILL)
            news.until(lambda s: s["trouble"])
            if death < 2:
                news.until(lambda s: not s["trouble"] and s["judged"])
                assert {**settled(news), "revision": 0} == {**before, "revision": 0}
        assert "again and again" in news.state["trouble"]
        status, _, _ = client.ask("POST", "/api/open?name=log.csv", log.read_bytes(), Content_Type="text/csv")
        assert status == 200
        news.until(lambda s: not s["trouble"] and s["judged"])
        news.close()
