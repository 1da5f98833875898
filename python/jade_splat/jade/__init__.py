# SPDX-License-Identifier: Apache-2.0
"""Runs of jade_train in Python: load_run() reads one, render() renders its scene with the same op."""

from .gaussians import Gaussians, load_gaussians
from .runs import Camera, Run, load_run, render

__all__ = ["Camera", "Gaussians", "Run", "load_gaussians", "load_run", "render"]
