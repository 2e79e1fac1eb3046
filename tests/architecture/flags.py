#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""flags.py ROOT: fails if a text of the library names a flag of the command line.

The library does not know how its caller sets an option. Its messages write "option 'ca_file'" with the name of the field. The program
turns the name into the flag (apps/tarsier/framework/option_names.h). apps/tarsier/framework/error_help.cpp adds to a message which verb
helps. Only the tables of options may contain flags: what fields() returns.
"""
import os
import re
import sys

TEXT = re.compile(r'R"(\w*)\((?:.|\n)*?\)\1"|"(?:[^"\\\n]|\\.)*"')
COMMENT = re.compile(r"//[^\n]*|'(?:[^'\\\n]|\\.)'")
FLAG = re.compile(r"(?<![\w-])--[a-z][a-z-]*")

# Texts about the command line itself.
EXEMPT = {
    "media/child_capture.cpp": "the flags of another program",
    "planar/sheets/sheet.cpp": "the line printed on a board says how `tarsier calibrate` is to be called",
    "sfm/pipelines/shard_commands.cpp": "writes the command lines of a cluster's jobs",
    "sfm/pipelines/sharded_reconstructor.cpp": "names the command that makes what is missing",
}


def tables_of(source):
    """The (begin, end) of each body of fields()."""
    for begin in re.finditer(r"OptionFields (?:\w+::)*fields\(\)(?: const)? \{", source):
        depth, at = 1, begin.end()
        while depth > 0 and at < len(source):
            depth += {"{": 1, "}": -1}.get(source[at], 0)
            at += 1
        yield begin.start(), at


def flags_of(source):
    """(place, text) of each text that names a flag."""
    tables = list(tables_of(source))
    at = 0
    both = re.compile(f"{TEXT.pattern}|{COMMENT.pattern}")
    while found := both.search(source, at):
        at = found.end()
        text = found[0]
        if text[0] not in '"R' or not FLAG.search(text):
            continue
        if not any(begin <= found.start() < end for begin, end in tables):
            yield found.start(), text


def check_itself():
    cases = {
        'fail("give --voxel");': 1, '// "--voxel"\n': 0, 'f("a" /**/ "see --memory")': 1, "f('\"', \"--x\")": 1, 'f("-->", "--%", "a--b")': 0,
        'OptionFields fields() {\n return {{"a", a, "--a", "as --b"}};\n}\nfail("--c");': 1, 'R"(sbatch --array)"': 1, '"\\"--x"': 1,
    }
    for source, expected in cases.items():
        if len(list(flags_of(source))) != expected:
            sys.exit(f"this test is wrong about: {source}")


def main():
    check_itself()
    root = os.path.join(sys.argv[1] if len(sys.argv) > 1 else ".", "src", "tarsier")
    found = 0
    exempt = dict(EXEMPT)
    for folder, _, names in sorted(os.walk(root)):
        for name in sorted(names):
            path = os.path.relpath(os.path.join(folder, name), root)
            if not re.search(r"\.(h|inl|cpp)$", name) or re.search(r"_test\.cpp$|^testing_", name):
                continue
            with open(os.path.join(root, path), encoding="utf-8") as file:
                source = file.read()
            flags = list(flags_of(source))
            if flags and exempt.pop(path, None):
                continue
            for place, text in flags:
                print(f"src/tarsier/{path}:{source.count(chr(10), 0, place) + 1}: {text[:100]}")
            found += len(flags)
    if found:
        sys.exit(f"{found} texts of the library name flags; they name options: \"option 'field'\"")
    if exempt:
        sys.exit(f"without flags, so not exempt any more: {', '.join(exempt)}")


main()
