# SPDX-License-Identifier: MIT
"""Every verb gives the same files and the same JSON for any number of threads and any memory layout.

Each run of tests/e2e/cli_verbs.py is done with one thread and with three, from the same start. Addresses differ between runs by
themselves. Times are not compared. same_again.py [VERB ..]: these verbs, or of all the share $TARSIER_SHARD ("2/4": the second of
four); $TARSIER is the program, $TARSIER_INPUTS the output of cli_verbs.py --make.
"""
import hashlib
import json
import os
import re
import shlex
import shutil
import sys

import cli_verbs

# Times, memory, and values of the day.
MEASURED = re.compile(r"(^|_)(seconds?|s|ms|us|fps|hz|time|when|date|mb|created|threads)($|_)|_per_")
# Databases contain the time of each row, and are written in place. Other files are written beside their place and renamed.
DATABASE = re.compile(r"\.(db|db-wal|db-shm|db-journal)$")


# Larger work than in cli_verbs.VALID: everything that is trained with several threads.
OTHER = {"landmarks train tracker": "head/set.json -o tracker.json --levels 1 --trees 2 --scatter 3 --patch 7"}


# Two runs of each take 2 to 9 CPU s, so only `./test --all` does them.
LONG = {"landmarks train face-networks", "landmarks train visibility", "landmarks train tracker", "sfm dense", "calibrate", "aam eval"}


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(inner) for key, inner in value.items() if not MEASURED.search(key)}
    if isinstance(value, list):
        return [without_times(inner) for inner in value]
    return value


def take(source, target):
    """Puts an input into the folder of a run: as a link if nothing writes into it."""
    try:
        if not DATABASE.search(source):
            return os.link(source, target)
    except OSError:  # another file system
        pass
    return shutil.copy2(source, target)


def is_input(path):
    try:
        return os.path.samefile(path, os.path.join(cli_verbs.INPUTS, path))
    except OSError:
        return False


def state_of_inputs():
    """Size and time of each input, to detect writes."""
    paths = [os.path.join(folder, name) for folder, _, names in os.walk(cli_verbs.INPUTS) for name in names]
    return {path: (os.stat(path).st_size, os.stat(path).st_mtime_ns) for path in paths}


def content(path):
    if is_input(path):
        return "as it was"
    with open(path, "rb") as file:
        data = file.read()
    if path.endswith(".json"):
        data = json.dumps(without_times(json.loads(data))).encode()
    return hashlib.sha256(data).hexdigest()


def tree():
    return {os.path.join(folder, name): content(os.path.join(folder, name))
            for folder, _, names in os.walk(".") for name in names if not DATABASE.search(name)}


def run_with(threads, verb, entry):
    os.chdir("..")
    shutil.rmtree("work")
    shutil.copytree(cli_verbs.INPUTS, "work", copy_function=take)
    os.chdir("work")
    words = [*verb.split(), *shlex.split(OTHER.get(verb, entry["words"])), "--json", "--quiet", "--threads", str(threads)]
    result = cli_verbs.run(words, entry.get("stdin", ""))
    cli_verbs.check_lines(verb, entry, result)
    return [without_times(json.loads(line)) for line in result.out.splitlines()], tree()


def difference(one, other, path=""):
    """The first difference between two values of JSON."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return next((d for key in one if (d := difference(one[key], other[key], f"{path}.{key}"))), "")
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return next((d for k in range(len(one)) if (d := difference(one[k], other[k], f"{path}[{k}]"))), "")
    return "" if one == other else f"{path}: {str(one)[:80]} and {str(other)[:80]}"


def main():
    cli_verbs.prepare_inputs()
    before = state_of_inputs()
    # All except doctor, which reports the number of threads.
    left_out = {"doctor"} if os.environ.get("TARSIER_TEST_ALL") else {"doctor", *LONG}
    verbs = sys.argv[1:] or cli_verbs.shard_of([verb for verb in cli_verbs.VALID if verb not in left_out])
    for verb in verbs:
        begin = cli_verbs.children_cpu()
        lines, files = run_with(1, verb, cli_verbs.VALID[verb])
        other_lines, other_files = run_with(3, verb, cli_verbs.VALID[verb])
        if text := difference(lines, other_lines):
            cli_verbs.fail(verb, f"its JSON differs: {text}")
        for path in sorted(files.keys() | other_files.keys()):
            if files.get(path) != other_files.get(path):
                cli_verbs.fail(verb, f"{path} differs")
        print(f"   {cli_verbs.children_cpu() - begin:.1f} CPU s: {verb}", flush=True)
    if state_of_inputs() != before:
        cli_verbs.fail("all", "an input was written into")
    print(f"{len(verbs)} verbs, {len(cli_verbs.failures)} failures")
    sys.exit(1 if cli_verbs.failures else 0)


main()
