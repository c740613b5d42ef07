"""How the package is built: its description on an index, and the machine code in its wheel.

A wheel has all kernels, so building one takes minutes and needs numba. A checkout that is installed
to be edited has none: it compiles each kernel at its first use, so there numba is installed too.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from hatchling import build as hatchling
from hatchling.build import *  # noqa: F403  (the functions that pip calls)
from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

NUMBA = "numba>=0.61"


def get_requires_for_build_wheel(settings: dict[str, Any] | None = None) -> list[str]:
    """Return what a wheel is built with: numba, and what the package itself imports."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*hatchling.get_requires_for_build_wheel(settings), *project["dependencies"], NUMBA]


def portable(text: str) -> str:
    """Return a page in Markdown without pictures and links to the repository's own files.

    A package index resolves neither. The text of a link stays; the caption of a picture goes.
    """
    text = re.sub(r"!\[[^]]*\]\((?!https?:)[^)]*\)\n*(?:\*[^\n]*\*\n*)?", "", text)
    return re.sub(r"\[([^]]+)\]\((?!https?:)[^)]*\)", r"\1", text)


class Description(MetadataHookInterface):
    """Hook of Hatch that sets the field `readme`."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the description in the package's metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": portable(text)}


class MachineCode(BuildHookInterface):
    """Hook of Hatch that adds machine code to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile all kernels, or have numba installed beside a checkout that is edited."""
        if version == "editable":
            build_data["dependencies"].append(NUMBA)
            return
        self.folder = tempfile.TemporaryDirectory()
        line = [sys.executable, "-m", "gym_passive_walker.apps.build", self.folder.name]
        path = os.pathsep.join([self.root, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        subprocess.run(line, check=True, cwd=self.root, env=os.environ | {"PYTHONPATH": path})
        # Its bitcode is read by the LLVM that wrote it, and by later ones.
        of_llvm = version_of("llvmlite").split(".")[:2]
        build_data["dependencies"].append(f"llvmlite>={'.'.join(of_llvm)}")
        build_data["force_include"][self.folder.name] = "gym_passive_walker/built"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel now."""
        if version != "editable":
            self.folder.cleanup()
