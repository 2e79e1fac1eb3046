#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/sanitize.sh [asan|tsan|all] [flags of ctest]     e.g.  scripts/sanitize.sh asan -L unit
# asan: the whole test suite under AddressSanitizer and UndefinedBehaviorSanitizer (including leaks).
# tsan: the parts that use threads under ThreadSanitizer; OpenCV's loops run on threads that it can see
#       (tests/sanitize/tsan_threads.cpp). Lists what is left out, and why. Exit status 1 if anything failed.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
# shellcheck source=scripts/setup.sh
. scripts/setup.sh

which=${1:-all}
[ $# -eq 0 ] || shift
case $which in asan | tsan | all) ;; *) die "asan, tsan or all, not $which" ;; esac

# Unit tests of code that starts threads or is called by several, and the scripts that run the live parts.
threaded='^(media/(live_source|http_stream|http_sink|atomic_file|sqlite)_test'
threaded+='|core/core_test|cartoon/(cartoonize|kernels)_test|linalg/(nn|tile_cholesky)_test|render/render_test'
threaded+='|sfm/(mapper/incremental_mapper|reconstruction/reconstruct|bundle/bundle_solver|features/(pairs|flow|matching)|pipelines/(pipeline|online))_test'
threaded+='|face/regression/(trees|descent|patches)_test|face/landmarks/(train_model|adapt|hog_detector)_test'
threaded+='|face/recognition/recognizer_test|face/head/train_head_test|face/appearance/model_test|face/shape/shape_model_test'
threaded+='|plate/train/training_test|ui/(people|sfm|calibrate)_session_test'
threaded+='|e2e/(cartoon_live|cartoon_serve|cartoon_interrupt|people|sfm_reconstruct))$'

build_some() { # build_some PRESET REGEX: configures it, builds the program and the test programs of these names
  local preset=$1 targets=()
  mkdir -p "build/$preset"
  phase "configure ($preset)"
  quietly "build/$preset/configure.log" cmake --preset "$preset" -DTARSIER_BUILD_TESTS=ON || die "cmake could not configure the build"
  phase_done
  mapfile -t targets < <(ctest --test-dir "build/$preset" -N -R "$2" 2>/dev/null | sed -nE 's|.*: (.*)/[a-z_0-9]*_test$|\1_test|p' | tr / _ | sort -u)
  phase "build (build/$preset: the program, ${#targets[@]} test programs)"
  quietly "build/$preset/build.log" cmake --build "build/$preset" -j "$(build_jobs)" --target tarsier tarsier-capture "${targets[@]}" ||
    die "the build failed (above)"
  phase_done
}

run() { # run PRESET FLAGS..: runs the tests of a preset that is built with these flags of ctest
  local preset=$1 status=0 results
  shift
  results=$root/build/$preset/test-results
  rm -rf "$results"
  mkdir -p "$results"
  phase "tests ($preset)"
  # Sanitized code is 2 to 20 times slower: a longer time for each test instead of leaving the slow ones out.
  TARSIER_TEST_TIMEOUT=1200 ctest --test-dir "build/$preset" --no-tests=error --output-on-failure --timeout 3600 \
    --parallel "$(nproc)" --output-junit "$results/ctest.junit" "$@" || status=$?
  phase_done
  scripts/count-tests.sh "$results" || status=1
  return "$status"
}

failed=0
if [ "$which" != tsan ]; then
  echo "== left out of asan: faults/* (their library replaces malloc, as the sanitizer does: scripts/faults.sh runs them), install/*"
  echo "   (packages are built without sanitizers)"
  build asan -DTARSIER_BUILD_TESTS=ON
  run asan -E '^install/' "$@" || failed=1
fi
if [ "$which" != asan ]; then
  echo "== left out of tsan: everything that runs in one thread (the rest of the suite)"
  build_some tsan "$threaded"
  run tsan -R "$threaded" "$@" || failed=1
fi
exit "$failed"
