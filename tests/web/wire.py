# SPDX-License-Identifier: MIT
"""Starts the real server on its own workspace and talks to it, with urllib and sockets only.

The folder of the programs is $TARSIER_SERVE_BIN.
"""
import http.client
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
TARSIER = os.path.join(os.environ.get("TARSIER_SERVE_BIN", os.path.join(ROOT, "build", "release", "bin")), "tarsier")
TIMEOUT = float(os.environ.get("TARSIER_WEB_TIMEOUT", "120"))  # s; only a failing test waits this long
IMAGE, STATE, HELLO, JOB, PING, ENDED = range(1, 7)


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def json(self):
        return json.loads(self.body)


class Studio:
    """A server; `with Studio() as studio` ends it."""

    def __init__(self, *flags, workspace=None, sign_in=True):
        self.own = workspace is None
        self.workspace = workspace or tempfile.mkdtemp(prefix="tarsier-studio-")
        self.cookie = self.csrf = None
        self.errors = []
        environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.process = subprocess.Popen([TARSIER, "serve", "--workspace", self.workspace, "--port", "0", "--json", *flags],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError("the server did not start: " + self.process.stderr.read())
        self.reader = threading.Thread(target=self.read_errors, daemon=True)
        self.reader.start()
        self.about = json.loads(line)
        self.link = self.about["link"]
        self.url = self.about["url"]
        self.host = re.match(r"https?://([^/]+)/", self.url).group(1)
        port = self.host.rpartition(":")[2]
        self.port = int(port) if port.isdigit() else None  # behind a proxy: not known
        if sign_in:
            self.sign_in()

    def read_errors(self):
        for line in self.process.stderr:
            self.errors.append(line)

    def sign_in(self):
        answer = self.post("/api/session", {"token": self.token()}, headers={})
        assert answer.status == 200, answer.body
        self.cookie = answer.headers["Set-Cookie"].split(";")[0]
        self.csrf = answer.json()["csrf"]

    def token(self):
        return self.link.split("#t=")[1]

    def new_link(self):
        line = subprocess.run([TARSIER, "serve", "--workspace", self.workspace, "--link", "--json"], capture_output=True,
                              text=True, check=True).stdout
        return json.loads(line)["link"]

    def api_token(self):
        with open(os.path.join(self.workspace, ".studio", "api-token"), encoding="ascii") as file:
            return file.read().strip()

    def headers(self):
        own = {}
        if self.cookie:
            own = {"Cookie": self.cookie, "X-Tarsier-CSRF": self.csrf}
        return own

    def ask(self, method, path, body=None, headers=None, source="127.0.0.1"):
        """Follows no redirects and hides no errors. `headers` replaces those of a signed-in page."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT, source_address=(source, 0))
        try:
            connection.request(method, path, body, self.headers() if headers is None else headers)
            answer = connection.getresponse()
            return Answer(answer.status, answer.headers, answer.read())
        finally:
            connection.close()

    def get(self, path, **more):
        return self.ask("GET", path, **more)

    def post(self, path, value, headers=None, **more):
        sent = dict(self.headers() if headers is None else headers)
        sent.setdefault("Content-Type", "application/json")
        return self.ask("POST", path, json.dumps(value), sent, **more)

    def start_session(self, verb, inputs, flags=None):
        answer = self.post("/api/sessions", {"verb": verb, "inputs": inputs, "flags": flags or {}})
        assert answer.status == 201, (answer.status, answer.body)
        return answer.json()

    def live(self, sessions, source="127.0.0.1", receive_buffer=0, jobs=False):
        return Live(self, sessions, source, receive_buffer, jobs)

    def children(self):
        """The processes that the server started, and their children."""
        found, parents = [], {self.process.pid}
        listing = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
        rows = [tuple(map(int, line.split())) for line in listing.splitlines()]
        while parents:
            parents = {pid for pid, parent in rows if parent in parents}
            found += sorted(parents)
        return found

    def interrupt(self, number=signal.SIGINT):
        """The seconds until it ended, and its exit status."""
        begin = time.monotonic()
        self.process.send_signal(number)
        status = self.process.wait(timeout=20)
        return time.monotonic() - begin, status

    def close(self):
        if self.process.poll() is None:
            self.interrupt()
        self.process.stdout.close()
        if self.own:
            shutil.rmtree(self.workspace, ignore_errors=True)

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.close()


class Live:
    """GET /api/live as a program reads it: record by record."""

    def __init__(self, studio, sessions, source, receive_buffer, jobs):
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(TIMEOUT)
        self.socket.bind((source, 0))
        self.socket.connect(("127.0.0.1", studio.port))
        lines = [f"GET /api/live?s={','.join(sessions)}{'&jobs=1' if jobs else ''} HTTP/1.1", f"Host: {studio.host}"]
        # Each is a separate viewer: streams of one browser would take turns.
        lines.append(f"Authorization: Bearer {studio.api_token()}")
        self.socket.sendall("\r\n".join(lines + ["", ""]).encode())
        self.file = self.socket.makefile("rb", buffering=1 << 16 if not receive_buffer else 512)
        self.status = int(self.file.readline().split()[1])
        self.head = {}
        while True:
            line = self.file.readline().strip()
            if not line:
                break
            name, _, value = line.decode().partition(":")
            self.head[name.lower()] = value.strip()
        self.rest = b""

    def bytes(self, count):
        while len(self.rest) < count:
            size = self.file.readline()
            if not size:
                return None
            size = int(size, 16)
            self.rest += self.file.read(size)
            self.file.readline()
            if size == 0:
                return None
        result, self.rest = self.rest[:count], self.rest[count:]
        return result

    def record(self):
        """(kind, id, payload), or None at the end."""
        head = self.bytes(4)
        if head is None:
            return None
        data = self.bytes(struct.unpack(">I", head)[0])
        if data is None:
            return None
        length = data[1]
        return data[0], data[2:2 + length].decode(), data[2 + length:]

    def wait_for(self, kind, accept=lambda payload: True, seconds=TIMEOUT):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            record = self.record()
            if record is None:
                raise AssertionError("the stream ended")
            if record[0] == kind and accept(record[2]):
                return record
        raise AssertionError(f"no record of kind {kind} within {seconds} s")

    def close(self):
        self.file.close()
        self.socket.close()


def wait_until(condition, seconds=TIMEOUT, what="a condition"):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"{what}: not within {seconds} s")


def run_tests(namespace):
    """Runs every function test_.. of a module, or those that the command line names; returns the status for sys.exit."""
    failed = []
    for name, function in list(namespace.items()):
        if not name.startswith("test_") or not callable(function) or (sys.argv[1:] and name not in sys.argv[1:]):
            continue
        begin = time.monotonic()
        try:
            function()
            print(f"ok    {name} ({time.monotonic() - begin:.1f} s)", flush=True)
        except Exception as error:  # noqa: BLE001 - every failure is reported, the others still run
            import traceback
            traceback.print_exc()
            print(f"FAIL  {name}: {error}", flush=True)
            failed.append(name)
    return 1 if failed else 0
