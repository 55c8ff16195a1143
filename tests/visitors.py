"""A workbench as a process of its own, and those who visit it without a browser."""

import base64
import http.client
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

LONG = 60
"""Seconds after which a test gives up waiting."""


class Client:
    """One visitor of a workbench."""

    def __init__(self, port, cookie=""):
        self.port, self.cookie = port, cookie

    def ask(self, method, path, body=None, **headers):
        """Status, headers and content of an answer."""
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG)
        given = {"Host": f"127.0.0.1:{self.port}", "Cookie": self.cookie}
        if method == "POST":
            given |= {"Origin": f"http://127.0.0.1:{self.port}", "Content-Type": "application/json"}
        given |= {name.replace("_", "-"): value for name, value in headers.items()}
        line.request(method, path, body, {name: value for name, value in given.items() if value is not None})
        try:
            with line.getresponse() as answer:
                return answer.status, answer.headers, answer.read()
        finally:
            line.close()

    def do(self, revision=None, **asked):
        """An act: status and what was said."""
        return self.say("do", {**asked, "revision": revision})

    def say(self, what, given):
        """A message to the desk: status and its answer."""
        status, _, content = self.ask("POST", "/api/say", json.dumps({"what": what, "given": given}))
        return status, json.loads(content)

    def take(self, kind):
        """Status and content of a file to take away."""
        status, said = self.say("take", {"kind": kind})
        return status, base64.b64decode(said.get("content", ""))


class News:
    """What a page hears, as it comes."""

    def __init__(self, client):
        self.line = http.client.HTTPConnection("127.0.0.1", client.port, timeout=LONG)
        self.line.request("GET", "/events", headers={"Host": f"127.0.0.1:{client.port}", "Cookie": client.cookie})
        self.socket = self.line.sock
        self.answer = self.line.getresponse()
        self.state, self.progress, self.ended = {}, None, False
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self):
        kind = ""
        try:
            for line in self.answer:
                text = line.decode().rstrip("\n")
                if text.startswith("event: "):
                    kind = text.removeprefix("event: ")
                elif text.startswith("data: "):
                    content = json.loads(text.removeprefix("data: "))
                    if kind == "state":
                        self.state = content
                    elif kind == "progress":
                        self.progress = content["text"]
        except (OSError, ValueError, http.client.HTTPException, AttributeError):
            pass
        self.ended = True

    def until(self, wanted):
        """The state as soon as this is true of it."""
        return until(lambda: self.state if self.state.get("columns") and wanted(self.state) else None)

    def close(self):
        if not self.ended:
            self.socket.shutdown(socket.SHUT_RDWR)
        self.reader.join(5)
        self.answer.close()
        self.line.close()


def until(found, seconds=LONG):
    """What a function returns as soon as it is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if value := found():
            return value
        time.sleep(0.03)
    raise AssertionError("waited in vain")


def settled(news):
    """The state when nothing more is found out."""
    news.until(lambda s: s["judged"] and s["history"][-1]["held_out"])
    until(lambda: news.progress == "")
    return news.state


@contextmanager
def running(*arguments, folder=None, within=()):
    """A workbench's process, its port and its token; `within` is a command that starts it, such as taskset."""
    command = [*within, sys.executable, "-m", "thermocorr", "workbench", "--no-browser", *map(str, arguments)]
    environment = {**os.environ, "TMPDIR": str(folder)} if folder else os.environ
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        line = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line)
        assert found, process.stderr.read()
        yield process, int(found[1]), found[2]
    finally:
        process.kill()
        process.communicate()


def visitor(port, token):
    """A client with the cookie that the token is worth."""
    status, headers, _ = Client(port).ask("GET", f"/?token={token}")
    assert status == 303 and headers["Location"] == "/"
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "samesite=strict" in cookie.lower()
    return Client(port, cookie.split(";")[0])
