"""Controls Debian's Chromium over its debugging pipe, with the standard library only.

    with Browser() as browser:
        page = browser.page("http://127.0.0.1:8765/", width=800)
        page.click("button", "Try it")
        page.wait("document.querySelector('canvas')")
        page.screenshot("session.png")
        assert page.complaints() == []

Elements are found as users of a screen reader find them: by role and name in the accessibility tree. Waiting repeats a
condition in the page until it holds; no fixed time is slept.
"""

import base64
import fcntl
import json
import os
import queue
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from urllib.parse import urlsplit

TIMEOUT = float(os.environ.get("TARSIER_WEB_TIMEOUT", "120"))  # s; only a failing test waits this long


class BrowserError(Exception):
    """The browser refused a command, or a page did not reach an expected state in time."""


def find_chromium():
    """The path of a Chromium, or None."""
    for name in (os.environ.get("CHROMIUM"), "chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name) if name else None
        if path:
            return path
    return None


_KEYS = {
    "Enter": (13, "\r"),
    "Tab": (9, ""),
    "Escape": (27, ""),
    "Backspace": (8, ""),
    "Delete": (46, ""),
    "ArrowLeft": (37, ""),
    "ArrowUp": (38, ""),
    "ArrowRight": (39, ""),
    "ArrowDown": (40, ""),
    "Home": (36, ""),
    "End": (35, ""),
    " ": (32, " "),
}

# Reports violated security policies to the driver, and counts events for the tests.
_WATCH = """
addEventListener('securitypolicyviolation', (event) => {
  tarsierReport(JSON.stringify({kind: 'csp', text: `${event.violatedDirective} ${event.blockedURI} ` +
    `${event.sourceFile}:${event.lineNumber}`}));
});
"""


class Browser:
    """One Chromium with its own profile, which is removed at the end."""

    def __init__(self, arguments=(), fake_camera=True):
        path = find_chromium()
        if path is None:
            raise BrowserError("no chromium on this machine")
        self._profile = tempfile.mkdtemp(prefix="tarsier-chromium-")
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        # The child's ends first get high numbers. Otherwise they could be 3 and 4 in the wrong order.
        read_end = fcntl.fcntl(to_browser, fcntl.F_DUPFD, 20)
        write_end = fcntl.fcntl(from_browser, fcntl.F_DUPFD, 20)

        def pipes():
            os.setsid()
            os.dup2(read_end, 3)
            os.dup2(write_end, 4)

        command = [
            path,
            "--headless=new",
            "--remote-debugging-pipe",
            f"--user-data-dir={self._profile}",
            "--no-first-run",
            "--no-default-browser-check",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-default-apps",
            "--disable-extensions",
            "--disable-sync",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--mute-audio",
            "--renderer-process-limit=1",
            "--hide-scrollbars",
            "--force-color-profile=srgb",
            "--enable-unsafe-swiftshader",
            "--password-store=basic",
            # A popup of a page is a page of its own, and hidden windows are drawn like others.
            "--disable-popup-blocking",
        ]
        if os.geteuid() == 0:
            command.append("--no-sandbox")
        if fake_camera:
            command += ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
        command += [*arguments, "about:blank"]
        self._log = open(os.path.join(self._profile, "browser.log"), "wb")
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            pass_fds=(3, 4, read_end, write_end),
            preexec_fn=pipes,
        )
        for end in (to_browser, from_browser, read_end, write_end):
            os.close(end)
        self._next = 0
        self._lock = threading.Lock()
        self._answers = {}
        self._pages = {}
        self._gone = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.version = self.send("Browser.getVersion")["product"]
        self.send("Target.setDiscoverTargets", {"discover": True})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        if self._process.poll() is None:
            try:
                self.send("Browser.close", timeout=5)
                self._process.wait(5)
            except (BrowserError, OSError, subprocess.TimeoutExpired):
                pass
            if self._process.poll() is None:
                os.killpg(self._process.pid, signal.SIGKILL)
                self._process.wait()
        for end in (self._out, self._in):
            try:
                os.close(end)
            except OSError:
                pass
        self._log.close()
        shutil.rmtree(self._profile, ignore_errors=True)

    def send(self, method, parameters=None, session=None, timeout=TIMEOUT):
        """One command of the DevTools protocol; returns its result."""
        with self._lock:
            self._next += 1
            number = self._next
            box = queue.Queue(1)
            self._answers[number] = box
            message = {"id": number, "method": method, "params": parameters or {}}
            if session:
                message["sessionId"] = session
            data = json.dumps(message).encode() + b"\0"
            while data:
                data = data[os.write(self._out, data):]
        try:
            answer = box.get(timeout=timeout)
        except queue.Empty:
            raise BrowserError(f"{method}: no answer in {timeout} s") from None
        finally:
            self._answers.pop(number, None)
        if "error" in answer:
            raise BrowserError(f"{method}: {answer['error'].get('message')}")
        return answer.get("result", {})

    def page(self, address="about:blank", width=1280, height=800, **options):
        """A new page; it has its own cookies only if `context` is given. With `window` it stays visible beside others;
        window=False makes it a tab in front of those of the last window, which are hidden then."""
        parameters = {"url": "about:blank"}
        if "window" in options:
            parameters["newWindow"] = options.pop("window")
        context = options.pop("context", None)
        if context:
            parameters["browserContextId"] = context
        target = self.send("Target.createTarget", parameters)["targetId"]
        page = Page(self, target, width, height, **options)
        if address != "about:blank":
            page.open(address)
        return page

    def new_context(self):
        """Separate cookies and storage, for another user."""
        return self.send("Target.createBrowserContext")["browserContextId"]

    def targets(self):
        return self.send("Target.getTargets")["targetInfos"]

    def attach(self, target, width=720, height=600):
        """A page that another one opened."""
        return Page(self, target, width, height)

    def _read(self):
        held = b""
        while True:
            try:
                data = os.read(self._in, 1 << 20)
            except OSError:
                data = b""
            if not data:
                break
            *messages, held = (held + data).split(b"\0") if b"\0" in data else ([held + data])
            for message in messages:
                self._take(json.loads(message))
        self._gone = True
        for box in list(self._answers.values()):
            box.put({"error": {"message": "the browser ended"}})

    def _take(self, message):
        if "id" in message:
            box = self._answers.get(message["id"])
            if box:
                box.put(message)
            return
        page = self._pages.get(message.get("sessionId"))
        if page:
            page._event(message["method"], message["params"])


class Page:
    """A tab. Collects all its complaints."""

    def __init__(self, browser, target, width, height, dark=False, still=True, touch=False):
        self._browser = browser
        self.target = target
        self._complaints = []
        self._requests = []
        self._posts = set()  # requests that wait for their answers
        self._own = None  # host of the page
        self._session = browser.send("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        browser._pages[self._session] = self
        for domain in ("Page", "Runtime", "Log", "Network", "DOM", "Accessibility"):
            self.send(f"{domain}.enable")
        self.send("Runtime.addBinding", {"name": "tarsierReport"})
        self.send("Page.addScriptToEvaluateOnNewDocument", {"source": _WATCH})
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        if still:
            features.append({"name": "prefers-reduced-motion", "value": "reduce"})
        self.send("Emulation.setEmulatedMedia", {"features": features})
        if touch:
            self.send("Emulation.setTouchEmulationEnabled", {"enabled": True})
        self.resize(width, height)

    def send(self, method, parameters=None, timeout=TIMEOUT):
        return self._browser.send(method, parameters, self._session, timeout)

    def close(self):
        self._browser.send("Target.closeTarget", {"targetId": self.target})

    # ---- Navigation ----

    def resize(self, width, height=800, zoom=1):
        """`zoom` 2 is the view at 200 %: half as many CSS pixels, each twice as large."""
        self.width, self.height = width, height
        self.send(
            "Emulation.setDeviceMetricsOverride",
            {"width": int(width / zoom), "height": int(height / zoom), "deviceScaleFactor": zoom, "mobile": False},
        )

    def open(self, address):
        self._own = urlsplit(address).netloc
        self._posts.clear()  # requests of the previous page
        result = self.send("Page.navigate", {"url": address})
        if "errorText" in result:
            raise BrowserError(f"{address}: {result['errorText']}")
        self.wait("document.readyState === 'complete'")

    def reload(self):
        self.evaluate("window.tarsierOld = true")
        self.send("Page.reload")
        self.wait("!window.tarsierOld && document.readyState === 'complete'")

    def hide(self, hidden):
        """Behaves as if the tab were in the background."""
        self.send("Page.setWebLifecycleState", {"state": "frozen" if hidden else "active"})

    # ---- Queries ----

    def evaluate(self, script, timeout=TIMEOUT):
        """The value of an expression (awaited) in the page."""
        answer = self.send(
            "Runtime.evaluate",
            {"expression": script, "awaitPromise": True, "returnByValue": True, "userGesture": True},
            timeout,
        )
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            text = details.get("exception", {}).get("description") or details.get("text")
            raise BrowserError(f"{script[:200]}: {text}")
        return answer["result"].get("value")

    def wait(self, condition, timeout=TIMEOUT, what=None):
        """Waits until the expression is true in the page; returns its value. The page itself checks every 25 ms."""
        end = time.monotonic() + timeout
        script = f"""new Promise((done) => {{
          const until = performance.now() + 1000;
          const look = () => {{
            let value;
            try {{ value = (() => ({condition}))(); }} catch (problem) {{ value = false; }}
            if (value || performance.now() > until) done((value instanceof Node ? true : value) || null); else setTimeout(look, 25);
          }};
          look();
        }})"""
        problem = ""
        while time.monotonic() < end:
            try:
                value = self.evaluate(script, timeout=10)
                if value:
                    return value
            except BrowserError as error:
                # A navigation ends the query; it is repeated in the new page.
                problem = str(error)
                if "navigat" not in problem and "context" not in problem.lower():
                    raise
        shown = self.evaluate("document.body ? document.body.innerText.slice(0, 600) : ''")
        raise BrowserError(f"not in {timeout} s: {what or condition} {problem}\n--- page ---\n{shown}")

    def wait_text(self, text, timeout=TIMEOUT):
        self.wait(f"document.body.innerText.includes({json.dumps(text)})", timeout, f"text {text!r}")

    def text(self, selector="body"):
        return self.evaluate(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''")

    def wait_posts(self, timeout=TIMEOUT):
        """Waits until all requests of the page are answered."""
        end = time.monotonic() + timeout
        while True:
            self.evaluate("new Promise((done) => setTimeout(done, 100))")  # requests that the page delays
            if not self._posts:
                return
            if time.monotonic() > end:
                raise BrowserError(f"{len(self._posts)} requests without an answer in {timeout} s")

    # ---- Finding elements by role and name ----

    def find_all(self, role, name=None, contains=None):
        root = self.send("DOM.getDocument", {"depth": 0})["root"]["nodeId"]
        nodes = self.send("Accessibility.queryAXTree", {"nodeId": root, "role": role})["nodes"]
        found = []
        for node in nodes:
            own = (node.get("name") or {}).get("value", "")
            if node.get("ignored") or "backendDOMNodeId" not in node:
                continue
            if name is not None and own != name:
                continue
            if contains is not None and contains.lower() not in own.lower():
                continue
            found.append((node["backendDOMNodeId"], own, node))
        return found

    def find(self, role, name=None, contains=None, timeout=TIMEOUT):
        """The first element with this role and name; waits until it exists."""
        end = time.monotonic() + timeout
        while True:
            try:
                found = self.find_all(role, name, contains)
            except BrowserError:
                found = []
            if found:
                return found[0][0]
            if time.monotonic() > end:
                names = sorted({one[1] for one in self.find_all(role)})
                raise BrowserError(f"no {role} {name or contains!r} in {timeout} s; there are: {names[:40]}")
            # Waits until the page draws, not for a fixed time.
            self.evaluate("new Promise((done) => setTimeout(done, 40))")

    def has(self, role, name=None, contains=None):
        return bool(self.find_all(role, name, contains))

    def on(self, node, function):
        """Calls a function of the page with the element as `this`; returns its value."""
        handle = self.send("DOM.resolveNode", {"backendNodeId": node})["object"]["objectId"]
        answer = self.send(
            "Runtime.callFunctionOn",
            {"objectId": handle, "functionDeclaration": function, "returnByValue": True, "awaitPromise": True,
             "userGesture": True},
        )
        if "exceptionDetails" in answer:
            raise BrowserError(answer["exceptionDetails"].get("exception", {}).get("description", "failed"))
        return answer["result"].get("value")

    # ---- Actions ----

    def center(self, node):
        """Scrolls the element into view and returns its center. Refuses an element that another one covers."""
        self.send("DOM.scrollIntoViewIfNeeded", {"backendNodeId": node})
        at = self.on(node, """function () {
          const box = this.getBoundingClientRect();
          const x = box.left + box.width / 2, y = box.top + box.height / 2;
          const top = document.elementFromPoint(x, y);
          const inside = (one) => this.contains(one) || one.closest?.('label')?.control === this;
          const own = top && (inside(top) || top.contains(this));
          window.tarsierMissed = false;
          if (top && inside(top)) {
            // The page may have drawn the element once more meanwhile: the same in its place is no miss.
            const same = (one) => !this.isConnected && one.closest?.(this.localName)?.outerHTML === this.outerHTML;
            addEventListener('click', ({target}) => { window.tarsierMissed = !inside(target) && !same(target); }, {capture: true, once: true});
          }
          return {x, y, width: box.width, height: box.height, own: Boolean(own), top: top ? top.outerHTML.slice(0, 120) : ''};
        }""")
        if at["width"] == 0 or at["height"] == 0:
            raise BrowserError("the element has no size")
        if not at["own"]:
            raise BrowserError(f"the element is covered by {at['top']}")
        return at["x"], at["y"]

    def click_at(self, x, y, button="left", count=1):
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.send(
                "Input.dispatchMouseEvent",
                {"type": kind, "x": x, "y": y, "button": "none" if kind == "mouseMoved" else button,
                 "clickCount": count},
            )

    def drag(self, start, end, steps=8):
        (x0, y0), (x1, y1) = start, end
        self.send("Input.dispatchMouseEvent", {"type": "mousePressed", "x": x0, "y": y0, "button": "left", "clickCount": 1})
        for step in range(1, steps + 1):
            x, y = x0 + (x1 - x0) * step / steps, y0 + (y1 - y0) * step / steps
            self.send("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": x, "y": y, "button": "left", "buttons": 1})
        self.send("Input.dispatchMouseEvent", {"type": "mouseReleased", "x": x1, "y": y1, "button": "left", "clickCount": 1})

    def click(self, role, name=None, contains=None, timeout=TIMEOUT):
        """A real mouse click; repeated while the page still moves elements."""
        end = time.monotonic() + timeout
        while True:
            node = self.find(role, name, contains, timeout)
            try:
                x, y = self.center(node)
                self.click_at(x, y)
                if not self.missed():
                    return
            except BrowserError:
                if time.monotonic() > end:
                    raise
            self.evaluate("new Promise((done) => setTimeout(done, 50))")

    def missed(self):
        """Whether the last click hit another element, because the page moved before it arrived."""
        try:
            return self.evaluate("window.tarsierMissed")
        except BrowserError:  # the click led to another page
            return False

    def focus(self, role, name=None, contains=None):
        node = self.find(role, name, contains)
        self.send("DOM.focus", {"backendNodeId": node})
        return node

    def fill(self, role, name, text):
        """Replaces the content of a field as typing does."""
        node = self.focus(role, name)
        self.on(node, "function () { this.select?.(); }")
        if text:
            self.send("Input.insertText", {"text": text})
        else:
            self.press("Delete")

    def choose(self, name, value):
        """Selects an option of a select box."""
        end = time.monotonic() + TIMEOUT
        while True:
            node = self.find("combobox", name)
            options = self.on(node, "function () { return [...this.options].map((one) => one.value); }")
            if value in options:
                break
            if time.monotonic() > end:
                raise BrowserError(f"{name}: no option {value!r} among {options}")
            self.evaluate("new Promise((done) => setTimeout(done, 40))")
        self.on(node, f"""function () {{
          this.value = {json.dumps(value)};
          this.dispatchEvent(new Event('change', {{bubbles: true}}));
        }}""")

    def slide(self, name, value):
        node = self.find("slider", name)
        self.on(node, f"""function () {{
          this.value = {json.dumps(str(value))};
          this.dispatchEvent(new Event('input', {{bubbles: true}}));
        }}""")

    def upload(self, node, paths):
        self.send("DOM.setFileInputFiles", {"backendNodeId": node, "files": [os.path.abspath(one) for one in paths]})

    def file_input(self, index=0):
        """The node of the n-th file field."""
        root = self.send("DOM.getDocument", {"depth": 0})["root"]["nodeId"]
        found = self.send("DOM.querySelectorAll", {"nodeId": root, "selector": "input[type=file]"})["nodeIds"]
        if index >= len(found):
            raise BrowserError(f"no file field {index}")
        return self.send("DOM.describeNode", {"nodeId": found[index]})["node"]["backendNodeId"]

    def press(self, key, shift=False, control=False):
        code, text = _KEYS.get(key, (ord(key.upper()[0]), key))
        modifiers = (8 if shift else 0) | (2 if control else 0)
        base = {"key": key, "windowsVirtualKeyCode": code, "modifiers": modifiers}
        down = dict(base, type="keyDown" if text and not control else "rawKeyDown")
        if text and not control:
            down["text"] = text
        self.send("Input.dispatchKeyEvent", down)
        self.send("Input.dispatchKeyEvent", dict(base, type="keyUp"))

    # ---- Checks ----

    def screenshot(self, path, full=True):
        parameters = {"format": "png", "captureBeyondViewport": full}
        if full:
            size = self.send("Page.getLayoutMetrics")["cssContentSize"]
            parameters["clip"] = {
                "x": 0, "y": 0, "width": size["width"], "height": min(size["height"], 6000), "scale": 1,
            }
        data = self.send("Page.captureScreenshot", parameters)["data"]
        os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
        with open(path, "wb") as file:
            file.write(base64.b64decode(data))
        return path

    def overflow(self):
        """By how many pixels the page is wider than its window; which elements reach out."""
        return self.evaluate("""(() => {
          const wide = document.documentElement.scrollWidth - innerWidth;
          if (wide <= 0) return null;
          const out = [...document.querySelectorAll('main *, header *')]
            .filter((one) => one.getBoundingClientRect().right > innerWidth + 1)
            .slice(0, 5).map((one) => one.outerHTML.slice(0, 90));
          return `${wide} px: ${out.join(' | ')}`;
        })()""")

    def axe(self, source, rules=None):
        """Serious or critical findings of axe-core, one line each; of these rules only, if given."""
        if not self.evaluate("typeof axe !== 'undefined'"):
            self.send("Runtime.evaluate", {"expression": source})
        tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
        only = {"type": "rule", "values": rules} if rules else {"type": "tag", "values": tags}
        answer = self.evaluate(
            f"axe.run(document, {{resultTypes: ['violations'], runOnly: {json.dumps(only)}}})"
            """.then((result) => JSON.stringify(result.violations.map((one) => ({id: one.id, impact: one.impact,
                 help: one.help, nodes: one.nodes.slice(0, 3).map((node) => node.html.slice(0, 160) + ' # ' +
                 (node.any[0]?.message ?? node.all[0]?.message ?? ''))}))))""",
            timeout=120,
        )
        return [
            f"{one['impact']} {one['id']}: {one['help']}: {' || '.join(one['nodes'])}"
            for one in json.loads(answer)
            if one["impact"] in ("serious", "critical")
        ]

    def complaints(self):
        """Console errors, violated policies, and requests to other hosts since the last call."""
        found, self._complaints = self._complaints, []
        return found

    def requests(self):
        return list(self._requests)

    def _event(self, method, parameters):
        if method == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self._complaints.append(
                "exception: " + (details.get("exception", {}).get("description") or details.get("text", ""))
            )
        elif method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning", "assert"):
            words = [str(one.get("value", one.get("description", ""))) for one in parameters["args"]]
            self._complaints.append(f"console {parameters['type']}: {' '.join(words)}")
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            entry = parameters["entry"]
            self._complaints.append(f"log: {entry['text']} {entry.get('url', '')}")
        elif method == "Runtime.bindingCalled" and parameters["name"] == "tarsierReport":
            report = json.loads(parameters["payload"])
            self._complaints.append(f"{report['kind']}: {report['text']}")
        elif method in ("Network.loadingFinished", "Network.loadingFailed"):
            self._posts.discard(parameters["requestId"])
        elif method == "Network.requestWillBeSent":
            if parameters["request"]["method"] != "GET":
                self._posts.add(parameters["requestId"])
            address = parameters["request"]["url"]
            parts = urlsplit(address)
            if parts.scheme in ("http", "https", "ws", "wss"):
                self._requests.append(address)
                if self._own and parts.netloc != self._own:
                    self._complaints.append(f"request to another host: {address}")
