# SPDX-License-Identifier: Apache-2.0
"""A fast differentiable splatting op for PyTorch."""

from ._library import BUILD
from .rendering import rasterization, splat

__all__ = ["BUILD", "rasterization", "splat"]
__version__ = "0.2.0"
