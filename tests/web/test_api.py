#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The documented interface of the studio: every curl example is run, every verb that accepts images answers with its schema,
and Prometheus can read the metrics."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.error
import urllib.request

import pages

TARSIER = os.path.join(pages.BIN, "tarsier")


def draw(*words):
    subprocess.run([TARSIER, *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=120)


def check(value, schema, schemas, where="answer"):
    """The part of JSON Schema that the description uses."""
    if "$ref" in schema:
        return check(value, schemas[schema["$ref"].rsplit("/", 1)[1]], schemas, where)
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool, "null": type(None)}
    assert not types or any(isinstance(value, kinds[kind]) for kind in types), f"{where}: {value!r:.100} is no {types}"
    assert "enum" not in schema or value in schema["enum"], f"{where}: {value!r} is none of {schema['enum']}"
    if isinstance(value, dict):
        for name in schema.get("required", []):
            assert name in value, f"{where}: no {name} in {list(value)}"
        for name, inner in schema.get("properties", {}).items():
            if name in value:
                check(value[name], inner, schemas, f"{where}.{name}")
    if isinstance(value, list):
        assert len(value) >= schema.get("minItems", 0) and len(value) <= schema.get("maxItems", 1 << 30), f"{where}: {len(value)} items"
        for item in value:
            check(item, schema.get("items", {}), schemas, where + "[]")
    return None


class ApiTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = pages.Server()
        cls.folder = tempfile.mkdtemp(prefix="tarsier-api-")
        for name, source in (("photo", "synth:portrait?frames=1"), ("car", "synth:drive?frames=1"), ("desk", "synth:markers?frames=1"),
                             ("cover", "synth:scene?frames=1")):
            draw("cartoon", "run", source, "--mode", "none", "-o", os.path.join(cls.folder, name + ".jpg"))
        draw("cartoon", "run", "synth:board?frames=120&fps=10", "--every", "20", "--mode", "none", "-o", os.path.join(cls.folder, "boards"))
        boards = sorted(os.listdir(os.path.join(cls.folder, "boards")))
        for number, name in enumerate(boards[1:5], 1):
            shutil.copy(os.path.join(cls.folder, "boards", name), os.path.join(cls.folder, f"board{number}.jpg"))
        cls.api = cls.server.call("/api/openapi.json")[1]
        with open(os.path.join(cls.server.workspace, ".studio", "api-token"), encoding="utf-8") as file:
            cls.token = file.read().strip()

    @classmethod
    def tearDownClass(cls):
        cls.server.close()
        shutil.rmtree(cls.folder)

    def ask(self, path, method="GET", token=None):
        request = urllib.request.Request(self.server.origin + path, method=method)
        if token:
            request.add_header("Authorization", f"Bearer {token}")
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.status, answer.headers, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.headers, error.read()

    def job(self, request):
        """A job that has ended."""
        name = self.server.call("/api/jobs", request)[1]["id"]
        end = time.monotonic() + 60
        while self.server.call(f"/api/jobs/{name}")[1]["state"] in ("queued", "running") and time.monotonic() < end:
            threading.Event().wait(0.05)
        return name

    def curl(self, source, extra):
        environment = {**os.environ, "TARSIER_URL": self.server.origin, "TARSIER_TOKEN": self.token, **extra}
        return subprocess.run(["bash", "-c", source], cwd=self.folder, env=environment, capture_output=True, timeout=90, check=False)

    def example(self, operation):
        return [sample["source"] for sample in operation["x-codeSamples"]]

    def test_every_example_of_curl(self):
        paths = self.api["paths"]
        everything = {(method, path): operation for path, methods in paths.items() for method, operation in methods.items()}
        self.assertGreater(len(everything), 40)
        done = set()

        def run(method, path, code=0, **extra):
            for source in self.example(everything[method, path]):
                result = self.curl(source, extra)
                self.assertEqual(result.returncode, code, f"{source}\n{result.stdout[:300]!r} {result.stderr!r}")
            done.add((method, path))

        sets, file, state = "/api/sets/{name}", "/api/sets/{name}/files/{file}", "/api/state/{name}"
        run("post", "/api/sets")
        run("put", file)
        run("post", "/api/sets/{name}/files")
        for path in ("/api/sets", sets, file):
            run("get", path)
        # Verbs on images; some need the results of others.
        self.assertEqual(self.server.call("/api/run", {"verb": "people enroll", "inputs": ["Ann", "set:holiday/photo.jpg"],
                                                       "flags": {"--any-quality": True}})[1]["exit"], 0)
        with open(os.path.join(self.folder, "cover.jpg"), "rb") as cover:
            self.server.call("/api/sets/holiday/files/cover.jpg", cover.read(), "PUT", "image/jpeg")
        made = self.server.call("/api/run", {"verb": "ar target-train", "inputs": ["set:holiday/cover.jpg"],
                                             "flags": {"-o": "ws:cover.target.json", "--width": "20cm"}})[1]
        self.assertEqual(made["exit"], 0, made)
        verbs = [path for path in paths if path.startswith("/api/v1/")]
        self.assertGreaterEqual(len(verbs), 11)
        for path in sorted(verbs):
            run("post", path)
        run("post", "/api/run")
        # Jobs: the job of the description is long and needs other images, so it is cancelled.
        run("post", "/api/jobs")
        newest = self.server.call("/api/jobs")[1]["jobs"][0]["id"]
        self.server.call(f"/api/jobs/{newest}/cancel", {})
        drawn = self.job({"verb": "cartoon run", "inputs": ["set:holiday/photo.jpg"], "flags": {"-o": "out:drawn.png"}})
        one = "/api/jobs/{id}"
        for path in ("/api/jobs", one, one + "/log", one + "/lines", one + "/files/{path}"):
            run("get", path, JOB=drawn)
        long = self.server.call("/api/jobs", {"verb": "sfm synth", "flags": {"-o": "out:scene", "--images": 300}})[1]["id"]
        run("post", one + "/cancel", JOB=long)
        run("post", one + "/again", JOB=drawn)
        run("delete", one, JOB=drawn)
        # Live sessions.
        run("post", "/api/sessions")
        session = self.server.call("/api/sessions")[1]["sessions"][0]["id"]
        for method, path in (("get", "/api/sessions"), ("get", "/api/sessions/{id}"), ("post", "/api/sessions/{id}/events"),
                             ("get", "/api/sources")):
            run(method, path, SESSION=session)
        end = time.monotonic() + 30
        while not self.server.call(f"/api/sessions/{session}")[1]["frames"] and time.monotonic() < end:
            threading.Event().wait(0.1)
        run("get", "/api/sessions/{id}/snapshot.jpg", SESSION=session)
        run("get", "/api/sessions/{id}/stages", SESSION=session)
        # 204 if the next frame is late. On a busy machine the request is repeated.
        stages = os.path.join(self.folder, "stages.bin")
        while time.monotonic() < end + 60 and not (os.path.exists(stages) and os.path.getsize(stages)):
            run("get", "/api/sessions/{id}/stages", SESSION=session)
        run("get", "/api/sessions/{id}/stream.mjpg", 28, SESSION=session)  # endless stream: curl ends by its time limit
        run("get", "/api/live", 28, SESSION=session)
        for name in ("snapshot.jpg", "stream.mjpg", "live.bin", "stages.bin"):
            self.assertGreater(os.path.getsize(os.path.join(self.folder, name)), 1000, name)
        run("delete", "/api/sessions/{id}", SESSION=session)
        run("post", "/api/viewer-cameras")
        camera = self.server.call("/api/viewer-cameras", {})[1]["id"].removeprefix("viewer:")
        run("post", "/api/viewer-cameras/{id}/frame", VIEWER=camera)
        run("delete", "/api/viewer-cameras/{id}", VIEWER=camera)
        # Other requests.
        draw("cartoon", "run", "synth:scene?frames=1", "--mode", "none", "-o", os.path.join(self.server.workspace, "x.png"))
        shutil.move(os.path.join(self.server.workspace, "x.png"), os.path.join(self.server.workspace, "camera.yaml"))
        for path in ("/api/state", state, "/metrics", "/healthz", "/api/info", "/api/help", "/api/openapi.json", "/api/audit", "/api/session"):
            run("get", path)
        run("delete", state)
        run("delete", file)
        run("delete", sets)
        run("get", "/api/sign-ins")
        run("post", "/api/api-token", 22)  # refused for a program
        for _ in range(2):
            self.server.call("/api/session", {"token": self.server.new_link().split("#t=")[1]})
        signed_in = self.server.call("/api/sign-ins")[1]["sign_ins"]
        self.assertEqual(len(signed_in), 2)
        run("delete", "/api/sign-ins/{id}", SIGN_IN=signed_in[0]["id"])
        run("delete", "/api/sign-ins")
        run("post", "/api/session", 22)  # the token of the example is not valid
        done.add(("delete", "/api/session"))  # needs a browser's cookie
        self.assertEqual(set(everything) - done, set(), "examples that nobody ran")

    def test_every_verb_answers_with_its_schema(self):
        self.server.call("/api/sets", {"name": "schemas"})
        schemas = self.api["components"]["schemas"]
        for name, path, image, query in (("plates", "plate/read", "car", ""), ("faces", "landmarks/fit", "photo", ""), ("faces", "pose/track", "photo", ""),
                                         ("markers", "ar/markers", "desk", ""), ("faces", "people/identify", "photo", ""), ("faces", "cartoon/run", "photo", "?mode=paint")):
            if name == "faces" and "people" in path:
                self.server.call("/api/run", {"verb": "people enroll", "inputs": ["Ann", "synth:portrait?frames=1"], "flags": {"--any-quality": True}})
            with open(os.path.join(self.folder, image + ".jpg"), "rb") as file:
                status, answer = self.server.call(f"/api/v1/{path}{query}", file.read(), "POST", "image/jpeg")
            self.assertEqual(status, 200, f"{path}: {answer}")
            self.assertIn(name, answer, path)
            operation = self.api["paths"][f"/api/v1/{path}"]["post"]
            check(answer, operation["responses"]["200"]["content"]["application/json"]["schema"], schemas, path)
            self.assertEqual(answer["image"], "image", path)
            self.assertNotIn(self.server.workspace, json.dumps(answer), "no path of the server")
        check(self.server.call("/api/run", {"verb": "models list"})[1], schemas["Run"], schemas)
        name = self.job({"verb": "models list"})
        check(self.server.call(f"/api/jobs/{name}")[1], schemas["Job"], schemas)

    def test_unreadable_images(self):
        for body, kind, wanted in ((b"", "image/jpeg", 400), (b"nonsense", "image/jpeg", 415), (b"<svg/>", "image/png", 415),
                                   (b"{}", "application/json", 415), (b"\xff\xd8\xff\xe0 cut", "image/jpeg", 415)):
            status, answer = self.server.call("/api/v1/plate/read", body, "POST", kind)
            self.assertEqual(status, wanted, answer)
            self.assertIn("error", answer)
        with open(os.path.join(self.folder, "photo.jpg"), "rb") as file:
            photo = file.read()
        for path, wanted in (("/api/v1/plate/none", 404), ("/api/v1/sfm/reconstruct", 404), ("/api/v1/serve", 404), ("/api/v1/plate/read?x=1", 400),
                             ("/api/v1/plate/read?on-event=id", 400), ("/api/v1/plate/read?output=/tmp/x", 400), ("/api/v1/plate/read?top=x", 400),
                             ("/api/v1/plate/read?top=1000", 400), ("/api/v1/plate/read?detector=/etc/passwd", 400), ("/api/v1/people/verify", 400)):
            status, answer = self.server.call(path, photo, "POST", "image/jpeg")
            self.assertEqual(status, wanted, f"{path}: {answer}")

    def test_metrics(self):
        status, headers, body = self.ask("/metrics", token=self.token)
        self.assertEqual(status, 200)
        self.assertTrue(headers["Content-Type"].startswith("text/plain; version=0.0.4"))
        names = set()
        for line in body.decode().splitlines():
            if line.startswith("#"):
                self.assertRegex(line, r"^# (HELP [a-z_]+ .+|TYPE [a-z_]+ (gauge|counter))$")
                continue
            self.assertRegex(line, r'^[a-z_]+(\{([a-z_]+="([^"\\\n]|\\.)*",?)*\})? [0-9.e+-]+$')
            names.add(re.match("[a-z_]+", line).group(0))
        for name in ("tarsier_jobs", "tarsier_http_requests_total", "tarsier_resident_memory_bytes", "tarsier_uptime_seconds", "tarsier_workspace_bytes"):
            self.assertIn(name, names)

    def test_without_sign_in(self):
        for path, methods in self.api["paths"].items():
            for method, operation in methods.items():
                if operation.get("security") == [] or path == "/api/session":
                    continue
                concrete = re.sub(r"\{[a-z]+\}", "x", path)
                for token in (None, "wrong"):
                    status, _, _ = self.ask(concrete, method.upper(), token)
                    self.assertIn(status, (401, 429), f"{method} {path} with {token}")
        self.assertEqual(self.ask("/healthz")[0], 200)

    def test_about(self):
        info = self.server.call("/api/info")[1]
        for name in ("version", "machine", "workspace", "limits", "uptime_s", "tls"):
            self.assertIn(name, info)
        self.assertEqual(info["workspace"]["path"], self.server.workspace)
        verbs = self.server.call("/api/help")[1]
        check(verbs, self.api["components"]["schemas"]["Help"], self.api["components"]["schemas"])
        self.assertGreater(len(verbs["verbs"]), 60)
        found = {verb["verb"]: verb["needs_output"] for verb in verbs["verbs"] if "needs_output" in verb}
        self.assertEqual(found.get("landmarks show"), ["--output"])
        for count in ("0", "x", "9999"):
            self.assertEqual(self.server.call(f"/api/audit?count={count}")[0], 400)


if __name__ == "__main__":
    if not os.path.exists(os.path.join(pages.BIN, "tarsier-serve")):
        print(f"skipped: no tarsier-serve in {pages.BIN}")
        sys.exit(pages.SKIPPED)
    if shutil.which("curl") is None:
        print("skipped: no curl")
        sys.exit(pages.SKIPPED)
    unittest.main(verbosity=2)
