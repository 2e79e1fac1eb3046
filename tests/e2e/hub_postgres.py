# SPDX-License-Identifier: MIT
"""tarsier hub with PostgreSQL: the server is killed and restarted, the hub is killed, the tables have another version, the
password is wrong. $TARSIER_POSTGRES: the folder of the server's programs."""
import json
import os
import pwd
import shutil
import signal
import subprocess
import sys
import tempfile

import plate_publish as site

PROGRAMS = os.environ["TARSIER_POSTGRES"]


class Server:
    """In its own folder, on a free port of 127.0.0.1; never as root, which the server refuses."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="tarsier-pg-", dir="/tmp")
        self.user = {}
        if os.getuid() == 0:
            nobody = pwd.getpwnam("nobody")
            os.chown(self.folder, nobody.pw_uid, nobody.pw_gid)
            self.user = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
        self.port = site.free_port()
        with open(self.folder + "-password", "w") as file:
            file.write("se:cret\n")
        os.chmod(self.folder + "-password", 0o644)
        done = self.run("initdb", "-D", self.folder + "/data", "-U", "hub", "-A", "scram-sha-256", "--pwfile", self.folder + "-password", "--no-sync")
        os.unlink(self.folder + "-password")
        if done.returncode != 0:
            site.fail("initdb: " + done.stderr)
        self.start()
        self.query("CREATE DATABASE events", "postgres")

    def run(self, name, *words):
        return subprocess.run([f"{PROGRAMS}/{name}", *words], capture_output=True, text=True, cwd="/tmp", **self.user)

    def start(self):
        done = subprocess.run([f"{PROGRAMS}/pg_ctl", "start", "-w", "-D", self.folder + "/data", "-l", self.folder + "/log", "-o",
                               f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={self.folder}"],
                              stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd="/tmp", **self.user)
        if done.returncode != 0:
            site.fail(f"PostgreSQL does not start: {done.stderr}")

    def stop(self, how="fast"):
        self.run("pg_ctl", "stop", "-w", "-m", how, "-D", self.folder + "/data")

    def address(self, password="se%3Acret", database="events"):
        return f"postgresql://hub:{password}@127.0.0.1:{self.port}/{database}"

    def query(self, text, database="events"):
        done = subprocess.run([shutil.which("psql") or f"{PROGRAMS}/psql", "-At", "-F", "|", self.address(database=database), "-c", text],
                              capture_output=True, text=True)
        return [line.split("|") for line in done.stdout.splitlines()]

    def remove(self):
        self.stop("immediate")
        shutil.rmtree(self.folder, ignore_errors=True)


def listed(address):
    result = subprocess.run([site.TARSIER, "hub", "--log", address, "--list", "--json"], capture_output=True, text=True)
    return result, [json.loads(line) for line in result.stdout.splitlines()]


def refused(server, words, status, pattern):
    result = subprocess.run([site.TARSIER, "hub", *words], capture_output=True, text=True, timeout=60)
    if result.returncode != status or result.stderr.count("\n") != 1 or pattern not in result.stderr or "cret" in result.stderr:
        site.fail(f"hub {words}: expected {status} and {pattern!r}: {result}")


def check(server):
    address = server.address()
    broker = site.Broker("pg", "allow_anonymous true\n").start()
    refused(server, ["--log", address, "--list"], 3, "has no log of a hub")
    words = [site.TARSIER, "hub", f"mqtt://127.0.0.1:{broker.port}/site", "--log", address, "--quiet"]

    def start_hub():
        return site.start(words, stdout=subprocess.DEVNULL, stderr=open("hub.err", "a"))

    def stored():
        return {(node, int(seq)) for node, seq in server.query("SELECT node, seq FROM hub_event")}

    cars = [os.path.join("cars/images", name) for name in sorted(os.listdir("cars/images"))]

    def all_events_sent():
        return not site.rows("gate.db", "SELECT 1 FROM outbox")

    def publish():
        site.node(broker, "gate", cars).wait(60)
        for _ in range(5):
            if site.wait_for(all_events_sent, 6):
                return
            site.node(broker, "gate", cars[:1]).wait(60)
        site.fail("the hub does not store: " + open("hub.err").read()[-600:])

    hub = start_hub()
    publish()
    server.stop("immediate")  # as if it was killed
    node = site.node(broker, "gate", cars)
    node.wait(60)
    server.start()
    publish()
    if hub.poll() is not None:
        site.fail(f"the hub did not wait for its server: {hub.returncode} {open('hub.err').read()[-600:]}")
    site.end(hub, signal.SIGKILL)
    hub = start_hub()
    publish()
    truth = {("gate", seq) for seq in range(1, site.assigned_numbers("gate") + 1)}
    if not truth or not site.wait_for(lambda: stored() == truth, 20):
        site.fail(f"{len(stored())} events of {len(truth)}")
    if server.query("SELECT count(*), count(DISTINCT (node, outbox, seq)) FROM hub_event") != [[str(len(truth))] * 2]:
        site.fail("doubles")
    result, lines = listed(address)
    if result.returncode != 0 or len(lines) != len(truth) or lines[0]["node"] != "gate" or lines[0]["event"] != "plate":
        site.fail(f"--list: {len(lines)} lines of {len(truth)}; {result.stderr}")
    site.end(hub, signal.SIGINT)
    # The same columns as in the file.
    other = site.hub(broker)
    site.wait_for(lambda: site.rows("events.db", "SELECT id FROM hub_id"))
    site.end(other, signal.SIGINT)
    for table in ("hub_event", "hub_mark", "hub_id"):
        file = [row[1] for row in site.rows("events.db", f"PRAGMA table_info({table})")]
        database = [row[0] for row in server.query(f"SELECT column_name FROM information_schema.columns WHERE table_name = '{table}' ORDER BY ordinal_position")]
        if file != database:
            site.fail(f"{table}: {file} in SQLite, {database} in PostgreSQL")
    # Schema versions.
    server.query("UPDATE hub_version SET version = 99")
    refused(server, words[2:], 6, "has version 99, and this program knows")
    refused(server, ["--log", address, "--list"], 3, "has version 99")
    server.query("DROP TABLE hub_version, hub_mark, hub_id")
    refused(server, words[2:], 6, "has a table hub_event that is of no hub")
    # Users without access.
    for bad in (server.address(password="wrong"), server.address(database="missing")):
        refused(server, [words[2], "--log", bad], 6, "postgresql://***@127.0.0.1")
    site.end(broker.process)


def main():
    if subprocess.run([site.TARSIER, "plate", "synth", "-o", "cars", "--count", "3", "--size", "640x360", "--quiet"]).returncode != 0:
        sys.exit("no images")
    server = Server()
    try:
        check(server)
    finally:
        for process in site.running:
            if process.poll() is None:
                process.kill()
                process.wait()
        server.remove()
    sys.exit(1 if site.failures else 0)


main()
