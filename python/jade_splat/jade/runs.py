# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import math
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jade_splat import splat
from torch import Tensor

from .gaussians import Gaussians, PathLike, load_gaussians


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
class Run:
    """The results that jade_train wrote into a folder."""

    path: Path
    gaussians: Gaussians
    cameras: list[Camera]  # test views, then the moments of each exposure; empty for runs without cameras.json
    scores: dict[str, Any]  # eval.json; empty without test views
    metrics: dict[str, np.ndarray]  # one column per key of metrics.jsonl; NaN if a line lacks it


def load_run(folder: PathLike, device: torch.device | str = "cpu") -> Run:
    """Reads a run directory: its scene, cameras, scores and curves.

    Raises FileNotFoundError or ValueError naming the file.
    """
    path = Path(folder)
    scene = path / "point_cloud.ply"
    if not scene.is_file():
        raise FileNotFoundError(f"{path}: expected point_cloud.ply, found none; is this the --output of a finished jade_train?")
    return Run(
        path,
        replace(load_gaussians(scene, device), near_plane=_near_plane(path / "config.yaml")),
        _cameras(path / "cameras.json"),
        _json(path / "eval.json", {}),
        _columns(path / "metrics.jsonl"),
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
    if not isinstance(gaussians, Gaussians):
        raise TypeError(f"scene: expected a Run, Gaussians or a path, found {type(scene).__name__}")
    if device is not None:
        gaussians = gaussians.to(device)
    like = gaussians.means
    if not isinstance(like, Tensor) or not like.is_floating_point():
        found = like.dtype if isinstance(like, Tensor) else type(like).__name__
        raise TypeError(f"means: expected a float32 tensor, found {found}")
    # In a small scene without a run the camera can be nearer than the usual near plane.
    spread = like.detach() - like.detach().median(0, keepdim=True).values if len(like) else like.new_ones(1, 3)
    radius = float(spread.abs().median(0).values.norm())
    # x_camera = R (x − origin) + (t + R origin), with the shift in double.
    pose = _pose(camera)
    try:
        behind = torch.as_tensor(background, dtype=like.dtype, device=like.device)
    except (TypeError, ValueError):
        raise ValueError(f"background: expected 3 numbers, found {background!r}") from None
    if behind.shape != (3,):
        raise ValueError(f"background: expected 3 numbers, found {background!r}")
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
        near_plane=gaussians.near_plane or min(0.01, 0.01 * radius) or 0.01,
        antialiased=gaussians.antialiased,
    )
    return (color + (1 - alpha) * behind[:, None, None])[0].permute(1, 2, 0)


def _pose(camera: Camera) -> np.ndarray:
    """camera_from_world in double. Raises TypeError or ValueError naming the member that is not usable."""
    if not isinstance(camera, Camera):
        raise TypeError(f"camera: expected a Camera, found {type(camera).__name__}")
    for name, least in {"fx": 0, "fy": 0, "cx": -math.inf, "cy": -math.inf}.items():
        value = getattr(camera, name)
        try:
            usable = not isinstance(value, str) and least < float(value) < math.inf
        except (TypeError, ValueError, RuntimeError):
            usable = False
        if not usable:
            raise ValueError(f"{name}: expected a {'positive' if least == 0 else 'finite'} number of px, found {value!r}")
    matrix = camera.camera_from_world
    if isinstance(matrix, Tensor):
        if matrix.requires_grad:
            raise NotImplementedError("camera_from_world: gradients of cameras are not supported; pass a detached tensor")
        matrix = matrix.cpu().numpy()
    try:
        pose = np.array(matrix, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"camera_from_world: expected shape (4, 4) of numbers, found {type(matrix).__name__}") from None
    if pose.shape != (4, 4):
        raise ValueError(f"camera_from_world: expected shape (4, 4), found {pose.shape}")
    if not np.isfinite(pose).all():
        raise ValueError(f"camera_from_world: expected finite numbers, found {pose[~np.isfinite(pose)][0]}")
    last = np.array([0.0, 0.0, 0.0, 1.0])
    if not np.allclose(pose[3], last, rtol=0, atol=1e-4):
        transposed = np.allclose(pose[:, 3], last, rtol=0, atol=1e-4)
        fix = "the matrix looks transposed, pass its .T" if transposed else "correct it"
        raise ValueError(f"camera_from_world: expected 0, 0, 0, 1 as the last row, found {pose[3].tolist()}; {fix}")
    rotation = pose[:3, :3]
    determinant = np.linalg.det(rotation)
    if determinant < 0 or not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=0.01):
        raise ValueError(
            "camera_from_world: expected a rotation in the first 3 rows and columns, found one that is scaled, mirrored or "
            f"not perpendicular (determinant {determinant:.3g}); correct it"
        )
    return pose


def _near_plane(path: Path) -> float:
    """splat.near_plane of a run's settings, 0 if they do not say."""
    if not path.is_file():
        return 0.0
    found = re.search(r"^  near_plane: ([0-9][0-9.e-]*)", path.read_text("utf-8", "replace"), re.M)
    return float(found[1]) if found else 0.0


def _json(path: Path, default: Any) -> Any:
    """Content of the default's type, which stands for a missing file."""
    if not path.is_file():
        return default
    try:
        content = json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: expected JSON, found {error}") from error
    if not isinstance(content, type(default)):
        raise ValueError(f"{path}: expected a {type(default).__name__}, found a {type(content).__name__}")
    return content


def _cameras(path: Path) -> list[Camera]:
    def camera(entry: dict[str, Any]) -> Camera:
        pose = np.array(entry["camera_from_world"], np.float64)[:3]
        numbers = {key: entry[key] for key in ("name", "width", "height", "fx", "fy", "cx", "cy")}
        return Camera(**numbers, camera_from_world=np.vstack([pose, [0, 0, 0, 1]]))

    cameras = []
    for index, entry in enumerate(_json(path, [])):
        try:
            cameras.append(camera(entry))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(
                f"{path}: expected name, width, height, fx, fy, cx, cy and camera_from_world [3, 4] of camera {index}, "
                f"found others ({error}); is it the file of a jade_train run?"
            ) from error
    return cameras


def _columns(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        return {}
    rows = []
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        try:
            row = json.loads(line)
        except ValueError as error:
            raise ValueError(f"{path}:{number}: expected a JSON object, found {error}") from error
        if not isinstance(row, dict):
            raise ValueError(f"{path}:{number}: expected a JSON object, found {row!r}")
        rows.append(row)
    keys = {key: None for row in rows for key, value in row.items() if isinstance(value, (int, float))}
    for number, row in enumerate(rows, 1):
        for key in keys & row.keys():
            if not isinstance(row[key], (int, float, type(None))):
                raise ValueError(f"{path}:{number}: expected a number as {key}, as on other lines, found {row[key]!r}")
    return {key: np.array([row.get(key, np.nan) for row in rows], np.float64) for key in keys}
