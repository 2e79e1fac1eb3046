#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Controls the program's windows through pipes, as `tarsier serve` does, for pipe_window.sh.

Session(arguments) starts the program with TARSIER_WINDOW=pipe:IN:OUT. Records are read when they arrive; the newest state and
the newest image are kept. No display is needed.
"""
import fcntl
import json
import os
import select
import signal
import struct
import subprocess
import sys
import time

from cli_verbs import MAX_STOP_CPU, children_cpu
from processes import cpu_seconds

PROGRAM = os.environ["TARSIER"]
TIMEOUT = int(os.environ.get("TARSIER_TEST_TIMEOUT", "300"))  # s; only a failing test waits this long


class Failed(Exception):
    pass


class Session:
    def __init__(self, arguments, viewer=False, read=True):
        self.arguments = arguments
        self.name = "tarsier " + " ".join(arguments)
        child_in, self.to = os.pipe()
        self.out, child_out = os.pipe()
        child_viewer, self.viewer = os.pipe() if viewer else (None, None)
        environment = dict(os.environ)
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            environment.pop(name, None)
        environment["TARSIER_WINDOW"] = "pipe:%d:%d" % (child_in, child_out)
        passed_fds = [child_in, child_out]
        if viewer:
            environment["TARSIER_VIEWER"] = str(child_viewer)
            passed_fds.append(child_viewer)
        self.stdout = open("stdout.txt", "w+")
        self.stderr = open("stderr.txt", "w+")
        self.program = subprocess.Popen([PROGRAM] + arguments, stdin=subprocess.DEVNULL, stdout=self.stdout,
                                        stderr=self.stderr, env=environment, pass_fds=passed_fds)
        for fd in passed_fds:
            os.close(fd)
        fcntl.fcntl(self.out, fcntl.F_SETFL, os.O_NONBLOCK)
        self.bytes = b""
        self.hello = self.state = self.image = None
        self.hellos = self.states = self.images = 0
        self.frame = self.age = None
        self.ended = False

    def send(self, **line):
        self.write(json.dumps(line).encode() + b"\n")

    def write(self, text):
        os.write(self.to, text)

    def read(self, timeout=0.05):
        """Reads all available records."""
        if self.ended or not select.select([self.out], [], [], timeout)[0]:
            return
        try:
            got = os.read(self.out, 1 << 20)
        except BlockingIOError:
            return
        if not got:
            self.ended = True
            return
        self.bytes += got
        while len(self.bytes) >= 4:
            length = struct.unpack(">I", self.bytes[:4])[0]
            if not 1 <= length <= 64 << 20:
                raise Failed("a record of %d bytes" % length)
            if len(self.bytes) < 4 + length:
                break
            kind, payload = self.bytes[4:5], self.bytes[5:4 + length]
            self.bytes = self.bytes[4 + length:]
            if kind == b"H":
                self.hello = json.loads(payload)
                self.hellos += 1
            elif kind == b"S":
                if self.hello is None:
                    raise Failed("a state before the hello")
                self.state = json.loads(payload)
                self.states += 1
            elif kind == b"J":
                self.frame, self.age = struct.unpack(">II", payload[:8])
                self.image = payload[8:]
                self.images += 1
            else:
                raise Failed("a record of kind %r" % kind)

    def until(self, what, condition):
        end = time.monotonic() + TIMEOUT
        while not condition():
            if self.ended:
                raise Failed("%s: ended, waiting for %s; stderr: %s" % (self.name, what, self.log()))
            if time.monotonic() > end:
                raise Failed("%s: no %s; state: %s; stderr: %s" % (self.name, what, self.state, self.log()))
            self.read()

    def log(self):
        self.stderr.flush()
        return open("stderr.txt").read().strip()[-500:]

    def output(self):
        return open("stdout.txt").read()

    def next_image(self, save=None):
        before = self.images
        self.send(want=1)
        self.until("image", lambda: self.images > before)
        if self.image[:3] != b"\xff\xd8\xff" or self.image[-2:] != b"\xff\xd9":
            raise Failed("%s: what was sent is no JPEG" % self.name)
        if save:
            with open(save, "wb") as file:
                file.write(self.image)
        return self.image

    def expect_exit(self, status=0):
        """Reads until the program ends by itself."""
        end = time.monotonic() + TIMEOUT
        while self.program.poll() is None:
            self.read()
            if self.ended:
                time.sleep(0.005)
            if time.monotonic() > end:
                self.program.kill()
                raise Failed("%s: does not end" % self.name)
        for _ in range(100):
            if self.ended:
                break
            self.read()
        if self.program.returncode != status:
            raise Failed("%s: ended with %s, expected %d; stderr: %s" %
                         (self.name, self.program.returncode, status, self.log()))

    def close(self, status=0):
        self.send(close=True)
        self.expect_exit(status)
        self.close_pipes()

    def interrupt(self):
        """Seconds of processor time from SIGINT to the end: a user's waiting time on an idle machine."""
        before = children_cpu() + (cpu_seconds(self.program.pid) or 0.0)
        self.program.send_signal(signal.SIGINT)
        self.expect_exit(130)
        self.close_pipes()
        return max(0.0, children_cpu() - before)

    def close_pipes(self):
        for fd in (self.to, self.out, self.viewer):
            if fd is not None:
                os.close(fd)
        self.to = self.out = self.viewer = None
        self.stdout.close()
        self.stderr.close()


# --- the checks of pipe_window.sh ---

failures = []


def expect(truth, text):
    if not truth:
        failures.append(text)
        print("FAILED: " + text, flush=True)


def start_session(arguments, **more):
    """A session that has received its first frame or image."""
    session = Session(arguments, **more)
    session.until("image", lambda: session.state and session.state["width"] and
                  (session.state["frame"] is None or session.state["frame"]["index"] >= 0))
    names = [action["name"] for action in session.hello["actions"]]
    expect(session.hello["title"].startswith("Tarsier "), "%s: title %s" % (session.name, session.hello["title"]))
    expect("help" in names and "quit" in names, "%s: actions %s" % (session.name, names))
    return session


def perform(session, name, what, condition):
    session.send(action=name)
    session.until("%s after action %s" % (what, name), lambda: condition(session.state["state"]))


def expect_change(session, line, what):
    """The image changes after this event."""
    before, requested = session.image, -1
    session.send(**line)

    def has_changed():
        nonlocal requested
        if session.images > requested:
            requested = session.images
            session.send(want=1)
        return session.image != before

    session.until(what, has_changed)


def expect_quick_interrupt(arguments, session=None):
    """SIGINT ends it within half a second, in the best of a few tries: other programs may use the machine's caches."""
    best = None
    for _ in range(5):
        session = session or start_session(arguments)
        took, session = session.interrupt(), None
        best = took if best is None else min(best, took)
        if best <= MAX_STOP_CPU:
            return
    expect(False, "tarsier %s: %.2f CPU s after SIGINT" % (" ".join(arguments), best))


def cartoon():
    arguments = ["cartoon", "run", "synth:portrait?live=1", "--json"]
    s = start_session(arguments)
    s.next_image("cartoon.jpg")
    expect(s.state["frame"]["source"] == "live", "cartoon: source %s" % s.state["frame"])
    first = s.frame
    s.next_image()
    expect(s.frame > first, "cartoon: frame %d after %d" % (s.frame, first))
    expect(s.age < 60000, "cartoon: the age is %d ms" % s.age)
    images = s.images
    states = s.states
    s.until("states", lambda: s.states > states + 5)
    expect(s.images == images, "cartoon: an image without a request")
    # While paused, a redrawn image is shown; the panel of keys is not.
    perform(s, "pause", "paused", lambda state: state["paused"])
    s.next_image()
    frozen = s.next_image()
    s.send(key=ord("h"))
    s.until("help", lambda: s.state["state"]["help"])
    expect(s.next_image() == frozen, "cartoon: the panel of keys is on the image")
    expect_change(s, {"action": "sketch"}, "sketch while it is paused")
    expect_change(s, {"slider": "sketch-threshold", "value": 240}, "other lines")
    expect(s.state["sliders"]["sketch-threshold"] == 240, "cartoon: sliders %s" % s.state["sliders"])
    s.send(max_width=320, quality=50)
    small = s.next_image("cartoon-small.jpg")
    expect(s.state["width"] in (320, 640) and len(small) < len(frozen), "cartoon: the small image is %d bytes" % len(small))
    s.write(b"nonsense\n" + b"x" * 100000 + b"\n")
    perform(s, "pause", "resumed", lambda state: not state["paused"])
    expect("a line is ignored" in s.log(), "cartoon: no warning of a broken line: " + s.log())
    s.close()
    lines = [json.loads(line) for line in stdout_lines()]
    expect(any(line.get("event") == "action sketch" for line in lines), "cartoon: no line of the action")
    expect_quick_interrupt(arguments)
    # Other ways to end: q, the end of IN, the end of OUT.
    s = start_session(arguments)
    s.send(key=ord("q"))
    s.until("finished", lambda: s.state["finished"])
    s.expect_exit(0)
    s.close_pipes()
    s = start_session(arguments)
    os.close(s.to)
    s.to = None
    s.expect_exit(0)
    s.close_pipes()
    s = start_session(arguments)
    os.close(s.out)
    s.out, s.ended = None, True
    s.expect_exit(0)
    s.close_pipes()


def stdout_lines():
    return open("stdout.txt").read().splitlines()


def slow_reader():
    """Nobody reads: the program continues, and its memory does not grow."""
    s = start_session(["cartoon", "run", "synth:bars?live=1&size=1920x1080", "--json", "--mode", "none"])
    s.send(want=1)
    pid = s.program.pid

    def pages():
        return int(open("/proc/%d/statm" % pid).read().split()[1])

    def frames():
        return open("stdout.txt").read().count("\n")

    end = time.monotonic() + TIMEOUT
    while s.states < 20 and time.monotonic() < end:
        s.read()
    pages_before, index_before = pages(), int(s.state["frame"]["index"])
    time.sleep(2)  # about fifty frames arrive meanwhile
    expect(s.program.poll() is None, "slow reader: the program has ended")
    expect(pages() - pages_before < 16384, "slow reader: %d pages more" % (pages() - pages_before))
    s.until("newer state", lambda: s.state["frame"]["index"] > index_before + 20)
    s.next_image("bars.jpg")
    s.close()


def stills():
    s = start_session(["cartoon", "run", "images", "--json"])
    first = s.state["frame"]["name"]
    s.next_image("stills.jpg")
    s.send(key=0x10002)
    s.until("next image", lambda: s.state["frame"]["name"] != first)
    second = s.state["frame"]["name"]
    expect("next-image" in [action["name"] for action in s.hello["actions"]], "stills: no action next-image")
    s.send(action="next-image")
    s.until("third image", lambda: s.state["frame"]["name"] != second)
    expect(s.state["frame"]["source"] == "file" and s.state["frame"]["age_ms"] == 0, "stills: %s" % s.state["frame"])
    s.close()


def landmarks():
    arguments = ["landmarks", "track", "synth:portrait?live=1&fps=15", "--window", "--json"]
    s = start_session(arguments)
    s.until("face", lambda: s.state["state"]["faces"] == 1)
    s.next_image("landmarks.jpg")
    expect_change(s, {"action": "numbers"}, "numbers")
    perform(s, "smooth", "no smoothing", lambda state: not state["smoothing"])
    s.close()
    expect_quick_interrupt(arguments)


def annotate():
    arguments = ["landmarks", "annotate", "images", "-o", "set.yaml", "--json", "--proposals", "off"]
    s = start_session(arguments)
    s.send(max_width=512)
    s.next_image("annotate.jpg")
    # Clicks on the reduced image are mapped to points of the image.
    left, top, scale = s.state["state"]["view"]
    clicked = [(200, 150), (320, 240), (400, 300)]
    for count, (x, y) in enumerate(clicked, 1):
        at = {"x": (left + scale * x + 0.5) / 2 - 0.5, "y": (top + scale * y + 0.5) / 2 - 0.5}
        s.send(mouse="left-down", **at)
        s.send(mouse="left-up", **at)
        s.until("point %d" % count, lambda: s.state["state"]["points"] == count)
        s.next_image("annotate.jpg")
    expect(s.state["state"]["places"] == [[float(x), float(y)] for x, y in clicked], "annotate: %s" % s.state["state"]["places"])
    for stage in ("connections", "symmetry", "images"):
        s.send(key=13)
        s.until("stage " + stage, lambda: s.state["state"]["stage"] == stage)
    s.send(action="go-on")
    s.until("next image", lambda: s.state["state"]["image"] == 1)
    s.next_image("annotate-next.jpg")
    s.send(key=9)
    s.until("chosen point", lambda: s.state["state"]["selected"] == 0)
    perform(s, "hide", "hidden point", lambda state: state["places"][0] is None and state["places"][1] is not None)
    perform(s, "undo", "point again", lambda state: state["places"][0] is not None)
    s.close()
    points = json.load(open("set.yaml"))["payload"]["samples"][0]["points"]
    expect(all(abs(p[0] - w[0]) < 0.01 and abs(p[1] - w[1]) < 0.01 for p, w in zip(points, clicked)),
           "annotate: clicked %s, got %s" % (clicked, points))
    s = start_session(["landmarks", "show", "set.yaml", "--json"])
    s.next_image("show-set.jpg")
    expect_change(s, {"action": "mirrored"}, "mirrored image")
    s.close()
    expect_quick_interrupt(["landmarks", "show", "set.yaml", "--json"])


def explore():
    arguments = ["aam", "explore", "--json"]
    s = start_session(arguments)
    expect(len(s.hello["sliders"]) >= 4, "explore: sliders %s" % s.hello["sliders"])
    s.next_image("explore.jpg")
    expect_change(s, {"slider": "shape 1", "value": 2.5}, "another shape")
    s.until("slider", lambda: s.state["sliders"]["shape 1"] == 2.5 and s.state["state"]["shape"][0] == 2.5)
    expect_change(s, {"action": "mesh"}, "mesh")
    s.close()
    expect_quick_interrupt(arguments)
    s = start_session(["landmarks", "show", os.path.join(os.environ["TARSIER_SOURCE"], "models/landmarks68.json"), "--json"])
    s.next_image("show-model.jpg")
    perform(s, "next", "next patch", lambda state: state["patch"] == 1)
    s.close()


def calibrate():
    arguments = ["calibrate", "synth:board?live=1&fps=8", "--board", "chess:9x6", "--square", "25mm", "-o", "camera.yaml",
                 "--window", "--json"]
    s = start_session(arguments)
    s.until("view", lambda: s.state["state"]["views"] >= 1)
    s.next_image("calibrate.jpg")
    views = s.state["state"]["views"]
    perform(s, "undo", "view forgotten", lambda state: state["views"] != views)
    s.until("views again", lambda: s.state["state"]["views"] >= 4)
    s.send(key=ord("q"))
    s.expect_exit(0)
    s.close_pipes()
    expect(os.path.exists("camera.yaml"), "calibrate: no camera.yaml")
    expect_quick_interrupt(arguments)


def plates():
    arguments = ["plate", "read", "synth:drive", "--window", "--json"]
    s = start_session(arguments)
    begin = time.monotonic()
    s.until("half a second of the video", lambda: s.state["frame"]["time"] >= 0.5)
    expect(time.monotonic() - begin > 0.05 or s.states > 2, "plates: the video is not played at its own speed")
    s.next_image("plates.jpg")
    perform(s, "pause", "paused", lambda state: state["paused"])
    expect_change(s, {"action": "characters"}, "characters")
    s.close()
    expect_quick_interrupt(arguments)


def markers():
    arguments = ["ar", "markers", "synth:markers?live=1&fps=15", "--window", "--json"]
    s = start_session(arguments)
    s.until("markers", lambda: s.state["state"]["markers"] >= 1)
    perform(s, "cube", "cubes", lambda state: state["draw"] == "cube")
    s.next_image("markers.jpg")
    s.close()
    expect_quick_interrupt(arguments)


def people():
    arguments = ["people", "live", "synth:portrait?live=1&fps=15", "--gallery", "people.db", "--json"]
    s = start_session(arguments)
    s.until("face", lambda: s.state["state"]["recognized"])
    # The button in the image, clicked with the mouse.
    s.next_image("people.jpg")
    s.send(mouse="left-down", x=50, y=20)
    s.until("collecting", lambda: s.state["state"]["mode"] == "collect")
    s.until("faces", lambda: s.state["state"]["people"] and s.state["state"]["people"][0]["faces"] >= 2)
    perform(s, "train", "trained", lambda state: state["mode"] == "recognize")
    s.until("known face", lambda: any(face["known"] for face in s.state["state"]["recognized"]) and
            not s.state["state"]["flash"])
    s.next_image("people-known.jpg")
    s.close()
    expect_quick_interrupt(arguments)
    # Nobody is enrolled. A seen person is stored, grouped, named by typing, and then known. Then the naming is undone.
    s = start_session(["people", "live", "synth:portrait?live=1&fps=15", "--gallery", "unknown.db", "--keep", "1d", "--json"])
    s.until("sighting", lambda: s.state["state"]["unknown"]["waiting"] == 1)
    s.send(action="groups")
    s.until("group", lambda: s.state["state"]["unknown"] == {"groups": 1, "waiting": 0})
    s.until("list", lambda: s.state["state"]["panel"] and [row["id"] for row in s.state["state"]["panel"]["rows"]] == [1])
    s.next_image("people-groups.jpg")
    s.send(key=27)
    s.until("no list", lambda: s.state["state"]["panel"] is None)
    s.until("its group", lambda: [face["group"] for face in s.state["state"]["recognized"]] == [1])
    s.next_image("people-group.jpg")
    s.send(action="name")
    s.until("a name is asked for", lambda: (s.state["state"]["panel"] or {}).get("typing") == "Person 1")
    for letter in "Zoe":
        s.send(key=ord(letter))
    s.until("the name", lambda: s.state["state"]["panel"]["typing"] == "Zoe")
    s.next_image("people-naming.jpg")
    s.send(key=13)
    s.until("Zoe", lambda: any(face["known"] and face["label"] == "Zoe" for face in s.state["state"]["recognized"]))
    s.send(action="log")
    s.until("corrections", lambda: (s.state["state"]["panel"] or {}).get("list") == "corrections")
    s.next_image("people-log.jpg")
    s.send(action="undo")
    s.until("nobody", lambda: s.state["state"]["people"] == [] and s.state["state"]["unknown"]["groups"] == 1)
    s.close()


def pose():
    arguments = ["pose", "track", "synth:portrait?live=1&fps=15", "--window", "--json"]
    s = start_session(arguments)
    s.until("face", lambda: s.state["state"]["faces"] == 1)
    s.next_image("pose.jpg")
    s.send(key=ord("d"))
    perform(s, "draw", "another drawing", lambda state: state["draw"] != "axes")
    s.close()
    expect_quick_interrupt(arguments)


def online():
    s = start_session(["sfm", "reconstruct", "scene/images", "--camera-file", "scene/camera.yaml", "-o", "model",
                       "--max-features", "500", "--pairs", "sequential", "--overlap", "4", "--online", "--window", "--json"])
    s.until("model", lambda: s.state["state"]["points"] > 50)
    s.next_image("sfm.jpg")
    expect_change(s, {"key": 0x10001}, "turned cloud")
    s.close()
    expect(os.path.exists("model/points3D.txt"), "sfm: no model is written")


def viewer():
    """Frames of a remote camera, as a server passes them."""
    good = open("face.jpg", "rb").read()

    def record(image):
        return struct.pack(">I", len(image)) + image

    s = Session(["landmarks", "track", "viewer:ab12", "--window", "--json"], viewer=True)
    s.until("state", lambda: s.state)
    expect(s.state["frame"]["source"] == "connecting", "viewer: %s" % s.state["frame"])
    os.write(s.viewer, record(good))
    s.until("face", lambda: s.state["state"].get("faces") == 1)
    s.next_image("viewer.jpg")
    os.write(s.viewer, record(b"no image") + record(good[:1000]))
    s.until("stale source", lambda: s.state["frame"]["source"] == "stale")
    expect(s.log().count("is skipped") in (1, 2), "viewer: warnings: " + s.log())
    os.write(s.viewer, record(good))
    s.until("live source", lambda: s.state["frame"]["source"] == "live")
    print("viewer: %.2f CPU s after SIGINT" % s.interrupt())
    for how in ("end", "nothing", "too long"):
        s = Session(["cartoon", "run", "viewer:ab12", "--json"], viewer=True)
        os.write(s.viewer, record(good))
        s.until("frame", lambda: s.state and s.state["frame"]["index"] == 0)
        if how == "end":
            os.close(s.viewer)
            s.viewer = None
        else:
            os.write(s.viewer, struct.pack(">I", 0 if how == "nothing" else (16 << 20) + 1))
        s.expect_exit(4)
        expect(s.state["frame"]["source"] == "lost", "viewer: the last state is %s" % s.state["frame"])
        s.close_pipes()
    # A camera without a window: calibrate treats it as a session.
    s = Session(["calibrate", "viewer:ab12", "--board", "chess:9x6", "--square", "25mm", "-o", "none.yaml", "--json"],
                viewer=True)
    os.write(s.viewer, record(good))
    end = time.monotonic() + TIMEOUT
    while '"verdict":"no board"' not in s.output() and s.program.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    expect('"verdict":"no board"' in s.output(), "viewer: calibrate says " + s.output() + s.log())
    os.close(s.viewer)
    s.viewer = None
    s.expect_exit(4)
    s.close_pipes()


if __name__ == "__main__":
    checks = [cartoon, slow_reader, stills, landmarks, annotate, explore, calibrate, plates, markers, people, pose, online,
              viewer]
    selected = sys.argv[1:]
    for check in checks:
        if selected and check.__name__ not in selected:
            continue
        begin = time.monotonic()
        try:
            check()
        except Failed as error:
            expect(False, "%s: %s" % (check.__name__, error))
        print("%s: %.1f s" % (check.__name__, time.monotonic() - begin), flush=True)
    sys.exit(1 if failures else 0)
