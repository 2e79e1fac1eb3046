# SPDX-License-Identifier: MIT
"""Three nodes with synthetic drives, a broker and a hub, each in its own network namespace. Each is killed at random moments, and
links are cut. At the end the hub has every event that a node ever wrote exactly once, including all vehicles of the drives, and
the nodes' disks hold no pending event. Run in a network namespace with the right to make others. TARSIER_LINK_KILLS is the number
of kills."""
import json
import os
import random
import signal
import subprocess
import sys
import time

import plate_publish as site

ROUNDS = int(os.environ.get("TARSIER_LINK_KILLS", "2"))
FRAMES = int(os.environ.get("TARSIER_LINK_FRAMES", "25"))
NODES = {"gate": 11, "yard": 12, "exit": 13}  # and the seed of its drive
PORT = 1883


def ip(*words):
    subprocess.run(["ip", *words], check=True)


def make_network():
    ip("link", "set", "lo", "up")
    ip("link", "add", "bridge", "type", "bridge")
    ip("link", "set", "bridge", "up")
    for number, name in enumerate(["broker", "hub", *NODES], start=1):
        ip("netns", "add", name)
        ip("link", "add", f"to-{name}", "type", "veth", "peer", "name", "eth0", "netns", name)
        ip("link", "set", f"to-{name}", "master", "bridge", "up")
        ip("-n", name, "addr", "add", f"10.77.0.{number}/24", "dev", "eth0")
        ip("-n", name, "link", "set", "eth0", "up")
        ip("-n", name, "link", "set", "lo", "up")


def start_in(name, words):
    return site.start(["ip", "netns", "exec", name, *words], stdout=subprocess.DEVNULL, stderr=open(f"{name}.err", "a"))


def source_of(name):
    return f"synth:drive?seed={NODES[name]}&frames={FRAMES}&size=640x360&fps=5&seconds={FRAMES // 5}&cars=3"


def start_broker():
    with open("broker.conf", "w") as file:
        file.write(f"listener {PORT} 10.77.0.1\npersistence false\nuser root\nallow_anonymous true\n")
    return start_in("broker", [site.BROKER, "-c", "broker.conf"])


def start_hub():
    return start_in("hub", [site.TARSIER, "hub", f"mqtt://10.77.0.1:{PORT}/site", "--log", "events.db"])


def start_node(name):
    return start_in(name, [site.TARSIER, "plate", "read", source_of(name), "--events", "--publish", f"mqtt://10.77.0.1:{PORT}/site/{name}",
                           "--outbox", f"{name}.db", "--threads", "1", "--quiet"])


def texts_of_drive(name):
    lines = subprocess.run([site.TARSIER, "plate", "read", source_of(name), "--events", "--json", "--quiet"], capture_output=True, text=True).stdout
    return {json.loads(line)["text"] for line in lines.splitlines()}


def size_of(name):
    return sum(os.path.getsize(name + ending) for ending in (".db", ".db-wal") if os.path.exists(name + ending))


def restart_ended(nodes):
    """The nodes that were killed or have reached the end of their drive."""
    for name, node in nodes.items():
        if node.poll() is not None:
            nodes[name] = start_node(name)


def main():
    random.seed(int(os.environ.get("TARSIER_MQTT_SEED", "1")))
    make_network()
    truth = {name: texts_of_drive(name) for name in NODES}
    broker, hub = start_broker(), start_hub()
    nodes = {name: start_node(name) for name in NODES}
    largest = 0
    for number in range(ROUNDS):
        written = sum(site.assigned_numbers(name) for name in NODES)
        site.wait_for(lambda before=written: restart_ended(nodes) or sum(site.assigned_numbers(name) for name in NODES) > before, 30)
        time.sleep(random.uniform(0, 1))  # at any moment of their work
        victim = random.choice(["broker", "hub", *NODES])
        fault = random.choice(["killed", "cut off"])
        if fault == "cut off":
            ip("link", "set", f"to-{victim}", "down")
            time.sleep(random.uniform(0.1, 1))
            ip("link", "set", f"to-{victim}", "up")
        elif victim == "broker":
            site.end(broker, signal.SIGKILL)
            broker = start_broker()
        elif victim == "hub":
            site.end(hub, signal.SIGKILL)
            hub = start_hub()
        else:
            site.end(nodes[victim], signal.SIGKILL)
        restart_ended(nodes)
        largest = max(largest, *(size_of(name) for name in NODES))
        print(f"   {number + 1}: {victim} {fault}; {len(site.stored())} stored of {sum(site.assigned_numbers(name) for name in NODES)}", flush=True)
    for node in nodes.values():
        node.wait()

    def all_events_sent():
        return all(not site.rows(f"{name}.db", "SELECT 1 FROM outbox") for name in NODES)

    for _ in range(10):  # pending events of a node are sent at its next run at the latest
        for node in [start_node(name) for name in NODES]:
            node.wait()
        if site.wait_for(all_events_sent, 5):
            break
    written = {(name, seq) for name in NODES for seq in range(1, site.assigned_numbers(name) + 1)}
    if not written or not site.wait_for(lambda: site.stored() == written, 30):
        site.fail(f"the hub has {len(site.stored())} events of {len(written)}; {sorted(written - site.stored())[:10]} are missing")
    count = site.rows("events.db", "SELECT count(*), count(DISTINCT node || outbox || seq) FROM hub_event")
    if count != [(len(written), len(written))]:
        site.fail(f"doubles: {count} of {len(written)}")
    for name in NODES:
        events = [json.loads(text) for text, in site.rows("events.db", f"SELECT event FROM hub_event WHERE node = '{name}'")]
        closed = {event["text"] for event in events if event["state"] == "closed"}
        if closed != truth[name] or not closed:
            site.fail(f"{name}: vehicles {sorted(closed)}, and an undisturbed drive has {sorted(truth[name])}")
    if not all_events_sent():
        site.fail("a node keeps what the hub has stored")
    if largest > 2_000_000:
        site.fail(f"an outbox grew to {largest} bytes")
    for process in (hub, broker):
        site.end(process, signal.SIGKILL)
    print(f"   {len(written)} events, {ROUNDS} kills and cuts, outboxes up to {largest} bytes", flush=True)
    sys.exit(1 if site.failures else 0)


main()
