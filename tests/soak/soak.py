# SPDX-License-Identifier: MIT
"""Hours of live cameras that are killed, frozen and started again, watched by readers whose memory must not grow.

A camera (`tarsier cartoon run synth:.. -o http://..`) is killed with SIGKILL or frozen with SIGSTOP at seeded random moments and
started again. The readers: one draws the stream and serves the drawing to viewers that come and go; one detects markers in
it; one has a camera that is a child process (picam:, its rpicam-vid is simulated by a script), which is killed too. Every few
seconds each reader's memory, descriptors, threads and children are written to samples.csv.

Passed if for each reader: at rest (nothing killed, no viewers) before the end it has as many descriptors, threads and children
as at rest in the beginning, and no zombies; its own memory (RssAnon), by a straight line through the second half of the
run, grows by less than GROWTH_KB in that half; frames arrive again after every kill, within BACK_S; SIGINT ends it with 130.
"""
import argparse
import atexit
import json
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import time

GROWTH_KB = 2048  # over the second half; changes of the allocator between samples are below 1 MB
BACK_S = 30  # until frames arrive again; about 2 s on an idle machine. A further interruption meanwhile does not stop the clock
REST_S = 30  # nothing is killed in the first and last seconds of this length
START_S = 180  # until each reader has its first frames; then the clock of the run starts
TICK_S = 0.2

FAKE_RPICAM = """#!{python}
import sys, time
image = open({image!r}, "rb").read()
while True:
    sys.stdout.buffer.write(image)
    sys.stdout.buffer.flush()
    time.sleep(0.2)
"""


started = []


def start(words, **how):
    process = subprocess.Popen([PROGRAM, *words], stdin=subprocess.DEVNULL, **how)
    started.append(process)
    return process


def end_all():
    """Ends all processes, however this script ends."""
    for process in started:
        if process.poll() is None:
            process.kill()
            process.wait()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Reader:
    """A tarsier process whose resources must stay constant, with its measurements."""

    def __init__(self, name, words, environment=None):
        self.name = name
        self.errors = open(f"{name}.stderr", "w")
        self.process = start([*words, "--json", "--wait", "--give-up", "0"], stdout=subprocess.PIPE, stderr=self.errors,
                             env=environment, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        os.set_blocking(self.process.stdout.fileno(), False)
        self.frames = 0
        self.rest = b""
        self.waiting_since = None  # the camera is back, but no image has arrived yet
        self.delays = []
        self.newest = self.longest_silence = 0.0  # s, time of the last frame; longest time without a frame
        self.samples = []

    def wait_for_frames(self, now):
        if self.waiting_since is None:
            self.waiting_since = now

    def drain(self, now):
        self.longest_silence = max(self.longest_silence, now - self.newest)
        try:
            data = os.read(self.process.stdout.fileno(), 1 << 20)
        except BlockingIOError:
            return
        lines = (self.rest + data).split(b"\n")
        self.rest = lines.pop()
        new = sum(1 for line in lines if b'"frame"' in line)
        self.frames += new
        if new:
            self.newest = now
        if new and self.waiting_since is not None:
            self.delays.append(now - self.waiting_since)
            self.waiting_since = None

    def sample(self, now):
        pid = self.process.pid
        with open(f"/proc/{pid}/status") as file:
            fields = dict(line.split(":", 1) for line in file if ":" in line)
        with open(f"/proc/{pid}/statm") as file:
            shared_pages = int(file.read().split()[2])
        rss = int(fields["VmRSS"].split()[0])
        children = 0
        zombies = 0
        for task in os.listdir(f"/proc/{pid}/task"):
            try:
                with open(f"/proc/{pid}/task/{task}/children") as file:
                    pids = file.read().split()
            except OSError:
                continue  # the thread has ended
            for child in pids:
                try:
                    with open(f"/proc/{child}/stat") as file:
                        zombies += file.read().rsplit(")", 1)[1].split()[0] == "Z"
                    children += 1
                except OSError:
                    pass
        anon = int(fields.get("RssAnon", f"{rss - 4 * shared_pages}").split()[0])
        row = dict(t=round(now, 1), reader=self.name, rss_kb=rss, anon_kb=anon,
                   descriptors=len(os.listdir(f"/proc/{pid}/fd")), threads=int(fields["Threads"]), children=children,
                   zombies=zombies, frames=self.frames)
        self.samples.append(row)
        return row


class Camera:
    """The server that is killed."""

    def __init__(self, url):
        self.url = url
        self.process = None
        self.kills = self.freezes = 0

    def start(self):
        self.process = start(["cartoon", "run", "synth:markers?size=320x240&fps=5&live=1", "--mode", "none", "-o", self.url,
                              "--quiet"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def kill(self):
        self.process.kill()
        self.process.wait()
        started.remove(self.process)
        self.process = None
        self.kills += 1


class Viewers:
    """Viewers of a reader's server: they connect, read for a while, and disconnect without notice."""

    def __init__(self, port):
        self.port = port
        self.open = []  # (socket, time to leave)
        self.came = 0

    def tick(self, now, dice, may_come):
        if may_come and len(self.open) < 3 and dice.random() < 0.02:
            try:
                viewer = socket.create_connection(("127.0.0.1", self.port), timeout=1)
                viewer.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n" if dice.random() < 0.9 else b"GET /")
                viewer.setblocking(False)
                self.open.append((viewer, now + dice.uniform(0, 20)))
                self.came += 1
            except OSError:
                pass
        for viewer, leaves in list(self.open):
            gone = now >= leaves or not may_come
            try:
                gone = not viewer.recv(1 << 20) or gone
            except BlockingIOError:
                pass
            except OSError:
                gone = True
            if gone:
                viewer.close()
                self.open.remove((viewer, leaves))


def slope(samples, key):
    """kB per second, by a straight line through the samples."""
    times = [s["t"] for s in samples]
    values = [s[key] for s in samples]
    middle, mean = statistics.mean(times), statistics.mean(values)
    spread = sum((t - middle) ** 2 for t in times)
    return sum((t - middle) * (v - mean) for t, v in zip(times, values)) / spread if spread else 0.0


def judge(reader, seconds):
    """A row of figures, and its failures."""
    wrong = []
    at_rest = [s for s in reader.samples if s["t"] < REST_S]
    in_the_end = [s for s in reader.samples if s["t"] > seconds - REST_S + 15]
    half = [s for s in reader.samples if s["t"] > seconds / 2]
    growth = slope(half, "anon_kb") * seconds / 2
    if growth > GROWTH_KB:
        wrong.append(f"memory grew by {growth:.0f} kB in the second half")
    for key in ("descriptors", "threads", "children"):
        before, after = (statistics.median_high(s[key] for s in group) for group in (at_rest, in_the_end))
        if after > before:
            wrong.append(f"{key}: {before} in the beginning, {after} in the end")
    zombies = in_the_end[-1]["zombies"]
    if zombies:
        wrong.append(f"{zombies} zombies in the end")
    if reader.waiting_since is not None:
        wrong.append("no frame since the camera's last start")
    if reader.delays and max(reader.delays) > BACK_S:
        wrong.append(f"frames came again only after {max(reader.delays):.1f} s")
    row = dict(reader=reader.name, seconds=round(seconds), frames=reader.frames, interruptions=len(reader.delays),
               back_s_median=round(statistics.median(reader.delays), 1) if reader.delays else 0,
               back_s_max=round(max(reader.delays), 1) if reader.delays else 0,
               longest_silence_s=round(reader.longest_silence, 1),
               anon_kb_first=round(statistics.median(s["anon_kb"] for s in at_rest)),
               anon_kb_last=round(statistics.median(s["anon_kb"] for s in in_the_end)),
               growth_kb_second_half=round(growth), descriptors=in_the_end[-1]["descriptors"],
               descriptors_max=max(s["descriptors"] for s in reader.samples), threads=in_the_end[-1]["threads"],
               children=in_the_end[-1]["children"])
    return row, wrong


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--hours", type=float, default=2)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--every", type=float, default=5, help="s between samples")
    options = arguments.parse_args()
    seconds = max(options.hours * 3600, 4 * REST_S)
    dice = random.Random(options.seed)

    ports = free_port(), free_port()
    url, served = (f"http://127.0.0.1:{port}/" for port in ports)
    subprocess.run([PROGRAM, "cartoon", "run", "synth:markers?size=320x240", "--mode", "none", "--frames", "1", "-o", "frame.jpg",
                    "--quiet"], check=True)
    os.makedirs("path", exist_ok=True)
    with open("path/rpicam-vid", "w") as file:
        file.write(FAKE_RPICAM.format(python=sys.executable, image=os.path.abspath("frame.jpg")))
    os.chmod("path/rpicam-vid", 0o755)
    with_child = {**os.environ, "PATH": os.path.abspath("path") + ":" + os.environ["PATH"]}

    camera = Camera(url)
    camera.start()
    readers = [Reader("cartoon_http", ["cartoon", "run", url, "--mode", "sketch", "-o", served]),
               Reader("markers_http", ["ar", "markers", url, "-o", "none"]),
               Reader("cartoon_picam", ["cartoon", "run", "picam:0", "--mode", "none", "-o", "none"], with_child)]
    of_network, of_child = readers[:2], readers[2]
    viewers = Viewers(ports[1])
    child_kills = 0
    wrong = []
    begin = time.monotonic()
    while any(reader.frames < 10 for reader in readers):
        if time.monotonic() - begin > START_S:
            sys.exit(f"FAILED: no frames in {START_S} s")
        for reader in readers:
            reader.drain(0)
        time.sleep(TICK_S)
    begin = time.monotonic()
    next_sample = 0.0
    next_event = next_child_event = float(REST_S)
    back_at = thaw_at = None
    with open("samples.csv", "w") as table:
        table.write("t,reader,rss_kb,anon_kb,descriptors,threads,children,zombies,frames\n")
        while (now := time.monotonic() - begin) < seconds:
            quiet = now < REST_S or now > seconds - REST_S
            for reader in readers:
                if reader.process.poll() is not None:
                    print(f"FAILED: {reader.name} ended with {reader.process.returncode} after {now:.0f} s", flush=True)
                    sys.exit(1)
                reader.drain(now)
            viewers.tick(now, dice, not quiet)
            if back_at is not None and (now >= back_at or quiet):
                camera.start()
                back_at = None
                for reader in of_network:
                    reader.wait_for_frames(now)
            elif thaw_at is not None and (now >= thaw_at or quiet):
                camera.process.send_signal(signal.SIGCONT)
                thaw_at = None
                for reader in of_network:
                    reader.wait_for_frames(now)
            elif not quiet and now >= next_event and back_at is None and thaw_at is None:
                if dice.random() < 0.8:
                    camera.kill()
                    back_at = now + dice.uniform(0, 8)
                else:
                    camera.process.send_signal(signal.SIGSTOP)
                    camera.freezes += 1
                    thaw_at = now + dice.uniform(1, 8)
                next_event = now + dice.uniform(2, 60)
            if not quiet and now >= next_child_event:
                with open(f"/proc/{of_child.process.pid}/task/{of_child.process.pid}/children") as file:
                    pids = file.read().split()
                for task in os.listdir(f"/proc/{of_child.process.pid}/task"):
                    try:
                        with open(f"/proc/{of_child.process.pid}/task/{task}/children") as file:
                            pids += file.read().split()
                    except OSError:
                        pass
                for pid in set(pids):  # the reader's own child, of any of its threads
                    try:
                        os.kill(int(pid), signal.SIGKILL)
                        child_kills += 1
                        of_child.wait_for_frames(now)
                    except ProcessLookupError:
                        pass
                next_child_event = now + dice.uniform(2, 60)
            if now >= next_sample:
                for reader in readers:
                    table.write(",".join(str(v) for v in reader.sample(now).values()) + "\n")
                table.flush()
                next_sample += options.every
            time.sleep(TICK_S)

    for reader in readers:
        row, troubles = judge(reader, seconds)
        print(json.dumps(row), flush=True)
        wrong += [f"{reader.name}: {trouble}" for trouble in troubles]
        reader.process.send_signal(signal.SIGINT)
        try:
            while reader.process.poll() is None and time.monotonic() - begin < seconds + 30:
                reader.drain(now)
                time.sleep(0.05)
            status = reader.process.wait(timeout=1)
            if status != 130:
                wrong.append(f"{reader.name}: SIGINT ended it with {status}")
        except subprocess.TimeoutExpired:
            wrong.append(f"{reader.name}: SIGINT does not end it")
    print(json.dumps(dict(camera_kills=camera.kills, camera_freezes=camera.freezes, child_kills=child_kills, viewers=viewers.came,
                          hours=round(seconds / 3600, 3), seed=options.seed)))
    for trouble in wrong:
        print("FAILED:", trouble)
    print("failed" if wrong else "passed")
    sys.exit(1 if wrong else 0)


PROGRAM = os.environ["TARSIER"]
atexit.register(end_all)
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
main()
