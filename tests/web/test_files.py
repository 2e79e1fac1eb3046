#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Sets, files and state of a workspace on the real server: what is stored, what is refused, and what remains after a kill."""

import http.client
import os
import signal
import socket
import stat
import struct
import sys
import unittest
import urllib.parse
import zlib

import pages


def png(width, height, rows=None):
    """A PNG whose header states this size; only `rows` rows are present."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    data = b"".join(b"\0" + bytes((x * 7 + y) % 256 for x in range(width * 3)) for y in range(height if rows is None else rows))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))


def form(*files):
    """A body of type multipart/form-data and its content type."""
    body = b"".join(b'--bound\r\nContent-Disposition: form-data; name="file"; filename="' + name.encode()
                    + b'"\r\nContent-Type: image/png\r\n\r\n' + data + b"\r\n" for name, data in files)
    return body + b"--bound--\r\n", "multipart/form-data; boundary=bound"


class FilesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = pages.Server()

    @classmethod
    def tearDownClass(cls):
        cls.server.close()

    def setUp(self):
        self.name = self.id().rsplit(".", 1)[1]
        self.assertEqual(self.server.call("/api/sets", {"name": self.name})[0], 201)

    def tearDown(self):
        self.server.call(f"/api/sets/{self.name}", method="DELETE")

    def put(self, file, data, kind="application/octet-stream"):
        return self.server.call(f"/api/sets/{self.name}/files/{urllib.parse.quote(file, safe='')}", data, "PUT", kind)

    def files(self):
        return [file["name"] for file in self.server.call(f"/api/sets/{self.name}")[1]["files"]]

    def raw(self, method, path, body=None, headers=None):
        """A request whose path is sent unchanged."""
        with open(os.path.join(self.server.workspace, ".studio", "api-token"), encoding="utf-8") as file:
            token = file.read().strip()
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=30)
        connection.putrequest(method, path)
        connection.putheader("Authorization", f"Bearer {token}")
        for key, value in (headers or {}).items():
            connection.putheader(key, value)
        if body is not None:
            connection.putheader("Content-Length", str(len(body)))
        connection.endheaders(body)
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer.status, answer.headers, data

    def test_store_read_delete(self):
        data = png(40, 30)
        status, file = self.put("Grüße (1).png", data)
        self.assertEqual(status, 201, file)
        self.assertEqual((file["width"], file["height"], file["kind"], file["bytes"]), (40, 30, "image", len(data)))
        self.assertEqual(self.files(), ["Grüße (1).png"])
        path = f"/api/sets/{self.name}/files/" + urllib.parse.quote("Grüße (1).png")
        status, headers, body = self.raw("GET", path)
        self.assertEqual((status, headers["Content-Type"], body), (200, "image/png", data))
        self.assertEqual(headers["X-Content-Type-Options"], "nosniff")
        self.assertEqual(self.put("Grüße (1).png", png(50, 20))[1]["width"], 50)
        self.assertEqual(self.server.call(path, method="DELETE")[0], 204)
        self.assertEqual(self.server.call(path)[0], 404)
        self.assertEqual(self.server.call(path, method="DELETE")[0], 404)

    def test_thumbnails(self):
        self.put("a.png", png(400, 300))
        status, headers, body = self.raw("GET", f"/api/sets/{self.name}/files/a.png?width=100")
        self.assertEqual((status, headers["Content-Type"]), (200, "image/jpeg"))
        self.assertTrue(body.startswith(b"\xff\xd8"))
        kept = os.path.join(self.server.workspace, ".studio", "thumbnails")
        self.assertEqual(len(os.listdir(kept)), 1)
        self.put("a.png", png(300, 300))
        self.assertEqual(os.listdir(kept), [], "a thumbnail of what was replaced")
        self.assertEqual(self.raw("GET", f"/api/sets/{self.name}/files/a.png?width=100")[0], 200)
        self.put("b.png", png(300, 300))
        self.assertEqual(self.raw("GET", f"/api/sets/{self.name}/files/b.png?width=100")[0], 200)
        self.assertEqual(self.server.call(f"/api/sets/{self.name}/files/b.png", method="DELETE")[0], 204)
        self.assertEqual(len(os.listdir(kept)), 1)
        for width in ("0", "x", "99999", "-1", "1e3"):
            self.assertEqual(self.server.call(f"/api/sets/{self.name}/files/a.png?width={width}")[0], 400, width)
        self.put("a.txt", b"a.png\n")
        self.assertEqual(self.server.call(f"/api/sets/{self.name}/files/a.txt?width=100")[0], 415)
        self.assertEqual(self.server.call(f"/api/sets/{self.name}", method="DELETE")[0], 204)
        self.assertEqual(os.listdir(kept), [], "a thumbnail of a set that was deleted")

    def test_forms(self):
        body, kind = form(("image.png", png(10, 10)), ("image.png", png(20, 10)), ("C:\\photos\\b.png", png(30, 10)))
        status, answer = self.server.call(f"/api/sets/{self.name}/files", body, "POST", kind)
        self.assertEqual(status, 201, answer)
        self.assertEqual([file["name"] for file in answer["files"]], ["image.png", "image (2).png", "b.png"])
        body, kind = form(("../../escape.png", png(10, 10)))
        status, answer = self.server.call(f"/api/sets/{self.name}/files", body, "POST", kind)
        self.assertEqual((status, answer["files"][0]["name"]), (201, "escape.png"))
        for name in ("..", ".hidden", "a\\..", "*"):
            body, kind = form((name, png(10, 10)))
            self.assertEqual(self.server.call(f"/api/sets/{self.name}/files", body, "POST", kind)[0], 400, name)
        body, kind = form(("c.png", png(10, 10)))
        self.assertEqual(self.server.call(f"/api/sets/{self.name}/files", body[:-20], "POST", kind)[0], 400)
        self.assertEqual(self.server.call(f"/api/sets/{self.name}/files", b"nonsense", "POST", kind)[0], 400)
        self.assertEqual(self.server.call(f"/api/sets/{self.name}/files", body, "POST", "multipart/form-data")[0], 415)
        self.assertEqual(self.server.call("/api/sets/none/files", *[body, "POST", kind])[0], 404)

    def test_hostile_names(self):
        for path in ("/api/sets/..", "/api/sets/%2e%2e", "/api/sets/..%2f..%2fetc", "/api/sets/%2fetc", "/api/sets/.studio",
                     "/api/sets/a%00b", f"/api/sets/{self.name}/../{self.name}", f"/api/sets/{self.name}/files/..%2f..%2f.studio%2fapi-token",
                     f"/api/sets/{self.name}/files/%2e%2e", "/api/sets/%ff", "/api/sets/" + "a" * 200, "/api/state/.studio", "/api/state/..",
                     "/api/state/sets", "/api/state/jobs", "/api/jobs/..", "/api/jobs/../files/x", "/api/jobs/x/files/../job.json",
                     "/api/jobs/x/files/%2e%2e/job.json", "/api/sets//files/x"):
            for method in ("GET", "DELETE"):
                status, _, body = self.raw(method, path)
                self.assertIn(status, (400, 404, 405), f"{method} {path}: {body[:100]}")
        for name in ("", ".", "..", ".x", "a/b", "a\\b", "a\nb", "*", "[a]", "?", "x" * 121, " a", "\u202e", None, 3, {}):
            self.assertEqual(self.server.call("/api/sets", {"name": name})[0], 400, repr(name))
        # A name with markup is shown as text.
        name = "<img src=x onerror=alert(1)>"
        self.assertEqual(self.put(name + ".png", png(5, 5))[0], 201)
        status, headers, body = self.raw("GET", f"/api/sets/{self.name}")
        self.assertEqual((status, headers["Content-Type"].split(";")[0]), (200, "application/json"))
        self.assertIn(name.encode(), body)

    def test_links_are_not_followed(self):
        folder = os.path.join(self.server.workspace, "sets", self.name)
        os.symlink("/etc/passwd", os.path.join(folder, "link.txt"))
        os.symlink("/etc", os.path.join(self.server.workspace, "sets", "linked"))
        os.symlink("/etc/passwd", os.path.join(self.server.workspace, "linked.txt"))
        try:
            self.assertEqual(self.files(), [])
            self.assertEqual(self.server.call(f"/api/sets/{self.name}/files/link.txt")[0], 404)
            self.assertEqual(self.server.call("/api/sets/linked")[0], 404)
            self.assertNotIn("linked", [entry["name"] for entry in self.server.call("/api/sets")[1]["sets"]])
            self.assertEqual(self.server.call("/api/sets/linked/files/passwd")[0], 404)
            self.assertEqual(self.server.call("/api/sets/linked", method="DELETE")[0], 404)
            self.assertEqual(self.server.call("/api/state/linked.txt")[0], 404)
            for reference in (f"set:{self.name}/link.txt", "set:linked", "set:linked/passwd", "ws:linked.txt"):
                status, answer = self.server.call("/api/run", {"verb": "landmarks show", "inputs": [reference],
                                                               "flags": {"--output": "out:sheet.png"}})
                self.assertEqual(status, 400, answer)
        finally:
            os.unlink(os.path.join(self.server.workspace, "sets", "linked"))
            os.unlink(os.path.join(self.server.workspace, "linked.txt"))

    def test_unreadable_images(self):
        for file, data in (("bomb.png", png(60000, 60000, 0)), ("cut.png", png(50, 50)[:100]), ("page.html", b"<script>1</script>"),
                           ("page.png", b"<script>1</script>"), ("drawing.svg", b"<svg onload='alert(1)'/>"), ("empty.png", b""),
                           ("list.mp4", b"#EXTM3U\nfile:///etc/passwd\n"), ("list.txt", b"/etc/passwd\n"),
                           ("set.json", b'{"image": "../../secret.jpg"}'), ("program", b"\x7fELF")):
            status, answer = self.put(file, data)
            self.assertIn(status, (400, 415), file)
            self.assertIn("error", answer, file)
        self.assertEqual(self.files(), [])
        # Files that a browser must not execute are downloads.
        self.assertEqual(self.put("data.json", b'{"a": "<script>"}')[0], 201)
        _, headers, _ = self.raw("GET", f"/api/sets/{self.name}/files/data.json")
        self.assertEqual(headers["Content-Type"], "application/octet-stream")
        self.assertTrue(headers["Content-Disposition"].startswith("attachment"))

    def test_large_files(self):
        status, _, body = self.raw("PUT", f"/api/sets/{self.name}/files/a.txt", None, {"Content-Length": str((64 << 20) + 1)})
        self.assertEqual(status, 413, body)
        self.assertEqual(self.put("b.txt", b"a" * (3 << 20))[0], 201)

    def test_sets(self):
        self.assertEqual(self.server.call("/api/sets", {"name": self.name})[0], 409)
        self.assertEqual(self.server.call("/api/sets/none")[0], 404)
        self.assertEqual(self.server.call("/api/sets/none", method="DELETE")[0], 404)
        self.assertEqual(self.server.call("/api/sets/none/files/a.png", png(5, 5), "PUT", "image/png")[0], 404)
        self.put("a.png", png(5, 5))
        entry = [one for one in self.server.call("/api/sets")[1]["sets"] if one["name"] == self.name][0]
        self.assertEqual(entry["files"], 1)
        mode = os.stat(os.path.join(self.server.workspace, "sets", self.name, "a.png")).st_mode
        self.assertEqual(stat.S_IMODE(mode), 0o600)

    def test_state(self):
        status, answer = self.server.call("/api/run", {"verb": "ar marker-sheet", "inputs": [],
                                                       "flags": {"--output": "ws:sheet.png", "--ids": "0-1", "--size": "40mm"}})
        self.assertEqual((status, answer["exit"]), (200, 0), answer)
        self.assertIn("sheet.png", [file["name"] for file in self.server.call("/api/state")[1]["files"]])
        self.assertEqual(self.raw("GET", "/api/state/sheet.png")[2][:4], b"\x89PNG")
        self.assertEqual(self.server.call("/api/state/sheet.png", method="DELETE")[0], 204)
        self.assertEqual(self.server.call("/api/state/sheet.png")[0], 404)


class KillTest(unittest.TestCase):
    def test_kill_during_an_upload(self):
        server = pages.Server()
        try:
            self.assertEqual(server.call("/api/sets", {"name": "a"})[0], 201)
            self.assertEqual(server.call("/api/sets/a/files/kept.png", png(40, 30), "PUT", "image/png")[0], 201)
            self.assertEqual(server.call("/api/sets/a/files/old.png", png(40, 30), "PUT", "image/png")[0], 201)
            with open(os.path.join(server.workspace, ".studio", "api-token"), encoding="utf-8") as file:
                token = file.read().strip()
            for name in ("new.png", "old.png"):  # half of the file
                half = socket.create_connection(("127.0.0.1", server.port))
                half.sendall(f"PUT /api/sets/a/files/{name} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
                             f"Authorization: Bearer {token}\r\nContent-Type: image/png\r\nContent-Length: 1000000\r\n\r\n".encode()
                             + b"x" * 300000)
                self.addCleanup(half.close)
            server.call("/api/sets")  # after one more request, both halves have arrived
            server.stop(signal.SIGKILL)
            server.start()
            files = server.call("/api/sets/a")[1]["files"]
            self.assertEqual([(file["name"], file["width"]) for file in files], [("kept.png", 40), ("old.png", 40)])
            self.assertEqual(os.listdir(os.path.join(server.workspace, ".studio", "uploads")), [])
        finally:
            server.close()

    def test_one_server_a_workspace(self):
        server = pages.Server()
        try:
            with self.assertRaisesRegex(RuntimeError, "another server"):  # it prints no link
                pages.Server(workspace=server.workspace)
            self.assertEqual(server.call("/api/sets")[0], 200)
        finally:
            server.close()

    def test_quota(self):
        server = pages.Server("--quota", "0.001")  # GB
        try:
            self.assertEqual(server.call("/api/sets", {"name": "a"})[0], 201)
            self.assertEqual(server.call("/api/sets/a/files/a.txt", b"a" * 600_000, "PUT", "text/plain")[0], 201)
            self.assertEqual(server.call("/api/sets/a/files/b.txt", b"a" * 600_000, "PUT", "text/plain")[0], 507)
            status, answer = server.call("/api/sets/a/files/c.txt", b"a" * 600_000, "PUT", "text/plain")
            self.assertEqual(status, 507)
            self.assertIn("delete", answer["error"])
            self.assertEqual(server.call("/api/jobs", {"verb": "ar marker-sheet", "flags": {"-o": "out:a.png"}})[0], 201)
            self.assertEqual(server.call("/api/sets/a", method="DELETE")[0], 204)
            self.assertEqual(server.call("/api/sets", {"name": "b"})[0], 201)
            self.assertEqual(server.call("/api/sets/b/files/c.txt", b"a" * 600_000, "PUT", "text/plain")[0], 201)
        finally:
            server.close()


if __name__ == "__main__":
    if not os.path.exists(os.path.join(pages.BIN, "tarsier-serve")):
        print(f"skipped: no tarsier-serve in {pages.BIN}")
        sys.exit(pages.SKIPPED)
    unittest.main(verbosity=2)
