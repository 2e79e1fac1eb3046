# SPDX-License-Identifier: MIT
"""Tests all verbs as `tarsier help --json` lists them, so that a new verb is tested from the start.

For each verb: --help, its example, its flags, --version, an unknown flag, a missing input, a missing model, --json, --quiet,
interruption. Runs in an empty folder; $TARSIER is the program. If all verbs are tested, same_again.py tests --json and --quiet,
since it runs each verb twice anyway. A verb that is missing in a table below fails.

cli_verbs.py [VERB ..]           these verbs, or all; of all, the share $TARSIER_SHARD ("2/4": the second of four)
cli_verbs.py --make FOLDER       only makes the inputs, which $TARSIER_INPUTS then names to several runs
cli_verbs.py --stops [VERB ..]   only interrupts, after more delays, and prints the table of docs/results.md
"""
import json
import os
import random
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from processes import cpu_seconds, stat_of

PROGRAM = os.environ["TARSIER"]
INPUTS = os.environ.get("TARSIER_INPUTS", "")  # a folder that make_inputs() filled
PATIENCE = int(os.environ.get("TARSIER_TEST_TIMEOUT", "900"))  # s, for a run on a loaded machine; more under sanitizers
failures = []


def fail(verb, text):
    failures.append(verb)
    print(f"FAILED: {verb}: {text}", flush=True)


class Result:
    def __init__(self, status, out, err):
        self.status, self.out, self.err = status, out, err

    def __str__(self):
        return f"exit status {self.status}, stdout {self.out[:300]!r}, stderr {self.err[:500]!r}"


def run(words, stdin=""):
    try:
        done = subprocess.run([PROGRAM, *words], input=stdin, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return Result(-1, "", f"tarsier {' '.join(words)}: still running after {PATIENCE} s")
    return Result(done.returncode, done.stdout, done.stderr)


def expect_error(verb, result, status, name=""):
    lines = result.err.splitlines()
    if result.status != status:
        fail(verb, f"expected exit status {status}: {result}")
    elif len(lines) != 1 or not lines[0].startswith("tarsier: error: "):
        fail(verb, f"not one line of error: {result}")
    elif name not in lines[0]:
        fail(verb, f"the error does not name {name}: {result}")
    elif result.out:
        fail(verb, f"an error, and output: {result}")


# The valid run of each verb: the words after the verb, lines on stdin, exit status (0 by default), lines of JSON (by default at
# least one). The program makes `head`, `cars` .. first.
FACE = "head/images/0000.png"
BOARD = "'synth:board?size=320x240&fps=5&frames=%s' --board chess:9x6 --square 25mm"
SHIPPED = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../models/head.json")
TRACKER = os.path.join(os.path.dirname(SHIPPED), "landmarks68.json")
VALID = {
    "cartoon run": dict(words="scene.png -o drawn.png"),
    "landmarks annotate": dict(words="head/images -o own.json --actions -", stdin="frames 1\nclick 20 20\n"),
    "landmarks import": dict(words="points -o imported.json"),
    "landmarks show": dict(words="head/set.json -o sheet.png"),
    "landmarks train shape": dict(words="head/set.json -o shape.json"),
    "landmarks train patches": dict(words="head/set.json -o patches.json --patch 5"),
    "landmarks train detector": dict(words="head/set.json -o detector.json"),
    "landmarks train trees": dict(words="head/set.json -o trees.json --levels 1 --trees 2"),
    "landmarks train tracker": dict(words="head/set.json -o tracker.json --levels 1 --trees 2 --without sdm"),
    "landmarks train network": dict(words=f"head/set.json --model {TRACKER} -o network.json --steps 2"),
    "landmarks train visibility": dict(words=f"head/set.json --model {TRACKER} -o visibility.json --steps 2"),
    "landmarks train face-detector": dict(words="head/set.json -o finder.json --window 40 --no-mirror"),
    "landmarks train face-networks": dict(words="head/set.json -o networks.json --without markers/images --scan-steps 3 --refine-steps 3 --check-steps 3 --drawings 0 --turned 1"),
    "landmarks fit": dict(words=f"{FACE} -o fitted.png"),
    "landmarks track": dict(words="head/images --sequence -o none"),
    "landmarks adapt": dict(words="head/set.json -o adapted.json --starts 4 --ridge 1"),
    "landmarks eval": dict(words="head/set.json"),
    "aam train": dict(words="head/set.json -o aam.json --width 24 --levels 1 --no-colour --no-detector"),
    "aam explore": dict(words="-o face.png"),
    "aam fit": dict(words=f"{FACE} -o aam.png --iterations 3"),
    "aam eval": dict(words="head/set.json --iterations 3"),
    "pose solve": dict(words="--object cube.txt --points seen.txt --focal 800"),
    "pose train-head": dict(words="head/set.json -o learnt.json --modes 1 --iterations 2"),
    "pose train-view": dict(words="--truth head/truth.jsonl -o views.json"),
    "pose track": dict(words=f"{FACE} -o posed.png"),
    "pose eval": dict(words="--truth head/truth.jsonl"),
    "pose synth": dict(words="-o other --count 1 --size 160x120"),
    "people enroll": dict(words=f"Ann {FACE} --any-quality"),
    "people list": dict(words=""),
    "people forget": dict(words="Ann --yes"),
    "people export": dict(words="-o all"),
    "people train": dict(words=""),
    "people group": dict(words="seen.db"),
    "people groups": dict(words="--gallery seen.db"),
    "people name": dict(words="1 Zoe --gallery seen.db"),
    "people correct not": dict(words="--face 1"),
    "people correct move": dict(words="Zoe --face 1"),
    "people correct merge": dict(words="Ann Ben"),
    "people correct split": dict(words="Ann Zoe --face 1"),
    "people correct undo": dict(words="--gallery seen.db"),
    "people log": dict(words="--gallery seen.db"),
    "people index": dict(words="", status=1),
    "people identify": dict(words=f"{FACE} -o named.png"),
    "people verify": dict(words=f"Ann {FACE} --far 0.5"),
    "people show": dict(words="-o inside.png"),
    "people eval": dict(words="faces.lst -k 1 --seeds 1 --algorithm lbph"),
    "people live": dict(words="head/images --sequence -o none"),
    "people liveness": dict(words="head/images --sequence -o none", status=1),
    "plate read": dict(words="cars/images/car-00000.jpg -o read.png"),
    "plate segment": dict(words="cars/images -o cut"),
    "plate train-detector": dict(words="plates -o svm.json --pipeline classic"),
    "plate train-reader": dict(words="letters -o mlp.json --pipeline classic --reader mlp --neurons 2"),
    "plate eval": dict(words="cars/images --truth cars/truth.csv"),
    "plate sweep": dict(words="letters --features 5 --neurons 2 --splits 1 --train 60 --iterations 1"),
    "plate synth": dict(words="-o more --count 1 --size 320x180"),
    "plate log": dict(words="plates.db"),
    "plate watch add": dict(words="watch.csv 2471KFD --label Ann"),
    "plate watch remove": dict(words="watch.csv 9999ZZZ", status=1, lines=0),
    "plate watch list": dict(words="watch.csv"),
    "plate watch test": dict(words="watch.csv 2471KFD"),
    "sfm reconstruct": dict(words="views/images -o model --no-cache"),
    "sfm plan": dict(words="views/images -o planned --shards 2"),
    "sfm features": dict(words="fresh --shard 1/2"),
    "sfm match": dict(words="matchless --shard 1/2"),
    "sfm map": dict(words="matched -o mapped --no-cache"),
    "sfm merge": dict(words="clustered -o merged --no-cache"),
    "sfm dense": dict(words="model -o dense --quality draft --images views/images"),
    "sfm mesh": dict(words="depths -o mesh.glb --faces 2000"),
    "sfm synth": dict(words="-o scene2 --images 2 --size 160x120"),
    "sfm eval": dict(words="model --truth views/truth.jsonl"),
    "calibrate": dict(words=f"{BOARD % 40} -o lens.yaml"),
    "ar marker-sheet": dict(words="--ids 0-3 -o sheet.pdf"),
    "ar markers": dict(words="markers/images -o none"),
    "ar eval": dict(words="markers/truth.jsonl"),
    "ar synth": dict(words="planar -o posters --count 1 --posters 1 --size 320x240"),
    "ar target-train": dict(words="scene.png -o scene.target.json --trials 2"),
    "ar target-track": dict(words="scene.png --target first.target.json -o none"),
    "models list": dict(words=""),
    "models info": dict(words="landmarks68"),
    "models verify": dict(words=""),
    "models import": dict(words="tiny/tiny-weights_manifest.json -o tiny.json --any-weights"),
    "models install": dict(words=f"{SHIPPED} --own-dir own"),
    "models remove": dict(words="head --own-dir none-of-them", status=1),
    "doctor": dict(words=""),
    "merge": dict(words="part.jsonl -o merged.jsonl"),
}
# With --debug-dir these verbs write their stages: at least this many images or clouds in the run above.
STAGES = {"cartoon run": 5, "plate read": 3, "landmarks fit": 4, "landmarks track": 4, "aam fit": 2, "people identify": 4,
          "people live": 4, "pose track": 6, "sfm reconstruct": 4, "sfm dense": 8, "ar markers": 3, "ar target-track": 3}
# These runs are long, so they are only interrupted here. demo_page and the figures of docs/results.md run them fully.
LONG = {"demo": "-o page", "serve": "--workspace studio --port 0 --no-browser",
        "hub": "mqtt://127.0.0.1:1 --log hub.db", **{f"bench {name}": "--json" for name in
        "aam cartoon eyes landmarks people plate calibrate markers posit render sfm steady targets".split()}}

# The examples name files that do not exist. All must report this with this status, except those that need no file.
EXAMPLE_STATUS = {
    "aam explore": 0, "pose synth": 0, "plate synth": 0, "sfm synth": 0, "ar marker-sheet": 0, "ar synth": 0, "models list": 0,
    "models info": 0, "people list": 1, "people group": 1, "people groups": 1, "people log": 1, "people forget": 1, "people export": 1, "people train": 1, "people index": 1, "people show": 1,
    "models verify": 0, "models remove": 1, "doctor": 0, "plate watch add": 0,
}

# These need no file. They draw small images here, where the example gives no size.
SMALLER = {"sfm synth": "--size 160x120", "ar synth": "--size 320x240", "pose synth": "--size 160x120", "plate synth": "--size 320x180"}


def default_in(text, flag):
    """Whether --help shows, after the flag's name, the default of `help --json`."""
    shown = re.match(r"(?: [A-Z]+| \{[^}]*\})?(?: \([^)]*\))?=(\S+)", text)
    default = flag["default"]
    if default is None or default is False:
        return shown is None
    if shown is None:
        return False
    if isinstance(default, bool):
        return shown[1] in ("on", "true")
    if isinstance(default, list):
        return shown[1] == f"[{','.join(str(value) for value in default)}]"
    if flag["type"] in ("integer", "number"):
        return float(shown[1]) == default
    return "=" + default in text


def check_help(verb):
    """--help and `help --json` show the same flags, with the same defaults."""
    name = verb["verb"]
    result = run([*name.split(), "--help"])
    if result.status != 0 or result.err or f"Usage: tarsier {name}" not in result.out:
        fail(name, f"--help: {result}")
    for given in verb["inputs"]:
        if not re.search(rf"^  {re.escape(given['names'][0])}\b", result.out, re.M):
            fail(name, f"--help lacks {given['names'][0]}")
    shown = {}
    for line in result.out.splitlines():
        found = re.match(r"  (-[^\s=]+)(.*)", line)
        if found:
            shown.update((called, found[2]) for called in found[1].split(","))
    known = {called for flag in verb["flags"] for called in flag["names"]}
    if set(shown) != known | {"-h", "--help"}:
        fail(name, f"--help and help --json differ: {sorted(set(shown) ^ known)}")
    for flag in verb["flags"]:
        if flag["type"] not in ("switch", "integer", "number", "text"):
            fail(name, f"{flag['names'][0]}: type {flag['type']!r}")
        if not default_in(shown.get(flag["names"][0], ""), flag):
            fail(name, f"{flag['names'][0]}: default {flag['default']!r}, --help has {shown.get(flag['names'][0])!r}")
    if verb["example"] and "Example: " + verb["example"] not in result.out:
        fail(name, "--help lacks the example")
    common = {flag["names"][0] for flag in verb["flags"] if flag["group"] == "Common"}
    if common != {"--json", "--quiet", "--seed", "--threads", "--log-level", "--progress", "--config"}:
        fail(name, f"common flags: {sorted(common)}")
    if (name in STAGES) != any("--debug-dir" in flag["names"] for flag in verb["flags"]):
        fail(name, "--debug-dir is of the verbs in STAGES, and of no other")


UNITS = re.compile(r"""\b(px|mm|s|degrees|seconds|frames?|share|times|images?|features|points?|modes?|views?|images|grey\ levels
    |standard\ deviations?|nats|%|batches|digits|pages?|characters?|candidates|plates?|faces?|people|samples?|threads|cores
    |iterations?|rounds|runs|draws|splits|levels?|trees?|starts?|eigenfaces|sightings|fits|sides?|pixels|hidden|rate
    |neurons|width|aperture|aligner's|rays|diagonal|fps|newest|numbers?|mistakes|accuracy|deviations|distances|inlier
    |weight|likeness|Laplacian|Scharr|filters|natural|overlap|score|worth|scale|SIFT|reduced|differs?|taken|life|tree
    |GB|jobs?|any\ that\ is\ free|logit|SVM|training|random|camera|noise|kind|page|png|dpi|resolution|objects?|object\ units|corners|how\ many|%\ of)\b|%\ of|\d\.\.\d|[([]\d+(\.\d+)?,\ \d""", re.X)


def check_flags(verb):
    name = verb["verb"]
    if not verb["help"]:
        fail(name, "no description")
    for flag in verb["inputs"] + verb["flags"]:
        called = flag["names"][0]
        text = flag["help"]
        if not text and not flag["choices"]:
            fail(name, f"{called} has no description")
        if flag["type"] in ("integer", "number") and called.startswith("-"):
            if flag["default"] is None and not flag["required"] and "[" not in text and "default" not in text:
                fail(name, f"{called}: --help does not tell its default")
            if flag["group"] != "Common" and not flag.get("range") and not UNITS.search(text):
                fail(name, f"{called}: --help tells no unit, no range and no meaning: {text!r}")


def check_example(verb):
    """It belongs to this verb, uses only existing flags, has all required ones, and is no usage error."""
    name = verb["verb"]
    words = shlex.split(verb["example"])
    if not words:
        return fail(name, "no example: add one to apps/tarsier/framework/examples.cpp")
    if words[: 1 + len(name.split())] != ["tarsier", *name.split()]:
        return fail(name, f"the example is of another verb: {verb['example']}")
    known = {n for flag in verb["flags"] for n in flag["names"]}
    for word in words:
        if word.startswith("-") and word.split("=")[0] not in known:
            fail(name, f"the example has an unknown flag: {word}")
    if name in LONG or name in ("people live", "people liveness"):  # a camera
        return None
    os.makedirs("empty", exist_ok=True)
    here = os.getcwd()
    os.chdir("empty")
    try:
        if name.startswith("people "):  # a gallery without people
            run(["people", "enroll", "Nobody", "missing.jpg"])
        result = run([*words[1:], *shlex.split(SMALLER.get(name, ""))])
    finally:
        os.chdir(here)
    status = EXAMPLE_STATUS.get(name, 3)
    if result.status != status:
        fail(name, f"the example, without its files: expected exit status {status}: {result}")
    elif status == 3:  # the last line; "nobody is enrolled" may come before it
        result.err = "\n".join(result.err.splitlines()[-1:])
        expect_error(name, result, 3)
    return None


def check_usage(verb):
    name = verb["verb"]
    expect_error(name, run([*name.split(), "--frobnicate"]), 2, "--frobnicate")
    result = run([*name.split(), "--version"])
    if result.status != 0 or not re.fullmatch(r"tarsier \d+\.\d+\.\d+\n", result.out) or result.err:
        fail(name, f"--version: {result}")
    if any(flag["required"] for flag in verb["inputs"] + verb["flags"]):
        expect_error(name, run(name.split()), 2)


def check_missing(verb):
    """Inputs at a path that does not exist: one line that names it."""
    name = verb["verb"]
    words = shlex.split(VALID[name]["words"])
    if name not in EXAMPLE_STATUS and not name.startswith("people "):
        gone = ["gone/" + w if os.path.exists(w) and words[i - 1] not in ("-o", "--target") else w for i, w in enumerate(words)]
        first = next((w for w in gone if w.startswith("gone/")), None)
        if first:
            expect_error(name, run([*name.split(), *gone], VALID[name].get("stdin", "")), 3, "gone/")
    for flag in verb["flags"]:
        for called in flag["names"]:
            if called in ("--model", "--detector", "--reader", "--head", "--appearance", "--background"):
                if flag["choices"] or (name, called) in NO_FILE:
                    continue
                own = [w for i, w in enumerate(words) if called not in (w, words[i - 1])]
                result = run([*name.split(), *own, called, "missing.json"], VALID[name].get("stdin", ""))
                expect_error(f"{name} {called}", result, 5, "missing.json")


# Flags of these names that the run of VALID does not read.
NO_FILE = {("plate log", "--detector"), ("plate log", "--reader"), ("landmarks train tracker", "--head"), ("plate train-reader", "--detector"), ("pose track", "--appearance"), ("pose eval", "--appearance")}


def check_json_and_quiet(verb):
    name = verb["verb"]
    entry = VALID[name]
    words = [*name.split(), *shlex.split(entry["words"]), "--json", "--quiet"]
    prepare(name)
    return check_lines(name, entry, run(words, entry.get("stdin", "")))


def check_lines(name, entry, result):
    """Checks the output of a run with --json and --quiet; same_again.py calls it for its runs."""
    if result.status != entry.get("status", 0):
        return fail(name, f"a run: {result}")
    told = [line for line in result.err.splitlines() if not line.startswith("tarsier: warning: ")]
    if told:
        fail(name, f"--quiet, and stderr has {told}")
    lines = result.out.splitlines()
    if len(lines) < entry.get("lines", 1):
        fail(name, f"--json wrote {len(lines)} lines")
    for line in lines:
        try:
            if not isinstance(json.loads(line), dict):
                fail(name, f"--json wrote no object: {line[:200]}")
        except ValueError:
            fail(name, f"--json wrote {line[:200]!r}")
    return None


def check_stages(name):
    """--debug-dir contains the stages of the verb."""
    prepare(name)
    words = [*name.split(), *shlex.split(VALID[name]["words"]), "--quiet", "--debug-dir", "stages/" + name.replace(" ", "-")]
    result = run(words)
    made = [os.path.join(folder, file) for folder, _, files in os.walk(words[-1]) for file in files]
    if result.status != 0 or len(made) < STAGES[name]:
        fail(name, f"--debug-dir made {sorted(made)}: {result}")
    if any(os.path.getsize(path) < 100 for path in made):
        fail(name, f"--debug-dir made an empty file: {sorted(made)}")


def prepare(name):
    """Restores what a verb's run needs and another verb may have removed: the gallery of Ann and Ben, and the sightings'
    gallery."""
    if name.startswith("people "):
        for path in os.listdir("."):
            if path.startswith(("people.db", "seen.db")):
                os.unlink(path)
        shutil.copy(os.path.join(INPUTS, "people.db"), "people.db")
        if name != "people forget":  # it would find Ann's faces in the other gallery
            shutil.copy(os.path.join(INPUTS, "seen.db"), "seen.db")


def temporary_files():
    return sorted(os.path.join(folder, name) for folder, _, names in os.walk(".") for name in names
                  if name.startswith(".") or name.endswith((".tmp", ".part")))


# `faces.txt`, `cars.txt`, `crowd.lst`, `head/crowd.json` .. list the same few images many times.
INTERRUPTED = {
    **LONG,
    "cartoon run": "synth:scene -o stopped.mp4 --quality reference",
    "landmarks train patches": "head/crowd.json -o stopped.json",
    "landmarks train detector": "head/crowd.json -o stopped.json",
    "landmarks train tracker": "head/set.json -o stopped.json",
    "landmarks train trees": "head/set.json -o stopped.json",
    "landmarks train network": f"head/crowd.json --model {TRACKER} -o stopped.json",
    "landmarks train visibility": f"head/crowd.json --model {TRACKER} -o stopped.json",
    "landmarks train face-detector": "head/set.json -o stopped.json --window 40",
    "landmarks fit": "@faces.txt -o stopped",
    "landmarks train face-networks": "head/set.json -o stopped.json --without cars/images",
    "landmarks track": "synth:scene -o stopped.mp4",
    "landmarks adapt": "head/crowd.json -o stopped.json",
    "landmarks eval": "head/crowd.json --eyes 36,45",
    "aam train": "head/crowd.json -o stopped.json",
    "aam fit": "@faces.txt -o stopped",
    "aam eval": "head/set.json --convergence stopped.png --tries 1000",
    "pose train-head": "head/set.json -o stopped.json --modes 1 --iterations 1000",
    "pose train-view": "--truth head/crowd.jsonl -o stopped.json",
    "pose track": "@faces.txt -o stopped",
    "pose eval": "--truth head/crowd.jsonl",
    "pose synth": "-o stopped --count 1000",
    "people enroll": "Zoe @faces.txt --any-quality",
    "people train": "--list crowd.lst --raw -o stopped.json",
    "people identify": "@faces.txt -o stopped",
    "people verify": "Ann @faces.txt",
    "people live": "@faces.txt --sequence -o stopped.mp4",
    "people liveness": "@faces.txt --sequence -o stopped.mp4",
    "people eval": "crowd.lst --raw -k 5",
    "plate read": "@cars.txt -o stopped",
    "plate segment": "@cars.txt -o stopped",
    "plate train-detector": "cars/images -o stopped.json",
    "plate train-reader": "--scenes points -o stopped.json",
    "plate eval": "@cars.txt --truth cars/truth.csv",
    "plate synth": "-o stopped --count 10000",
    "plate sweep": "letters --train 60 --splits 1000",
    "sfm reconstruct": "ring/images -o stopped --no-cache",
    "sfm features": "ring-planned",
    "sfm match": "ring-matchless",
    "sfm map": "ring-matched -o stopped --no-cache",
    "sfm merge": "ring-clustered -o stopped --no-cache",
    "sfm dense": "model -o stopped --quality high --images views/images",
    "sfm mesh": "depths -o stopped.glb",
    "sfm synth": "-o stopped --images 200",
    "calibrate": f"{BOARD % 1000} -o stopped.yaml",
    "ar markers": "synth:scene -o stopped.mp4",
    "ar eval": "many/crowd.jsonl -o stopped.json",
    "ar synth": "markers -o stopped --count 10000",
    "ar target-train": "scene.png -o stopped.json --trials 500",
    "ar target-track": "synth:scene --target first.target.json -o stopped.mp4",
}
# These end by themselves within a moment: their work does not grow with the input, or only as fast as files are read.
SHORT = {"landmarks annotate", "landmarks import", "landmarks show", "landmarks train shape", "aam explore", "pose solve", "people list", "people group", "people groups", "people name", "people correct not", "people correct move",
         "people correct merge", "people correct split", "people correct undo", "people log", "people index", "people show", "people forget", "people export", "plate log",
         "plate watch add", "plate watch remove", "plate watch list", "plate watch test", "sfm plan", "sfm eval", "ar marker-sheet", "models list", "models info",
         "models verify", "models import", "models install", "models remove", "doctor", "merge"}
# Limit from SIGINT to the end, processor time. Each verb runs with one thread, so on an idle machine it is the user's waiting time.
# On a slower or busy machine the limit grows by the factor that REFERENCE_VERIFY_CPU takes longer. Sanitized code is several times slower.
MAX_STOP_CPU = float(os.environ.get("TARSIER_STOP_CPU", "5" if os.environ.get("TARSIER_SANITIZED") else "0.5"))  # s
REFERENCE_VERIFY_CPU = 0.2  # s of `tarsier models verify --threads 1` on the machine where that limit was set
STOP_TRIES = 3  # the best counts: other programs may evict the processor's caches at any time
MAX_STOP_WALL = 60  # s, on a loaded machine. Needed because a sleeping program uses no processor time.
STOP_DELAYS = (0.05, 0.5 if os.environ.get("TARSIER_TEST_ALL") else 0.2)  # CPU s after the program is ready for signals
MORE_STOP_DELAYS = (0.05, 0.2, 0.5, 1.0)


def wait_until_ready(pid):
    """Waits until the program waits for SIGINT, which it then blocks (or has ended). Before that it has begun nothing."""
    while stat_of(pid):
        with open(f"/proc/{pid}/status") as file:
            blocked = next((int(line.split()[1], 16) for line in file if line.startswith("SigBlk:")), 0)
        if blocked & (1 << (signal.SIGINT - 1)):
            return
        time.sleep(0.005)


def wait_until_used(pid, seconds):
    """Waits until it has computed for this time, has ended, or waits for something (a source that plays in real time)."""
    begin = used = cpu_seconds(pid) or 0.0
    changed = time.monotonic()
    while used is not None and used - begin < seconds:
        time.sleep(0.005)
        before, used = used, cpu_seconds(pid)
        if used != before:
            changed = time.monotonic()
        elif time.monotonic() - changed > 5:
            return


class Stop:
    """An interrupted run: exit status, stderr, and CPU seconds and seconds from the signal to the end."""

    def __init__(self, words, delay):
        self.cpu = self.wall = 0.0
        self.hung = False
        with tempfile.TemporaryFile("w+", errors="replace") as stderr:
            process = subprocess.Popen([PROGRAM, *words, "--threads", "1"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                       stderr=stderr, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))  # nohup ignores it
            wait_until_ready(process.pid)
            wait_until_used(process.pid, delay)
            before = cpu_seconds(process.pid)
            begin = time.monotonic()
            os.kill(process.pid, signal.SIGINT)
            pid = 0
            while not pid:
                pid, status, usage = os.wait4(process.pid, os.WNOHANG)
                if not pid and not self.hung and time.monotonic() - begin > MAX_STOP_WALL:
                    self.hung = True
                    process.kill()
                time.sleep(0.002)
            process.returncode = self.status = os.waitstatus_to_exitcode(status)
            if before is not None:
                self.wall = time.monotonic() - begin
                self.cpu = max(0.0, usage.ru_utime + usage.ru_stime - before)
            stderr.seek(0)
            self.error = stderr.read()


def slowdown_factor():
    """How many times slower this machine is now than the machine of REFERENCE_VERIFY_CPU, at least 1."""
    begin = children_cpu()
    run(["models", "verify", "--quiet", "--threads", "1"])
    return max(1.0, (children_cpu() - begin) / REFERENCE_VERIFY_CPU)


def stop_fresh_run(name, words, delay):
    """A run stopped after `delay` CPU seconds, with fresh inputs and without earlier results; and the files before it."""
    subprocess.run("rm -rf stopped stopped.*", shell=True, check=True)
    prepare(name)
    before = temporary_files()
    return Stop([*name.split(), *shlex.split(words)], delay), before


def check_interruption(name, words, delays=STOP_DELAYS):
    """Stopped at several moments: status 130 (or the end was reached), quickly, and no partial output."""
    stops = []
    # On a busy machine the signal may come after the end. Then it is sent again, as early as possible.
    for delay in [*delays, *[0.0] * STOP_TRIES]:
        if delay == 0.0 and stops:
            break
        for _ in range(STOP_TRIES):
            stop, before = stop_fresh_run(name, words, delay)
            limit = MAX_STOP_CPU * slowdown_factor() if stop.cpu > MAX_STOP_CPU else MAX_STOP_CPU
            if stop.cpu <= limit:
                break
        where = f"SIGINT after {delay} CPU s"
        if stop.hung:
            fail(name, f"{where} did not end it within {MAX_STOP_WALL} s")
        if stop.status not in (0, 130):
            fail(name, f"{where}: exit status {stop.status}: {stop.error[:300]!r}")
        if stop.status == 130 and stop.cpu > limit:
            fail(name, f"{where}: it computed for {stop.cpu:.2f} s until it ended, of {limit:.2f} s that it may take here")
        if temporary_files() != before:
            fail(name, f"{where} left {set(temporary_files()) - set(before)}")
        for path in ("stopped.json", "stopped.yaml", "stopped.pdf", "stopped.png"):
            if stop.status == 130 and os.path.exists(path):
                fail(name, f"{where}: {path} was written")
        if stop.status == 130:
            stops.append(stop)
    if not stops:
        fail(name, "it had ended before SIGINT came: give it more to do in INTERRUPTED")
        return 0.0, 0.0
    slowest = max(stop.cpu for stop in stops), max(stop.wall for stop in stops)
    print(f"   stopped after {slowest[0]:.2f} CPU s, {slowest[1]:.2f} s: {name}", flush=True)
    return slowest


def write_grey(path, width, height, value):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as file:
        file.write(b"P5\n%d %d\n255\n" % (width, height))
        file.write(bytes(value(x, y) for y in range(height) for x in range(width)))


def make_inputs(folder):
    """Fills a new folder with the inputs that VALID and INTERRUPTED name."""
    here = os.getcwd()
    shutil.rmtree(folder + ".part", ignore_errors=True)
    os.makedirs(folder + ".part")
    os.chdir(folder + ".part")
    make_inputs_here()
    os.chdir(here)
    shutil.rmtree(folder, ignore_errors=True)
    os.rename(folder + ".part", folder)


def make_inputs_here():
    def made(*words):
        result = run(list(words))
        if result.status != 0:
            sys.exit(f"cannot make the inputs: tarsier {' '.join(words)}: {result}")

    made("cartoon", "run", "synth:scene", "--frames", "1", "-o", "scene.png", "--quiet")
    made("pose", "synth", "-o", "head", "--count", "12", "--size", "320x240", "--near", "450", "--far", "500", "--quiet")
    made("pose", "synth", "-o", "other", "--count", "6", "--size", "320x240", "--near", "450", "--far", "500",
         "--seed", "7", "--quiet")
    made("plate", "synth", "-o", "cars", "--count", "2", "--size", "640x360", "--quiet")
    subprocess.run([sys.executable, os.path.join(os.path.dirname(os.path.abspath(__file__)), "tiny_face_network.py"), "tiny"], check=True)
    made("ar", "synth", "markers", "-o", "markers", "--count", "2", "--size", "320x240", "--quiet")
    made("ar", "markers", "markers/images", "--jsonl", "part.jsonl", "--quiet")
    made("ar", "synth", "planar", "-o", "many", "--count", "12", "--size", "480x360", "--quiet")
    made("ar", "target-train", "scene.png", "-o", "first.target.json", "--trials", "2", "--quiet")
    made("sfm", "synth", "-o", "views", "--images", "5", "--size", "320x240", "--quiet")
    os.makedirs("points")
    with open("points/a.pts", "w") as file:
        file.write("version: 1\nn_points: 3\n{\n1 1\n5 1\n3 4\n}\n")
    subprocess.run(["cp", "scene.png", "points/a.png"], check=True)
    random.seed(2)
    for k in range(60):
        for name, on in (("1", lambda x, y: 8 <= x <= 11), ("L", lambda x, y: x < 5 or y > 15)):
            write_grey(f"letters/{name}/{k}.pgm", 20, 20,
                       lambda x, y: 230 if on(x, y) and random.random() > 0.05 else random.randint(0, 40))
        write_grey(f"plates/plate/{k}.pgm", 144, 33, lambda x, y: 40 if x // 9 % 2 and 8 < y < 25 else 210)
        write_grey(f"plates/no-plate/{k}.pgm", 144, 33, lambda x, y: random.randint(0, 255))
    with open("faces.lst", "w") as file:
        file.writelines(f"{folder}/images/{i:04}.png\t{folder}\n" for folder in ("head", "other") for i in range(6))
    result = run(["plate", "read", "cars/images", "--log", "plates.db", "-o", "none", "--quiet"])
    if result.status not in (0, 1):
        sys.exit(f"cannot make a log of plates: {result}")
    with open("watch.csv", "w") as file:
        file.write("plate,label\n2471KFD,Ann\n")
    cube = [(x, y, z) for z in (0, 10) for y in (0, 10) for x in (0, 10)]
    with open("cube.txt", "w") as file:
        file.writelines(f"{x} {y} {z}\n" for x, y, z in cube)
    with open("seen.txt", "w") as file:
        file.writelines(f"{800 * (x + 0.1 * z - 5) / (60 + z)} {800 * (y - 0.2 * z - 5) / (60 + z)}\n" for x, y, z in cube)
    for person, folder in (("Ann", "head"), ("Ben", "other")):
        made("people", "enroll", person, f"{folder}/images", "--any-quality", "--quiet")
    # Of a third head: nothing of Ann, whom a parallel run forgets.
    made("pose", "synth", "-o", "third", "--count", "4", "--size", "320x240", "--near", "450", "--far", "500", "--quiet", "--seed", "77")
    made("people", "enroll", "Eve", "third/images", "--any-quality", "--quiet", "--gallery", "seen.db")
    shutil.rmtree("third")
    run(["people", "identify", "other/images", "--keep", "30d", "--far", "0.000001", "--quiet", "--gallery", "seen.db"])
    made("people", "group", "--quiet", "seen.db")
    made("people", "correct", "move", "Adam", "--face", "1", "--quiet", "--gallery", "seen.db")
    made("sfm", "reconstruct", "views/images", "-o", "model", "--no-cache", "--quiet")
    for work in ("fresh", "matchless", "matched"):  # a plan; with features; with matches
        made("sfm", "plan", "views/images", "-o", work, "--shards", "2", "--quiet")
        for stage in ("features", "match")[: ("fresh", "matchless", "matched").index(work)]:
            made("sfm", stage, work, "--quiet")
    made("sfm", "plan", "views/images", "-o", "clustered", "--cluster-size", "4", "--quiet")
    for words in (("features",), ("match",), ("map", "--cluster", "all")):
        made("sfm", words[0], "clustered", *words[1:], "--quiet")
    # Enough images that each stage takes many times the first of STOP_DELAYS.
    made("sfm", "synth", "-o", "ring", "--images", "40", "--size", "320x240", "--quiet")
    made("sfm", "plan", "ring/images", "-o", "ring-planned", "--shards", "40", "--cluster-size", "16", "--quiet")
    for stage, work, made_from in (("features", "ring-matchless", "ring-planned"), ("match", "ring-matched", "ring-matchless"),
                                   ("map", "ring-clustered", "ring-matched")):
        shutil.copytree(made_from, work)
        made("sfm", stage, work, *(["--cluster", "all"] if stage == "map" else []), "--quiet")
    made("sfm", "dense", "model", "-o", "depths", "--quality", "draft", "--quiet")
    make_crowds()


def make_crowds():
    """Lists the same few images many times, for runs that must last."""
    faces = [f"{folder}/images/{name}" for folder in ("head", "other") for name in sorted(os.listdir(f"{folder}/images"))]
    cars = [f"cars/images/{name}" for name in sorted(os.listdir("cars/images"))]
    for path, names in (("faces.txt", faces * 30), ("cars.txt", cars * 100)):
        with open(path, "w") as file:
            file.writelines(f"{name}\n" for name in names)
    with open("crowd.lst", "w") as file:
        file.writelines(f"{path}\tperson {k}\n" for k, path in enumerate(faces) for _ in range(12))
    with open("head/set.json") as file:
        everything = json.load(file)
    everything["payload"]["samples"] *= 20
    with open("head/crowd.json", "w") as file:
        json.dump(everything, file)
    for folder in ("head", "many"):
        with open(f"{folder}/truth.jsonl") as file:
            lines = file.read()
        with open(f"{folder}/crowd.jsonl", "w") as file:
            file.write(lines * 20)


def children_cpu():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def prepare_inputs():
    """Makes the inputs if they do not exist, and works in a copy of them. Caches and settings belong to this run."""
    global INPUTS
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
        os.environ[name] = os.path.abspath("home")
    if not INPUTS:
        INPUTS = os.path.abspath("inputs")
        make_inputs(INPUTS)
    shutil.copytree(INPUTS, "work")
    os.chdir("work")


def shard_of(verbs):
    """The part of a list that $TARSIER_SHARD names: "2/4" is the second, sixth, tenth .."""
    number, count = (int(word) for word in os.environ.get("TARSIER_SHARD", "1/1").split("/"))
    return verbs[number - 1 :: count]


def stop_table(only):
    """The max over four moments for each verb."""
    prepare_inputs()
    print("| verb | CPU ms | ms |\n|---|---|---|")
    for name, words in INTERRUPTED.items():
        if not only or name in only:
            cpu, wall = check_interruption(name, words, MORE_STOP_DELAYS)
            print(f"| {name} | {1000 * cpu:.0f} | {1000 * wall:.0f} |", flush=True)


def main():
    arguments = sys.argv[1:]
    if arguments[:1] == ["--make"]:
        make_inputs(os.path.abspath(arguments[1]))
        return
    if arguments[:1] == ["--stops"]:
        stop_table(arguments[1:])
        sys.exit(1 if failures else 0)
    listing = run(["help", "--json"])
    verbs = json.loads(listing.out)["verbs"]
    names = {verb["verb"] for verb in verbs}
    if listing.status != 0 or len(names) < 50:
        sys.exit(f"the list of verbs: {listing}")
    for name in sorted(names - set(VALID) - set(LONG)):
        fail(name, "this verb is in no table of tests/e2e/cli_verbs.py")
    for name in sorted(names - set(INTERRUPTED) - SHORT):
        fail(name, "may it run long? Then it belongs to INTERRUPTED, else to SHORT, in tests/e2e/cli_verbs.py")
    for name in sorted((set(VALID) | set(LONG) | set(INTERRUPTED) | SHORT) - names):
        fail(name, "this test is of no verb")
    prepare_inputs()
    mine = [verb for verb in verbs if verb["verb"] in arguments] if arguments else shard_of(verbs)
    for verb in mine:
        name = verb["verb"]
        begin = children_cpu()
        check_help(verb)
        check_flags(verb)
        check_usage(verb)
        check_example(verb)
        if name in VALID:
            if arguments or name == "doctor":  # same_again.py tests all others
                check_json_and_quiet(verb)
            check_missing(verb)
        if name in STAGES:
            check_stages(name)
        if name in INTERRUPTED:
            check_interruption(name, INTERRUPTED[name])
        print(f"   {children_cpu() - begin:.1f} CPU s: {name}", flush=True)
    print(f"{len(mine)} verbs, {len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":  # same_again.py and tests/faults/faults.py use the tables above
    main()
