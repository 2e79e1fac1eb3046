#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/tidy.sh [--all | --since REVISION | FILE ..]     e.g.  scripts/tidy.sh src/tarsier/core/option_fields.cpp
# Runs clang-tidy with the rules of .clang-tidy on the named files, or on files that differ from a revision (HEAD, or
# that of --since; new files too), or on all of src, apps, examples, bench and fuzz (hours on two cores). For a header
# it checks the sources of the same name, for a test only its own file. Configures build/tidy for this and compiles
# nothing. Exit status 1 if something must be changed.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
# shellcheck source=scripts/setup.sh
. scripts/setup.sh

checked='^(src|apps|examples|bench|fuzz)/.*\.(cpp|h)$'
changed_since() { { git diff --name-only --diff-filter=d "$1" && git ls-files --others --exclude-standard; } | grep -E "$checked"; }
case ${1:-} in
  --all) mapfile -t files < <(git ls-files | grep -E "$checked") ;;
  --since)
    git rev-parse -q --verify "${2:-}^{commit}" >/dev/null || die "--since needs a revision, not '${2:-}'"
    mapfile -t files < <(changed_since "$2")
    ;;
  "") mapfile -t files < <(changed_since HEAD) ;;
  -*) die "--all, --since REVISION or files, not $1" ;;
  *) files=("$@") ;;
esac
[ "${#files[@]}" -gt 0 ] || { echo "no file has changed"; exit 0; }

# The newest that the code's C++20 can be read with: Debian 12 has 16 beside an older one.
if apt-cache show clang-tidy-16 >/dev/null 2>&1; then tools=(clang-16 clang-tidy-16); else tools=(clang clang-tidy); fi
install_packages "${build_packages[@]}" "${test_packages[@]}" "${tools[@]}"
compiler=$(fuzz_compiler) || die "there is no clang 16 or later"
tidy=$(command -v clang-tidy-16 || command -v clang-tidy) || die "there is no clang-tidy"

phase "configure (tidy, ${compiler##*/}, ${tidy##*/})"
mkdir -p build/tidy
quietly build/tidy/configure.log cmake --preset tidy -DTARSIER_BUILD_TESTS=ON -DCMAKE_CXX_COMPILER="$compiler" \
  -DCMAKE_CXX_CLANG_TIDY= || die "cmake could not configure the build"
phase_done

# What the build compiles of them: compile_commands.json names each source by its whole path.
sources=()
for file in "${files[@]}"; do
  file=$(realpath -s --relative-to="$root" "$file")
  [ -e "$file" ] || die "$file: no such file"
  candidates=("$file")
  [[ $file != *.h ]] || candidates=("${file%.h}.cpp" "${file%.h}_io.cpp" "${file%.h}_test.cpp")
  for candidate in "${candidates[@]}"; do
    if grep -qF "\"file\": \"$root/$candidate\"" build/tidy/compile_commands.json; then
      sources+=("$candidate")
    elif [ "$file" = "$candidate" ]; then
      echo "   left out: $file is not built here"
    fi
  done
done
[ "${#sources[@]}" -gt 0 ] || { echo "none of them is compiled"; exit 0; }
mapfile -t sources < <(printf '%s\n' "${sources[@]}" | sort -u)

phase "clang-tidy (${#sources[@]} files)"
status=0
printf '%s\0' "${sources[@]}" | xargs -0 -n 1 -P "$(build_jobs)" "$tidy" -p build/tidy --quiet || status=1
phase_done
exit "$status"
