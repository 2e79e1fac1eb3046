#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# What `cmake --install` lays out can be moved elsewhere, is found by find_package(tarsier), links, and runs.
. "${TARSIER_SOURCE:?the source tree}/tests/e2e/lib.sh"

quietly() { # quietly LOG COMMAND..
  local log=$1
  shift
  "$@" >"$log" 2>&1 </dev/null || { fail "$*"; tail -n 30 "$log"; finish; }
}
flags=${SANITIZE:+-fsanitize=$SANITIZE}

# Installed in one place, used in another: nothing may point back to where it was installed or built.
quietly install.log "$CMAKE" --install "$TARSIER_BUILD" --prefix "$PWD/first"
mv first moved
prefix=$PWD/moved
package=$(find "$prefix" -name tarsierConfig.cmake -printf '%h\n')
[ -n "$package" ] || { fail "no tarsierConfig.cmake was installed"; finish; }
for place in "$TARSIER_SOURCE" "$TARSIER_BUILD" "$PWD/first"; do
  grep -rlF -- "$place" "$package" && fail "a file of the CMake package names $place"
done

# Every header of ours that an installed header includes is installed, too.
includes=$(grep -rhoE '^#include "tarsier/[^"]+"' "$prefix/include" | sed 's/.*"\(.*\)"/\1/' | sort -u)
[ "$(wc -l <<<"$includes")" -ge 50 ] || fail "few headers were installed: $includes"
for header in $includes; do
  [ -f "$prefix/include/$header" ] || fail "$header is included but not installed"
done

quietly configure.log "$CMAKE" -G "$GENERATOR" -S "$TARSIER_SOURCE/examples/find_package" -B sample \
  -DCMAKE_CXX_COMPILER="$CXX" -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS="$flags" -DCMAKE_PREFIX_PATH="$prefix"
quietly build.log "$CMAKE" --build sample
run cartoon run synth:scene --frames 1 -o scene.png --quiet
expect_status 0
run cartoon run scene.png --mode sketch -o expected.png --quiet
expect_status 0
sample/ink scene.png drawn.png || fail "ink: exit status $?"
cmp expected.png drawn.png || fail "the sample draws otherwise than the program"
status=0
sample/ink missing.png other.png 2>stderr.txt || status=$?
[ "$status" -eq 3 ] || fail "ink of a missing file: exit status $status, expected 3"

# All modules at once: what the archives need beside each other is known to the package.
mkdir everything
cat >everything/CMakeLists.txt <<'CMAKE'
cmake_minimum_required(VERSION 3.25)
project(everything LANGUAGES CXX)
find_package(tarsier 0.1 REQUIRED)
add_executable(everything main.cpp)
target_link_libraries(everything PRIVATE tarsier::face_pipelines tarsier::planar_pipelines tarsier::sfm_pipelines tarsier::cartoon tarsier::planar_sheets tarsier::plate_train tarsier::plate_classic)
target_compile_definitions(everything PRIVATE MODELS="${tarsier_MODELS_DIR}")
foreach(bad "0.2" "1.0")  # before 1.0 each minor version is one of its own
  find_package(tarsier ${bad} QUIET)
  if(tarsier_FOUND)
    message(SEND_ERROR "version ${bad} was found")
  endif()
endforeach()
find_package(tarsier 0.1 QUIET COMPONENTS frobnicate)
if(tarsier_FOUND)
  message(SEND_ERROR "a module that is none was found")
endif()
CMAKE
cat >everything/main.cpp <<'CPP'
#include "tarsier/face/landmarks/model.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/plate/networks/recognizer.h"

#include <cstdio>
int main() {
  tarsier::sfm::PipelineOptions().check();
  const auto model = tarsier::face::landmarks::read_landmark_model(MODELS "/landmarks68.json");
  std::puts("read");
}
CPP
quietly configure2.log "$CMAKE" -G "$GENERATOR" -S everything -B everything/build \
  -DCMAKE_CXX_COMPILER="$CXX" -DCMAKE_BUILD_TYPE=Debug -DCMAKE_CXX_FLAGS="$flags" -DCMAKE_PREFIX_PATH="$prefix"
quietly build2.log "$CMAKE" --build everything/build
[ "$(everything/build/everything)" = read ] || fail "the shipped model of faces was not read through tarsier_MODELS_DIR"

# The installed program finds its models and its helper beside itself.
unset TARSIER_MODELS
TARSIER=$prefix/bin/tarsier
run models list --json
expect_status 0
expect_out '"landmarks68'
run models verify --quiet
expect_status 0
run doctor --json
expect_out "\"$prefix/share/tarsier/models\"|in $prefix/share/tarsier/models"
[ -x "$prefix/libexec/tarsier/tarsier-capture" ] || fail "no tarsier-capture"
# So do the programs that it starts.
run bench posit --json
expect_status 0
expect_out '"bench":"posit"'
run demo --only people -o page --quiet
expect_status 0
[ -s page/index.html ] || fail "no page of the installed demo"
finish
