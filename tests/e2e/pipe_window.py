#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Drives the program's windows through pipes, as `tarsier serve` does, for pipe_window.sh.

Session(arguments) starts the program with TARSIER_WINDOW=pipe:IN:OUT. Records are read as they come: the newest state
and the newest image are kept. Nothing here needs a display.
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

PROGRAM = os.environ["TARSIER"]
PATIENCE = 300  # s; only a test that fails waits for so long


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
        handed = [child_in, child_out]
        if viewer:
            environment["TARSIER_VIEWER"] = str(child_viewer)
            handed.append(child_viewer)
        self.stdout = open("stdout.txt", "w+")
        self.stderr = open("stderr.txt", "w+")
        self.program = subprocess.Popen([PROGRAM] + arguments, stdin=subprocess.DEVNULL, stdout=self.stdout,
                                        stderr=self.stderr, env=environment, pass_fds=handed)
        for fd in handed:
            os.close(fd)
        fcntl.fcntl(self.out, fcntl.F_SETFL, os.O_NONBLOCK)
        self.bytes = b""
        self.hello = self.state = self.image = None
        self.hellos = self.states = self.images = 0
        self.frame = self.age = None
        self.ended = False

    def say(self, **line):
        self.write(json.dumps(line).encode() + b"\n")

    def write(self, text):
        os.write(self.to, text)

    def read(self, patience=0.05):
        """Takes in what is there."""
        if self.ended or not select.select([self.out], [], [], patience)[0]:
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
        end = time.monotonic() + PATIENCE
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
        self.say(want=1)
        self.until("image", lambda: self.images > before)
        if self.image[:3] != b"\xff\xd8\xff" or self.image[-2:] != b"\xff\xd9":
            raise Failed("%s: what was sent is no JPEG" % self.name)
        if save:
            with open(save, "wb") as file:
                file.write(self.image)
        return self.image

    def ends(self, status=0):
        """Reads to the end, which must come by itself."""
        end = time.monotonic() + PATIENCE
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
        self.say(close=True)
        self.ends(status)
        self.away()

    def interrupt(self):
        """Seconds from SIGINT to the end."""
        begin = time.monotonic()
        self.program.send_signal(signal.SIGINT)
        self.ends(130)
        self.away()
        return time.monotonic() - begin

    def away(self):
        for fd in (self.to, self.out, self.viewer):
            if fd is not None:
                os.close(fd)
        self.to = self.out = self.viewer = None
        self.stdout.close()
        self.stderr.close()
