# SPDX-License-Identifier: Apache-2.0
"""Splatting by the equations of lib/jade/splat/README.md, in plain torch, one Gaussian after the other. Slow.

α is clamped at 0.999, as in gsplat and in jade_splat.rasterization(); splat() and the programs clamp it at 0.99.
"""

from __future__ import annotations

import torch
from torch import Tensor

MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, DILATION = 0.999, 1 / 255, 1e-4, 0.3


def rotation_matrices(quats: Tensor) -> Tensor:
    w, x, y, z = (quats / quats.norm(dim=-1, keepdim=True)).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return torch.stack(rows, -2)


def sh_basis(degree: int, d: Tensor) -> Tensor:
    x, y, z = d.unbind(-1)
    terms = [torch.full_like(x, 0.28209479177387814)]
    if degree >= 1:
        terms += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        terms += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * z * z - x * x - y * y),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree >= 3:
        ring = 4 * z * z - x * x - y * y
        terms += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * ring,
            0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -0.4570457994644658 * x * ring,
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return torch.stack(terms, -1)


def project(means, quats, scales, viewmat, K, width, height):
    """means2d [N,2], which keeps its gradient, depths [N], variances xx, xy, yy [N] and the determinant before dilation."""
    point = means @ viewmat[:3, :3].T + viewmat[:3, 3]
    z = point[:, 2]
    focal, center = torch.stack([K[0, 0], K[1, 1]]), K[:2, 2]
    size = torch.tensor([width, height], dtype=means.dtype, device=means.device)
    means2d = focal * point[:, :2] / z[:, None] + center
    if means2d.requires_grad:
        means2d.retain_grad()
    low, high = -center / focal - 0.15 * size / focal, (size - center) / focal + 0.15 * size / focal
    ratio = torch.minimum(torch.maximum(point[:, :2] / z[:, None], low), high)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([focal[0] / z, zero, -focal[0] * ratio[:, 0] / z], -1),
            torch.stack([zero, focal[1] / z, -focal[1] * ratio[:, 1] / z], -1),
        ],
        -2,
    )
    rows = jacobian @ viewmat[:3, :3] @ (rotation_matrices(quats) * scales[:, None, :])
    covariance = rows @ rows.transpose(-1, -2)
    cross = torch.linalg.cross(rows[:, 0], rows[:, 1])
    return means2d, z, covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1], (cross * cross).sum(-1)


def render_view(means, quats, scales, opacities, colors, viewmat, K, width, height, antialiased=False, near=0.01):
    """colors [N,D] → planes [H,W,D], alpha [H,W], Σ w z [H,W] and means2d."""
    means2d, z, xx, xy, yy, bare = project(means, quats, scales, viewmat, K, width, height)
    det = bare + DILATION * (xx + yy) + DILATION**2
    xx, yy = xx + DILATION, yy + DILATION
    if antialiased:
        opacities = opacities * (bare / det).sqrt()
    rows = torch.arange(height, dtype=means.dtype, device=means.device) + 0.5
    columns = torch.arange(width, dtype=means.dtype, device=means.device) + 0.5
    planes = means.new_zeros((height, width, colors.shape[-1]))
    alpha_sum, depth_sum = means.new_zeros((height, width)), means.new_zeros((height, width))
    transmittance = means.new_ones((height, width))
    going = torch.ones((height, width), dtype=torch.bool, device=means.device)
    for i in torch.argsort(z.detach(), stable=True).tolist():
        if z[i] < near:
            continue
        dx, dy = columns[None, :] - means2d[i, 0], rows[:, None] - means2d[i, 1]
        exponent = (yy[i] * dx * dx - 2 * xy[i] * dx * dy + xx[i] * dy * dy) / det[i]
        raw = opacities[i] * torch.exp(-0.5 * exponent)
        alpha = raw.clamp(max=MAX_ALPHA)
        shown = (raw >= MIN_ALPHA) & going
        left = transmittance * (1 - alpha)
        going = going & ~(shown & (left <= MIN_TRANSMITTANCE))
        weight = torch.where(shown & going, alpha * transmittance, 0)
        transmittance = torch.where(shown & going, left, transmittance)
        planes = planes + weight[..., None] * colors[i]
        depth_sum = depth_sum + weight * z[i]
        alpha_sum = 1 - transmittance
    return planes, alpha_sum, depth_sum, means2d


def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, sh_degree=None,
                  backgrounds=None, render_mode="RGB", rasterize_mode="classic"):
    """Reference of jade_splat.rasterization, without batches of scenes; returns the views' means2d instead of meta."""
    images, alphas, screens = [], [], []
    for view, (viewmat, K) in enumerate(zip(viewmats, Ks)):
        color = colors[view] if colors.dim() == (3 if sh_degree is None else 4) else colors
        if sh_degree is not None:
            away = means + viewmat[:3, :3].T @ viewmat[:3, 3]
            basis = sh_basis(sh_degree, away / away.norm(dim=-1, keepdim=True))
            color = (torch.einsum("nk,nkc->nc", basis, color[:, : basis.shape[1]]) + 0.5).clamp(min=0)
        planes, alpha, depth, means2d = render_view(
            means, quats, scales, opacities, color, viewmat, K, width, height, rasterize_mode == "antialiased"
        )
        if backgrounds is not None:
            planes = planes + (1 - alpha)[..., None] * backgrounds[view]
        if "ED" in render_mode:
            depth = depth / alpha.clamp(min=1e-10)
        parts = ([planes] if "RGB" in render_mode else []) + ([depth[..., None]] if "D" in render_mode else [])
        images.append(torch.cat(parts, -1))
        alphas.append(alpha[..., None])
        screens.append(means2d)
    return torch.stack(images), torch.stack(alphas), screens
