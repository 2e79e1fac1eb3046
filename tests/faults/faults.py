# SPDX-License-Identifier: MIT
"""Every verb that writes, with a full disk, a read-only one, an unreliable one, too little memory, and killed.

Each verb of tests/e2e/cli_verbs.py first runs undisturbed. This shows what it writes and how many files it opens, writes,
syncs and renames. Then it runs many times. Each time fault_shim.cpp makes one of these operations, chosen by the seed, fail,
or kills the program there. The outputs' places hold old files or none. Checked after each run:

- no crash; the exit status is a documented one; an error is one line that begins "tarsier: error: ";
- an output is the old file (or none) or the whole new one, never a part of it; exit status 0 means all of them, whole;
- nothing else remains; remains of a SIGKILL are gone after the next run;
- inputs are unchanged; databases pass PRAGMA integrity_check, and the program opens them;
- the next undisturbed run succeeds.

faults.py [--seed N] [--rounds N] [--seconds S] [--short] [VERB ..]; $TARSIER the program, $TARSIER_FAULT_SHIM the shim.
"""
import argparse
import collections
import hashlib
import json
import math
import os
import random
import resource
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import cli_verbs  # noqa: E402  (the table of valid runs)

PROGRAM = os.environ["TARSIER"]
SHIM = os.environ["TARSIER_FAULT_SHIM"]
STATUSES = {0, 1, 2, 3, 4, 5, 6, 130}
OLD = b"the old file\n"

# Runs in addition to cli_verbs.VALID, for more kinds of output. A verb without a row here has only its run of VALID.
MORE = {
    "cartoon run": ["many/images -o video.mp4 --mode sketch --sequence", "many/images -o video.avi --mode sketch --sequence",
                    "markers/images -o drawn --mode sketch", "scene.png -o drawn.png --debug-dir stages"],
    "plate read": ["cars/images -o none --csv plates.csv --log new.db", "cars/images -o none --log plates.db", "cars/images -o read.avi --sequence"],
    "plate log": ["plates.db --keep 30d", "plates.db --csv log.csv --crops cut", "plates.db --correct 1 1234BCD",
                  "plates.db --corrections learnt"],
    "sfm reconstruct": ["views/images -o model"],
    "landmarks fit": [f"{cli_verbs.FACE} -o none --csv points.csv"],
    "pose track": [f"{cli_verbs.FACE} -o none --csv poses.csv"],
    "ar marker-sheet": ["--ids 0-3 -o sheet.svg", "--ids 0-1 -o sheet.png"],
    "ar markers": ["markers/images -o marked --csv markers.csv"],
    "people enroll": [f"Cleo {cli_verbs.FACE} --any-quality --gallery new.db"],
}
# Runs that read their own earlier output (so the old file must be theirs), or that refuse to overwrite.
READS_OUTPUT = {"landmarks annotate", "sfm reconstruct", "people export"}
# Tables that grow line by line while a video or camera is processed, so that no measurement is lost. The first line replaces the
# old table. After a fault the table is a beginning of the complete one.
STREAMED = {"points.csv", "poses.csv", "markers.csv", "plates.csv"}
# The second run has no work left.
STATUS_AGAIN = {"people forget": {0, 1}, "plate log": {0, 1}, "people train": {0, 1}, "people enroll": {0, 1, 3}, "people export": {0, 6},
                "people name": {0, 3}, "people correct not": {0, 3}, "people correct move": {0, 3}, "people correct merge": {0, 3},
                "people correct split": {0, 3}, "people correct undo": {0, 3}}
# The runs of the short version: fast ones of each kind of output.
SHORT = ["cartoon run", "landmarks annotate", "landmarks import", "landmarks train shape", "people enroll", "people forget",
         "people export", "plate log", "ar marker-sheet", "pose solve"]

ACTIONS = {
    "open": ["ENOSPC", "EROFS+", "EACCES", "EIO", "KILL"],
    "write": ["ENOSPC", "EIO", "EIO+", "EDQUOT+", "KILL", "TEAR"],
    "sync": ["EIO", "EIO+", "KILL"],
    "rename": ["EIO", "ENOSPC", "EROFS+", "KILL"],
    "mkdir": ["ENOSPC", "EROFS+", "KILL"],
    "malloc": ["ENOMEM"],
}

tally = collections.Counter()
failures = []


class Run:
    def __init__(self, status, out, err):
        self.status, self.out, self.err = status, out, err

    def __str__(self):
        return f"exit status {self.status}, stderr {self.err[-600:]!r}"


def run(words, stdin="", fault=None, counts=None, least=None, file_limit=None, kill_after=None, stdout=None):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("TARSIER_FAULT")}
    if fault or counts:
        environment["LD_PRELOAD"] = SHIM
        environment["TARSIER_FAULT_UNDER"] = os.getcwd()
        if fault:
            environment["TARSIER_FAULT"] = fault
        if counts:
            environment["TARSIER_FAULT_COUNTS"] = counts
        if least:
            environment["TARSIER_FAULT_LEAST"] = str(least)

    def before():
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if file_limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

    process = subprocess.Popen([PROGRAM, *words], stdin=subprocess.PIPE, stdout=stdout or subprocess.DEVNULL,
                               stderr=subprocess.PIPE, text=True, env=environment, preexec_fn=before, errors="replace")
    try:
        if kill_after is not None:
            try:
                out, err = process.communicate(stdin, timeout=kill_after)
            except subprocess.TimeoutExpired:
                process.kill()
                out, err = process.communicate()
        else:
            out, err = process.communicate(stdin, timeout=300)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return Run(-999, "", "still running after 300 s")
    return Run(process.returncode, out or "", err)


digests = {}  # digests of files read before, by place on the disk, size and time of the last change


def digest(path):
    about = os.stat(path)
    key = (about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns)
    if key not in digests:
        with open(path, "rb") as file:
            digests[key] = hashlib.sha256(file.read()).hexdigest()
    return digests[key]


def take(source, target):
    """Puts an input into the folder of a run: as a link if nothing writes into it in normal operation."""
    if is_database(source):
        return shutil.copy2(source, target)
    try:
        return os.link(source, target)
    except OSError:  # another file system
        return shutil.copy2(source, target)


OLD_DIGEST = hashlib.sha256(OLD).hexdigest()


def tree():
    return {os.path.relpath(os.path.join(folder, name), "."): digest(os.path.join(folder, name))
            for folder, _, names in os.walk(".") for name in names}


def is_database(path):
    """Files that grow and are repaired by their reader; a .journal (landmarks annotate) is one too."""
    return path.endswith((".db", ".db-wal", ".db-shm", ".db-journal", ".journal"))


def is_unborn(path):
    """A database that was stopped before its tables existed: empty, to be filled by the next run."""
    try:
        base = sqlite3.connect(path)
        tables = base.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        base.close()
    except sqlite3.Error:
        return False
    return tables == 0


def is_whole(path):
    """For outputs that differ each time: compares as far as their kind allows."""
    with open(path, "rb") as file:
        data = file.read()
    if path.endswith(".json"):
        try:
            json.loads(data)
        except ValueError:
            return False
    elif path.endswith(".jsonl"):
        try:
            for line in data.splitlines():
                json.loads(line)
        except ValueError:
            return False
    elif path.endswith(".png"):
        return data.endswith(b"IEND\xaeB`\x82")
    elif path.endswith(".jpg"):
        return data.endswith(b"\xff\xd9")
    return len(data) > 0


class Case:
    """One verb with one set of words, in its own folder."""

    def __init__(self, verb, words, stdin, inputs):
        self.verb, self.stdin, self.inputs = verb, stdin, inputs
        self.words = [*verb.split(), *shlex.split(words), "--quiet"]
        self.name = f"{verb} {words}"
        self.folder = os.path.join(os.path.dirname(inputs), "work")
        self.journal = []

    def fail(self, what, fault):
        text = f"{self.name} [{fault}]: {what}"
        failures.append(text)
        print("FAILED:", text, flush=True)

    def fresh(self):
        os.chdir(os.path.dirname(self.inputs))
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.inputs, self.folder, copy_function=take)
        os.chdir(self.folder)

    def learn(self):
        """Undisturbed runs: which outputs there are, which are the same each time, how often each operation occurs."""
        self.fresh()
        self.before = tree()
        counts = os.path.join(os.path.dirname(self.inputs), "counts.txt")
        if os.path.exists(counts):
            os.unlink(counts)
        plain = run(self.words, self.stdin, counts=counts)
        self.status = plain.status
        if plain.status not in (0, 1):
            self.fail(f"the undisturbed run: {plain}", "none")
            return False
        first = tree()
        with open(counts) as file:
            self.counts = {line.split()[0]: int(line.split()[1]) for line in file}
        self.fresh()
        run(self.words, self.stdin)
        second = tree()
        self.outputs = {path: value for path, value in second.items() if self.before.get(path) != value and not is_database(path)}
        self.steady = {path for path in self.outputs if first.get(path) == second[path]}
        self.streamed = {path: open(path, "rb").read() for path in self.outputs if os.path.basename(path) in STREAMED}
        self.databases = [path for path in second if path.endswith(".db")]
        self.writes = any(self.before.get(path) != value for path, value in second.items())
        self.biggest = max((os.path.getsize(path) for path in second if self.before.get(path) != second[path]), default=0)
        return True

    def with_old_files(self):
        for path in self.outputs:
            if path not in self.before:
                os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
                with open(path, "wb") as file:
                    file.write(OLD)

    def check(self, result, fault, killed, memory, has_old):
        now = tree()
        if killed and result.status == -signal.SIGKILL:
            pass
        elif result.status not in STATUSES:
            self.fail(f"crashed: {result}", fault)
        elif result.status not in (0, 1):
            lines = [line for line in result.err.splitlines() if not line.startswith("tarsier: warning: ")]
            if len(lines) != 1 or not lines[0].startswith("tarsier: error: "):
                self.fail(f"not one line of error: {result}", fault)
            # A database that cannot be opened for reading is bad input, also if the output would have been refused later.
            expected = {6} if self.writes and ".db: " not in result.err else {3, 6}
            if not killed and not memory and result.status not in expected:
                self.fail(f"expected exit status 6: {result}", fault)
        done = result.status == self.status
        for path, value in self.before.items():
            if path not in self.outputs and not is_database(path) and now.get(path) != value:
                self.fail(f"the input {path} was changed or is gone", fault)
        left = []
        for path in sorted(now):
            if is_database(path) or (path in self.before and path not in self.outputs):
                continue
            if path not in self.outputs:
                left.append(path)
                continue
            is_new = now[path] == self.outputs[path] or (path not in self.steady and now[path] != OLD_DIGEST and is_whole(path))
            is_old = has_old and now[path] == OLD_DIGEST or self.before.get(path) == now[path]
            if path in self.streamed and not done:
                with open(path, "rb") as file:
                    is_new = is_new or self.streamed[path].startswith(file.read())
            if not is_new and not is_old:
                self.fail(f"{path} is neither the old file nor the new one ({os.path.getsize(path)} bytes)", fault)
            if done and not is_new:
                self.fail(f"exit status {result.status}, but {path} is not there ({result})", fault)
        if done:
            for path in sorted(set(self.outputs) - set(now)):
                self.fail(f"exit status {result.status}, but {path} is missing ({result})", fault)
        if left and not killed:
            self.fail(f"left behind: {left}", fault)
        self.check_databases(fault)

    def check_databases(self, fault):
        for path in self.databases:
            if not os.path.exists(path) or path not in self.before and is_unborn(path):
                continue
            is_log = path == "plates.db" or (path == "new.db" and self.verb == "plate read")
            result = run(["plate", "log", path] if is_log else ["people", "list", "--gallery", path])
            if result.status not in (0, 1):
                self.fail(f"the program does not open {path}: {result}", fault)
            try:
                base = sqlite3.connect(path)
                answer = base.execute("PRAGMA integrity_check").fetchone()[0]
                base.close()
                if answer != "ok":
                    self.fail(f"{path}: {answer}", fault)
            except sqlite3.Error as error:
                self.fail(f"{path}: {error}", fault)

    def run_again(self, fault):
        """The same words, undisturbed, after the disturbed run."""
        result = run(self.words, self.stdin)
        if result.status != self.status and result.status not in STATUS_AGAIN.get(self.verb, ()):
            self.fail(f"the next run: {result}", fault)
            return
        now = tree()
        for path in sorted(now):
            if path not in self.outputs and path not in self.before and not is_database(path):
                self.fail(f"still there after the next run: {path}", fault)
        for path in self.steady:
            if now.get(path) != self.outputs[path]:
                self.fail(f"the next run did not write {path}", fault)

    def disturb(self, dice):
        has_old = self.verb not in READS_OUTPUT and dice.random() < 0.5
        kinds = [kind for kind in ACTIONS if self.counts.get(kind, 0) > 0 and kind != "malloc"]
        kinds += ["malloc", "malloc"]
        if self.outputs or self.databases:
            kinds += ["kill", "limit"] if self.biggest > 1 else ["kill"]
        kinds.append("stdout")
        kind = dice.choice(kinds)
        self.fresh()
        if has_old:
            self.with_old_files()
        if kind == "kill":
            seconds = dice.uniform(0, 1.2 * self.seconds)
            fault = f"SIGKILL after {seconds:.3f} s"
            result = run(self.words, self.stdin, kill_after=seconds)
        elif kind == "limit":
            limit = dice.randrange(0, self.biggest)
            fault = f"files of at most {limit} bytes"
            result = run(self.words, self.stdin, file_limit=limit)
        elif kind == "stdout":
            fault = "stdout is full"
            with open("/dev/full", "w") as full:
                result = run([*self.words, "--json"], self.stdin, stdout=full)
        else:
            count = self.counts[kind]
            number = dice.randint(1, count) if kind != "malloc" else int(math.exp(dice.uniform(0, math.log(max(2, count)))))
            fault = f"{kind}:{number}:{dice.choice(ACTIONS[kind])}"
            result = run(self.words, self.stdin, fault=fault)
        if has_old:
            fault += " over old files"
        killed = "KILL" in fault or "TEAR" in fault
        tally[kind if not killed else "SIGKILL"] += 1
        tally[f"status {result.status}"] += 1
        if kind == "stdout":  # perhaps only text on stdout failed: the files are complete or missing
            if result.status not in (6, self.status):
                self.fail(f"expected exit status 6: {result}", fault)
        else:
            self.check(result, fault, killed, kind == "malloc", has_old)
        if kind != "malloc" or dice.random() < 0.2:
            self.run_again(fault)


def make_inputs(folder):
    if made := os.environ.get("TARSIER_INPUTS"):
        shutil.copytree(made, folder)
    else:
        cli_verbs.make_inputs(folder)
    os.rename(os.path.join(folder, "model"), os.path.join(folder, "first-model"))


def cases(inputs, only):
    for verb, row in cli_verbs.VALID.items():
        if only and verb not in only:
            continue
        for words in [row["words"], *MORE.get(verb, [])]:
            yield Case(verb, words.replace("model --truth", "first-model --truth"), row.get("stdin", ""), inputs)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--rounds", type=int, default=10, help="disturbed runs of each set of words")
    arguments.add_argument("--seconds", type=float, default=math.inf, help="stop after so long")
    arguments.add_argument("--short", action="store_true", help="cheap verbs only, few inputs")
    arguments.add_argument("verbs", nargs="*")
    options = arguments.parse_args()
    root = os.getcwd()
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
        os.environ[name] = os.path.join(root, "home")
    inputs = os.path.join(root, "inputs")
    if not os.path.isdir(inputs):
        make_inputs(inputs + ".part")
        os.chdir(root)
        os.rename(inputs + ".part", inputs)
    begin = time.monotonic()
    runs = 0
    done = 0
    for case in cases(inputs, options.verbs or (SHORT if options.short else None)):
        start = time.monotonic()
        if not case.learn():
            continue
        case.seconds = (time.monotonic() - start) / 2
        done += 1
        dice = random.Random(f"{options.seed} {case.name}")
        before = len(failures)
        for _ in range(options.rounds):
            if time.monotonic() - begin > options.seconds:
                sys.exit(f"FAILED: not done after {options.seconds:.0f} s")
            case.disturb(dice)
            runs += 1
        print(f"   {case.name}: {options.rounds} runs, {len(failures) - before} failures, "
              f"one takes {case.seconds:.1f} s", flush=True)
    print(f"{done} sets of words, {runs} disturbed runs, {len(failures)} failures; "
          + ", ".join(f"{key}: {value}" for key, value in sorted(tally.items())))
    sys.exit(1 if failures else 0)


main()
