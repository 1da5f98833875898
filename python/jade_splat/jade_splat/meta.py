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
    # Inside, Gaussians are the last axis: one matrix product per camera, few operations of torch.
    size = torch.linspace(cameras.width, cameras.height, 2, dtype=means.dtype, device=means.device)[:, None]
    rotation, shift = cameras.viewmats[..., :3, :].split((3, 1), -1)  # [..., C, 3, 3 and 1]
    plane, z = (rotation @ means.mT[..., None, :, :] + shift).split((2, 1), -2)  # [..., C, 2 and 1, N]
    focal, center = cameras.Ks.diagonal(dim1=-2, dim2=-1)[..., :2, None], cameras.Ks[..., :2, 2:]  # [..., C, 2, 1]
    ratio, scale = plane / z, focal / z
    left, margin = center / focal, 0.15 * size / focal
    clamped = ratio.clamp(-left - margin, size / focal - left + margin)
    # Rows of J · W · M, with J the Jacobian of the projection.
    axes = (_axes(quats) * scales.mT[..., None, :, :]).flatten(-2)  # [..., 3, 3 N]
    in_camera = (rotation @ axes[..., None, :, :]).unflatten(-1, (3, means.shape[-2]))  # [..., C, 3, 3, N]
    across, along = in_camera.split((2, 1), -3)
    u, v = (scale[..., None, :] * (across - clamped[..., None, :] * along)).unbind(-3)
    xx, xy, yy = (u * u).sum(-2), (u * v).sum(-2), (v * v).sum(-2)
    xy2 = xy * xy
    opacity = opacities[..., None, :].expand(xy.shape)
    if cameras.antialiased:
        bare = (xx * yy - xy2).clamp_min(0)
    xx, yy = xx + _DILATION, yy + _DILATION
    det = xx * yy - xy2
    if cameras.antialiased:
        opacity = opacity * (bare / det).sqrt()
    sigmas = (2 * (opacity / _MIN_ALPHA).clamp_min(1).log()).sqrt()
    means2d = ratio * focal + center
    radii = (sigmas[..., None, :] * torch.stack([xx, yy], -2).sqrt()).ceil()
    depth = z[..., 0, :]
    shown = (depth >= cameras.near_plane) & (depth <= cameras.far_plane) & (det > 0)
    shown &= (opacity >= _MIN_ALPHA) & (opacity <= _MAX_OPACITY)
    shown &= ((means2d + radii > 0) & (means2d - radii < size)).all(-2)
    return {
        "radii": torch.where(shown[..., None, :], radii, 0).mT.to(torch.int32, memory_format=torch.contiguous_format),
        "means2d": means2d.mT.contiguous(),
        "depths": depth,
        "conics": torch.stack([yy, -xy, xx], -1) / det[..., None],
        "opacities": opacity,
    }


def _axes(quats: Tensor) -> Tensor:
    """Rotation matrices [..., 3, 3, N] of quaternions [..., N, 4] of any length."""
    unit = torch.nn.functional.normalize(quats, dim=-1)
    products = (unit[..., None] * (2 * unit)[..., None, :]).flatten(-2).unbind(-1)
    _, wx, wy, wz, _, xx, xy, xz, _, _, yy, yz, _, _, _, zz = products
    entries = (1 - yy - zz, xy - wz, xz + wy, xy + wz, 1 - xx - zz, yz - wx, xz - wy, yz + wx, 1 - xx - yy)
    return torch.stack(entries, -2).unflatten(-2, (3, 3))


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

    def __contains__(self, key: object) -> bool:
        return key in self._values or key in self._pending

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
