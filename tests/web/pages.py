"""The real server with its own workspace, for tests, with the standard library only."""

import atexit
import json
import os
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.error
import urllib.request

import chromium

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
CLIENT = os.path.join(ROOT, "apps", "web", "client")
DIST = os.path.join(ROOT, "apps", "web", "dist")
SKIPPED = 77  # ctest treats this status as skipped
LONG = 240  # s, for work on a busy machine
# Requests that were pending when their session or camera ended. On a busy machine the server notices the end first.
LATE = re.compile(r"404 \(Not Found\) \S+/api/(sessions/\w+(/stages\b|$)|viewer-cameras/\w+/frame)")

BIN = os.environ.get("TARSIER_SERVE_BIN", os.path.join(ROOT, "build", "release", "bin"))
OUT = os.environ.get("TARSIER_WEB_BUILD", os.path.join(ROOT, "build", "web"))


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Server:
    """`tarsier serve` on a free port of 127.0.0.1."""

    def __init__(self, *arguments, workspace=None, environment=None):
        self._own = workspace is None
        self.workspace = workspace or tempfile.mkdtemp(prefix="tarsier-studio-")
        self.arguments = arguments
        self._environment = environment or {}
        self.start()

    def start(self):
        self.fresh = True  # its first link is not used yet
        self.port = free_port()
        self.origin = f"http://127.0.0.1:{self.port}"
        self.log = []
        self._links = queue.Queue()
        command = [os.path.join(BIN, "tarsier"), "serve", "--workspace", self.workspace, "--port", str(self.port),
                   "--no-browser", *self.arguments]
        if os.environ.get("TARSIER_WEB_ASSETS"):  # pages from a folder instead of those in the program
            command += ["--assets", os.environ["TARSIER_WEB_ASSETS"]]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, **self._environment}, start_new_session=True,
        )
        threading.Thread(target=self._read, args=(self.process.stdout, self._links), daemon=True).start()
        try:
            self.link = self._links.get(timeout=chromium.TIMEOUT)
        except queue.Empty:
            self.link = None
        if self.link is None:
            self.stop()
            raise RuntimeError("the server printed no link:\n" + "\n".join(self.log))

    def _read(self, stream, links):  # separate arguments: the server may have been restarted meanwhile
        for line in stream:
            self.log.append(line.rstrip())
            found = re.search(r"https?://\S+#t=\S+", line)
            if found:
                links.put(found.group(0))
        links.put(None)

    def new_link(self):
        """Another link, for another browser."""
        made = subprocess.run(
            [os.path.join(BIN, "tarsier"), "serve", "--workspace", self.workspace, "--link"],
            capture_output=True, text=True, timeout=chromium.TIMEOUT, check=False,
        )
        found = re.search(r"https?://\S+#t=\S+", made.stdout + made.stderr)
        if not found:
            raise RuntimeError(f"no link: {made.stdout} {made.stderr}")
        return found.group(0)

    def call(self, path, data=None, method=None, kind="application/json"):
        """A request as a program makes it, with the workspace's token. Returns status and decoded body."""
        with open(os.path.join(self.workspace, ".studio", "api-token"), encoding="utf-8") as file:
            token = file.read().strip()
        body = json.dumps(data).encode() if isinstance(data, (dict, list)) else data
        request = urllib.request.Request(self.origin + path, data=body, method=method)
        request.add_header("Authorization", f"Bearer {token}")
        if body is not None:
            request.add_header("Content-Type", kind)
        try:
            with urllib.request.urlopen(request, timeout=chromium.TIMEOUT) as answer:
                status, raw = answer.status, answer.read()
        except urllib.error.HTTPError as error:
            status, raw = error.code, error.read()
        try:
            return status, json.loads(raw) if raw else None
        except ValueError:
            return status, raw

    def stop(self, how=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(how)
            try:
                self.process.wait(15)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()

    def close(self):
        self.stop()
        if self._own:
            shutil.rmtree(self.workspace, ignore_errors=True)


def axe_source():
    """axe-core from the client's packages, or None if they are not installed."""
    path = os.path.join(CLIENT, "node_modules", "axe-core", "axe.min.js")
    if not os.path.exists(path):
        return None
    with open(path, encoding="utf-8") as file:
        return file.read()


# Screenshots of every screen for people take a quarter of a browser's time: TARSIER_WEB_LOOK=1.
LOOK = bool(os.environ.get("TARSIER_WEB_LOOK"))
# By default, pages are checked at the width of a phone; `./test --all` checks them at all these widths.
ALL = LOOK or bool(os.environ.get("TARSIER_TEST_ALL"))
WIDTHS = (360, 800, 1440) if ALL else (360,)


def shot(page, name):
    """A screenshot for people, if requested: OUT/name.png."""
    if LOOK:
        page.screenshot(os.path.join(OUT, f"{name}.png"))


_shared = {}


def _close_shared():
    for one in ("browser", "server"):
        if one in _shared:
            _shared.pop(one).close()


atexit.register(_close_shared)


class PageTest(unittest.TestCase):
    """One browser and one server for all tests of a file, and a page for each class. A class with `server_arguments` or
    `own_server` has its own server. Each test must end without complaints."""

    server_arguments = ()
    own_server = False
    server = None
    browser = None
    page = None
    context = None

    @classmethod
    def setUpClass(cls):
        if "browser" not in _shared:
            _shared["browser"] = chromium.Browser()
        cls.browser = _shared["browser"]
        if cls.server_arguments or cls.own_server:
            cls.server = Server(*cls.server_arguments)
        else:
            if "server" not in _shared:
                _shared["server"] = Server()
            cls.server = _shared["server"]
        try:
            # Separate cookies: a port that is used again must not find those of another server.
            cls.context = cls.browser.new_context()
            cls.page = cls.browser.page(width=1440, height=900, context=cls.context)
            cls.sign_in(cls.page, cls.server.link if cls.server.fresh else cls.server.new_link())
            cls.server.fresh = False
        except BaseException:
            cls.tearDownClass()
            raise

    @classmethod
    def tearDownClass(cls):
        if cls.page:
            cls.page.close()
            cls.page = None
        if cls.server and cls.server is not _shared.get("server"):
            cls.server.close()
        cls.server = None

    @classmethod
    def sign_in(cls, page, link=None):
        # The page "api" makes few requests to the server.
        page.open((link or cls.server.link).replace("/#t=", "/api#t="))
        page.wait("document.querySelector('main[data-page=api][data-ready=yes]')", what="signed in")

    def setUp(self):
        self.page.resize(1440, 900)

    def tearDown(self):
        self.assertEqual([one for one in self.page.complaints() if not LATE.search(one)], [])

    def until(self, what, condition):
        """Waits until `condition` is true and returns its value; only a failing test waits for LONG."""
        end = time.monotonic() + LONG
        while time.monotonic() < end:
            value = condition()
            if value:
                return value
            self.page.evaluate("new Promise((done) => setTimeout(done, 100))")
        self.fail(f"not in {LONG} s: {what}\n{self.page.text('main')[:600]}")

    def jobs_of(self, verb):
        return [job for job in self.server.call("/api/jobs")[1]["jobs"] if job["verb"] == verb]

    def go(self, path):
        """Opens a page of the studio by its address."""
        self.page.open(self.server.origin + path)
        self.page.wait("document.querySelector('main[data-ready=yes]')", what=f"page {path}")

    def check_page(self, name, widths=WIDTHS):
        """Screenshots at each width, light and dark, if requested. Checks that the page does not scroll sideways, and that axe
        finds nothing serious at the narrowest and the widest, in light and dark."""
        source = axe_source()
        for width in sorted({*widths, 360, 800, 1440}) if LOOK else widths:
            self.page.resize(width, 800)
            self.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            shot(self.page, f"{name}-{width}")
            if LOOK:
                self.page.evaluate("document.documentElement.dataset.theme = 'dark'")
                shot(self.page, f"{name}-{width}-dark")
                self.page.evaluate("delete document.documentElement.dataset.theme")
            self.assertIsNone(self.page.overflow(), f"{name} at {width} px")
            if source and width == min(widths):
                self.assertEqual(self.page.axe(source), [], f"{name} at {width} px")
        self.page.evaluate("document.documentElement.dataset.theme = 'dark'")
        if source:
            # After the light page was checked at this width, the dark page differs only in colours.
            rules = None if ALL and len(widths) > 1 else ["color-contrast"]
            self.assertEqual(self.page.axe(source, rules), [], f"{name}, dark")
        self.page.evaluate("delete document.documentElement.dataset.theme")
        self.page.resize(1440, 800, zoom=2)
        self.assertIsNone(self.page.overflow(), f"{name} at 200 %")
        self.page.resize(1440, 900)


def main():
    """Runs the tests of the calling file; 77 and one line if nothing is available to run them with."""
    if chromium.find_chromium() is None:
        print("skipped: no chromium on this machine (apt-get install chromium)")
        sys.exit(SKIPPED)
    if not os.path.exists(os.path.join(BIN, "tarsier")):
        print(f"skipped: no program in {BIN} (TARSIER_SERVE_BIN names its folder)")
        sys.exit(SKIPPED)
    unittest.main(verbosity=2)
