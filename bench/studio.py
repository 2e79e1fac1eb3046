#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Measures the studio on this machine: bench/studio.py [--minutes M] [--json]

Over loopback, with the program of build/release/bin (or of $TARSIER_SERVE_BIN), 640x480 at 25 frames/s:
  frame age        ms from a frame's last byte in the session until its image is at the viewer
  event to image   ms from sending an action until the image that shows it is at the viewer
  20 viewers       images that each of 19 viewers received in 10 s beside one that reads 1 kB/s
  9 sessions       frames/s of each in one tab
  server           processor time without its sessions, % of a core; memory
  tabs             --minutes M: viewers come and go for M minutes; memory at the start, max, at the end
"""
import argparse
import json
import os
import statistics
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "tests", "web"))
from wire import IMAGE, STATE, Studio, wait_until  # noqa: E402

SOURCE = "synth:clock?live=1&size=640x480&fps=25"


def memory_mb(pid):
    with open(f"/proc/{pid}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def processor_seconds(pid):
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def age_of(record):
    return struct.unpack(">II", record[2][:8])[1]


def watch(live, seconds, counts=None, index=0):
    """Ages of the images that arrived in `seconds` s."""
    ages = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        record = live.record()
        if record is None:
            break
        if record[0] == IMAGE:
            ages.append(age_of(record))
            if counts is not None:
                counts[index] += 1
    return ages


def frame_age_and_clicks(results):
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE], {"--mode": "sketch"})["id"]
        live = studio.live([session])
        live.wait_for(IMAGE)
        before, begin = processor_seconds(studio.process.pid), time.monotonic()
        ages = watch(live, 10)
        share = (processor_seconds(studio.process.pid) - before) / (time.monotonic() - begin)
        results["frame age, ms"] = {"median": statistics.median(ages), "max": max(ages), "images": len(ages)}
        results["server, one viewer, % of a core"] = round(100 * share, 2)
        delays = []
        for i in range(40):
            mode = ("none", "sketch")[i % 2]
            begin = time.monotonic()
            studio.post(f"/api/sessions/{session}/events", [{"action": mode}])
            live.wait_for(STATE, lambda text, mode=mode: json.loads(text)["state"]["mode"] == mode)
            live.wait_for(IMAGE)
            delays.append(1000 * (time.monotonic() - begin))
        results["event to image, ms"] = {"median": round(statistics.median(delays)), "max": round(max(delays)),
                                         "events": len(delays)}
        live.close()


def twenty_viewers(results):
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE], {"--mode": "sketch"})["id"]
        fast = [studio.live([session]) for _ in range(19)]
        slow = studio.live([session], receive_buffer=2048)
        fast[0].wait_for(IMAGE)
        counts = [0] * len(fast)
        end = time.monotonic() + 10

        def crawl():
            while time.monotonic() < end:
                slow.socket.recv(100)
                time.sleep(0.1)

        threads = [threading.Thread(target=watch, args=(viewer, 10, counts, i)) for i, viewer in enumerate(fast)]
        threads.append(threading.Thread(target=crawl))
        before, begin = processor_seconds(studio.process.pid), time.monotonic()
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        share = (processor_seconds(studio.process.pid) - before) / (time.monotonic() - begin)
        results["20 viewers, one at 1 kB/s: images of each other one in 10 s"] = {"min": min(counts), "max": max(counts)}
        results["server, 20 viewers, % of a core"] = round(100 * share, 2)
        results["memory of the server, MB"] = round(memory_mb(studio.process.pid), 1)


def nine_sessions(results):
    with Studio() as studio:
        source = "synth:bars?live=1&size=320x240&fps=10"
        sessions = [studio.start_session("cartoon run", [source], {"--mode": "none"})["id"] for _ in range(9)]
        live = studio.live(sessions)
        counts = dict.fromkeys(sessions, 0)
        end = time.monotonic() + 10
        while time.monotonic() < end:
            record = live.record()
            if record and record[0] == IMAGE:
                counts[record[1]] += 1
        results["9 sessions of 10 frames/s in one stream: images a second of each"] = {
            "min": min(counts.values()) / 10, "max": max(counts.values()) / 10}


def tabs(results, minutes):
    with Studio() as studio:
        session = studio.start_session("cartoon run", [SOURCE], {"--mode": "none"})["id"]
        memory = []
        opened = 0
        end = time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            lives = [studio.live([session]) for _ in range(6)]
            for live in lives:
                live.wait_for(IMAGE)
            for live in lives:
                live.close()
            opened += len(lives)
            wait_until(lambda: studio.get("/api/sessions/" + session).json()["viewers"] == 0, what="the tabs are closed")
            memory.append(memory_mb(studio.process.pid))
        tenth = max(1, len(memory) // 10)
        results[f"tabs that come and go for {minutes:g} min: memory of the server, MB"] = {
            "first tenth": round(statistics.mean(memory[:tenth]), 1), "max": round(max(memory), 1),
            "last tenth": round(statistics.mean(memory[-tenth:]), 1), "tabs": opened}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=0, help="of tabs that come and go (default: none)")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results = {}
    frame_age_and_clicks(results)
    twenty_viewers(results)
    nine_sessions(results)
    if arguments.minutes > 0:
        tabs(results, arguments.minutes)
    if arguments.json:
        print(json.dumps(results))
    else:
        for name, value in results.items():
            print(f"{name}: {value}")


if __name__ == "__main__":
    main()
