# SPDX-License-Identifier: Apache-2.0
"""What surrounds the network: its event input, the double integral it is compared with, and their mix."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

BINS = 6
EDI_WINDOWS = 8


def scer_from_bins(bins: Tensor) -> Tensor:
    """Six hard signed bins [N,6,H,W] to the symmetric cumulative form: about log(I_t / I_mid) / threshold."""
    v1, v2, v3, v4, v5, v6 = bins.unbind(1)
    return torch.stack([-(v1 + v2 + v3), -(v2 + v3), -v3, v4, v4 + v5, v4 + v5 + v6], 1)


def normalise(events: Tensor) -> Tensor:
    """Divides each sample by its largest magnitude; a sample without events stays zero."""
    largest = events.abs().amax((1, 2, 3), keepdim=True)
    return events / torch.where(largest > 0, largest, torch.ones_like(largest))


def event_mask(events: Tensor) -> Tensor:
    """[N,1,H,W]: 1 where any channel is not zero, closed by 3x3 (outside: 0 in the dilation, 1 in the erosion)."""
    active = (events != 0).any(1, keepdim=True).to(events.dtype)
    dilated = F.max_pool2d(active, 3, 1, 1)
    return -F.max_pool2d(-dilated, 3, 1, 1)


def network_input(bins: Tensor, kind: str = "scer") -> tuple[Tensor, Tensor]:
    """Raw bins to (events, mask) as the network takes them."""
    events = normalise(scer_from_bins(bins) if kind == "scer" else bins)
    return events, event_mask(events)


def double_integral(blurry: Tensor, windows: Tensor) -> Tensor:
    """EDI at mid exposure from nine samples: blurry [N,3,H,W], windows [N,8,H,W] of threshold-weighted signed sums."""
    rising = windows[:, EDI_WINDOWS // 2 :].cumsum(1)
    falling = -windows[:, : EDI_WINDOWS // 2].flip(1).cumsum(1)
    ratio = 1 + rising.exp().sum(1, keepdim=True) + falling.exp().sum(1, keepdim=True)
    return (EDI_WINDOWS + 1) * blurry / ratio


def mean_mix(a: Tensor, b: Tensor) -> Tensor:
    return (a + b) / 2


def oracle_mix(a: Tensor, b: Tensor, truth: Tensor) -> Tensor:
    """Per pixel the restoration with the smaller squared error: what perfect routing would give."""
    error_a, error_b = ((x - truth).square().sum(1, keepdim=True) for x in (a, b))
    return torch.where(error_a <= error_b, a, b)


def psnr(a: Tensor, b: Tensor) -> Tensor:
    """[N]: of the mean squared error over pixels and channels, peak 1, after clamping the first to [0,1]."""
    mse = (a.float().clamp(0, 1) - b.float()).square().mean((1, 2, 3))
    return -10 / math.log(10) * mse.clamp_min(1e-12).log()
