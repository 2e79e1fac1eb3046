#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# scripts/package.sh [FOLDER]: builds Tarsier and makes its Debian packages for this machine's Debian: dist/*.deb (or
# FOLDER/*.deb). Installs missing build dependencies. docs/install.md lists the contents of each package.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/setup.sh
. scripts/setup.sh
folder=${1:-dist}

install_packages "${build_packages[@]}" dpkg-dev file
# Dates of pages and changelogs are those of the source.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH
umask 022
build package
phase "packages"
rm -rf build/package/packages
quietly build/package/package.log cpack --config build/package/CPackConfig.cmake -G DEB || die "cpack failed (above)"
mkdir -p "$folder"
rm -f "$folder"/tarsier_*.deb "$folder"/tarsier-gui_*.deb "$folder"/tarsier-onnx_*.deb "$folder"/tarsier-models_*.deb "$folder"/libtarsier-dev_*.deb
mv build/package/packages/*.deb "$folder/"
phase_done
(cd "$folder" && ls -l -- *.deb)
