#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Jobs and runs on the real server: results, cancellation, the queue, and what remains after a kill."""

import base64
import json
import os
import signal
import sys
import threading
import time
import unittest

import pages


def children_of(server):
    """Command lines of processes that work in the server's workspace, except the server."""
    found = []
    for entry in os.listdir("/proc"):
        if not entry.isdigit() or int(entry) == server.process.pid:
            continue
        try:
            with open(f"/proc/{entry}/cmdline", "rb") as file:
                words = file.read().split(b"\0")
        except OSError:
            continue
        text = b" ".join(words)
        if server.workspace.encode() in text and b"serve" not in words[1:2] and b"tarsier-serve" not in words[0]:
            found.append(text.decode(errors="replace"))
    return found


def until(what, patience=300):
    """Waits until what() returns something; returns the last value."""
    end = time.monotonic() + patience
    while True:
        value = what()
        if value or time.monotonic() > end:
            return value
        threading.Event().wait(0.05)


LONG = {"verb": "sfm synth", "flags": {"--output": "out:scene", "--images": 500, "--size": "640x480"}}
SHORT = {"verb": "ar marker-sheet", "flags": {"--output": "out:sheet.png", "--ids": "0-1", "--size": "40mm", "--family": "4x4_50"}}


class JobsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = pages.Server()

    @classmethod
    def tearDownClass(cls):
        cls.server.close()

    def start(self, request):
        status, job = self.server.call("/api/jobs", request)
        self.assertEqual(status, 201, job)
        return job["id"]

    def job(self, name):
        return self.server.call(f"/api/jobs/{name}")[1]

    def wait(self, name, *states):
        job = until(lambda: (lambda now: now if now["state"] in states else None)(self.job(name)))
        self.assertIsNotNone(job, self.job(name))
        return job

    def test_a_job_to_its_end(self):
        name = self.start({**SHORT, "name": "Two markers <b>"})
        job = self.wait(name, "done", "failed")
        self.assertEqual((job["state"], job["exit"], job["error"], job["name"]), ("done", 0, None, "Two markers <b>"))
        self.assertEqual([(file["name"], file["kind"]) for file in job["files"]], [("sheet.png", "image")])
        self.assertTrue(job["command"].startswith("tarsier ar marker-sheet"))
        self.assertLessEqual(job["created"], job["started"])
        self.assertEqual(self.server.call(f"/api/jobs/{name}/files/sheet.png")[1][:4], b"\x89PNG")
        self.assertEqual(self.server.call(f"/api/jobs/{name}/files/sheet.png?width=64")[1][:2], b"\xff\xd8")
        self.assertEqual(self.server.call(f"/api/jobs/{name}/log")[0], 200)
        self.assertIn(name, [one["id"] for one in self.server.call("/api/jobs")[1]["jobs"]])
        # Its result is the input of another job.
        run = self.server.call("/api/run", {"verb": "ar markers", "inputs": [f"job:{name}/sheet.png"],
                                                "flags": {"--family": "4x4_50"}})[1]
        self.assertEqual(run["exit"], 0, run)
        self.assertEqual(sorted(marker["id"] for marker in run["lines"][0]["markers"]), [0, 1])
        self.assertEqual(run["lines"][0]["image"], f"job:{name}/sheet.png")
        again = self.server.call(f"/api/jobs/{name}/again", {})
        self.assertEqual(again[0], 201)
        self.assertNotEqual(again[1]["id"], name)
        self.wait(again[1]["id"], "done")
        for one in (name, again[1]["id"]):
            self.assertEqual(self.server.call(f"/api/jobs/{one}", method="DELETE")[0], 204)
            self.assertEqual(self.server.call(f"/api/jobs/{one}")[0], 404)
            self.assertFalse(os.path.exists(os.path.join(self.server.workspace, "jobs", one)))

    def test_cancel_and_the_queue(self):
        first, second = self.start(LONG), self.start(LONG)
        job = until(lambda: (lambda now: now if now["progress"] and now["progress"]["done"] else None)(self.job(first)))
        self.assertEqual((job["state"], job["progress"]["total"], job["progress"]["unit"]), ("running", 500, "images"))
        self.assertEqual(self.job(second)["state"], "queued")
        self.assertEqual(self.server.call(f"/api/jobs/{first}", method="DELETE")[0], 409)
        self.assertEqual(self.server.call(f"/api/jobs/{first}/again", {})[0], 409)
        self.assertEqual(self.server.call(f"/api/jobs/{second}/cancel", {})[0], 202)
        self.assertEqual(self.job(second)["state"], "cancelled")
        begun = time.monotonic()
        self.assertEqual(self.server.call(f"/api/jobs/{first}/cancel", {})[0], 202)
        self.wait(first, "cancelled")
        self.assertLess(time.monotonic() - begun, 9, "SIGINT is enough")
        self.assertEqual(self.server.call(f"/api/jobs/{first}/cancel", {})[0], 409)
        self.assertFalse(until(lambda: not children_of(self.server)) is False)

    def test_a_job_that_fails(self):
        self.server.call("/api/sets", {"name": "empty"})
        job = self.wait(self.start({"verb": "sfm reconstruct", "inputs": ["set:empty"], "flags": {"-o": "out:model"}}), "failed", "done")
        self.assertEqual((job["state"], job["exit"]), ("failed", 3), job)
        self.assertTrue(job["error"].startswith("set:empty"), job["error"])
        self.assertIn("error", self.server.call(f"/api/jobs/{job['id']}/log")[1].decode())

    def test_verbs_that_are_forbidden(self):
        before = len(os.listdir(os.path.join(self.server.workspace, "jobs")))
        for request in (
            {"verb": "serve"}, {"verb": "demo"}, {"verb": "help"}, {"verb": "sh -c id"}, {"verb": ""}, {}, {"verb": 3},
            {"verb": "cartoon run", "inputs": ["/etc/passwd"]}, {"verb": "cartoon run", "inputs": ["http://127.0.0.1/"]},
            {"verb": "cartoon run", "inputs": ["@/etc/passwd"]}, {"verb": "cartoon run", "inputs": ["0"]},
            {"verb": "cartoon run", "inputs": ["set:../x"]}, {"verb": "cartoon run", "inputs": ["allowed:nobody"]},
            {"verb": "cartoon run", "inputs": ["viewer:x"]}, {"verb": "cartoon run", "inputs": ["synth:scene"], "flags": {"-o": "/tmp/x.png"}},
            {"verb": "cartoon run", "inputs": ["synth:scene"], "flags": {"-o": "http://0.0.0.0:8080/"}},
            {"verb": "cartoon run", "inputs": ["synth:scene"], "flags": {"--listen-all": True}},
            {"verb": "cartoon run", "inputs": ["synth:scene"], "flags": {"--config": "set:a/b.toml"}},
            {"verb": "plate read", "inputs": ["synth:car"], "flags": {"--on-event": "/bin/sh"}},
            {"verb": "people list", "flags": {"--gallery": "/etc/passwd"}}, {"verb": "models list", "flags": {"--models-dir": "/"}},
            {"verb": "cartoon run", "inputs": "synth:scene"}, {"verb": "cartoon run", "flags": []}, [],
        ):
            for path in ("/api/jobs", "/api/run"):
                status, answer = self.server.call(path, request)
                self.assertEqual(status, 400, f"{path} {request}: {answer}")
                self.assertNotIn("\n", answer["error"])
        self.assertEqual(len(os.listdir(os.path.join(self.server.workspace, "jobs"))), before)

    def test_runs(self):
        status, run = self.server.call("/api/run", {"verb": "models list"})
        self.assertEqual((status, run["exit"], run["error"]), (200, 0, None))
        self.assertGreater(len(run["lines"]), 3)
        # Drawn images are included.
        status, run = self.server.call("/api/run", {"verb": "cartoon run", "inputs": ["synth:portrait?frames=1"],
                                                    "flags": {"--mode": "sketch", "-o": "out:drawn.png"}})
        self.assertEqual((status, [file["name"] for file in run["files"]]), (200, ["drawn.png"]), run)
        self.assertEqual(base64.b64decode(run["files"][0]["base64"])[:4], b"\x89PNG")
        # The verb itself checks what the policy accepted.
        status, run = self.server.call("/api/run", {"verb": "cartoon run", "inputs": ["synth:none"]})
        self.assertEqual((status, run["exit"]), (422, 3), run)
        status, run = self.server.call("/api/run", {"verb": "cartoon run", "inputs": ["synth:scene"], "flags": {"--mode": "none-such"}})
        self.assertEqual((status, run["exit"]), (400, 2), run)
        self.assertEqual(os.listdir(os.path.join(self.server.workspace, ".studio", "runs")), [])

    def test_people_and_plates(self):
        """The job results that the pages of people and plates show."""
        name = self.start({"verb": "pose synth", "flags": {"--output": "out:heads", "--count": 4, "--people": 2}})
        self.assertEqual(self.wait(name, "done", "failed")["state"], "done")
        person = "-Ann <b>é"
        enrol = self.server.call("/api/run", {"verb": "people enroll", "inputs": [person, f"job:{name}/heads/images/0000.png"],
                                              "flags": {"--any-quality": True, "--note": "agreed / 2026"}})[1]
        self.assertEqual(enrol["exit"], 0, enrol)
        people = self.server.call("/api/run", {"verb": "people list"})[1]["lines"]
        self.assertEqual([(one["name"], one["note"]) for one in people], [(person, "agreed / 2026")])
        self.assertTrue(os.path.exists(os.path.join(self.server.workspace, "gallery")))
        exported = self.start({"verb": "people export", "flags": {"--output": "out:export"}})
        self.assertIn("export/people.json", [file["name"] for file in self.wait(exported, "done", "failed")["files"]])
        self.assertEqual(self.server.call(f"/api/jobs/{exported}", method="DELETE")[0], 204)
        status, gone = self.server.call("/api/run", {"verb": "people forget", "inputs": [person]})
        self.assertEqual((status, gone["lines"][0]["proven"]), (200, True), gone)
        log = self.start({"verb": "plate read", "inputs": ["synth:drive?frames=12"], "flags": {"--log": "ws:plates.db", "--events": True}})
        self.assertEqual(self.wait(log, "done", "failed")["state"], "done")
        found = self.server.call("/api/run", {"verb": "plate log", "inputs": ["ws:plates.db"],
                                              "flags": {"--since": "12h", "--limit": 5, "--crops": "out:crops"}})[1]
        self.assertEqual(len(found["files"]), len(found["lines"]))
        best = max(found["lines"], key=lambda line: line["confidence"])
        text = best["text"]
        self.assertIn(f"crops/{best['id']}-{text}.jpg", [file["name"] for file in found["files"]])
        near = {"--text": text[:-1] + "?", "--near": True}
        self.assertEqual(len(self.server.call("/api/run", {"verb": "plate log", "inputs": ["ws:plates.db"], "flags": near})[1]["lines"]), 1)
        events = [line["event"] for line in self.server.call("/api/audit")[1]["lines"]]
        for event in ("enrol", "forget", "export"):
            self.assertIn(event, events)
        self.assertNotIn("Ann", json.dumps(self.server.call("/api/audit")[1]))

    def test_a_model_during_reconstruction(self):
        scene = self.start({"verb": "sfm synth", "flags": {"--output": "out:scene", "--images": 5, "--size": "400x300"}})
        self.assertEqual(self.wait(scene, "done", "failed")["state"], "done")
        name = self.start({"verb": "sfm reconstruct", "inputs": [f"job:{scene}/scene/images"],
                           "flags": {"--output": "out:model", "--growing": True}})
        seen = set()

        def look():
            job = self.job(name)
            seen.update(file["name"] for file in job["files"])
            return job if job["state"] not in ("queued", "running") else None

        job = until(look)
        self.assertEqual((job["state"], job["exit"]), ("done", 0), job)
        self.assertIn("model/growing/points3D.txt", seen)
        left = [file["name"] for file in job["files"]]
        self.assertIn("model/points3D.txt", left)
        self.assertFalse([file for file in left if "growing" in file])
        self.assertEqual({one["registered"] for one in job["lines"][-1]["images"]}, {True})

    def test_a_curve_of_training(self):
        plates = self.start({"verb": "plate synth", "flags": {"--output": "out:plates", "--count": 6}})
        self.assertEqual(self.wait(plates, "done", "failed")["state"], "done")
        name = self.start({"verb": "plate train-detector", "inputs": [f"job:{plates}/plates"],
                           "flags": {"--output": "out:detector.json", "--steps": 2, "--aligner-steps": 2}})
        job = self.wait(name, "done", "failed")
        self.assertEqual(job["state"], "done", job)
        curve = [line for line in job["lines"] if "loss" in line]
        stages = list(dict.fromkeys(line["progress"] for line in curve))
        self.assertEqual(stages, ["detector", "aligner"], job["lines"])

    def test_the_feed_reports_jobs(self):
        import http.client
        import struct
        with open(os.path.join(self.server.workspace, ".studio", "api-token"), encoding="utf-8") as file:
            token = file.read().strip()
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=30)
        connection.request("GET", "/api/live?jobs=1", headers={"Authorization": f"Bearer {token}"})
        answer = connection.getresponse()
        self.assertEqual(answer.status, 200)
        name = self.start(SHORT)
        states = []
        while "done" not in states:
            length, = struct.unpack(">I", answer.read(4))
            record = answer.read(length)
            size = record[1]
            if record[0] == 4 and record[2:2 + size].decode() == name:
                states.append(json.loads(record[2 + size:])["state"])
        connection.close()


class KillTest(unittest.TestCase):
    def test_kill_during_jobs(self):
        server = pages.Server()
        try:
            done = server.call("/api/jobs", SHORT)[1]["id"]
            until(lambda: server.call(f"/api/jobs/{done}")[1]["state"] == "done")
            running = server.call("/api/jobs", LONG)[1]["id"]
            waiting = server.call("/api/jobs", SHORT)[1]["id"]
            until(lambda: server.call(f"/api/jobs/{running}")[1]["progress"])
            self.assertTrue(children_of(server))
            server.stop(signal.SIGKILL)
            self.assertTrue(until(lambda: not children_of(server)), children_of(server))
            server.start()
            job = server.call(f"/api/jobs/{running}")[1]
            self.assertEqual(job["state"], "interrupted", job)
            self.assertIn("again", job["error"])
            self.assertEqual(server.call(f"/api/jobs/{done}")[1]["state"], "done")
            self.assertEqual(server.call(f"/api/jobs/{done}/files/sheet.png")[1][:4], b"\x89PNG")
            self.assertTrue(until(lambda: server.call(f"/api/jobs/{waiting}")[1]["state"] == "done"), "what waited is done")
            self.assertEqual(server.call(f"/api/jobs/{running}/again", {})[1]["id"], running)
            self.assertTrue(until(lambda: server.call(f"/api/jobs/{running}")[1]["state"] == "running"))
            server.stop()  # a normal stop: it ends its children
            self.assertFalse(children_of(server))
            server.start()
            self.assertEqual(server.call(f"/api/jobs/{running}")[1]["state"], "interrupted")
        finally:
            server.close()

    def test_kill_during_a_run(self):
        server = pages.Server()
        try:
            request = {"verb": "sfm synth", "flags": {"--output": "out:scene", "--images": 200}}
            thread = threading.Thread(target=lambda: self.assertRaises(Exception, server.call, "/api/run", request), daemon=True)
            thread.start()
            self.assertTrue(until(lambda: children_of(server)))
            server.stop(signal.SIGKILL)
            self.assertTrue(until(lambda: not children_of(server)), children_of(server))
            thread.join(10)
            server.start()
            self.assertEqual(os.listdir(os.path.join(server.workspace, ".studio", "runs")), [])
        finally:
            server.close()


if __name__ == "__main__":
    if not os.path.exists(os.path.join(pages.BIN, "tarsier-serve")):
        print(f"skipped: no tarsier-serve in {pages.BIN}")
        sys.exit(pages.SKIPPED)
    unittest.main(verbosity=2)
