#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Confirmed data is never lost. The server and all its children are killed at once while a user annotates and enrols,
at moments drawn with a fixed seed. The state after the next start is compared with the last answer before the kill."""

import http.client
import itertools
import os
import random
import signal
import subprocess
import sys
import threading
import time
import unittest

import pages

TARSIER = os.path.join(pages.BIN, "tarsier")
SEED = 20261123
CUTS = 6  # of each kind


def draw(*words):
    subprocess.run([TARSIER, *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=120)


def family(process):
    """A process and all its descendants, the youngest last."""
    children = {}
    for entry in os.listdir("/proc"):
        if not entry.isdigit():
            continue
        try:
            with open(f"/proc/{entry}/stat", encoding="ascii", errors="replace") as file:
                children.setdefault(int(file.read().rsplit(")", 1)[1].split()[1]), []).append(int(entry))
        except OSError:
            continue
    found = [process]
    for one in found:
        found += children.get(one, [])
    return found


def cut_power(server):
    """SIGKILL to the server and its children; returns when all have ended."""
    for process in family(server.process.pid):
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            pass
    server.process.wait()


class PowerCut(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = pages.Server()
        cls.folder = os.path.join(cls.server.workspace, "drawn")
        draw("pose", "synth", "-o", cls.folder, "--count", "8", "--people", "1")
        cls.server.call("/api/sets", {"name": "faces"})
        images = os.path.join(cls.folder, "images")
        cls.faces = sorted(os.listdir(images))
        for name in cls.faces:
            with open(os.path.join(images, name), "rb") as file:
                status, answer = cls.server.call(f"/api/sets/faces/files/{name}", file.read(), "PUT", "image/png")
            assert status == 201, answer

    @classmethod
    def tearDownClass(cls):
        cls.server.close()

    def setUp(self):
        self.random = random.Random(f"{SEED} {self.id().rsplit('.', 1)[1]}")

    def ask(self, path, data=None):
        """The decoded answer; None if the server ended before it was complete."""
        try:
            status, answer = self.server.call(path, data)
        except (OSError, http.client.HTTPException):
            return None
        self.assertIn(status, (200, 201, 204), answer)
        return answer if answer is not None else {}

    def until(self, what, condition, patience=240):
        end = time.monotonic() + patience
        while time.monotonic() < end:
            value = condition()
            if value:
                return value
            threading.Event().wait(0.01)
        self.fail(f"not in {patience} s: {what}")

    def cut_within(self, shortest, longest):
        """Cuts the power at a random moment within this range, in seconds from now."""
        timer = threading.Timer(self.random.uniform(shortest, longest), cut_power, [self.server])
        timer.start()
        return timer

    # --- annotation ---

    def annotate(self):
        session = self.ask("/api/sessions", {"verb": "landmarks annotate", "inputs": ["set:faces"], "flags": {"-o": "ws:points.json"}})
        return session["id"], self.state(session["id"])

    def state(self, name):
        def look():
            session = self.ask(f"/api/sessions/{name}")
            self.assertIsNone(session["error"], session)
            return session["state"]

        return self.until("the first view", look)

    def test_clicks_of_an_annotation(self):
        """Each click, and each undone click, is in the journal when the POST is answered."""
        kept, clicks, confirmed = [], 0, 0
        for cut in range(CUTS + 1):
            name, state = self.annotate()
            places = [tuple(place) for place in state["places"]]
            if cut > 0:
                self.assertTrue(self.is_same(places, kept) or self.is_same(places, after),
                                f"cut {cut}: {len(places)} points, {len(kept)} confirmed")
            if cut == CUTS:
                break
            kept, undone = places, 0
            x0, y0, scale = state["view"]
            timer = self.cut_within(0.05, 0.6)
            while True:
                if undone < len(kept) - len(places) and self.random.random() < 0.2:
                    events, after = [{"action": "undo"}], kept[:-1]
                else:
                    clicks += 1  # each at its own place: none hits an existing point
                    at = (20 + clicks % 23 * 12, 20 + clicks // 23 % 20 * 11)
                    x, y = x0 + scale * at[0], y0 + scale * at[1]
                    events = [{"mouse": kind, "x": x, "y": y} for kind in ("left-down", "left-up")]
                    after = [*kept, at]
                if self.ask(f"/api/sessions/{name}/events", events) is None:
                    break
                kept = after
                confirmed += 1
            timer.join()
            self.server.start()
        print(f"annotation: {CUTS} cuts, {confirmed} clicks confirmed, {len(places)} points kept")
        self.assertGreater(confirmed, 2 * CUTS)

    # --- enrolment ---

    def faces_of(self, name):
        """Number of faces of a person in the gallery. It opens, whatever happened to its last writer."""
        if not os.path.exists(os.path.join(self.server.workspace, "gallery")):
            return 0
        listed = self.ask("/api/run", {"verb": "people list"})
        self.assertIn(listed["exit"], (0, 1), listed)
        return sum(one["faces"] for one in listed["lines"] if one["name"] == name)

    def test_enrolment_from_images(self):
        """As the page does it: one image at a time, each with its own answer."""
        confirmed = 0
        for _ in range(3):
            before, taken, timer = self.faces_of("Ann"), 0, None
            for name in itertools.cycle(self.faces):
                answer = self.ask("/api/run", {"verb": "people enroll", "inputs": ["Ann", f"set:faces/{name}"],
                                               "flags": {"--any-quality": True, "--note": "agreed"}})
                if answer is None:
                    break
                taken += answer["lines"][-1]["added"]
                timer = timer or self.cut_within(0, 1.5)
            timer.join()
            self.server.start()
            self.assertIn(self.faces_of("Ann"), (before + taken, before + taken + 1))
            confirmed += taken
        print(f"enrolment from images: 3 cuts, {confirmed} faces confirmed, {self.faces_of('Ann')} kept")

    def test_enrolment_in_a_session(self):
        """A face that the page shows as taken is in the gallery."""
        confirmed = kept = 0
        for cut in range(3):
            name = f"Ben {cut}"
            request = {"verb": "people live", "inputs": ["synth:portrait?live=1&fps=10"],
                       "flags": {"--names": name, "--min-seconds": 0, "--min-difference": 0, "--faces": 1000}}
            path = f"/api/sessions/{self.ask('/api/sessions', request)['id']}"

            def taken():
                session = self.ask(path)
                if session is None:
                    return None
                self.assertIsNone(session["error"], session)
                return sum(one["faces"] for one in (session["state"] or {}).get("people", []) if one["name"] == name)

            self.until("the window", lambda: self.ask(path)["actions"])
            self.ask(path + "/events", [{"action": "add"}])
            self.until("the first face", taken)
            timer = self.cut_within(0, 0.8)
            while True:
                now = taken()
                if now is None:
                    break
                seen = now
            timer.join()
            self.server.start()
            found = self.faces_of(name)
            self.assertGreaterEqual(found, seen)
            self.assertGreater(seen, 0)
            confirmed, kept = confirmed + seen, kept + found
        print(f"enrolment in a session: 3 cuts, {confirmed} faces confirmed, {kept} kept")

    def test_enrolment_as_a_job(self):
        """An interrupted job reports this, and has what it had confirmed. Repeated, it adds the rest."""
        before = self.faces_of("Cleo")
        request = {"verb": "people enroll", "inputs": ["Cleo", "set:faces"], "flags": {"--any-quality": True}}
        job = self.ask("/api/jobs", request)["id"]
        self.until("it runs", lambda: self.ask(f"/api/jobs/{job}")["state"] == "running")
        cut_power(self.server)
        self.server.start()
        reply = self.ask(f"/api/jobs/{job}")
        self.assertEqual(reply["state"], "interrupted", reply)
        self.assertIn("again", reply["error"])
        self.assertGreaterEqual(self.faces_of("Cleo"), before)
        self.ask(f"/api/jobs/{job}/again", {})
        reply = self.until("its end", lambda: (lambda now: now if now["ended"] else None)(self.ask(f"/api/jobs/{job}")))
        self.assertEqual(reply["state"], "done", reply)
        self.assertGreaterEqual(self.faces_of("Cleo"), reply["lines"][-1]["added"])

    def is_same(self, places, others):
        return len(places) == len(others) and all(
            abs(a - b) < 1.5 for one, other in zip(places, others) for a, b in zip(one, other))


if __name__ == "__main__":
    if not os.path.exists(os.path.join(pages.BIN, "tarsier-serve")):
        print(f"skipped: no tarsier-serve in {pages.BIN}")
        sys.exit(pages.SKIPPED)
    unittest.main(verbosity=2)
