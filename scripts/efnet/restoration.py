# SPDX-License-Identifier: Apache-2.0
"""Pre- and postprocessing of the network: its event input, EDI for comparison, and their mix."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

BINS = 6  # of the published network
EDI_WINDOWS = 8  # of the printed double integral
WINDOWS = 16  # of the counts from which any moment is restored: the nine poses of an exposure are at window borders
CANDIDATES = 4  # number of thresholds for which moment_input integrates


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
    return event_mask_of((events != 0).any(1, keepdim=True).to(events.dtype))


def event_mask_of(active: Tensor) -> Tensor:
    """Event mask from a map [N,1,H,W] of ones and zeros."""
    dilated = F.max_pool2d(active, 3, 1, 1)
    return -F.max_pool2d(-dilated, 3, 1, 1)


def network_input(bins: Tensor, kind: str = "scer") -> tuple[Tensor, Tensor]:
    """Converts raw bins to the network's (events, mask)."""
    events = normalise(scer_from_bins(bins) if kind == "scer" else bins)
    return events, event_mask(events)


def moment_input(counts: Tensor, time: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Input of an any-time network, from signed counts [N,W,H,W] of equal windows and moments [N] in [0,1].

    events [N,W+8,H,W]: counts cumulated from the moment to each border of the windows, relative to the mean count
    of a pixel with events; the log of the double integral, for four thresholds; the moment; the log of that mean
    count. mask [N,1,H,W]. log_gain [N,4,H,W]: log of the blurry frame over the sharp one at the moment, for each
    threshold.
    A pixel's counts depend on a threshold that the network does not know: it chooses among the candidates.
    """
    count, windows, height, width = counts.shape
    knots = F.pad(counts.cumsum(1), [0, 0, 0, 0, 1, 0])
    border = torch.arange(windows + 1, device=counts.device, dtype=counts.dtype)
    near = (1 - (time.view(-1, 1) * windows - border).abs()).clamp_min(0.0).view(count, windows + 1, 1, 1)
    cumulative = knots - (knots * near).sum(1, keepdim=True)
    active = (counts != 0).any(1, keepdim=True).to(counts.dtype)
    scale = counts.abs().sum([1, 2, 3]) / active.sum([1, 2, 3]).clamp_min(1.0)
    scale = torch.where(scale > 0, scale, torch.ones_like(scale)).view(count, 1, 1, 1)
    log_share = torch.full_like(border, 1.0 / windows).log()
    log_share[0] -= 0.6931471805599453  # both ends count half
    log_share[-1] -= 0.6931471805599453
    gains = []
    for threshold in (0.1, 0.2, 0.35, 0.55):
        exponent = cumulative * threshold + log_share.view(1, -1, 1, 1)
        gains.append(torch.logsumexp(exponent, 1, keepdim=True))
    log_gain = torch.cat(gains, 1).clamp(-3.0, 3.0)
    plane = torch.ones_like(active)
    moment = plane * (2 * time - 1).view(count, 1, 1, 1)
    events = torch.cat([(cumulative / scale).clamp(-8.0, 8.0), log_gain, moment, plane * scale.log()], 1)
    return events, event_mask_of(active), log_gain


def any_time_channels() -> int:
    """Number of event channels of moment_input: borders, candidates, moment and scale."""
    return WINDOWS + 1 + CANDIDATES + 2


def any_time_input(blurry: Tensor, counts: Tensor, time: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The arguments of an any-time EFNet: blurry, events, mask, and the EDI images of the candidate thresholds."""
    events, mask, log_gain = moment_input(counts, time)
    images = (blurry.unsqueeze(1) * (-log_gain).exp().unsqueeze(2)).clamp(0.0, 1.5)
    return blurry, events, mask, images.flatten(1, 2)


def double_integral(blurry: Tensor, windows: Tensor, moment: int | None = None, trapezoid: bool = False) -> Tensor:
    """EDI from the samples at the borders of equal windows, at one of them (default: mid exposure).

    blurry [N,3,H,W]; windows [N,W,H,W] of threshold-weighted signed sums. Equal weights as printed, or trapezoid
    ones.
    """
    knots = F.pad(windows.cumsum(1), [0, 0, 0, 0, 1, 0])
    number = windows.shape[1]
    chosen = number // 2 if moment is None else moment
    weights = torch.ones(number + 1, device=windows.device, dtype=windows.dtype)
    if trapezoid:
        weights[[0, -1]] = 0.5
    gain = ((knots - knots[:, chosen : chosen + 1]).exp() * (weights / weights.sum()).view(1, -1, 1, 1)).sum(1, keepdim=True)
    return blurry / gain


def mean_mix(a: Tensor, b: Tensor) -> Tensor:
    return (a + b) / 2


def oracle_mix(a: Tensor, b: Tensor, truth: Tensor) -> Tensor:
    """Per pixel the restoration with the smaller squared error: the result of perfect routing."""
    error_a, error_b = ((x - truth).square().sum(1, keepdim=True) for x in (a, b))
    return torch.where(error_a <= error_b, a, b)


def psnr(a: Tensor, b: Tensor) -> Tensor:
    """[N]: PSNR of the mean squared error over pixels and channels, peak 1, after clamping the first to [0,1]."""
    mse = (a.float().clamp(0, 1) - b.float()).square().mean((1, 2, 3))
    return -10 / math.log(10) * mse.clamp_min(1e-12).log()
