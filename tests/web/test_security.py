#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The rules that protect the studio, each on the real server: who has access, where it listens, what is refused, and that hostile
clients do not affect the others."""
import http.client
import json
import os
import random
import re
import socket
import ssl
import stat
import struct
import subprocess
import sys
import threading
import time

from wire import IMAGE, TARSIER, Studio, run_tests, wait_until

POLICY = ("default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
          "worker-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'")


def raw(studio, text, seconds=5, source="127.0.0.1"):
    """Sends raw bytes; returns the answer until the end, or until no data came for `seconds` s."""
    with socket.socket() as client:
        client.settimeout(seconds)
        client.bind((source, 0))
        client.connect(("127.0.0.1", studio.port))
        client.sendall(text)
        answer = b""
        try:
            while True:
                piece = client.recv(65536)
                if not piece:
                    break
                answer += piece
                head, mark, body = answer.partition(b"\r\n\r\n")
                length = re.search(rb"(?i)content-length: (\d+)", head)
                if mark and length and len(body) >= int(length.group(1)):
                    break
        except (socket.timeout, ConnectionError):
            pass
        return answer


def status_of(answer):
    return int(answer.split(b" ", 2)[1]) if answer.startswith(b"HTTP/1.") else 0


def expect(answer, status, what):
    assert answer.status == status, f"{what}: {answer.status} {answer.body[:200]!r}, expected {status}"
    if status >= 400:
        assert list(answer.json()) == ["error"], (what, answer.body)


def test_api_needs_a_sign_in():
    with Studio(sign_in=False) as studio:
        for path in ("/api/info", "/api/help", "/api/sources", "/api/sessions", "/api/live", "/api/sets", "/api/jobs",
                     "/api/audit", "/metrics", "/api/openapi.json"):
            expect(studio.get(path), 401, path)
        for path in ("/api/sessions", "/api/jobs", "/api/run", "/api/sets", "/api/viewer-cameras"):
            expect(studio.post(path, {}), 401, path)
        assert studio.get("/api/session").json()["signed_in"] is False
        assert "csrf" not in studio.get("/api/session").json()
        assert studio.get("/healthz").status == 200
        page = studio.get("/")
        assert page.status == 200 and b"<html" in page.body
        assert studio.get("/people").body == page.body


def test_the_link_signs_in_once():
    with Studio(sign_in=False) as studio:
        answer = studio.post("/api/session", {"token": studio.token()})
        assert answer.status == 200
        cookie = answer.headers["Set-Cookie"]
        for part in ("tarsier_session=", "HttpOnly", "SameSite=Strict", "Path=/"):
            assert part in cookie, cookie
        assert "Secure" not in cookie, "without TLS a browser would drop it"
        expect(studio.post("/api/session", {"token": studio.token()}), 401, "a used token")
        # Another link for another browser; the first browser stays signed in.
        first = cookie.split(";")[0]
        studio.link = studio.new_link()
        studio.sign_in()
        for own in (first, studio.cookie):
            assert studio.get("/api/info", headers={"Cookie": own}).status == 200
        # Signing out ends only this session.
        assert studio.ask("DELETE", "/api/session").status == 204
        assert studio.get("/api/info").status == 401
        assert studio.get("/api/info", headers={"Cookie": first}).status == 200


def test_the_token_is_in_the_fragment():
    with Studio(sign_in=False) as studio:
        # Browsers do not send the fragment. So it is in no request, no log of a proxy, and no Referer.
        assert re.fullmatch(re.escape(studio.url) + "#t=[0-9a-f]{64}", studio.link), studio.link
        assert re.fullmatch(re.escape(studio.url) + "#t=[0-9a-f]{64}", studio.new_link())


def test_concurrent_requests_use_a_link_once():
    with Studio(sign_in=False) as studio:
        results = []
        barrier = threading.Barrier(6)

        def attempt():
            barrier.wait()
            results.append(studio.post("/api/session", {"token": studio.token()}).status)

        threads = [threading.Thread(target=attempt) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(results) == [200] + [401] * 5, results


def test_sign_in_attempts_are_limited():
    with Studio(sign_in=False) as studio:
        statuses = [studio.post("/api/session", {"token": f"{i:064x}"}).status for i in range(14)]
        assert statuses[:10] == [401] * 10 and statuses[10:] == [429] * 4, statuses
        refused = studio.post("/api/session", {"token": studio.token()})
        expect(refused, 429, "also the right one")
        assert 1 <= int(refused.headers["Retry-After"]) <= 60
        # Other clients are not locked out, and the token was not used up.
        other = studio.post("/api/session", {"token": studio.token()}, source="127.0.0.9")
        assert other.status == 200, other.body
        # A client that is not our proxy cannot state another address: 14 names count as one address.
        named = [studio.post("/api/session", {"token": f"{i:064x}"}, headers={"X-Forwarded-For": f"203.0.113.{i}"},
                             source="127.0.0.10").status for i in range(14)]
        assert named[:10] == [401] * 10 and named[10:] == [429] * 4, named
        bearer = [studio.get("/api/info", headers={"Authorization": f"Bearer {i:064x}"}, source="127.0.0.8").status
                  for i in range(13)]
        assert bearer[:10] == [401] * 10 and bearer[10:] == [429] * 3, bearer
        events = [json.loads(line) for line in open(os.path.join(studio.workspace, ".studio", "audit.log"), encoding="utf-8")]
        kinds = [event["event"] for event in events]
        assert kinds.count("sign-in refused") == 29 and "sign-in" in kinds and "api token refused" in kinds, kinds
        text = json.dumps(events)
        assert studio.token() not in text and "0000000000000000000000000000000001" not in text


def test_api_token_of_programs():
    with Studio() as studio:
        own = {"Authorization": "Bearer " + studio.api_token()}
        assert studio.get("/api/info", headers=own).status == 200
        # No CSRF header: no browser sends one by itself.
        assert studio.post("/api/sets", {"name": "x"}, headers=own).status == 201
        expect(studio.get("/api/info", headers={"Authorization": "Bearer x"}), 401, "a wrong one")
        expect(studio.get("/api/info", headers={"Authorization": "Basic " + studio.api_token()}), 401, "another scheme")


def test_secrets_are_in_private_files():
    with Studio() as studio:
        folder = os.path.join(studio.workspace, ".studio")
        assert stat.S_IMODE(os.stat(folder).st_mode) == 0o700
        assert stat.S_IMODE(os.stat(os.path.join(folder, "api-token")).st_mode) == 0o600
        secret = studio.cookie.split("=")[1]
        for path, _, names in os.walk(studio.workspace):
            for name in names:
                with open(os.path.join(path, name), "rb") as file:
                    text = file.read()
                assert secret.encode() not in text and secret not in name, f"{name} holds the cookie"
                assert studio.token().encode() not in text and studio.token() not in name, f"{name} holds the token"
        log = "".join(studio.errors)
        assert secret not in log and studio.token() not in log and studio.api_token() not in log


def test_sign_ins_survive_a_restart():
    first = Studio()
    try:
        cookie, csrf, link = first.cookie, first.csrf, first.new_link()
        first.interrupt()
        with Studio(workspace=first.workspace, sign_in=False) as second:
            second.cookie, second.csrf = cookie, csrf
            assert second.get("/api/info").status == 200
            assert second.post("/api/sets", {"name": "kept"}).status == 201
            assert second.get("/api/session").json()["csrf"] == csrf
            assert second.post("/api/session", {"token": link.split("#t=")[1]}, headers={}).status == 200
    finally:
        first.own = True
        first.close()


def test_foreign_hosts_are_refused():
    with Studio() as studio:
        own = studio.headers()
        for host in ("evil.example", f"evil.example:{studio.port}", "127.0.0.1", "127.0.0.1:1", f"127.0.0.2:{studio.port}",
                     f"localhost.evil.example:{studio.port}", f"127.0.0.1:{studio.port}@evil.example", "", f"[::2]:{studio.port}"):
            for path in ("/", "/api/session", "/api/info", "/healthz"):
                answer = studio.get(path, headers={**own, "Host": host})
                assert answer.status in (400, 421), (host, path, answer.status)
        for host in (f"127.0.0.1:{studio.port}", f"localhost:{studio.port}", f"LOCALHOST:{studio.port}", f"[::1]:{studio.port}"):
            assert studio.get("/api/info", headers={**own, "Host": host}).status == 200, host
        # libmicrohttpd itself refuses HTTP/1.1 without Host; it would accept HTTP/1.0.
        assert status_of(raw(studio, b"GET /api/session HTTP/1.0\r\n\r\n")) == 400
        assert status_of(raw(studio, b"GET /api/session HTTP/1.1\r\n\r\n")) == 400


def test_other_sites_are_refused():
    with Studio() as studio:
        own = studio.headers()
        origin = f"http://{studio.host}"
        for foreign in ("http://evil.example", "null", f"https://{studio.host}", "http://127.0.0.1:1", "http://localhost",
                        origin + ".evil.example", "file://"):
            for method, path in (("GET", "/api/info"), ("GET", "/"), ("POST", "/api/sets"), ("POST", "/api/session")):
                answer = studio.ask(method, path, None if method == "GET" else '{"name":"a","token":"b"}',
                                    {**own, "Origin": foreign, "Content-Type": "application/json"})
                expect(answer, 403, f"{method} {path} from {foreign}")
        for site in ("cross-site", "same-site", "anything"):
            expect(studio.get("/api/info", headers={**own, "Sec-Fetch-Site": site}), 403, site)
            expect(studio.post("/api/sets", {"name": "a"}, headers={**own, "Sec-Fetch-Site": site}), 403, site)
            # An image or a frame in another page.
            expect(studio.get("/", headers={"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors",
                                            "Sec-Fetch-Dest": "image"}), 403, site)
            expect(studio.get("/", headers={"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate",
                                            "Sec-Fetch-Dest": "iframe"}), 403, site)
            # A link may lead to the page, not to the data; a form of another site may lead to nothing.
            link = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
            assert studio.get("/live", headers=link).status == 200
            expect(studio.get("/api/info", headers={**own, **link}), 403, site)
            expect(studio.get("/metrics", headers={**own, **link}), 403, site)
            expect(studio.post("/live", {}, headers={**own, **link}), 403, site)
        for site in ("same-origin", "none"):
            assert studio.get("/api/info", headers={**own, "Sec-Fetch-Site": site, "Origin": origin}).status == 200
        assert studio.get("/api/sets").json()["sets"] == []


def files_of(folder):
    found = {}
    for path, _, names in os.walk(folder):
        for name in names:
            with open(os.path.join(path, name), "rb") as file:
                found[os.path.join(path, name)] = file.read()
    return found


def test_a_link_from_another_site_shows_and_changes_nothing():
    """The only request that another site can cause. Its answer is the same for everybody, and nothing of it is stored."""
    with Studio() as studio:
        studio.post("/api/sets", {"name": "secret-holiday"})
        studio.start_session("cartoon run", ["synth:bars?live=1&size=64x48&fps=1"])
        link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
        sessions = [one["id"] for one in studio.get("/api/sessions").json()["sessions"]]
        before = files_of(studio.workspace)
        for path in ("/", "/live", "/people", "/session/" + sessions[0], "/reconstruct?job=x", "/train?data=set:a", "/nothing", "/healthz"):
            signed_in = studio.get(path, headers={**studio.headers(), **link})
            stranger = studio.get(path, headers={})
            assert signed_in.status == stranger.status and signed_in.body == stranger.body, path
            assert "Set-Cookie" not in signed_in.headers, path
            for word in ("secret-holiday", studio.csrf, studio.cookie.split("=")[1]):
                assert word.encode() not in signed_in.body, path
        assert files_of(studio.workspace) == before
        assert [one["id"] for one in studio.get("/api/sessions").json()["sessions"]] == sessions


def test_get_requests_change_nothing():
    """Each change has an address that does not accept GET, which a link or an image can cause."""
    with Studio() as studio:
        camera = studio.post("/api/viewer-cameras", {}).json()["id"]
        session = studio.start_session("cartoon run", ["synth:bars?live=1&size=64x48&fps=1"])["id"]
        changes = ("/api/run", "/api/jobs/x/cancel", "/api/jobs/x/again", f"/api/sessions/{session}/events", "/api/viewer-cameras",
                   f"/api/viewer-cameras/{camera[7:]}", f"/api/viewer-cameras/{camera[7:]}/frame", "/api/sets/x/files",
                   "/api/v1/plate/read")
        for path in changes:
            for method in ("GET", "HEAD"):
                answer = studio.ask(method, path)
                assert answer.status in (404, 405), (method, path, answer.status)
        before = files_of(studio.workspace)
        for path in ("/api/session", "/api/info", "/api/help", "/api/sources", "/api/sessions", "/api/sets", "/api/jobs",
                     "/api/state", "/api/audit", "/api/openapi.json", "/metrics"):
            assert studio.get(path).status == 200, path
        assert files_of(studio.workspace) == before
        assert camera in [one["id"] for one in studio.get("/api/sources").json()["sources"]], "its end is a DELETE"
        assert studio.get("/api/sessions").json()["sessions"][0]["running"]


def test_changes_need_the_csrf_header_and_json():
    with Studio() as studio:
        cookie = {"Cookie": studio.cookie}
        body = {"name": "a"}
        expect(studio.post("/api/sets", body, headers=cookie), 403, "no CSRF header")
        expect(studio.post("/api/sets", body, headers={**cookie, "X-Tarsier-CSRF": studio.csrf[:-1] + "x"}), 403, "wrong")
        expect(studio.post("/api/sets", body, headers={**cookie, "X-Tarsier-CSRF": ""}), 403, "empty")
        for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "", "text/json"):
            expect(studio.post("/api/sets", body, headers={**studio.headers(), "Content-Type": kind}), 415, kind)
            expect(studio.post("/api/session", {"token": "x"}, headers={"Content-Type": kind}), 415, kind)
        expect(studio.ask("DELETE", "/api/session", headers=cookie), 403, "signing out by another page")
        assert studio.get("/api/sets").json()["sets"] == []
        expect(studio.ask("GET", "/api/info", body="{}"), 400, "a body with GET")
        assert studio.post("/api/sets", body).status == 201
        for kind in ("Application/JSON", "application/json; charset=utf-8"):
            assert studio.post("/api/sets", {"name": kind[:3] + kind[-3:]},
                               headers={**studio.headers(), "Content-Type": kind}).status == 201


def test_responses_carry_the_policy():
    with Studio() as studio:
        for path, headers in (("/", {}), ("/live", {}), ("/api/session", {}), ("/api/info", {}), ("/nothing.js", {}),
                              ("/api/info", studio.headers()), ("/", {"Host": "evil.example"})):
            answer = studio.get(path, headers=headers)
            got = {name.lower(): value for name, value in answer.headers.items()}
            assert got["content-security-policy"] == POLICY, (path, got)
            assert got["x-content-type-options"] == "nosniff"
            assert got["referrer-policy"] == "no-referrer"
            assert got["cross-origin-opener-policy"] == "same-origin"
            assert got["cross-origin-resource-policy"] == "same-origin"
            assert got["permissions-policy"].startswith("camera=(self), microphone=()")
            assert got["x-frame-options"] == "DENY"
            assert "access-control-allow-origin" not in got
            if path.startswith("/api"):
                assert got["cache-control"] == "no-store"


def test_malformed_paths_and_bodies():
    with Studio() as studio:
        own = "".join(f"{name}: {value}\r\n" for name, value in studio.headers().items())
        for path in ("/../etc/passwd", "/api/../api/info", "/assets/../../etc/passwd", "/%2e%2e/etc/passwd", "/assets/%2e%2e/x",
                     "/assets/..%2f..%2fetc/passwd", "/assets/..%5cx", "/a//b", "/a/./b", "/api/sets/a%00b", "/%zz", "/%", "//evil",
                     "http://evil.example/", "/api/sets/x%2Fy", "/api/sets/a%0ab"):
            answer = raw(studio, f"GET {path} HTTP/1.1\r\nHost: {studio.host}\r\n{own}\r\n".encode())
            assert status_of(answer) == 400, (path, answer[:200])
        for query in ("a=%zz", "&".join(f"a{i}=1" for i in range(300)), "a=%00"):
            expect(studio.get("/api/info?" + query), 400, query[:20])
        for body in (b"{", b"", b"[1]", b'{"verb":1}', b"\xff\xfe", b"[" * 5000, b'{"a":' * 2000 + b"1" + b"}" * 2000):
            answer = studio.ask("POST", "/api/sessions", body, {**studio.headers(), "Content-Type": "application/json"})
            assert answer.status in (400, 415), (body[:20], answer.status)
        assert "nested" in answer.json()["error"], answer.body
        expect(studio.ask("POST", "/api/sessions", b" " * 70000, {**studio.headers(), "Content-Type": "application/json"}), 413,
               "a large body")
        head = f"POST /api/sets HTTP/1.1\r\nHost: {studio.host}\r\n{own}Content-Type: application/json\r\n"
        assert status_of(raw(studio, f"{head}Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n".encode())) == 411
        assert status_of(raw(studio, f"{head}Content-Length: 99999999999\r\n\r\n".encode())) == 413
        assert status_of(raw(studio, f"{head}Content-Length: -5\r\n\r\n".encode())) in (0, 400)
        expect(studio.ask("PATCH", "/api/sets"), 405, "a method")
        answer = studio.ask("DELETE", "/api/sources")
        expect(answer, 405, "a method")
        assert answer.headers["Allow"] == "GET"
        expect(studio.get("/api/nothing"), 404, "no such address")
        # A head that is too long, or too many fields: refused or cut off, and the server continues.
        raw(studio, b"GET /" + b"a" * 100000 + b" HTTP/1.1\r\n\r\n")
        raw(studio, b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 20000 + b"\r\n")
        head = f"GET / HTTP/1.1\r\nHost: {studio.host}\r\n".encode()
        assert status_of(raw(studio, head + b"".join(b"X%d: y\r\n" % i for i in range(300)) + b"\r\n")) == 431
        assert status_of(raw(studio, head + b"X: " + b"y" * 50000 + b"\r\n\r\n")) in (0, 400, 413, 431)
        raw(studio, b"\x16\x03\x01\x02\x00\x01\x00" + random.Random(1).randbytes(200), 1)
        raw(studio, random.Random(2).randbytes(2000), 1)
        assert studio.get("/api/info").status == 200
        assert studio.process.poll() is None


def test_free_sources_and_dangerous_flags_are_refused():
    secret = "rtsp://user:hunter2@127.0.0.1:1/stream"
    with Studio("--allow-source", f"door={secret}") as studio:
        for source in ("/dev/video0", "0", "rtsp://evil.example/", "http://169.254.169.254/", "/etc/passwd", "file:///etc/passwd",
                       "@list.txt", "*.jpg", "../x", "allowed:nothing", "camera:-1", "camera:0;id", "set:../../etc", "ws:../x",
                       "viewer:none", "--on-event=id", "-", "picam:", "door", secret):
            answer = studio.post("/api/sessions", {"verb": "cartoon run", "inputs": [source]})
            assert answer.status in (400, 404), (source, answer.status, answer.body)
            assert "hunter2" not in answer.body.decode() or source == secret
        for flags in ({"--on-event": "id"}, {"--config": "/etc/passwd"}, {"--output": "/tmp/x"}, {"--nothing": "1"},
                      {"--output": "http://0.0.0.0:80/"}, {"mode": "sketch"}, {"--mode": ["a", {}]}):
            answer = studio.post("/api/sessions", {"verb": "cartoon run", "inputs": ["synth:portrait?live=1&fps=8&size=320x240"], "flags": flags})
            assert answer.status == 400, (flags, answer.status, answer.body)
        # A value that looks like a flag is treated as a value.
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&fps=8&size=320x240"], {"--mode": "--json"})
        wait_until(lambda: studio.get("/api/sessions/" + session["id"]).json()["exit"] == 2, what="a usage error")
        assert studio.ask("DELETE", "/api/sessions/" + session["id"]).status == 204
        for verb in ("serve", "demo", "help", "bench cartoon", "rm", "cartoon", ""):
            answer = studio.post("/api/sessions", {"verb": verb, "inputs": []})
            assert answer.status in (400, 404), (verb, answer.body)
        assert studio.get("/api/sessions").json()["sessions"] == []
        assert b"hunter2" not in studio.get("/api/sources").body
        # The allowed source is shown by its name everywhere.
        session = studio.start_session("cartoon run", ["allowed:door"], {})
        wait_until(lambda: not studio.get("/api/sessions/" + session["id"]).json()["running"], what="the end without a camera")
        body = studio.get("/api/sessions").body + studio.get("/api/audit").body
        assert b"hunter2" not in body and b"user:" not in body, body
        assert "hunter2" not in "".join(studio.errors)
        assert studio.get("/api/sessions/" + session["id"]).json()["error"]


def test_slow_clients_are_closed():
    with Studio() as studio:
        slow = []
        for _ in range(20):
            client = socket.create_connection(("127.0.0.1", studio.port), source_address=("127.0.0.7", 0))
            client.sendall(f"GET / HTTP/1.1\r\nHost: {studio.host}\r\n".encode())
            slow.append(client)
        begin = time.monotonic()
        ended = [False] * len(slow)
        while not all(ended) and time.monotonic() - begin < 25:
            for i, client in enumerate(slow):
                if ended[i]:
                    continue
                try:
                    client.sendall(b"X-A: b\r\n")  # one field per second prevents an idle timeout
                    client.settimeout(0.01)
                    ended[i] = client.recv(100) == b""
                except socket.timeout:
                    pass
                except OSError:
                    ended[i] = True
            time.sleep(0.5)
        took = time.monotonic() - begin
        assert all(ended), f"{ended.count(False)} slow clients still open"
        assert 5 < took < 20, took
        for client in slow:
            client.close()
        assert studio.get("/api/info").status == 200


def is_open(client):
    client.setblocking(False)
    try:
        return client.recv(1) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def test_browsers_have_sixteen_cameras():
    with Studio() as studio:
        made = [studio.post("/api/viewer-cameras", {}) for _ in range(17)]
        assert [answer.status for answer in made] == [201] * 16 + [409], made[-1].body
        assert studio.ask("DELETE", "/api/viewer-cameras/" + made[0].json()["id"].split(":")[1]).status == 204
        assert studio.post("/api/viewer-cameras", {}).status == 201


def test_a_paused_viewer_gets_new_images():
    """Images that a slow viewer missed are not kept for it, neither in the server nor in the socket."""
    with Studio() as studio:
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&size=320x240&fps=20"], {"--mode": "none"})
        live = studio.live([session["id"]], receive_buffer=2048)
        live.wait_for(IMAGE)

        def frames():
            return studio.get("/api/sessions/" + session["id"]).json()["frames"]

        begin = frames()
        wait_until(lambda: frames() > begin + 40, what="40 frames that nobody reads")
        newest, old = frames(), 0
        while struct.unpack(">I", live.wait_for(IMAGE)[2][:4])[0] < newest - 1:
            old += 1
        assert old <= 4, f"{old} old images were kept for a viewer that did not read"
        live.close()


def test_200_clients_do_not_block_others():
    with Studio() as studio:
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&size=320x240"])
        live = studio.live([session["id"]])
        live.wait_for(IMAGE)
        hostile = []

        def open_some(count, source):
            for i in range(count):
                try:
                    client = socket.create_connection(("127.0.0.1", studio.port), 5, source_address=(source, 0))
                    client.sendall(b"GET / HTTP/1.1\r\nX-Slow: " if i % 2 else b"")
                    hostile.append(client)
                except OSError:
                    pass

        threads = [threading.Thread(target=open_some, args=(40, f"127.0.1.{k + 1}")) for k in range(5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        # If one address exceeds its share, its own oldest connections are closed, no others.
        open_some(100, "127.0.2.1")
        for k in range(4):
            open_some(40, f"127.0.3.{k + 1}")
        # The page is answered, also for the address of the hostile clients, and the images continue.
        # A request may be refused while older connections are being closed; the next one is answered.
        def answered(source):
            try:
                return studio.get("/api/info", source=source).status == 200
            except ConnectionError:
                return False

        wait_until(lambda: answered("127.0.0.1"), 5, "an answer within 5 s")
        wait_until(lambda: answered("127.0.2.1"), what="an answer for the address of the hostile ones")
        for _ in range(5):
            live.wait_for(IMAGE, seconds=5)
        # 64 per address, 256 in total, each with its thread.
        def connections():
            return float(re.search(r"^tarsier_http_connections (\S+)$", studio.get("/metrics").body.decode(), re.M).group(1))

        wait_until(lambda: connections() <= 257, 5, "no more than 256 connections")  # before slow heads are closed anyway
        of_one = sum(is_open(client) for client in hostile if client.getsockname()[0] == "127.0.2.1")
        assert of_one <= 64, of_one
        threads_now = len(os.listdir(f"/proc/{studio.process.pid}/task"))
        assert threads_now < 400, threads_now
        for client in hostile:
            client.close()
        live.close()
        assert studio.get("/api/info").status == 200


def test_uploads_stay_in_their_folder():
    with Studio() as studio:
        assert studio.post("/api/sets", {"name": "a"}).status == 201
        image = bytes.fromhex("89504e470d0a1a0a0000000d4948445200000001000000010806000000"
                                "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082")
        own = {**studio.headers(), "Content-Type": "image/png"}
        for name in ("..%2f..%2fx.png", "%2e%2e", ".hidden.png", "a%5cb.png", "a%00.png", "%2fetc%2fx.png"):
            answer = studio.ask("PUT", f"/api/sets/a/files/{name}", image, own)
            assert answer.status in (400, 404), (name, answer.status)
        for name in ("..", ".studio", "a/b", ""):
            expect(studio.post("/api/sets", {"name": name}), 400, name)
        assert studio.ask("PUT", "/api/sets/a/files/%3Cimg%20src=x%20onerror=alert(1)%3E.png", image, own).status == 201
        assert sorted(os.listdir(os.path.join(studio.workspace, "sets"))) == ["a"]
        # A user's file is never a page of the studio, whatever it contains: it runs nothing and requests nothing.
        answer = studio.get("/api/sets/a/files/%3Cimg%20src=x%20onerror=alert(1)%3E.png")
        assert answer.status == 200 and answer.headers["Content-Security-Policy"].endswith("sandbox"), answer.headers
        html = b"<script>alert(1)</script>"
        answer = studio.ask("PUT", "/api/sets/a/files/evil.html", html, {**own, "Content-Type": "text/html"})
        if answer.status == 201:
            answer = studio.get("/api/sets/a/files/evil.html")
            assert "sandbox" in answer.headers["Content-Security-Policy"]
            assert "html" not in answer.headers["Content-Type"], answer.headers["Content-Type"]
        wait_until(lambda: os.listdir(os.path.join(studio.workspace, ".studio", "uploads")) == [], what="no body left behind")


def refuses(flags, *words, status=2):
    done = subprocess.run([TARSIER, "serve", "--port", "0", "--workspace", "/dev/null/x", *flags], capture_output=True,
                          text=True, timeout=30, check=False)
    assert done.returncode == status, (flags, done.returncode, done.stderr)
    for word in words:
        assert word in done.stderr, (flags, done.stderr)


def test_refuses_to_listen_openly_without_tls():
    refuses(["--listen-all"], "--tls-self-signed", "--behind-proxy")
    refuses(["--listen-all", "--tls-cert", "x"], "--tls-key")
    refuses(["--tls-key", "x"], "--tls-cert")
    refuses(["--tls-cert", "x", "--tls-key", "y", "--tls-self-signed"], "--tls-self-signed")
    refuses(["--listen-all", "--behind-proxy", "studio.example"], "origin")
    refuses(["--listen-all", "--tls-self-signed", "--assets", "."], "--assets")
    refuses(["--allow-source", "noequals"], "NAME=SOURCE")
    refuses(["--allow-source", "a/b=0"], "NAME=SOURCE")
    refuses(["--allow-source", "a=0", "--allow-source", "a=1"], "twice")
    refuses(["--allow-source", "a=--on-event"], "begin with '-'")
    refuses(["--port", "70000"], "port")
    refuses(["--link"], "no studio is running here", status=3)


def test_listens_on_loopback_only_by_default():
    with Studio() as studio:
        listing = subprocess.run(["ss", "-Hltn"], capture_output=True, text=True, check=False).stdout if os.path.exists("/usr/bin/ss") or os.path.exists("/bin/ss") else None
        if listing is None:
            with open("/proc/net/tcp", encoding="ascii") as file:
                rows = [line.split()[1] for line in file if line.split()[3] == "0A"]
            own = [row.split(":")[0] for row in rows if int(row.split(":")[1], 16) == studio.port]
            assert own == ["0100007F"], own
        else:
            own = sorted(line.split()[3].rsplit(":", 1)[0] for line in listing.splitlines()
                         if line.split()[3].endswith(f":{studio.port}"))
            assert own in (["127.0.0.1", "[::1]"], ["127.0.0.1"]), own
        second = subprocess.run([TARSIER, "serve", "--port", "0", "--workspace", studio.workspace], capture_output=True, text=True,
                                timeout=30, check=False)
        assert second.returncode == 6 and "another" in second.stderr.lower() or "runs" in second.stderr, second.stderr
        taken = subprocess.run([TARSIER, "serve", "--port", str(studio.port), "--workspace", studio.workspace + "-2"],
                               capture_output=True, text=True, timeout=30, check=False)
        assert taken.returncode == 6 and "taken" in taken.stderr, taken.stderr
        subprocess.run(["rm", "-rf", studio.workspace + "-2"], check=True)


def test_tls_with_a_certificate_of_its_own():
    with Studio("--listen-all", "--tls-self-signed", sign_in=False) as studio:
        assert studio.url.startswith("https://")
        folder = os.path.join(studio.workspace, ".studio")
        assert stat.S_IMODE(os.stat(os.path.join(folder, "tls-key.pem")).st_mode) == 0o600
        context = ssl.create_default_context(cafile=os.path.join(folder, "tls-cert.pem"))
        connection = http.client.HTTPSConnection("localhost", studio.port, timeout=20, context=context)
        connection.connect()
        import hashlib
        sum_of = hashlib.sha256(connection.sock.getpeercert(True)).hexdigest().upper()
        assert studio.about["sha256"].replace(":", "") == sum_of
        connection.request("POST", "/api/session", json.dumps({"token": studio.token()}), {"Content-Type": "application/json"})
        answer = connection.getresponse()
        assert answer.status == 200 and "Secure" in answer.headers["Set-Cookie"], answer.headers
        answer.read()
        # The certificate contains the addresses too.
        check = http.client.HTTPSConnection("127.0.0.1", studio.port, timeout=20, context=context)
        check.request("GET", "/api/session")
        answer = check.getresponse()
        assert answer.status == 200 and json.loads(answer.read())["tls"] is True
        # Plain HTTP is not answered, other names and old TLS versions are refused.
        assert status_of(raw(studio, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", 2)) in (0, 400)
        check.request("GET", "/api/session", headers={"Host": f"evil.example:{studio.port}"})
        answer = check.getresponse()
        assert answer.status == 421
        answer.read()
        with open(os.path.join(folder, "tls-cert.pem"), encoding="ascii") as file:
            before = file.read()
        studio.interrupt()
        with Studio("--listen-all", "--tls-self-signed", workspace=studio.workspace, sign_in=False):
            with open(os.path.join(folder, "tls-cert.pem"), encoding="ascii") as file:
                assert file.read() == before, "browsers that trust it would have to be asked again"


def test_proxy_origin_and_addresses():
    studio = Studio("--behind-proxy", "https://Studio.Example", sign_in=False)
    try:
        assert studio.url == "https://studio.example/"
        studio.port = listening_port(studio.process.pid)
        own = {"Host": "studio.example", "Origin": "https://studio.example", "X-Forwarded-For": "1.2.3.4, 203.0.113.9"}
        answer = studio.post("/api/session", {"token": studio.token()}, headers=own)
        assert answer.status == 200 and "Secure" in answer.headers["Set-Cookie"], answer.body
        for origin in ("http://studio.example", "https://evil.example", "https://studio.example:444"):
            expect(studio.get("/api/session", headers={**own, "Origin": origin}), 403, origin)
        expect(studio.get("/api/session", headers={**own, "Host": "evil.example"}), 421, "different name")
        with open(os.path.join(studio.workspace, ".studio", "audit.log"), encoding="utf-8") as file:
            assert json.loads(file.readline())["address"] == "203.0.113.9"
        # The attempts of one client do not lock out another behind the same proxy.
        for _ in range(11):
            studio.post("/api/session", {"token": "x"}, headers={**own, "X-Forwarded-For": "203.0.113.10"})
        expect(studio.post("/api/session", {"token": "x"}, headers={**own, "X-Forwarded-For": "203.0.113.10"}), 429, "many")
        expect(studio.post("/api/session", {"token": "x"}, headers={**own, "X-Forwarded-For": "203.0.113.11"}), 401, "another")
    finally:
        studio.close()


def listening_port(pid):
    inodes = {os.readlink(f"/proc/{pid}/fd/{fd}") for fd in os.listdir(f"/proc/{pid}/fd")}
    with open("/proc/net/tcp", encoding="ascii") as file:
        for line in file:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                return int(words[1].split(":")[1], 16)
    raise AssertionError("it does not listen")


if __name__ == "__main__":
    sys.exit(run_tests(globals()))
