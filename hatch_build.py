"""What a wheel carries beside the text of the packages: the machine code of the loops, where it can be made.

It can where the environment that builds has the dependencies of the toolbox (`pip wheel --no-build-isolation --no-deps .`); the wheel is then one for its kind
of processor. Elsewhere, as where pip builds by itself to install from source, the wheel is one for all machines, and the first run compiles the loops.
"""

from __future__ import annotations

import importlib.util
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

NEEDED = ("casadi", "llvmlite", "numpy")


class CustomBuildHook(BuildHookInterface):
    """Puts the machine code into a wheel."""

    folder = ""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before the files are gathered; an editable installation is left alone."""
        if version != "standard" or not all(importlib.util.find_spec(name) for name in NEEDED):
            return
        self.folder = tempfile.mkdtemp()
        made = [sys.executable, "-m", "toolbox.translation.shipped", self.folder]
        subprocess.run(made, cwd=self.root, check=True, stdout=subprocess.DEVNULL)
        build_data["force_include"][self.folder] = "toolbox/translation/objects"
        build_data["pure_python"] = False
        systems = {
            "linux": f"manylinux_2_17_{platform.machine()}",
            "darwin": f"macosx_11_0_{platform.machine()}",
        }  # it needs no library of the system
        system = systems.get(
            sys.platform, sysconfig.get_platform()
        )  # the platform of a Python for both Macs is universal2, which this code is not
        build_data["tag"] = f"py3-none-{system.replace('-', '_').replace('.', '_')}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """After the wheel is written."""
        if self.folder:
            shutil.rmtree(self.folder)
