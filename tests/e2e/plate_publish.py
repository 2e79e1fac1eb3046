# SPDX-License-Identifier: MIT
"""plate read --publish and tarsier hub, with Debian's mosquitto. Nodes, broker and hub are killed at random moments; at the end the
hub has every event of every node once. Then: passwords, TLS, the last will, Home Assistant, a broker that is not available."""
import json
import os
import random
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import time

TARSIER = os.environ["TARSIER"]
ROUNDS = int(os.environ.get("TARSIER_MQTT_KILLS", "8" if os.environ.get("TARSIER_TEST_ALL") else "3"))
failures = []
running = []


def fail(text):
    failures.append(text)
    print("FAILED:", text, flush=True)


def program(name):
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/bin")


BROKER = program("mosquitto")
if BROKER is None:
    print("skipped: no mosquitto")
    sys.exit(77)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def start(words, **options):
    process = subprocess.Popen(words, stdin=subprocess.DEVNULL, **options)
    running.append(process)
    return process


def end(process, how=signal.SIGTERM):
    if process.poll() is None:
        process.send_signal(how)
    try:
        return process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        fail(f"{process.args} did not end")
        return None


class Broker:
    def __init__(self, name, lines):
        self.port = free_port()
        self.config = os.path.abspath(name + ".conf")
        with open(self.config, "w") as file:
            file.write(f"listener {self.port} 127.0.0.1\npersistence false\nuser root\n" + lines)
        self.log = open(name + ".log", "w")
        self.process = None

    def start(self):
        self.process = start([BROKER, "-c", self.config], stdout=self.log, stderr=self.log)
        for _ in range(200):
            try:
                socket.create_connection(("127.0.0.1", self.port), 1).close()
                return self
            except OSError:
                time.sleep(0.05)
        fail("mosquitto does not start: " + open(self.log.name).read()[-500:])
        return self

    def kill(self):
        end(self.process, signal.SIGKILL)


def node(broker, name, images, *more, **options):
    return start([TARSIER, "plate", "read", *images, "--publish", f"mqtt://127.0.0.1:{broker.port}/site/{name}", "--outbox",
                  f"{name}.db", "-o", "none", "--threads", "1", *more], stdout=subprocess.DEVNULL, stderr=open(f"{name}.err", "a"), **options)


def hub(broker, *more):
    return start([TARSIER, "hub", f"mqtt://127.0.0.1:{broker.port}/site", "--log", "events.db", *more],
                 stdout=open("hub.out", "a"), stderr=open("hub.err", "a"))


def rows(path, query):
    if not os.path.exists(path):
        return []
    database = sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=20)
    try:
        return database.execute(query).fetchall()
    except sqlite3.OperationalError:  # it is being created
        return []
    finally:
        database.close()


def assigned_numbers(name):
    """How many numbers a node's outbox has assigned."""
    found = rows(f"{name}.db", "SELECT seq FROM sqlite_sequence WHERE name = 'outbox'")
    return found[0][0] if found else 0


def stored():
    return {(n, s) for n, s in rows("events.db", "SELECT node, seq FROM hub_event")}


def wait_for(condition, timeout=60):
    end_time = time.time() + timeout
    while time.time() < end_time:
        if condition():
            return True
        time.sleep(0.1)
    return False


def check_kills():
    random.seed(int(os.environ.get("TARSIER_MQTT_SEED", "1")))
    broker = Broker("kills", "allow_anonymous true\n").start()
    cars = [os.path.join("cars/images", name) for name in sorted(os.listdir("cars/images"))]
    names = ["gate", "yard"]
    nodes = {name: node(broker, name, cars * 20) for name in names}
    hub_process = hub(broker)
    for turn in range(ROUNDS):
        time.sleep(random.uniform(0.2, 1.2))
        victim = random.choice(["broker", "hub", *names])
        if victim == "broker":
            broker.kill()
            time.sleep(random.uniform(0, 0.5))
            broker.start()
        elif victim == "hub":
            end(hub_process, signal.SIGKILL)
            hub_process = hub(broker)
        else:
            end(nodes[victim], signal.SIGKILL)
            nodes[victim] = node(broker, victim, cars * 5)
        print(f"   {turn + 1}: {victim} killed; {len(stored())} stored of {sum(assigned_numbers(n) for n in names)}", flush=True)
    for name in names:  # the last run of each node: pending events of its outbox are sent with the next run at the latest
        if nodes[name].wait(120) not in (0, 1):
            fail(f"{name} ended with {nodes[name].returncode}: {open(name + '.err').read()[-500:]}")

    def all_events_sent():
        return all(not rows(f"{name}.db", "SELECT 1 FROM outbox") for name in names)

    turns = 0
    while not all_events_sent() and turns < 10:
        turns += 1
        for process in [node(broker, name, cars[:1]) for name in names]:
            process.wait(60)
        wait_for(all_events_sent, 3)
    truth = {(name, seq) for name in names for seq in range(1, assigned_numbers(name) + 1)}
    if not truth or not wait_for(lambda: stored() == truth, 30):
        fail(f"the hub has {len(stored())} events of {len(truth)}; {sorted(truth - stored())[:10]} are missing")
    count = rows("events.db", "SELECT count(*), count(DISTINCT node || outbox || seq) FROM hub_event")
    if count != [(len(truth), len(truth))]:
        fail(f"doubles: {count} of {len(truth)}")
    if not all_events_sent():
        fail("a node keeps what the hub has stored")
    end(hub_process, signal.SIGINT)
    # A new hub starts empty: the nodes no longer have events that another hub has stored, and it does not wait for them.
    os.rename("events.db", "first.db")
    for ending in ("-wal", "-shm"):
        if os.path.exists("events.db" + ending):
            os.unlink("events.db" + ending)
    hub_process = hub(broker, "--json")
    node(broker, "gate", cars[:1]).wait(60)
    if not wait_for(lambda: not rows("gate.db", "SELECT 1 FROM outbox"), 30):
        fail("a new hub does not get on with an old node")
    wait_for(lambda: '"node":"gate"' in open("hub.out").read(), 10)
    end(hub_process, signal.SIGINT)
    listed = subprocess.run([TARSIER, "hub", "--log", "events.db", "--list", "--json"], capture_output=True, text=True)
    lines = [json.loads(line) for line in listed.stdout.splitlines()]
    if listed.returncode != 0 or not lines or lines[0]["node"] != "gate" or lines[0]["event"] != "plate":
        fail(f"hub --list: {listed}")
    end(broker.process)
    print(f"   {len(truth)} events, {ROUNDS} kills", flush=True)


def watcher(port, topic, *more):
    return start([program("mosquitto_sub"), "-h", "127.0.0.1", "-p", str(port), "-t", topic, "-v", "-q", "1", *more],
                 stdout=subprocess.PIPE, text=True)


def check_security():
    if program("mosquitto_passwd") is None or program("openssl") is None:
        return print("   no mosquitto_passwd or openssl: passwords and TLS are not tried")
    subprocess.run([program("mosquitto_passwd"), "-b", "-c", "users", "ann", "se:cret"], check=True)
    for words in (["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=ca"],
                  ["req", "-newkey", "rsa:2048", "-nodes", "-keyout", "broker.key", "-out", "broker.csr", "-subj", "/CN=localhost"],
                  ["x509", "-req", "-in", "broker.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-out", "broker.pem", "-days", "2"]):
        subprocess.run(["openssl", *words], check=True, capture_output=True)
    os.chmod("broker.key", 0o644)
    here = os.getcwd()
    broker = Broker("secure", f"allow_anonymous false\npassword_file {here}/users\ncafile {here}/ca.pem\ncertfile {here}/broker.pem\nkeyfile {here}/broker.key\n").start()
    with open("password", "w") as file:
        file.write("se:cret\n")

    def read(address, *more):
        result = subprocess.run([TARSIER, "plate", "read", "cars/images", "-o", "none", "--outbox", "secure.db", "--publish", address, *more],
                                capture_output=True, text=True, timeout=60)
        return result

    base = f"localhost:{broker.port}/site/secure"
    for address, more, problem in ((f"mqtts://ann:se%3Acret@{base}", ["--mqtt-ca-file", "ca.pem"], None),
                                   (f"mqtts://{base}", ["--mqtt-user", "ann", "--mqtt-password-file", "password", "--mqtt-ca-file", "ca.pem"], None),
                                   (f"mqtts://ann:wrong@{base}", ["--mqtt-ca-file", "ca.pem"], "refuses us"),
                                   (f"mqtts://ann:se%3Acret@{base}", [], "events wait"),
                                   (f"mqtt://ann:se%3Acret@{base}", [], "events wait")):
        result = read(address, *more)
        if result.returncode != 0 or (problem is None) != ("events wait" not in result.stderr) or (problem or "") not in result.stderr:
            fail(f"{address} {more}: {result.stderr}")
        if "cret" in result.stderr:
            fail(f"a password in the messages: {result.stderr}")
    for more, problem in ((["--mqtt-ca-file", "missing.pem"], "missing.pem"), (["--mqtt-password-file", "missing"], "missing")):
        result = read(f"mqtts://{base}", *more)
        if result.returncode != 3 or problem not in result.stderr:
            fail(f"{more}: {result.returncode} {result.stderr}")
    end(broker.process)


def check_states():
    broker = Broker("states", "allow_anonymous true\n").start()
    process = node(broker, "porch", ["synth:drive"], "--homeassistant", "--fps", "5")
    seen = ""
    listener = watcher(broker.port, "site/porch/state", "-W", "40")
    first = listener.stdout.readline()
    if '"online"' not in first:
        fail(f"no state: {first!r}")
    configs = subprocess.run([program("mosquitto_sub"), "-h", "127.0.0.1", "-p", str(broker.port), "-t", "homeassistant/#", "-C", "2", "-W", "10"],
                             capture_output=True, text=True).stdout.splitlines()
    if len(configs) != 2 or any("site/porch/events" not in line for line in configs):
        fail(f"Home Assistant's configurations: {configs}")
    end(process, signal.SIGKILL)
    if '"offline"' not in (seen := listener.stdout.readline()):
        fail(f"no last will: {seen!r}")
    end(listener)
    node(broker, "porch", ["cars/images"]).wait(60)
    states = subprocess.run([program("mosquitto_sub"), "-h", "127.0.0.1", "-p", str(broker.port), "-t", "site/porch/state", "-C", "1", "-W", "10"],
                            capture_output=True, text=True).stdout
    if '"offline"' not in states:
        fail(f"a node that has ended is {states!r}")
    end(broker.process)
    # Without a broker, reading continues, and the events wait.
    before = assigned_numbers("porch")
    begin = time.time()
    result = subprocess.run([TARSIER, "plate", "read", "cars/images", "-o", "none", "--publish", f"mqtt://127.0.0.1:{broker.port}/site/porch",
                             "--outbox", "porch.db"], capture_output=True, text=True)
    if result.returncode != 0 or assigned_numbers("porch") <= before or "events wait in porch.db" not in result.stderr or time.time() - begin > 30:
        fail(f"a broker that is away: {result}")


def check_usage():
    for words, status in ((["plate", "read", "cars/images", "--publish", "http://x"], 2), (["plate", "read", "cars/images", "--publish", "mqtt://x/#"], 2),
                          (["plate", "read", "cars/images", "--outbox", "x.db"], 2), (["plate", "read", "cars/images", "--homeassistant"], 2),
                          (["plate", "read", "cars/images", "--publish", "mqtt://x", "--outbox", "missing/x.db"], 6),
                          (["hub", "--log", "x.db"], 2), (["hub", "mqtt://x"], 2), (["hub", "--log", "gone.db", "--list"], 3),
                          (["hub", "mqtt://x", "--log", "missing/x.db"], 6)):
        result = subprocess.run([TARSIER, *words], capture_output=True, text=True, timeout=60)
        if result.returncode != status or not result.stderr.startswith("tarsier: error: ") or result.stderr.count("\n") != 1:
            fail(f"{words}: {result}")


def main():
    made = subprocess.run([TARSIER, "plate", "synth", "-o", "cars", "--count", "4", "--size", "640x360", "--quiet"])
    if made.returncode != 0:
        sys.exit("no images")
    try:
        for check in (check_usage, check_kills, check_states, check_security):
            print(check.__name__, flush=True)
            check()
    finally:
        for process in running:
            if process.poll() is None:
                process.kill()
                process.wait()
    print(f"{len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
