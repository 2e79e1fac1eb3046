#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/lint.sh: the checks that need no build: the format of all C++ files (clang-format 14, as in Debian 12), the
# shell scripts (shellcheck), the words (tests/architecture/glossary.py), flags in texts of the library
# (tests/architecture/flags.py), names of files (tests/architecture/paths.py), and, if npm is installed, the types,
# rules and format of the studio's pages (apps/web/client). Exit status 1 if something must be changed.
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

phase "flags in the library's texts"
tests/architecture/flags.py . || failed=1
phase_done

phase "names of files"
tests/architecture/paths.py . || failed=1
phase_done

phase "pages of the studio"
if ! command -v npm >/dev/null; then
  echo "   left out: there is no npm"
elif (cd apps/web/client && { [ -e node_modules/.package-lock.json ] || npm ci --ignore-scripts --no-audit --no-fund >/dev/null 2>&1; }); then
  (cd apps/web/client && npm run --silent types && npm run --silent lint && npm run --silent format) || failed=1
else
  echo "   left out: npm ci did not get the packages"
fi
phase_done
exit "$failed"
