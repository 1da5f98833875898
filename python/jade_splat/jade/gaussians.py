# SPDX-License-Identifier: Apache-2.0
"""Gaussians and the .ply that holds them, read as the programs read it."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

PathLike = str | os.PathLike

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}
_GEOMETRY = ("x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity")
_FLOATS = ("scale_", "opacity", "f_dc_", "f_rest_")
_MOST_LOGIT, _FULL_LOGIT = 1e4, 30  # a larger logit, such as the infinity of 255 in a byte, becomes the second
_LEAST_LOG_SCALE = -30  # of Gaussians that are rendered; flat ones have less
_LOG_FLATNESS, _LOG_POINT = -6.9, -16  # thickness of a flat Gaussian, relative to its thinnest axis or if it has none
_FAR = 256  # distance, in sizes of the scene, from which float32 is too coarse
_CONVERT = "if it holds Gaussians, jade_export --ply {} --output scene.ply writes one that is read"


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians by their parameters before the activations, as in a 3DGS .ply."""

    means: Tensor  # [N, 3], without `origin`
    quats: Tensor  # [N, 4], wxyz, of any length
    log_scales: Tensor  # [N, 3]
    logit_opacities: Tensor  # [N]
    sh: Tensor  # [N, K, 3], K = 1, 4, 9 or 16
    antialiased: bool = False  # how the scene was trained
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the means, in the coordinates of cameras
    near_plane: float = 0.0  # Gaussians nearer to a camera are not rendered; 0: from the size of the scene

    def to(self, device: torch.device | str) -> Gaussians:
        tensors = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: t.to(device) for name, t in tensors.items() if isinstance(t, Tensor)})


def load_gaussians(path: PathLike, device: torch.device | str = "cpu") -> Gaussians:
    """Reads a binary little-endian .ply with the attributes of 3D Gaussian Splatting, SH degree 0 to 3.

    Means far from the origin are moved to an `origin` near them, and filter_3D of Mip-Splatting is applied.

    Raises ValueError naming the file.
    """
    path = Path(path)
    data, comments = _vertices(path)
    rest = sum(name.startswith("f_rest_") for name in data.dtype.names)
    if rest not in (0, 9, 24, 45):
        raise ValueError(f"{path}: expected 0, 9, 24 or 45 properties f_rest_, found {rest}")
    constant, higher = [f"f_dc_{i}" for i in range(3)], [f"f_rest_{i}" for i in range(rest)]
    _check_properties(path, data.dtype, (*constant, *higher, *_GEOMETRY))

    def columns(*names: str) -> Tensor:
        return torch.from_numpy(np.stack([data[name] for name in names], -1).astype(np.float32))

    sh = columns(*constant)[:, None]
    if rest:
        # The file has all of red, then green, then blue.
        sh = torch.cat([sh, columns(*higher).unflatten(-1, (3, -1)).transpose(1, 2)], 1)
    means, origin = columns("x", "y", "z"), _said_origin(comments)
    if not any(origin) and any(origin := _found_origin(means)):
        exact = np.stack([data[axis] for axis in "xyz"], -1).astype(np.float64)
        means = torch.from_numpy((exact - np.array(origin)).astype(np.float32))
    log_scales, logits = columns("scale_0", "scale_1", "scale_2"), columns("opacity")[:, 0]
    if "filter_3D" in data.dtype.names:
        log_scales, logits = _smoothed(log_scales, logits, columns("filter_3D"))
    mode = next((c.partition("SplatRenderMode: ")[2] for c in comments if "SplatRenderMode: " in c), "")
    scene = Gaussians(
        means,
        columns("rot_0", "rot_1", "rot_2", "rot_3"),
        _thick(log_scales),
        torch.where(logits.abs() > _MOST_LOGIT, logits.clamp(-_FULL_LOGIT, _FULL_LOGIT), logits),
        sh.contiguous(),
        "mip" in mode,
        origin,
    )
    return scene.to(device)


def _check_properties(path: Path, dtype: np.dtype, names: tuple[str, ...]) -> None:
    missing = [name for name in names if name not in dtype.names]
    if missing:
        raise ValueError(
            f"{path}: expected the property {missing[0]} of 3D Gaussians, found none; " + _CONVERT.format(path)
        )
    for name in names:
        if name.startswith(_FLOATS) and dtype[name].kind != "f":
            raise ValueError(f"{path}: expected {name} as float, found integers; export the scene again with floats")


def _said_origin(comments: list[str]) -> tuple[float, float, float]:
    """The numbers of the first comment "origin X Y Z", or zero. A comment in words may begin with "origin" too."""
    for comment in comments:
        word, *numbers = comment.split()[:4] or [""]
        try:
            if word == "origin" and len(numbers) == 3:
                return (float(numbers[0]), float(numbers[1]), float(numbers[2]))
        except ValueError:
            continue
    return (0.0, 0.0, 0.0)


def _found_origin(means: Tensor) -> tuple[float, float, float]:
    """A short decimal near means that are far from the origin; else zero."""
    finite = means[means.isfinite().all(1)].double()
    if len(finite) == 0:
        return (0.0, 0.0, 0.0)
    middle = finite.median(0).values
    size = float((finite - middle).norm(dim=1).median())
    size = size if size > 0 and math.isfinite(size) else 1.0
    if not _FAR * size < float(middle.norm()) < math.inf:
        return (0.0, 0.0, 0.0)
    step = 10.0 ** math.floor(math.log10(size))
    x, y, z = (round(m / step) / round(1 / step) if step < 1 else round(m / step) * step for m in middle.tolist())
    return (x, y, z)


def _smoothed(log_scales: Tensor, logits: Tensor, sigma: Tensor) -> tuple[Tensor, Tensor]:
    """Scales and opacities with the filter of Mip-Splatting, of standard deviation sigma [N, 1]: S² becomes S² + σ²,
    and the opacity is multiplied by sqrt(det S² / det(S² + σ²)).
    """
    added, before = sigma.double().square(), (2 * log_scales.double()).exp()
    after = before + added
    share = torch.where(added > 0, before / after, 1)
    opacities = logits.double().sigmoid() * share.prod(1).sqrt()
    return (
        torch.where(added > 0, (0.5 * after.log()).float(), log_scales),
        torch.where(added[:, 0] > 0, opacities.logit().float(), logits),
    )


def _thick(log_scales: Tensor) -> Tensor:
    """Gives flat Gaussians, with a log scale of minus infinity, a thousandth of their thinnest other axis."""
    thin = log_scales < _LEAST_LOG_SCALE
    thinnest = log_scales.masked_fill(thin, math.inf).amin(1, keepdim=True)
    depth = torch.where(thinnest.isinf(), _LOG_POINT, (thinnest + _LOG_FLATNESS).clamp_min(1 + _LEAST_LOG_SCALE))
    return torch.where(thin, depth, log_scales)


def _header(path: Path, file) -> list[str]:
    lines: list[str] = []
    while not lines or lines[-1] != "end_header":
        line = file.readline(1 << 16)
        if not lines and line.strip() != b"ply":
            found = "another kind of file" if line else "an empty file"
            raise ValueError(f"{path}: expected a .ply, found {found}; " + _CONVERT.format(path))
        if not line.endswith(b"\n"):
            raise ValueError(f"{path}: expected a .ply header, found its end; copy the file again")
        lines.append(line.decode("latin-1").strip())
    return lines


def _vertices(path: Path) -> tuple[np.ndarray, list[str]]:
    """The vertices of a .ply, one field per property, and its comments."""
    with path.open("rb") as file:
        lines = _header(path, file)
        if "format binary_little_endian 1.0" not in lines:
            raise ValueError(f"{path}: expected binary_little_endian, found another format; " + _CONVERT.format(path))
        elements = [i for i, line in enumerate(lines) if line.startswith("element ")]
        if not elements or not lines[elements[0]].startswith("element vertex "):
            raise ValueError(f"{path}: expected vertices as the first element, found others; " + _CONVERT.format(path))
        number = lines[elements[0]].split()[2]
        if not number.isdecimal():
            raise ValueError(f"{path}: expected a number of vertices, found {number!r}; export the scene again")
        of_vertices = lines[elements[0] : (elements[1:] or [None])[0]]
        properties = [line.split()[1:] for line in of_vertices if line.startswith("property ")]
        try:
            dtype = np.dtype([(name, "<" + _TYPES[kind]) for kind, name in properties])
        except (KeyError, ValueError) as error:
            raise ValueError(f"{path}: expected properties of scalar types with different names, found others") from error
        begin, size, count = file.tell(), os.fstat(file.fileno()).st_size, int(number)
        found = (size - begin) // max(dtype.itemsize, 1)
        if found < count:
            raise ValueError(f"{path}: expected {count} vertices, found {found}; the file is cut short")
        if len(elements) == 1 and found > count:
            warnings.warn(
                f"{path}: expected {count} vertices as its header says, found {found}; the others are not read", stacklevel=4
            )
        data = np.fromfile(file, dtype, count)
    return data, [line[len("comment ") :] for line in lines if line.startswith("comment ")]
