#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/lint.sh: checks what needs no build: the format of all C++ files (clang-format 14, as Debian 12 has it), the shell
# scripts (shellcheck) and the words (tests/architecture/glossary.py). Exit status 1 where something is to be changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/setup.sh
. scripts/setup.sh

install_packages clang-format shellcheck python3
failed=0

phase "clang-format"
if clang-format --version | grep -q 'version 14\.'; then
  git ls-files '*.h' '*.cpp' | xargs clang-format --dry-run -Werror || failed=1
else
  echo "   left out: this is $(clang-format --version); other versions than 14 format some lines otherwise"
fi
phase_done

phase "shellcheck"
git ls-files | grep -E '\.sh$|^(demo|test|\.ci/run)$' | xargs shellcheck -S warning || failed=1
phase_done

phase "glossary"
tests/architecture/glossary.py . || failed=1
phase_done
exit "$failed"
