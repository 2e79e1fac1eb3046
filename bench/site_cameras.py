#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Cameras of a site read by one process: bench/site_cameras.py [--cameras 4 8 16] [--fps 5] [--seconds 120] [--json]

Plays synthetic streets (1280x720, a car every 20 s) as cameras: MJPEG over loopback in real time, each camera with its own phase.
One `tarsier plate read NAME=URL .. --log` reads them all. Each car that drives by from its first frame to its last must be an
event in the log. The texts are compared with those of the scene. Prints for each number of cameras:

  passed, missed, wrong   cars that drove by; those without an entry in the log; those with another text
  received, read          frames/s that arrived, and that were read (the others had no motion, or there was no time)
  cores                   processor time of the reader per second
  part, ms                share of the read frames that were read only around the motion; processor time to read one frame
"""
import argparse
import http.server
import json
import os
import resource
import socketserver
import struct
import subprocess
import sys
import tempfile
import threading
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PROGRAM = os.environ.get("TARSIER", os.path.join(ROOT, "build", "release", "bin", "tarsier"))
LOOP = 20  # s, length of a video
FILMS = 8  # cameras share videos, each with its own phase


def run(*words):
    done = subprocess.run([PROGRAM, *words, "--quiet"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode not in (0, 1):
        sys.exit(f"site_cameras: {' '.join(words)}: {done.stderr.strip()}")
    return [json.loads(line) for line in done.stdout.splitlines()]


def jpegs_of(path):
    """The images of an AVI of JPEGs."""
    with open(path, "rb") as file:
        data = file.read()
    images, at = [], data.index(b"movi") + 4
    while at + 8 <= len(data) and data[at : at + 4] in (b"00dc", b"00db", b"JUNK"):
        size = struct.unpack("<I", data[at + 4 : at + 8])[0]
        if data[at : at + 4] != b"JUNK":
            images.append(data[at + 8 : at + 8 + size])
        at += 8 + size + size % 2
    return images


class Film:
    """A street with one car: its images, its plate, and the time in sight, s."""

    def __init__(self, folder, seed, fps):
        source = (f"synth:drive?seconds={LOOP}&cars=1&parked=0&far=0&fps={fps}&frames={LOOP * fps}"
                  f"&size=1280x720&seed={seed}")
        path = os.path.join(folder, f"{seed}.avi")
        run("cartoon", "run", source, "--mode", "none", "-o", path)
        self.images = jpegs_of(path)
        # The result if each frame is read without time pressure.
        events = [event for event in run("plate", "read", path, "--events", "--json")
                  if event.get("event") == "plate" and event["state"] == "closed"
                  and event["last_time"] - event["first_time"] < LOOP / 2]  # not a sign that is always in sight
        if len(self.images) != LOOP * fps or len(events) != 1:
            sys.exit(f"site_cameras: film {seed}: {len(self.images)} images, {len(events)} vehicles")
        self.text = events[0]["text"]
        self.first, self.last = events[0]["first_time"], events[0]["last_time"]


class Handler(http.server.BaseHTTPRequestHandler):
    def log_message(self, *words):
        pass

    def do_GET(self):
        site = self.server.site
        camera = int(self.path.strip("/"))
        film, phase = site.films[camera % len(site.films)], site.phase(camera)
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
        self.end_headers()
        begin = time.monotonic()
        site.begun[camera] = begin
        frame = 0
        try:
            while not site.over.wait(max(0, begin + frame / site.fps - time.monotonic())):
                image = film.images[(round(phase * site.fps) + frame) % len(film.images)]
                self.wfile.write(b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(image), image))
                frame += 1
        except OSError:
            pass


class Server(socketserver.ThreadingMixIn, http.server.HTTPServer):
    daemon_threads = True
    request_queue_size = 64


class Site:
    def __init__(self, films, fps):
        self.films, self.fps = films, fps
        self.begun, self.over, self.count = {}, threading.Event(), 0

    def phase(self, camera):
        return LOOP * camera / self.count  # s

    def passed(self, camera, now):
        """The number of cars that drove by this camera from first to last frame."""
        film, phase = self.films[camera % len(self.films)], self.phase(camera)
        begin, end = phase, phase + now - self.begun[camera]
        return sum(begin <= film.first + LOOP * k and film.last + LOOP * k <= end for k in range(1 + int(end // LOOP)))

    def measure(self, cameras, seconds, folder):
        self.begun, self.over, self.count = {}, threading.Event(), cameras
        server = Server(("127.0.0.1", 0), Handler)
        server.site = self
        threading.Thread(target=server.serve_forever, daemon=True).start()
        log = os.path.join(folder, f"{cameras}.db")
        inputs = [f"c{k}=http://127.0.0.1:{server.server_port}/{k}" for k in range(cameras)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        reader = subprocess.Popen([PROGRAM, "plate", "read", *inputs, "--camera-fps", str(self.fps), "--log", log, "--json",
                                   "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL)
        lines = []
        drain = threading.Thread(target=lambda: lines.extend(reader.stdout), daemon=True)
        drain.start()
        while len(self.begun) < cameras and reader.poll() is None:
            time.sleep(0.1)
        time.sleep(seconds)
        now = time.monotonic()
        passed = {k: self.passed(k, now) for k in range(cameras)}
        time.sleep(3)  # time to finish the vehicles that were in sight
        reader.send_signal(2)
        drain.join()
        reader.wait()
        self.over.set()
        server.shutdown()
        server.server_close()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        report = next((json.loads(line)["cameras"] for line in reversed(lines) if '"cameras":[' in line), None)
        if report is None:
            sys.exit(f"site_cameras: no report: {reader.stderr.read()[-500:]}")
        entries = {}
        for entry in run("plate", "log", log, "--json"):
            entries.setdefault(entry["source"], []).append(entry["text"])
        missed = sum(max(0, passed[k] - len(entries.get(f"c{k}", []))) for k in range(cameras))
        wrong = sum(text != self.films[k % len(self.films)].text for k in range(cameras) for text in entries.get(f"c{k}", []))
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        elapsed = now + 3 - min(self.begun.values())
        return {"cameras": cameras, "passed": sum(passed.values()), "missed": missed, "wrong": wrong,
                "received": sum(one["received"] for one in report) / elapsed, "read": sum(one["read"] for one in report) / elapsed,
                "cores": spent / elapsed,
                "part": sum(one.get("in_part", 0) for one in report) / max(1, sum(one["read"] for one in report)),
                "read_ms": 1000 * sum(one["cpu_s"] for one in report) / max(1, sum(one["read"] for one in report))}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cameras", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--fps", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=120)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tarsier-site-") as folder:
        films = [Film(folder, seed, given.fps) for seed in range(1, min(FILMS, max(given.cameras)) + 1)]
        site = Site(films, given.fps)
        if not given.json:
            print("cameras  cars  missed  wrong  received/s  read/s  cores  part  ms")
        for cameras in given.cameras:
            row = site.measure(cameras, given.seconds, folder)
            print(json.dumps(row) if given.json else
                  f"{row['cameras']:7}  {row['passed']:4}  {row['missed']:6}  {row['wrong']:5}  {row['received']:10.1f}  {row['read']:6.1f}  {row['cores']:5.2f}  {row['part']:4.2f}  {row['read_ms']:.0f}",
                  flush=True)


if __name__ == "__main__":
    main()
