# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jade_splat import splat
from torch import Tensor

PathLike = str | os.PathLike

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, as in cameras.json."""

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    camera_from_world: np.ndarray  # [4, 4]; x right, y down, z forward


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

    def to(self, device: torch.device | str) -> Gaussians:
        tensors = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: t.to(device) for name, t in tensors.items() if isinstance(t, Tensor)})


@dataclass(frozen=True)
class Run:
    """The results that jade_train wrote into a folder."""

    path: Path
    gaussians: Gaussians
    cameras: list[Camera]  # learned poses; empty if poses were not learned
    scores: dict[str, Any]  # eval.json; empty without test views
    metrics: dict[str, np.ndarray]  # one column per key of metrics.jsonl; NaN if a line lacks it


def load_run(folder: PathLike, device: torch.device | str = "cpu") -> Run:
    """Reads a run directory: its scene, learned cameras, scores and curves.

    Raises FileNotFoundError or ValueError naming the file.
    """
    path = Path(folder)
    scene = path / "point_cloud.ply"
    if not scene.is_file():
        raise FileNotFoundError(f"{path}: expected point_cloud.ply, found none; is this the --output of a finished jade_train?")
    return Run(
        path,
        load_gaussians(scene, device),
        _cameras(path / "cameras.json"),
        _json(path / "eval.json", {}),
        _columns(path / "metrics.jsonl"),
    )


def load_gaussians(path: PathLike, device: torch.device | str = "cpu") -> Gaussians:
    """Reads a binary little-endian .ply with the attributes of 3D Gaussian Splatting, SH degree 0 to 3.

    Raises ValueError naming the file.
    """
    data, comments = _vertices(Path(path))

    def columns(*names: str) -> Tensor:
        missing = [name for name in names if name not in data.dtype.names]
        if missing:
            raise ValueError(f"{path}: expected the property {missing[0]} of 3D Gaussians, found none")
        return torch.from_numpy(np.stack([data[name] for name in names], -1).astype(np.float32)).to(device)

    rest = sum(name.startswith("f_rest_") for name in data.dtype.names)
    if rest not in (0, 9, 24, 45):
        raise ValueError(f"{path}: expected 0, 9, 24 or 45 properties f_rest_, found {rest}")
    sh = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if rest:
        # The file has all of red, then green, then blue.
        sh = torch.cat([sh, columns(*[f"f_rest_{i}" for i in range(rest)]).unflatten(-1, (3, -1)).transpose(1, 2)], 1)
    origin = next((tuple(map(float, c.split()[1:4])) for c in comments if c.startswith("origin ")), (0.0, 0.0, 0.0))
    return Gaussians(
        columns("x", "y", "z"),
        columns("rot_0", "rot_1", "rot_2", "rot_3"),
        columns("scale_0", "scale_1", "scale_2"),
        columns("opacity")[:, 0].clamp(-100, 100),
        sh.contiguous(),
        any(c == "SplatRenderMode: mip" for c in comments),
        origin,  # type: ignore[arg-type]
    )


def render(
    scene: Run | Gaussians | PathLike,
    camera: Camera,
    *,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    device: torch.device | str | None = None,
) -> Tensor:
    """Renders a scene, given as a run, Gaussians, or a run's folder or .ply: [H, W, 3], linear as trained, not
    clamped.

    Differentiable in the Gaussians' tensors. Without `device`, runs on their device.
    """
    if isinstance(scene, (str, os.PathLike)):
        path = Path(scene)
        scene = load_run(path) if path.is_dir() else load_gaussians(path)
    gaussians = scene.gaussians if isinstance(scene, Run) else scene
    if device is not None:
        gaussians = gaussians.to(device)
    like = gaussians.means
    # In a small scene the camera can be nearer than the usual near plane.
    spread = like.detach() - like.detach().median(0, keepdim=True).values if len(like) else like.new_ones(1, 3)
    radius = float(spread.abs().median(0).values.norm())
    # x_camera = R (x − origin) + (t + R origin), with the shift in double.
    pose = np.array(camera.camera_from_world, np.float64)
    pose[:3, 3] += pose[:3, :3] @ np.array(gaussians.origin)
    color, alpha, _ = splat(
        like,
        gaussians.quats,
        gaussians.log_scales,
        gaussians.logit_opacities,
        gaussians.sh,
        torch.from_numpy(pose).to(like)[None],
        like.new_tensor([[camera.fx, camera.fy, camera.cx, camera.cy]]),
        camera.width,
        camera.height,
        near_plane=min(0.01, 0.01 * radius) or 0.01,
        antialiased=gaussians.antialiased,
    )
    return (color + (1 - alpha) * like.new_tensor(background)[:, None, None])[0].permute(1, 2, 0)


def _vertices(path: Path) -> tuple[np.ndarray, list[str]]:
    """The vertices of a .ply, one field per property, and its comments."""
    with path.open("rb") as file:
        lines = []
        while not lines or lines[-1] != "end_header":
            line = file.readline(1000)
            if not line or (not lines and line.strip() != b"ply"):
                raise ValueError(f"{path}: expected a .ply header, found {'its end' if lines else 'other bytes'}")
            lines.append(line.decode("latin-1").strip())
        if "format binary_little_endian 1.0" not in lines:
            raise ValueError(f"{path}: expected binary_little_endian, found another format; jade_export writes it")
        elements = [i for i, line in enumerate(lines) if line.startswith("element ")]
        if not elements or not lines[elements[0]].startswith("element vertex "):
            raise ValueError(f"{path}: expected vertices as the first element, found none")
        count = int(lines[elements[0]].split()[2])
        properties = [line.split()[1:] for line in lines[elements[0] : (elements[1:] or [None])[0]] if line.startswith("property ")]
        try:
            dtype = np.dtype([(name, "<" + _TYPES[kind]) for kind, name in properties])
        except (KeyError, ValueError) as error:
            raise ValueError(f"{path}: expected properties of scalar types, found others") from error
        data = np.fromfile(file, dtype, count)
    if len(data) != count:
        raise ValueError(f"{path}: expected {count} vertices, found {len(data)}; the file is cut short")
    return data, [line[len("comment ") :] for line in lines if line.startswith("comment ")]


def _json(path: Path, default: Any) -> Any:
    if not path.is_file():
        return default
    try:
        return json.loads(path.read_text())
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: expected JSON, found {error.msg} in line {error.lineno}") from error


def _cameras(path: Path) -> list[Camera]:
    def camera(entry: dict[str, Any]) -> Camera:
        pose = np.vstack([np.array(entry["camera_from_world"], np.float64)[:3], [0, 0, 0, 1]])
        numbers = {key: entry[key] for key in ("name", "width", "height", "fx", "fy", "cx", "cy")}
        return Camera(**numbers, camera_from_world=pose)

    return [camera(entry) for entry in _json(path, [])]


def _columns(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        return {}
    rows = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError as error:
            raise ValueError(f"{path}:{number}: expected a JSON object, found {error.msg}") from error
    keys = {key: None for row in rows for key, value in row.items() if isinstance(value, (int, float))}
    return {key: np.array([row.get(key, np.nan) for row in rows], np.float64) for key in keys}
