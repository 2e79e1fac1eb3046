# SPDX-License-Identifier: MIT
"""No two random numbers are drawn within one list of arguments.

The evaluation order of arguments depends on the compiler: GCC for x86-64 begins with the last, GCC for arm64 and clang
with the first. The same seed would then give other images. Named variables, or braces (their order is fixed), give the
same result everywhere.     draws.py ROOT FOLDER..
"""
import os
import re
import sys

NAME = r"(?:\w+[.])?(?:rng|dice)_?"
DRAW = re.compile(rf"\b{NAME}\s*[.]\s*(?:uniform|normal|integer)\s*\(|\b{NAME}\s*\(|[(,]\s*{NAME}\s*[,)]|\bchance\(")


def blank(match):
    return " " * len(match.group())


def draws(argument):
    """Not counted: a generator passed as an argument, and a lambda, which is not run at this place."""
    return bool(DRAW.search(argument)) and not argument.startswith("[")


def draws_of(path):
    """(line, text) of each list of arguments with draws in more than one argument."""
    with open(path, encoding="utf-8") as file:
        text = file.read()
    code = re.sub(r"//[^\n]*", blank, re.sub(r'"(\\.|[^"\\\n])*"', blank, text))
    found, open_ones = [], []
    for place, letter in enumerate(code):
        if letter in "([{":
            open_ones.append((letter, place, [place + 1]))
        elif not open_ones:
            continue
        elif letter == ",":
            open_ones[-1][2].append(place + 1)
        elif letter == ";":
            open_ones[-1][2][:] = [place + 1]
        elif letter in ")]}":
            kind, begin, starts = open_ones.pop()
            ends = [start - 1 for start in starts[1:]] + [place]
            arguments = [code[a:b].strip() for a, b in zip(starts, ends)]
            is_call = kind == "(" and not re.search(r"\b(?:for|if|while|switch)\s*$", code[:begin][-12:])
            if is_call and sum(draws(a) for a in arguments) > 1:
                found.append((code.count("\n", 0, begin) + 1, " ".join(text[begin:place + 1].split())))
    return found


def main():
    root, folders = sys.argv[1], sys.argv[2:]
    files = failures = 0
    for folder in folders:
        for where, _, names in os.walk(os.path.join(root, folder)):
            for name in sorted(names):
                if not name.endswith((".cpp", ".h")) or name.endswith("_test.cpp") or name.startswith("testing_"):
                    continue
                files += 1
                path = os.path.join(where, name)
                for line, text in draws_of(path):
                    failures += 1
                    print(f"{os.path.relpath(path, root)}:{line}: draws whose order is the compiler's: {text[:120]}")
    print(f"{files} files, {failures} to mend")
    sys.exit(1 if failures or files == 0 else 0)


main()
