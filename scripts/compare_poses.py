#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how far the poses of a data set are from the true ones, in pixels.

    .venv/bin/python scripts/compare_poses.py DATA TRUE_DATA [--with-true-poses FOLDER] [--json]

Both are EvDeblur folders (docs/data.md) with the same clock: the output of jade_import, and the truth/ of
jade_simulate --recording, a scene with a slider's or a motion capture's poses, or another import. Position,
orientation and scale of an import are arbitrary: its cameras are first rotated by their mean rotation to the true
ones, then scaled and shifted for the best fit of their centres. The error of a camera is the image distance
between projected points: a grid of pixels at true depths between the near and the far bound, root mean square.
Printed for the start, the middle and the end of the exposures, all nine poses, and the sharp views.

--with-true-poses writes DATA again, with the true poses in its own axes and unit, so that points and bounds stay
valid, and a scene.yaml that keeps them: a reference for a scene that is trained on DATA.
"""
from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

POSES = 9
GRID = (7, 5)
DEPTHS = 4


class DataError(Exception):
    """The inputs cannot be compared; a one-line reason."""


def camera_axes(columns: np.ndarray) -> np.ndarray:
    """Converts LLFF's columns down, right, backwards [N,3,3] to right, down, forward, or back."""
    return np.stack([columns[..., 1], columns[..., 0], -columns[..., 2]], -1)


def turned_by(vector: np.ndarray) -> np.ndarray:
    """Rotation matrices of rotation vectors [N,3]."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    axis = vector / np.maximum(angle[..., 0], 1e-300)
    k = np.zeros((*vector.shape[:-1], 3, 3))
    k[..., 0, 1], k[..., 0, 2], k[..., 1, 2] = -axis[..., 2], axis[..., 1], -axis[..., 0]
    k -= np.swapaxes(k, -1, -2)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


def rotation_vector(r: np.ndarray) -> np.ndarray:
    """Rotation vectors of rotations by less than half a turn, as between neighbours of a path."""
    skew = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], -1) / 2
    sine, cosine = np.linalg.norm(skew, axis=-1), (np.trace(r, axis1=-2, axis2=-1) - 1) / 2
    return skew * np.where(sine > 1e-12, np.arctan2(sine, cosine) / np.maximum(sine, 1e-300), 1.0)[..., None]


@dataclass
class Poses:
    """Camera to world: axes [N,3,3] (right, down, forward) and centres [N,3]."""

    axes: np.ndarray
    centres: np.ndarray

    @staticmethod
    def of_rows(rows: np.ndarray) -> Poses:
        matrices = rows[:, :15].reshape(-1, 3, 5).astype(float)
        return Poses(camera_axes(matrices[:, :, :3]), matrices[:, :, 3])


class Scene:
    def __init__(self, folder: Path):
        self.folder = folder
        self.images = next((p for p in (folder / "images_1", folder / "images") if (p / "timestamps.npz").is_file()), None)
        rows = folder / "poses_bounds.npy"
        if self.images is None or not rows.is_file():
            raise DataError(f"{folder}: expected a data set with poses_bounds.npy and images_1/timestamps.npz")
        times = np.load(self.images / "timestamps.npz")
        self.start, self.end = (times[k].astype(float) for k in ("timestamps_start", "timestamps_end"))
        self.rows = np.load(rows)
        self.dense = (folder / "all_poses_bounds.npy").is_file()
        self.path_rows = np.load(folder / "all_poses_bounds.npy") if self.dense else self.rows
        self.path_times = np.load(folder / "all_timestamps.npy").astype(float) if self.dense else (self.start + self.end) / 2
        if len(self.start) != len(self.rows) or len(self.path_times) != len(self.path_rows):
            raise DataError(f"{folder}: expected as many poses as times")
        order = np.argsort(self.path_times, kind="stable")
        self.times, self.path = self.path_times[order], Poses.of_rows(self.path_rows[order])

    def at(self, times: np.ndarray) -> Poses:
        """Interpolates the path's poses: linear centres, and rotations about one axis."""
        if times.min() < self.times[0] - 0.5 or times.max() > self.times[-1] + 0.5:
            raise DataError(f"{self.folder}: expected poses from {times.min():.0f} to {times.max():.0f}, found them from "
                            f"{self.times[0]:.0f} to {self.times[-1]:.0f}; both data sets need one clock")
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        span = self.times[i + 1] - self.times[i]
        u = np.clip((times - self.times[i]) / np.where(span > 0, span, 1), 0, 1)[:, None]
        step = rotation_vector(np.swapaxes(self.path.axes[i], -1, -2) @ self.path.axes[i + 1])
        centres = self.path.centres[i] * (1 - u) + self.path.centres[i + 1] * u
        return Poses(self.path.axes[i] @ turned_by(u * step), centres)


@dataclass
class Similarity:
    """truth = scale * turn @ found + shift"""

    turn: np.ndarray
    scale: float
    shift: np.ndarray

    @staticmethod
    def between(found: Poses, true: Poses) -> Similarity:
        u, _, v = np.linalg.svd((true.axes @ np.swapaxes(found.axes, -1, -2)).sum(0))
        turn = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        own, wanted = found.centres @ turn.T, true.centres
        a, b = own - own.mean(0), wanted - wanted.mean(0)
        if not (a * a).sum() > 0:
            raise DataError("expected cameras at different places, found them all at one")
        scale = (a * b).sum() / (a * a).sum()
        return Similarity(turn, scale, wanted.mean(0) - scale * own.mean(0))

    def to_truth(self, poses: Poses) -> Poses:
        return Poses(self.turn @ poses.axes, self.scale * poses.centres @ self.turn.T + self.shift)

    def from_truth(self, poses: Poses) -> Poses:
        return Poses(self.turn.T @ poses.axes, (poses.centres - self.shift) @ self.turn / self.scale)


def image_errors(found: Poses, true: Poses, row: np.ndarray) -> np.ndarray:
    """[N] px: image motion from `true` to `found`, which is in the axes of the truth. row: size, focal length and
    bounds.
    """
    height, width, focal = row[:15].reshape(3, 5)[:, 4]
    x, y = np.meshgrid(np.linspace(0, width, GRID[0]), np.linspace(0, height, GRID[1]))
    rays = np.stack([(x - width / 2) / focal, (y - height / 2) / focal, np.ones_like(x)], -1).reshape(-1, 3)
    depths = 1 / np.linspace(1 / row[15], 1 / row[16], DEPTHS)
    points = (depths[:, None, None] * rays).reshape(-1, 3)
    world = points @ np.swapaxes(true.axes, -1, -2) + true.centres[:, None]
    seen = (world - found.centres[:, None]) @ found.axes
    moved = focal * (seen[..., :2] / np.maximum(seen[..., 2:], 1e-9) - points[:, :2] / points[:, 2:])
    return np.sqrt((moved**2).sum(-1).mean(-1))


def exposures(scene: Scene) -> np.ndarray:
    """[E,9] times"""
    blurry = scene.end > scene.start + 1
    if not blurry.any():
        raise DataError(f"{scene.folder}: expected exposures, found sharp frames only")
    return np.linspace(scene.start[blurry], scene.end[blurry], POSES, axis=1)


def mean_square(errors: np.ndarray) -> float:
    return round(float(np.sqrt((errors**2).mean())), 3)


def compare(data: Scene, truth: Scene) -> tuple[dict[str, float], Similarity]:
    times = exposures(data)
    fit = Similarity.between(data.at(times.ravel()), truth.at(times.ravel()))
    row = truth.rows[0].astype(float)
    row[15], row[16] = truth.rows[:, 15].min(), truth.rows[:, 16].max()

    def error(at: np.ndarray) -> np.ndarray:
        return image_errors(fit.to_truth(data.at(at)), truth.at(at), row)

    nine = error(times.ravel()).reshape(times.shape)
    result = {"exposures": len(times), "start_px": mean_square(nine[:, 0]), "middle_px": mean_square(nine[:, POSES // 2]),
              "end_px": mean_square(nine[:, -1]), "nine_px": mean_square(nine)}
    sharp = data.end <= data.start + 1
    if sharp.any():
        result["sharp_views_px"] = mean_square(error(data.start[sharp]))
    return result, fit


def rows_with(rows: np.ndarray, poses: Poses) -> np.ndarray:
    result = rows.astype(float).copy()
    matrices = result[:, :15].reshape(-1, 3, 5)
    matrices[:, :, :3], matrices[:, :, 3] = camera_axes(poses.axes), poses.centres
    result[:, :15] = matrices.reshape(-1, 15)
    return result


def write_with_true_poses(data: Scene, truth: Scene, fit: Similarity, output: Path) -> None:
    if output.exists():
        raise DataError(f"{output}: expected no such folder yet")
    text = settings_with_true_poses(data.folder / "scene.yaml")
    middles = np.clip((data.start + data.end) / 2, truth.times[0], truth.times[-1])
    shutil.copytree(data.folder, output, copy_function=link_or_copy, ignore=shutil.ignore_patterns("import", "*poses_bounds.npy"))
    np.save(output / "poses_bounds.npy", rows_with(data.rows, fit.from_truth(truth.at(middles))))
    if data.dense:  # beyond its end the true path stays at its last pose
        times = np.clip(data.path_times, truth.times[0], truth.times[-1])
        np.save(output / "all_poses_bounds.npy", rows_with(data.path_rows, fit.from_truth(truth.at(times))))
    scene = output / "scene.yaml"
    scene.unlink(missing_ok=True)  # it may be a link to that of DATA
    scene.write_text(text, encoding="utf-8")


def settings_with_true_poses(scene: Path) -> str:
    """The settings of DATA, if any, without learned poses."""
    text = scene.read_text(encoding="utf-8") if scene.is_file() else ""
    if re.search(r"^poses:", text, re.MULTILINE):
        raise DataError(f"{scene}: expected no key 'poses' of its own, which the copy sets; take it out")
    return text + ("\n" if text and not text.endswith("\n") else "") + "poses: {optimize: none}\n"


def link_or_copy(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--with-true-poses", type=Path, metavar="FOLDER", help="write DATA with the true poses")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        data, truth = Scene(arguments.data), Scene(arguments.truth)
        result, fit = compare(data, truth)
        if arguments.with_true_poses:
            write_with_true_poses(data, truth, fit, arguments.with_true_poses)
    except (DataError, OSError, ValueError, KeyError) as error:
        print(f"compare_poses: {error}", file=sys.stderr)
        return 3
    if arguments.json:
        print(json.dumps(result))
    else:
        print(", ".join(f"{key.removesuffix('_px').replace('_', ' ')} {value}{' px' if key.endswith('_px') else ''}"
                        for key, value in result.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
