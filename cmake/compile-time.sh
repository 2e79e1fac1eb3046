#!/bin/sh
# SPDX-License-Identifier: MIT
# compile-time.sh COMPILER ARGUMENT..      the launcher of compilers in builds with tests (CMAKE_CXX_COMPILER_LAUNCHER)
# Runs the compiler and writes the processor time that it took beside the object: OBJECT.time, what the shell's times
# prints; its second line is the compiler's. scripts/build-times.py adds these up.
"$@" || exit
object=
previous=
for argument; do
  [ "$previous" != -o ] || object=$argument
  previous=$argument
done
[ -z "$object" ] || times > "$object.time"
