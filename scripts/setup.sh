# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Common parts of ./demo and ./test: the Debian/Ubuntu packages, and the build. Source it from the top folder.

# Everything Tarsier is built from, by name (Debian 12 and 13, Ubuntu 24.04 and later).
build_packages=(
  g++ cmake ninja-build ccache pkg-config
  libopencv-dev libfmt-dev nlohmann-json3-dev libcli11-dev libmicrohttpd-dev libgnutls28-dev libx11-dev
  libavformat-dev libavcodec-dev libswscale-dev libavutil-dev
  libjpeg-dev libpng-dev zlib1g-dev libfreetype-dev libsqlite3-dev libeigen3-dev
  libdlib-dev libblas-dev liblapack-dev libmosquitto-dev
)
# Face cascades, and sample images and videos to show things on.
data_packages=(opencv-data opencv-doc)
# The typefaces that drawn number plates are lettered with.
data_packages+=(fonts-opendin fonts-urw-base35 fonts-freefont-ttf fonts-roadgeek fonts-dejavu-core fonts-dejavu-extra)
# .. and more that `plate train-reader` and `train-detector` letter them with, where they are installed:
# fonts-national-park fonts-routed-gothic fonts-bebas-neue fonts-osifont fonts-ocr-b fonts-roboto-unhinted fonts-open-sans fonts-b612
# fonts-liberation fonts-allerta fonts-tuffy fonts-adf-universalis fonts-adf-gillius fonts-dosis
# The test framework, and what plays the part of screens, fingers, cameras and servers in the tests.
test_packages=(libgtest-dev libgmock-dev xvfb xauth xdotool libxfixes3 ffmpeg openssl python3 mosquitto mosquitto-clients curl git)
# A peer that `tarsier bench markers` measures itself beside.
test_packages+=(libapriltag-dev)
# The browser that the pages of `tarsier serve` are driven in. Ubuntu has it as a snap only: the tests are skipped there.
if grep -qsx 'ID=debian' /etc/os-release; then test_packages+=(chromium); fi

# What scripts/fuzz.sh compiles with: clang 16 (C++20) or later with libFuzzer. Debian 12 has 16 beside an older `clang`.
fuzz_packages() {
  if apt-cache show clang-16 >/dev/null 2>&1; then
    printf '%s\n' clang-16 libclang-rt-16-dev llvm-16
  else
    printf '%s\n' clang libclang-rt-dev llvm
  fi
}
fuzz_compiler() { # the path of the first that is there and new enough
  local name version
  for name in clang++-16 clang++ clang++-17 clang++-18 clang++-19 clang++-20; do
    command -v "$name" >/dev/null || continue
    version=$("$name" -dumpversion)
    if [ "${version%%.*}" -ge 16 ]; then
      command -v "$name"
      return 0
    fi
  done
  return 1
}

die() {
  printf '%s: %s\n' "${0##*/}" "$*" >&2
  exit 1
}

# Processor minutes of a first build without tests on an AMD EPYC of 2023, of what the tests add to it, of running them, and of
# what `./test --all` adds.
build_cpu_minutes=22
test_build_cpu_minutes=11
test_cpu_minutes=14
all_test_cpu_minutes=10

phase_start=0
phase() { # phase TEXT: begins a step of the work
  phase_start=$SECONDS
  printf '== %s\n' "$*"
}
phase_done() { printf '   %s (%d s)\n' "${1:-done}" "$((SECONDS - phase_start))"; }

# quietly LOG COMMAND..: the output goes to LOG; a failure shows its end.
quietly() {
  local log=$1 status=0
  shift
  "$@" >"$log" 2>&1 </dev/null || status=$?
  if [ "$status" -ne 0 ]; then
    printf '   failed (status %d): %s\n   The end of %s:\n' "$status" "$*" "$log" >&2
    tail -n 40 "$log" | sed 's/^/   | /' >&2
  fi
  return "$status"
}

missing_packages() { # of "$@", those that are not installed, one a line
  local installed
  # dpkg-query fails when it does not know one of them: that is an answer, too.
  installed=$({ dpkg-query -W -f='${db:Status-Status} ${Package}\n' "$@" 2>/dev/null || true; } |
    sed -n 's/^installed //p' | sort -u)
  comm -23 <(printf '%s\n' "$@" | sort -u) <(printf '%s\n' "$installed")
}

install_packages() { # installs what is missing of "$@"; asks nothing but, at a terminal, sudo's password
  phase "packages"
  if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    printf '   This is neither Debian nor Ubuntu. Going on with what is installed; Tarsier needs the like of:\n   %s\n' "$*"
    return 0
  fi
  local missing=() become=() log
  mapfile -t missing < <(missing_packages "$@")
  if [ "${#missing[@]}" -eq 0 ]; then
    phase_done "all $# are installed"
    return 0
  fi
  printf '   installing %d: %s\n' "${#missing[@]}" "${missing[*]}"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null ||
      die "packages are missing, and there is neither root nor sudo. As root: apt-get install ${missing[*]}"
    become=(sudo)
    if ! sudo -n true 2>/dev/null; then
      [ -t 0 ] || die "packages are missing, and sudo wants a password but there is no terminal. As root: apt-get install ${missing[*]}"
      printf '   sudo may ask for your password:\n'
      sudo -v || die "sudo refused. As root: apt-get install ${missing[*]}"
    fi
  fi
  log=$(mktemp)
  local apt=("${become[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -y -q -o DPkg::Lock::Timeout=300)
  local install=("${apt[@]}" install --no-install-recommends "${missing[@]}")
  if ! compgen -G '/var/lib/apt/lists/*Packages*' >/dev/null; then
    quietly "$log" "${apt[@]}" update || die "the list of packages could not be fetched (no network?)"
  fi
  if ! "${install[@]}" >"$log" 2>&1 </dev/null; then # an old list names files that are gone: fetch a new one
    quietly "$log" "${apt[@]}" update || die "the list of packages could not be fetched (no network?)"
    quietly "$log" "${install[@]}" || die "the packages could not be installed (above). Debian 12, Ubuntu 24.04 or later is needed"
  fi
  rm -f "$log"
  phase_done
}

# As many jobs as cores, but one for each 1.2 GB of free memory: a small board must not start to swap.
build_jobs() {
  local cores free_kb by_memory
  cores=$(nproc 2>/dev/null || echo 1)
  free_kb=$(sed -n 's/^MemAvailable: *\([0-9]*\).*/\1/p' /proc/meminfo 2>/dev/null)
  by_memory=$((${free_kb:-8000000} / 1200000))
  [ "$by_memory" -ge 1 ] || by_memory=1
  echo $((cores < by_memory ? cores : by_memory))
}

# Says every minute how far the build is whose output goes to LOG, until the process PID ends.
watch_build() { # watch_build PID LOG
  local pid=$1 log=$2 start=$SECONDS next=$((SECONDS + 60)) at=() spent
  while kill -0 "$pid" 2>/dev/null; do
    sleep 1
    [ "$SECONDS" -ge "$next" ] || continue
    next=$((SECONDS + 60))
    spent=$((SECONDS - start))
    mapfile -t at < <(tail -c 2000 "$log" 2>/dev/null | grep -oE '^\[[0-9]+/[0-9]+\]' | tail -1 | tr -c '0-9\n' '\n' | grep .)
    if [ "${#at[@]}" -eq 2 ] && [ "${at[0]}" -gt 0 ]; then
      printf '   %d of %d steps, about %d min left\n' "${at[0]}" "${at[1]}" "$(((spent * (at[1] - at[0]) / at[0] + 59) / 60))"
    fi
  done
}

# say_duration PRESET BUILT CPU_MINUTES WHAT PACKAGE..: the first line of ./demo and ./test: about how long all of it takes here. BUILT is a
# program that is there where the build is; CPU_MINUTES and WHAT are of what follows on it.
say_duration() {
  local built=build/$1/bin/$2 rest=$3 what=$4 jobs list parts=() total=0
  shift 4
  jobs=$(build_jobs)
  part() { # part MINUTES NAME
    total=$((total + $1))
    parts+=("$2 $1")
  }
  if command -v dpkg-query >/dev/null && [ -n "$(missing_packages "$@")" ]; then part 2 packages; fi
  [ -x "$built" ] || part $((build_cpu_minutes / jobs + 1)) build
  part $(((rest + jobs - 1) / jobs)) "$what"
  list=$(IFS=,; printf '%s' "${parts[*]}")
  printf '== about %d minute%s here (%s%s); more on a slow or busy machine\n' "$total" "$([ "$total" -eq 1 ] || echo s)" "${list//,/, }" \
    "$([ ! -x "$built" ] || echo '; more where sources have changed')"
}

# build PRESET CMAKE-ARGUMENTS..: configures and builds build/PRESET.
build() {
  local preset=$1 jobs pid log status=0 stopped=no
  shift
  jobs=$(build_jobs)
  mkdir -p "build/$preset"
  phase "configure ($preset)"
  quietly "build/$preset/configure.log" cmake --preset "$preset" "$@" || die "cmake could not configure the build (above)"
  phase_done
  phase "build (build/$preset, $jobs at a time; the first time takes about $((build_cpu_minutes / jobs + 1)) minutes on this machine, more on a slow one)"
  if [ -t 1 ]; then # ninja shows where it is
    NINJA_STATUS='[%f/%t, %p, %e s] ' cmake --build "build/$preset" -j "$jobs" || die "the build failed (above)"
  else
    log=build/$preset/build.log
    ninja -C "build/$preset" -j "$jobs" >"$log" 2>&1 </dev/null &
    pid=$!
    trap 'stopped=yes; kill "$pid" 2>/dev/null || true' INT TERM # a command behind & does not hear Ctrl-C
    watch_build "$pid" "$log"
    wait "$pid" || status=$?
    trap - INT TERM
    [ "$stopped" = no ] || exit 130
    if [ "$status" -ne 0 ]; then
      printf '   The end of %s:\n' "$log" >&2
      tail -n 40 "$log" | sed 's/^/   | /' >&2
      die "the build failed (above)"
    fi
  fi
  phase_done
}
