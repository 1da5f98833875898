# SPDX-License-Identifier: Apache-2.0
"""Finds the compiled library and loads it into torch, or reports why it cannot."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import torch


def _version(text: str) -> tuple[int, int]:
    found = re.match(r"(\d+)\.(\d+)", text)
    return (int(found[1]), int(found[2])) if found else (0, 0)


def check_torch(build: dict, version: str, cuda: str | None) -> None:
    """Raises ImportError unless this torch can load a library that was built as described by `build`."""
    if _version(version) < _version(build["torch"]):
        raise ImportError(
            f"jade_splat: expected torch {build['torch']} or newer, found {version}; pip install -U torch"
        )
    if build["cuda"] is None:
        return
    if cuda is None or cuda.split(".")[0] != str(build["cuda"]):
        raise ImportError(
            f"jade_splat: expected torch for CUDA {build['cuda']}, found torch {version} for "
            f"{'the CPU' if cuda is None else 'CUDA ' + cuda}; install the torch or the jade-splat wheel of the other"
        )


def load() -> dict:
    """Loads the library once and returns its build description. JADE_SPLAT_LIBRARY names the folder of another
    build.
    """
    folder = Path(os.environ.get("JADE_SPLAT_LIBRARY") or Path(__file__).parent)
    library, build_file = folder / "_C.abi3.so", folder / "_build.json"
    if not library.is_file() or not build_file.is_file():
        raise ImportError(f"jade_splat: expected {library.name} in {folder}, found none; install the jade-splat wheel")
    build = json.loads(build_file.read_text())
    check_torch(build, torch.__version__, torch.version.cuda)
    torch.ops.load_library(str(library))
    return build


BUILD = load()
