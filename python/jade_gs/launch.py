# SPDX-License-Identifier: Apache-2.0
"""Starts a program of this package: this function implements the console commands jade_train, jade_import, …"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import sys
from pathlib import Path

from jade_gs.build import TORCH

PACKAGE = Path(__file__).resolve().parent
PROGRAMS = PACKAGE / "bin"
SHARE = PACKAGE / "share" / "jade"
# Folders of NVIDIA's wheels beside torch.
COMPANIONS = ("nvidia/cu13/lib", "nvidia/cudnn/lib", "nvidia/cusparselt/lib", "nvidia/nccl/lib", "nvidia/nvshmem/lib")


class Unusable(Exception):
    """The programs cannot run here; a one-line reason."""


def site_of_torch() -> Path:
    """The folder that contains torch, whose libraries the programs load. @throws Unusable."""
    install = f"run {sys.executable} -m pip install torch=={TORCH}"
    spec = importlib.util.find_spec("torch")
    if spec is None or not spec.submodule_search_locations:
        raise Unusable(f"expected torch {TORCH}, found none; {install}")
    try:
        found = importlib.metadata.version("torch")
    except importlib.metadata.PackageNotFoundError:
        found = "a torch without a version"
    # Another version has other symbols; the loader would report a missing one by its C++ name.
    if found.split("+")[0] != TORCH:
        raise Unusable(f"expected torch {TORCH}, which the programs were built with, found {found}; {install}")
    return Path(next(iter(spec.submodule_search_locations))).resolve().parent


def environment() -> dict[str, str]:
    """The environment of a program: its scripts use this Python, and its loader finds torch where Python does."""
    environment = dict(os.environ)
    environment.setdefault("JADE_PYTHON", sys.executable)
    site = site_of_torch()
    if site != PACKAGE.parent:
        # The programs search for torch beside this package only.
        folders = [site / "torch" / "lib", *(site / name for name in COMPANIONS)]
        known = environment.get("LD_LIBRARY_PATH")
        environment["LD_LIBRARY_PATH"] = ":".join([*map(str, folders), *([known] if known else [])])
    return environment


def main() -> int:
    name = Path(sys.argv[0]).name
    program = PROGRAMS / name
    try:
        if platform.machine() not in ("x86_64", "AMD64"):
            raise Unusable(f"expected an x86-64 processor, found {platform.machine()}; build from source there")
        if not program.is_file():
            raise Unusable(f"expected the program {program}, found none; install jade-gs again")
        os.execve(program, [name, *sys.argv[1:]], environment())
    except (Unusable, OSError) as problem:
        print(f"error: {name}: {problem}", file=sys.stderr)
        return 4
