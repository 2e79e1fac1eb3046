"""The committed pages equal the output of their sources, and the client's unit tests pass.

Needs node and the client's packages (npm ci); otherwise it is skipped, since a build of the program needs neither.
scripts/lint.sh has the client's other checks.
"""

import filecmp
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import pages


def packages():
    """Whether the client's packages are installed or can be installed."""
    if not shutil.which("node") or not shutil.which("npm"):
        return "no node and npm on this machine"
    # npm writes its own lock file when the installation is complete.
    if os.path.exists(os.path.join(pages.CLIENT, "node_modules", ".package-lock.json")):
        return None
    got = subprocess.run(["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"], cwd=pages.CLIENT,
                         capture_output=True, text=True, timeout=300, check=False)
    return None if got.returncode == 0 else "npm ci did not get the client's packages"


def files_of(folder):
    return sorted(
        os.path.relpath(os.path.join(place, name), folder) for place, _, names in os.walk(folder) for name in names
    )


class BundleTest(unittest.TestCase):
    def run_node(self, *words):
        done = subprocess.run(words, cwd=pages.CLIENT, capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(done.returncode, 0, f"{' '.join(words)}\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
        return done.stdout

    def test_the_committed_bundle_matches_the_sources(self):
        with tempfile.TemporaryDirectory() as folder:
            output = self.run_node("node", "build.mjs", folder)
            self.assertIn("first load", output)
            self.assertEqual(files_of(folder), files_of(pages.DIST))
            _, different, broken = filecmp.cmpfiles(folder, pages.DIST, files_of(folder), shallow=False)
            self.assertEqual(different + broken, [])

    def test_pure_code(self):
        self.run_node("node", "test/run.mjs")

    def test_every_bundled_package_has_its_licence(self):
        with open(os.path.join(pages.DIST, "LICENSES.txt"), encoding="utf-8") as file:
            text = file.read()
        for name in ("preact", "@preact/signals", "@preact/signals-core", "three", "uplot"):
            self.assertIn(f"==== {name} ", text)


if __name__ == "__main__":
    reason = packages()
    if reason:
        print(f"skipped: {reason}")
        sys.exit(pages.SKIPPED)
    unittest.main(verbosity=2)
