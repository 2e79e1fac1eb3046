#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Live sessions over the real server: images, states and events, slow viewers, cameras of viewers, and the end of sessions."""
import json
import os
import signal
import socket
import struct
import sys
import threading
import time

from wire import ENDED, HELLO, IMAGE, PING, STATE, Studio, run_tests, wait_until

SOURCE = "synth:portrait?live=1&size=320x240"


def expect(answer, status, what):
    assert answer.status == status, f"{what}: {answer.status} {answer.body[:200]!r}, expected {status}"


def test_images_states_and_events():
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE], {"--mode": "sketch"})
        assert session["running"] and session["verb"] == "cartoon run" and session["inputs"] == [SOURCE], session
        assert session["flags"] == {"--mode": "sketch"}, session
        assert "sketch" in session["command"] and "tarsier cartoon run" in session["command"]
        live = studio.live([session["id"]])
        assert live.status == 200
        hello = json.loads(live.wait_for(HELLO)[2])
        assert {"title", "actions", "sliders"} <= set(hello) and hello["actions"], hello
        kind, name, payload = live.wait_for(IMAGE)
        assert name == session["id"]
        frame, age = struct.unpack(">II", payload[:8])
        assert payload[8:10] == b"\xff\xd8" and payload.endswith(b"\xff\xd9") and age < 5000, (frame, age)
        # Newer images follow, each later than the previous.
        for _ in range(5):
            later = struct.unpack(">I", live.wait_for(IMAGE)[2][:4])[0]
            assert later > frame or frame == 0xffffffff, (frame, later)
            frame = later
        state = json.loads(live.wait_for(STATE)[2])
        assert state["width"] == 320 and state["height"] == 240 and state["state"]["mode"] == "sketch", state
        # An action and a slider reach the session.
        events = [{"action": "paint"}, {"slider": "evil-threshold", "value": 30}]
        expect(studio.post(f"/api/sessions/{session['id']}/events", events), 204, "events")
        live.wait_for(STATE, lambda text: json.loads(text)["state"]["mode"] == "paint")
        live.wait_for(STATE, lambda text: json.loads(text)["sliders"]["evil-threshold"] == 30)
        for bad in ([{"close": True}], [{"want": 1}], [{"quality": 1}], [{"mouse": "move"}], [{"key": "s"}], [{"key": 1e99}],
                    [1], {"key": 1}, [{"slider": "a"}], [{"mouse": "jump", "x": 1, "y": 1}], [{"action": 5}], [{}],
                    [{"key": 115}] * 65, [{"action": "x" * 200}], [{"action": "save"}], [{"key": 115, "shift": 1}]):
            expect(studio.post(f"/api/sessions/{session['id']}/events", bad), 400, bad)
        expect(studio.post("/api/sessions/nothing/events", []), 404, "no session")
        reply = studio.get(f"/api/sessions/{session['id']}").json()
        assert reply["frames"] > 3 and reply["viewers"] == 1 and reply["width"] == 320 and reply["output"], reply
        assert studio.get("/api/sessions").json()["sessions"][0]["id"] == session["id"]
        # Viewers are informed of the end.
        expect(studio.ask("DELETE", f"/api/sessions/{session['id']}"), 204, "the end")
        ended = json.loads(live.wait_for(ENDED)[2])
        assert ended["error"] is None, ended
        expect(studio.get(f"/api/sessions/{session['id']}"), 404, "gone")
        wait_until(lambda: not studio.children(), what="no child is left")


def test_snapshot_and_mjpeg():
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE])
        path = f"/api/sessions/{session['id']}"
        first = studio.get(path + "/snapshot.jpg")
        expect(first, 200, "a snapshot")
        assert first.headers["Content-Type"] == "image/jpeg" and first.body.startswith(b"\xff\xd8")
        second = studio.get(path + "/snapshot.jpg")
        assert int(second.headers["X-Tarsier-Frame"]) > int(first.headers["X-Tarsier-Frame"]) \
            or int(first.headers["X-Tarsier-Frame"]) == 0xffffffff
        with socket.create_connection(("127.0.0.1", studio.port), 10) as client:
            head = "".join(f"{name}: {value}\r\n" for name, value in studio.headers().items())
            client.sendall(f"GET {path}/stream.mjpg HTTP/1.1\r\nHost: {studio.host}\r\n{head}\r\n".encode())
            data = b""
            while data.count(b"--tarsier-frame\r\n") < 4:
                piece = client.recv(65536)
                assert piece, data[:300]
                data += piece
        assert b"multipart/x-mixed-replace; boundary=tarsier-frame" in data and b"Transfer-Encoding" not in data
        parts = data.split(b"--tarsier-frame\r\n")
        head, _, body = parts[1].partition(b"\r\n\r\n")
        assert f"Content-Length: {len(body) - 2}".encode() in head and body.startswith(b"\xff\xd8")


def test_without_viewers_nothing_is_encoded():
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE])
        wait_until(lambda: studio.get("/api/sessions/" + session["id"]).json()["frames"] > 5, what="frames")
        # Without a viewer, frames are processed but no image is sent.
        assert studio.get("/api/sessions/" + session["id"]).json()["viewers"] == 0
        live = studio.live([session["id"]])
        live.wait_for(IMAGE)
        live.close()
        wait_until(lambda: studio.get("/api/sessions/" + session["id"]).json()["viewers"] == 0, what="the viewer is gone")


def test_a_slow_viewer_does_not_delay_twenty_others():
    with Studio() as studio:
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&size=640x480"])
        fast = [studio.live([session["id"]]) for _ in range(19)]
        # A small TCP window, read at 1 kB per second.
        slow = studio.live([session["id"]], receive_buffer=2048)
        fast[0].wait_for(IMAGE)
        counts = [0] * len(fast)
        worst = [0] * len(fast)
        end = time.monotonic() + 6

        def watch(i):
            while time.monotonic() < end:
                record = fast[i].record()
                if record and record[0] == IMAGE:
                    counts[i] += 1
                    worst[i] = max(worst[i], struct.unpack(">II", record[2][:8])[1])

        def crawl():
            while time.monotonic() < end:
                try:
                    slow.socket.recv(100)
                except OSError:
                    return
                time.sleep(0.1)

        rss = memory_of(studio.process.pid)
        threads = [threading.Thread(target=watch, args=(i,)) for i in range(len(fast))] + [threading.Thread(target=crawl)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        frames = studio.get("/api/sessions/" + session["id"]).json()
        grown = memory_of(studio.process.pid) - rss
        print(f"      images of each fast viewer: {min(counts)}..{max(counts)} in 6 s, oldest {max(worst)} ms; "
              f"{frames['fps']} fps; memory {rss >> 20} MB, +{grown >> 20} MB")
        # All fast viewers receive nearly the same number: none waits for the slow one.
        assert min(counts) >= 6 and min(counts) >= 0.7 * max(counts), counts
        assert frames["viewers"] == 20
        assert grown < 64 << 20, grown
        for viewer in fast + [slow]:
            viewer.close()
        wait_until(lambda: studio.get("/api/sessions/" + session["id"]).json()["viewers"] == 0, what="all viewers are gone")


def memory_of(pid):
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")


def test_limits_of_sessions_and_streams():
    with Studio() as studio:
        ids = [studio.start_session("cartoon run", ["synth:bars?live=1&size=64x48&fps=1"])["id"] for _ in range(9)]
        answer = studio.post("/api/sessions", {"verb": "cartoon run", "inputs": [SOURCE]})
        expect(answer, 409, "a tenth session")
        # All nine in one stream.
        live = studio.live(ids)
        seen = set()
        end = time.monotonic() + 30
        while len(seen) < 9 and time.monotonic() < end:
            record = live.record()
            if record[0] == IMAGE:
                seen.add(record[1])
        assert seen == set(ids), (seen, ids)
        streams = [studio.live(ids[:1]) for _ in range(31)]
        assert all(stream.status == 200 for stream in streams)
        assert studio.live(ids[:1]).status == 503
        for stream in streams:
            stream.close()
        expect(studio.get("/api/live?s=" + ",".join(f"x{i}" for i in range(17))), 400, "too many in a stream")
        wait_until(lambda: studio.get("/api/sessions/" + ids[0]).json()["viewers"] == 1, what="room for other streams")
        unknown = studio.live(["nothing"])
        assert "no such session" in json.loads(unknown.wait_for(ENDED)[2])["error"]
        empty = studio.live([])
        empty.wait_for(PING, seconds=5)
        empty.wait_for(PING, seconds=5)


def test_ended_sessions_report_the_reason():
    with Studio() as studio:
        missing = studio.start_session("plate read", ["synth:nothing?live=1"])
        live = studio.live([missing["id"]])
        ended = json.loads(live.wait_for(ENDED)[2])
        assert ended["exit"] == 3 and "nothing" in ended["error"], ended
        reply = studio.get("/api/sessions/" + missing["id"]).json()
        assert reply["running"] is False and reply["exit"] == 3 and reply["error"] == ended["error"] and reply["log"], reply
        expect(studio.post(f"/api/sessions/{missing['id']}/events", [{"key": 115}]), 409, "events to one that ended")
        # A session that is killed from outside affects no other session.
        first = studio.start_session("cartoon run", [SOURCE])
        before = set(studio.children())
        second = studio.start_session("cartoon run", [SOURCE])
        watching = studio.live([second["id"]])
        watching.wait_for(IMAGE)
        victim = (set(studio.children()) - before).pop()
        os.kill(victim, signal.SIGKILL)
        ended = json.loads(watching.wait_for(ENDED)[2])
        assert ended["exit"] == 137 and "signal 9" in ended["error"], ended
        assert studio.get("/api/sessions/" + first["id"]).json()["running"]
        # A camera that does not exist.
        gone = studio.start_session("cartoon run", ["camera:63"])
        reply = wait_until(lambda: (lambda s: s if not s["running"] else None)(studio.get("/api/sessions/" + gone["id"]).json()))
        assert reply["exit"] == 3 and reply["error"], reply


def test_camera_of_a_viewer():
    with Studio() as studio:
        # An image to send: the image of a session.
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&size=320x240"])
        watching = studio.live([session["id"]])  # the first image shows that it is connected
        jpeg = watching.wait_for(IMAGE, lambda payload: payload[:4] != b"\xff\xff\xff\xff")[2][8:]
        watching.close()
        studio.ask("DELETE", "/api/sessions/" + session["id"])
        answer = studio.post("/api/viewer-cameras", {})
        expect(answer, 201, "a camera")
        camera = answer.json()["id"]
        assert camera.startswith("viewer:")
        assert camera in [source["id"] for source in studio.get("/api/sources").json()["sources"]]
        path = f"/api/viewer-cameras/{camera.split(':')[1]}/frame"
        own = {**studio.headers(), "Content-Type": "image/jpeg"}
        expect(studio.ask("POST", path, jpeg, own), 204, "a frame")
        expect(studio.ask("POST", path, jpeg, {**own, "Content-Type": "image/png"}), 415, "another type")
        expect(studio.ask("POST", path, b"no image", own), 415, "no JPEG")
        expect(studio.ask("POST", path, b"\x89PNG\r\n\x1a\n" + b"\0" * 100, own), 415, "a PNG that says it is none")
        expect(studio.ask("POST", "/api/viewer-cameras/none/frame", jpeg, own), 404, "no camera")
        session = studio.start_session("cartoon run", [camera])
        stop = threading.Event()

        def feed():
            while not stop.is_set():
                if studio.ask("POST", path, jpeg, own).status != 204:
                    return
                time.sleep(0.05)

        feeder = threading.Thread(target=feed)
        feeder.start()
        live = studio.live([session["id"]])
        for _ in range(4):
            live.wait_for(IMAGE)
        state = json.loads(live.wait_for(STATE)[2])
        assert state["width"] == 320, state
        expect(studio.ask("DELETE", f"/api/viewer-cameras/{camera.split(':')[1]}"), 204, "the camera's end")
        ended = json.loads(live.wait_for(ENDED, seconds=30)[2])
        stop.set()
        feeder.join()
        assert ended["exit"] != 0 and ended["error"], ended
        expect(studio.post("/api/sessions", {"verb": "cartoon run", "inputs": [camera]}), 400, "a camera that is over")


def test_interrupt_ends_all_at_once():
    for number, expected in ((signal.SIGINT, 130), (signal.SIGTERM, 0)):  # Ctrl-C interrupts; SIGTERM ends a service
        with Studio() as studio:
            ids = [studio.start_session("cartoon run", [SOURCE])["id"] for _ in range(3)]
            live = studio.live(ids)
            live.wait_for(IMAGE)
            children = studio.children()
            assert len(children) >= 3
            seconds, status = studio.interrupt(number)
            print(f"      ended after {seconds:.2f} s")
            assert status == expected and seconds < 1.5, (status, seconds)  # 0.5 s on an idle machine
            assert not any(os.path.exists(f"/proc/{child}") for child in children)
            assert live.record() is None or True
            assert not os.path.exists(os.path.join(studio.workspace, ".studio", "server.json"))


def test_children_end_with_a_server_that_is_killed():
    with Studio() as studio:
        studio.start_session("cartoon run", [SOURCE])
        children = wait_until(studio.children, what="a child")
        studio.process.kill()
        studio.process.wait()
        wait_until(lambda: not any(os.path.exists(f"/proc/{child}") and is_alive(child) for child in children), what="their end")
        with Studio(workspace=studio.workspace) as second:  # the lock is free, and the remains of the first server do no harm
            assert second.get("/api/info").status == 200


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_click_to_image():
    """The time from an event to the image that shows it, on a source of 25 frames a second."""
    with Studio() as studio:
        session = studio.start_session("cartoon run", ["synth:portrait?live=1&size=640x480"])
        live = studio.live([session["id"]])
        live.wait_for(IMAGE)
        delays, ages = [], []
        for i in range(12):
            mode = ("sketch", "paint")[i % 2]
            begin = time.monotonic()
            expect(studio.post(f"/api/sessions/{session['id']}/events", [{"action": mode}]), 204, mode)
            live.wait_for(STATE, lambda text: json.loads(text)["state"]["mode"] == mode)
            record = live.wait_for(IMAGE)
            delays.append(time.monotonic() - begin)
            ages.append(struct.unpack(">II", record[2][:8])[1])
        delays.sort()
        ages.sort()
        print(f"      event to image: median {1000 * delays[6]:.0f} ms, longest {1000 * delays[-1]:.0f} ms; "
              f"frame age: median {ages[6]} ms, oldest {ages[-1]} ms")
        assert delays[6] < 1.5, delays  # 0.1 s on an idle machine


if __name__ == "__main__":
    sys.exit(run_tests(globals()))
