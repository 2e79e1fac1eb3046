#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/arm64.sh [flags of ctest]: cross-builds the core modules for arm64 against a Debian for arm64 and runs their
# unit tests under qemu-user. TARGETS="..." builds other targets of the preset (TARGETS=all: everything). docs/pi.md
# says what this proves and what it does not.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/setup.sh
. scripts/setup.sh
suite=${SUITE:-bookworm}
export TARSIER_ARM64_ROOT=${TARSIER_ARM64_ROOT:-$PWD/build/arm64-root}

install_packages g++-aarch64-linux-gnu qemu-user-static mmdebstrap cmake ninja-build ccache pkg-config
if [ ! -e "$TARSIER_ARM64_ROOT/.complete" ]; then
  phase "a Debian $suite for arm64 in $TARSIER_ARM64_ROOT (unpacked, not run)"
  mkdir -p build
  # Where this machine gets its packages. Either of the two places may be missing.
  mirror=$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*.sources 2>/dev/null |
    sed -n 's/^URIs: *//p; s/^deb \(\[[^]]*\] \)\?\([^ ]*\) .*/\2/p' | head -1 || true)
  mirror=${mirror:-http://deb.debian.org/debian}
  libraries=()
  for package in "${build_packages[@]}"; do
    case $package in lib*-dev | nlohmann-json3-dev) libraries+=("$package") ;; esac
  done
  include=$(IFS=,; echo "${libraries[*]},libc6-dev,libstdc++-12-dev,libgtest-dev,libgmock-dev,opencv-data")
  [ "$suite" = bookworm ] || include=${include/libstdc++-12-dev/libstdc++-14-dev}
  [ -z "$(ls -A "$TARSIER_ARM64_ROOT" 2>/dev/null)" ] ||
    die "$TARSIER_ARM64_ROOT holds something else, or what an interrupted run left: remove it"
  quietly build/arm64-root.log mmdebstrap --variant=extract --architectures=arm64 --include="$include" \
    "$suite" "$TARSIER_ARM64_ROOT" "$mirror" || die "mmdebstrap failed (above)"
  # Links to absolute places would lead out of the root; alternatives are made only when packages are run.
  find "$TARSIER_ARM64_ROOT/usr/lib" -type l -lname '/*' | while read -r link; do
    ln -sfn "$(realpath -m --relative-to="$(dirname "$link")" "$TARSIER_ARM64_ROOT$(readlink "$link")")" "$link"
  done
  for library in blas lapack; do
    for name in "lib$library.so" "lib$library.so.3"; do
      ln -sfn "$library/$name" "$TARSIER_ARM64_ROOT/usr/lib/aarch64-linux-gnu/$name"
    done
  done
  # qemu shows programs the root's /dev/null in place of the machine's.
  rm -rf "${TARSIER_ARM64_ROOT:?}/dev"
  touch "$TARSIER_ARM64_ROOT/.complete"
  phase_done
fi

modules=(core media cartoon linalg geometry planar/markers planar/image_targets planar/calibration planar/augment
  plate/networks plate/train plate/text plate/classic plate/tracking)
read -ra targets <<<"${TARGETS:-}"
phase "configure (arm64)"
mkdir -p build/arm64
quietly build/arm64/configure.log cmake --preset arm64 || die "cmake could not configure the build (above)"
phase_done
if [ "${#targets[@]}" -eq 0 ]; then
  for module in "${modules[@]}"; do
    targets+=("${module//\//_}_test")
  done
  targets+=(tarsier-capture) # which the tests of media start
fi
phase "build (build/arm64)"
quietly build/arm64/build.log cmake --build build/arm64 -j "$(build_jobs)" -t "${targets[@]}" || die "the build failed (above)"
phase_done
export QEMU_LD_PREFIX=$TARSIER_ARM64_ROOT # for programs that a test starts
if ! build/arm64/bin/core_test --gtest_list_tests >/dev/null 2>&1; then
  # Only under an emulator that was called by name: what a test starts itself is not emulated.
  starting='EndOnSignals.*:LiveSourceTest.Children*:LiveSourceTest.TheCaptureProgram*'
  echo "== left out, as this kernel does not hand arm64 programs to qemu (Debian's binfmt-support does): $starting"
  export GTEST_FILTER="-$starting"
fi
phase "tests under $(qemu-aarch64-static --version | head -1)"
expression="^($(IFS='|'; echo "${modules[*]}"))/"
ctest --test-dir build/arm64 -R "$expression" --no-tests=error --output-on-failure --timeout 1500 "$@"
