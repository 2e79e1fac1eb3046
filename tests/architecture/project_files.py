# SPDX-License-Identifier: MIT
"""The files of the project."""

import os
import shutil
import subprocess


def project_files(root):
    """The paths of all files, relative to `root`, without those that .gitignore names. Without Git, or outside a clone: without build/
    and node_modules/."""
    if shutil.which("git"):
        listed = subprocess.run(["git", "-C", root, "ls-files", "--cached", "--others", "--exclude-standard"],
                                capture_output=True, text=True, check=False).stdout.splitlines()
        if listed:
            return [name for name in listed if os.path.isfile(os.path.join(root, name))]
    walked = [os.path.relpath(os.path.join(folder, name), root) for folder, _, names in os.walk(root) for name in names]
    return [name for name in walked if not name.startswith(("build/", ".git/")) and "node_modules/" not in name]
