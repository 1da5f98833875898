# SPDX-License-Identifier: Apache-2.0
"""Quantities that densification reads besides the images, computed on first use."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, MutableMapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

_MIN_ALPHA = 1 / 255  # a fainter splat does not count
_MAX_OPACITY = 1e4  # a larger one is rejected
_DILATION = 0.3  # px², added to both variances on the screen


class Cameras(NamedTuple):
    """[..., C] pinhole cameras and their culling limits."""

    viewmats: Tensor  # [..., C, 4, 4]
    Ks: Tensor  # [..., C, 3, 3]
    width: int
    height: int
    near_plane: float
    far_plane: float
    antialiased: bool


@torch.no_grad()
def project(means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, cameras: Cameras) -> dict[str, Tensor]:
    """Projected Gaussians: means2d [..., C, N, 2] px, radii [..., C, N, 2] px (0: culled), depths, opacities [...,
    C, N] and conics [..., C, N, 3] (xx, xy, yy of the inverse of the dilated covariance).
    """
    rotation = cameras.viewmats[..., None, :3, :3]  # [..., C, 1, 3, 3]
    point = (rotation @ means[..., None, :, :, None])[..., 0] + cameras.viewmats[..., None, :3, 3]  # [..., C, N, 3]
    depth = point[..., 2]
    focal = torch.stack([cameras.Ks[..., 0, 0], cameras.Ks[..., 1, 1]], -1)[..., None, :]
    center = cameras.Ks[..., None, :2, 2]
    size = means.new_tensor([cameras.width, cameras.height])
    ratio = point[..., :2] / depth[..., None]
    margin = 0.15 * size / focal
    clamped = torch.minimum(torch.maximum(ratio, -center / focal - margin), (size - center) / focal + margin)
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    axes = torch.stack(
        [
            *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        ],
        -1,
    ).unflatten(-1, (3, 3))
    in_camera = rotation @ (axes * scales[..., None, :])[..., None, :, :, :]  # [..., C, N, 3, 3]
    # Rows of J · W · M, with J the Jacobian of the projection.
    rows = (focal / depth[..., None])[..., None] * (in_camera[..., :2, :] - clamped[..., None] * in_camera[..., 2:, :])
    xx, xy, yy = (
        (rows[..., i, :] * rows[..., j, :]).sum(-1) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    bare = (xx * yy - xy * xy).clamp_min(0)
    xx, yy = xx + _DILATION, yy + _DILATION
    det = xx * yy - xy * xy
    opacity = opacities[..., None, :].expand(depth.shape)
    if cameras.antialiased:
        opacity = opacity * (bare / det).sqrt()
    sigmas = (2 * (opacity / _MIN_ALPHA).clamp_min(1).log()).sqrt()
    means2d = ratio * focal + center
    radii = (sigmas[..., None] * torch.stack([xx, yy], -1).sqrt()).ceil()
    shown = (depth >= cameras.near_plane) & (depth <= cameras.far_plane) & (det > 0)
    shown &= (opacity >= _MIN_ALPHA) & (opacity <= _MAX_OPACITY)
    shown &= ((means2d + radii > 0) & (means2d - radii < size)).all(-1)
    return {
        "radii": torch.where(shown[..., None], radii, 0).to(torch.int32),
        "means2d": means2d,
        "depths": depth,
        "conics": torch.stack([yy, -xy, xx], -1) / det[..., None],
        "opacities": opacity,
    }


def _versions(tensors: tuple[Tensor, ...]) -> list[int]:
    """How often each tensor was changed in place; tensors of inference mode do not count that."""
    try:
        return [tensor._version for tensor in tensors]
    except RuntimeError:
        return [0 if tensor.is_inference() else tensor._version for tensor in tensors]


class Meta(MutableMapping):
    """A dictionary whose screen quantities are computed on first access.

    If `packed`, these have one row per visible (batch, camera, Gaussian), indexed by batch_ids, camera_ids and
    gaussian_ids; otherwise they are [..., C, N, ...], with radii of 0 where a Gaussian is not visible.
    """

    __slots__ = ("_values", "_gaussians", "_cameras", "_means2d", "_packed", "_inputs", "_rendered", "_pending")
    _SCREEN = ("radii", "means2d", "depths", "conics", "opacities", "batch_ids", "camera_ids", "gaussian_ids")

    def __init__(self, values: dict[str, Any], gaussians: tuple[Tensor, ...], cameras: Cameras,
                 means2d: Tensor | None, packed: bool):
        self._values = values
        self._gaussians, self._cameras = gaussians, cameras
        self._means2d = means2d  # the leaf of the op's graph
        self._packed = packed
        self._inputs = (*gaussians, cameras.viewmats, cameras.Ks)
        self._rendered = _versions(self._inputs)
        self._pending = set(self._SCREEN)

    def __getitem__(self, key: str) -> Any:
        if key in self._pending:
            self._compute()
        return self._values[key]

    def __setitem__(self, key: str, value: Any) -> None:
        self._pending.discard(key)
        self._values[key] = value

    def __delitem__(self, key: str) -> None:
        if key in self._pending:
            self._pending.discard(key)
        else:
            del self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter([*self._values, *(key for key in self._SCREEN if key in self._pending)])

    def __len__(self) -> int:
        return len(self._values) + len(self._pending)

    def _compute(self) -> None:
        if _versions(self._inputs) != self._rendered:
            warnings.warn(
                "jade_splat: expected meta to be read before the Gaussians or cameras change in place, found them "
                "changed, so its values are not those of the image; read meta['means2d'] before optimizer.step()",
                stacklevel=3,
            )
        with torch.autocast(self._gaussians[0].device.type, enabled=False):
            screen: dict[str, Any] = project(*self._gaussians, self._cameras)
        leaf = self._means2d
        if leaf is not None:
            # The graph's own tensor had no values until now: the op reads only whether it requires a gradient.
            leaf.data.copy_(screen["means2d"])
            screen["means2d"] = leaf
        ids: dict[str, Tensor | None] = {"batch_ids": None, "camera_ids": None, "gaussian_ids": None}
        if self._packed:
            shown = (screen["radii"] > 0).all(-1)
            views, count = shown.shape[-2:]
            flat = shown.flatten().nonzero()[:, 0]
            ids = {
                "batch_ids": flat // (views * count),
                "camera_ids": flat // count % views,
                "gaussian_ids": flat % count,
            }
            screen = {key: _pack(value, shown.dim(), flat) for key, value in screen.items()}
        for key, value in (screen | ids).items():
            if key in self._pending:
                self._values[key] = value
        self._pending.clear()


def _pack(dense: Tensor, dims: int, rows: Tensor) -> Tensor:
    """The rows of a tensor whose first `dims` axes are batches, cameras and Gaussians. For a leaf, returns a leaf
    that receives the gradient's rows in each backward pass.
    """
    packed = dense.detach().flatten(0, dims - 1)[rows]
    if not dense.requires_grad:
        return packed
    packed.requires_grad_()

    def add(grad: Tensor) -> None:
        part = grad.flatten(0, dims - 1)[rows]
        packed.grad = part if packed.grad is None else packed.grad + part

    if dense.grad is not None:
        add(dense.grad)
    dense.register_hook(add)
    return packed


def screen_numbers(width: int, height: int, tile_size: int, batches: int, views: int) -> dict[str, int]:
    return {
        "width": width,
        "height": height,
        "tile_size": tile_size,
        "tile_width": -(width // -tile_size),
        "tile_height": -(height // -tile_size),
        "n_batches": batches,
        "n_cameras": views,
    }
