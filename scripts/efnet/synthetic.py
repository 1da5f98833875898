# SPDX-License-Identifier: Apache-2.0
"""Blurry frames, events and sharp frames, simulated on the fly in batches on any device.

A scene is one to three textured layers (photographs or procedural) that move in front of each other along smooth
camera-like paths. It is rendered at the borders of equal time steps; events follow the per-pixel threshold rule
between them. All random numbers come from one torch.Generator, so a seed and a device determine every batch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from draw import Draw
from footage import MARGIN, Footage
from restoration import WINDOWS

LUMA = (0.299, 0.587, 0.114)


@dataclass(frozen=True)
class NoiseOptions:
    """Strength of sensor noise; 0 is a clean simulation, 1 the strongest in training."""

    strength_min: float = 0.0
    strength_max: float = 1.0
    # share of exposures whose frames and events differ in time, and of those in which they differ in place
    apart: float = 0.5
    quantise: bool = True

    def share(self, of: float) -> float:
        """Share of exposures with a fault that has no strength; 0 for a clean simulation."""
        return of if self.strength_max > 0 else 0.0


@dataclass(frozen=True)
class SceneOptions:
    height: int = 256
    width: int = 256
    batch: int = 16
    blur_min_px: float = 2.0
    blur_max_px: float = 40.0
    layers_max: int = 3
    threshold_min: float = 0.1
    threshold_max: float = 0.6
    rectified: float = 0.35  # share of batches whose events are splatted at sub-pixel positions
    steps: int = 0  # time steps of the exposure; 0: from the blur length
    windows: int = WINDOWS  # of the counts
    moments: int = 2  # per exposure
    middle: bool = False  # only the middle, else any border of a time step
    noise: NoiseOptions = NoiseOptions()


@dataclass
class Sample:
    """N exposures, M moments of each."""

    blurry: Tensor  # [N,3,H,W] as the camera stores it
    counts: Tensor  # [N,W,H,W] signed counts of equal windows
    time: Tensor  # [N,M] in [0,1]
    sharp: Tensor  # [N,M,3,H,W] at these moments, without noise
    ends: Tensor  # [N,2,3,H,W] at the start and at the end
    weighted: Tensor | None  # [N,W,H,W] the counts times the nominal thresholds, for EDI; only on request


def smooth_noise(draw: Draw, count: int, channels: int, size: int, coarsest: int, octaves: int) -> Tensor:
    """[count,channels,size,size], about unit deviation."""
    total = torch.zeros(count, channels, size, size, device=draw.device)
    for octave in range(octaves):
        cells = min(coarsest * 2**octave, size)
        grid = draw.normal(count, channels, cells, cells)
        total += F.interpolate(grid, size=(size, size), mode="bicubic", align_corners=False) * 0.6**octave
    return total / total.std((2, 3), keepdim=True).clamp_min(1e-6)


def leaves(draw: Draw, count: int, size: int, number: int) -> Tensor:
    """Dead leaves: opaque ellipses, boxes and bars of all sizes over each other, shaded and lightly textured."""
    axis = torch.arange(size, device=draw.device, dtype=torch.float32)
    y, x = axis.view(1, size, 1), axis.view(1, 1, size)
    picture = draw.uniform(0, 1, count, 3, 1, 1).expand(count, 3, size, size).clone()
    for i in range(number):
        scale = size * 0.45 * (1 - i / number) ** 2 + 3
        radius = draw.log_uniform(0.25, 1.0, count, 2, 1, 1) * scale
        centre, angle = draw.uniform(0, size, count, 2, 1, 1), draw.uniform(0, math.pi, count, 1, 1)
        u, v = x - centre[:, 0], y - centre[:, 1]
        a = (u * angle.cos() + v * angle.sin()) / radius[:, 0]
        b = (v * angle.cos() - u * angle.sin()) / radius[:, 1]
        box = draw.chance(0.5, count, 1, 1)
        distance = torch.where(box, torch.maximum(a.abs(), b.abs()), (a * a + b * b).sqrt())
        cover = ((1 - distance) * radius.amin(1) + 0.5).clamp(0, 1).unsqueeze(1)
        colour = draw.uniform(0, 1, count, 3, 1, 1) + draw.uniform(-0.3, 0.3, count, 3, 1, 1) * a.unsqueeze(1)
        picture += cover * (colour - picture)
    return picture


def stripes(draw: Draw, count: int, size: int) -> Tensor:
    """Bars, grids and checkers with soft or hard edges."""
    axis = torch.arange(size, device=draw.device, dtype=torch.float32)
    y, x = axis.view(1, size, 1), axis.view(1, 1, size)
    angle = draw.uniform(0, math.pi, count, 1, 1)
    u, v = x * angle.cos() + y * angle.sin(), y * angle.cos() - x * angle.sin()
    period = draw.log_uniform(6, 80, count, 2, 1, 1)
    hardness = draw.log_uniform(0.5, 8, count, 1, 1)
    a = ((u / period[:, 0] * 2 * math.pi).sin() * hardness).tanh()
    b = ((v / period[:, 1] * 2 * math.pi).sin() * hardness).tanh()
    wave = torch.where(draw.chance(0.5, count, 1, 1), a * b, a).unsqueeze(1)
    return draw.uniform(0, 1, count, 3, 1, 1) + draw.uniform(-0.5, 0.5, count, 3, 1, 1) * wave


def procedural_textures(draw: Draw, count: int, size: int) -> Tensor:
    """[count,3,size,size] uint8."""
    parts = []
    for begin in range(0, count, 16):
        n = min(16, count - begin)
        picture = leaves(draw, n, size, 60 if size >= 256 else 24)
        picture = torch.where(draw.chance(0.2, n, 1, 1, 1), stripes(draw, n, size), picture)
        grain = smooth_noise(draw, n, 3, size, 8, 6).clamp(-2.5, 2.5)
        picture = picture + grain * draw.uniform(0, 0.12, n, 1, 1, 1)
        parts.append((picture.clamp(0, 1) * 255).round().to(torch.uint8))
    return torch.cat(parts)


def photographs(folder: Path, size: int) -> Tensor:
    """All pictures of a folder as [count,3,size,size] uint8 RGB; larger ones are cropped, smaller ones left out."""
    import cv2

    pictures = []
    for path in sorted(folder.iterdir()):
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is not None and min(image.shape[:2]) >= size:
            y, x = (image.shape[0] - size) // 2, (image.shape[1] - size) // 2
            square = image[y : y + size, x : x + size, ::-1].copy()
            pictures.append(torch.from_numpy(square).permute(2, 0, 1))
    if not pictures:
        raise FileNotFoundError(f"{folder}: expected pictures of at least {size}x{size} pixels, found none")
    return torch.stack(pictures)


def smooth_path(draw: Draw, count: int, channels: int, time: Tensor) -> Tensor:
    """[count,channels,times]: smooth, zero at mid exposure, length about 1 over the exposure."""
    phase, rate = draw.uniform(0, 2 * math.pi, count, channels, 1), draw.uniform(0.5, 2.5, count, channels, 1)
    wave = (2 * math.pi * rate * time + phase).sin() - phase.sin()
    weights = draw.normal(count, channels, 4, 1)
    bend = draw.uniform(0, 1, count, 1, 1)
    path = weights[:, :, 0] * time + bend * (
        weights[:, :, 1] * 1.2 * time**2 + weights[:, :, 2] * 2 * time**3 + weights[:, :, 3] * 0.12 * wave
    )
    inside = (time[1:] + time[:-1]).abs() < 1
    length = (path.diff(dim=2).square().sum(1).sqrt() * inside).sum(1).clamp_min(1e-6)
    return path / length.view(-1, 1, 1)


@dataclass
class Layer:
    texture: Tensor  # [N,4,T,T], the fourth is the cover
    centre: Tensor  # [N,2] texture pixels
    turn: Tensor  # [N,2,2] output pixels to texture pixels
    shift: Tensor  # [N,2,S] output pixels
    angle: Tensor  # [N,S]
    zoom: Tensor  # [N,S]
    tilt: Tensor  # [N,2,S] perspective, per pixel


def layer_cover(draw: Draw, count: int, size: int, kind: float) -> Tensor:
    """[count,1,size,size] in [0,1]: blobs, discs and boxes, or thin bars, with one-pixel edges."""
    axis = torch.arange(size, device=draw.device, dtype=torch.float32)
    y, x = axis.view(1, size, 1), axis.view(1, 1, size)
    if kind < 0.4:
        field = smooth_noise(draw, count, 1, size, 4, 3)[:, 0] - draw.uniform(0.2, 1.2, count, 1, 1)
        slope = (field.diff(dim=1).abs().mean((1, 2)) + field.diff(dim=2).abs().mean((1, 2))).view(-1, 1, 1)
        return (field / slope.clamp_min(1e-6) + 0.5).clamp(0, 1).unsqueeze(1)
    if kind < 0.6:
        angle, period = draw.uniform(0, math.pi, count, 1, 1), draw.log_uniform(24, 160, count, 1, 1)
        position = torch.remainder(x * angle.cos() + y * angle.sin(), period)
        thickness = draw.log_uniform(3, 20, count, 1, 1)
        return ((thickness / 2 - (position - period / 2).abs()) + 0.5).clamp(0, 1).unsqueeze(1)
    cover = torch.zeros(count, size, size, device=draw.device)
    for _ in range(6):
        radius = draw.log_uniform(6, 0.22 * size, count, 2, 1, 1)
        centre, angle = draw.uniform(0.1, 0.9, count, 2, 1, 1) * size, draw.uniform(0, math.pi, count, 1, 1)
        u, v = x - centre[:, 0], y - centre[:, 1]
        a = (u * angle.cos() + v * angle.sin()) / radius[:, 0]
        b = (v * angle.cos() - u * angle.sin()) / radius[:, 1]
        box = draw.chance(0.5, count, 1, 1)
        distance = torch.where(box, torch.maximum(a.abs(), b.abs()), (a * a + b * b).sqrt())
        cover = torch.maximum(cover, ((1 - distance) * radius.amin(1) + 0.5).clamp(0, 1))
    return cover.unsqueeze(1)


def recolour(draw: Draw, pictures: Tensor) -> Tensor:
    """Channel order, contrast, brightness and gamma of [N,3,T,T] in [0,1]."""
    count = pictures.shape[0]
    order = draw.uniform(0, 1, count, 3).argsort(1).view(count, 3, 1, 1).expand_as(pictures)
    keep = draw.chance(0.6, count, 1, 1, 1)
    pictures = torch.where(keep, pictures, pictures.gather(1, order))
    gamma = draw.log_uniform(0.6, 1.8, count, 1, 1, 1)
    gain, lift = draw.uniform(0.6, 1.0, count, 1, 1, 1), draw.uniform(0, 0.12, count, 1, 1, 1)
    return pictures.clamp_min(1e-4).pow(gamma) * gain * (1 - lift) + lift


def draw_layers(draw: Draw, bank: Tensor, options: SceneOptions, blur: Tensor, time: Tensor) -> list[Layer]:
    count, size = options.batch, bank.shape[-1]
    number = 1 + int(draw.scalar() * options.layers_max)
    radius = 0.5 * math.hypot(options.height, options.width)
    camera = smooth_path(draw, count, 2, time) * blur.view(-1, 1, 1)
    turning = smooth_path(draw, count, 4, time) * (blur / radius).view(-1, 1, 1) * draw.uniform(0, 0.8, count, 1, 1)
    layers = []
    for i in range(number):
        picture = recolour(draw, bank[draw.index(len(bank), count)].float() / 255)
        cover = torch.ones_like(picture[:, :1]) if i == 0 else layer_cover(draw, count, size, draw.scalar())
        near = draw.uniform(0.35, 1.0, count, 1, 1) if number > 1 and i == 0 else 1.0
        shift = camera * near
        if i > 0:  # some foregrounds move on their own
            own = draw.chance(0.4, count, 1, 1) * draw.uniform(0.2, 0.8, count, 1, 1)
            shift = shift * (1 - own) + smooth_path(draw, count, 2, time) * blur.view(-1, 1, 1) * own
        scale, angle = draw.log_uniform(0.8, 1.7, count), draw.uniform(0, 2 * math.pi, count)
        flip = torch.where(draw.chance(0.5, count), 1.0, -1.0)
        turn = scale.view(-1, 1, 1) * torch.stack(
            [torch.stack([angle.cos() * flip, -angle.sin()], -1), torch.stack([angle.sin() * flip, angle.cos()], -1)], 1
        )
        centre = size / 2 + draw.uniform(-0.2, 0.2, count, 2) * size
        layers.append(
            Layer(torch.cat([picture, cover], 1), centre, turn, shift, turning[:, 0], turning[:, 1], turning[:, 2:] / radius)
        )
    return layers


def pixel_grid(options: SceneOptions, device: torch.device) -> Tensor:
    """[H,W,2] pixel positions (x, y) from the picture's centre."""
    y = torch.arange(options.height, device=device, dtype=torch.float32) - (options.height - 1) / 2
    x = torch.arange(options.width, device=device, dtype=torch.float32) - (options.width - 1) / 2
    return torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)


def render(layers: list[Layer], positions: Tensor) -> Tensor:
    """Pictures [N,S,3,H,W] at pixel positions [1 or N,H,W,2], far layers first."""
    picture = torch.empty(0)
    for i, layer in enumerate(layers):
        count, _, size, _ = layer.texture.shape
        times, height, width = layer.angle.shape[1], positions.shape[1], positions.shape[2]
        p = positions.unsqueeze(1)
        depth = 1 + (p * layer.tilt.permute(0, 2, 1).reshape(count, times, 1, 1, 2)).sum(-1, keepdim=True)
        c = (layer.angle.cos() * (1 + layer.zoom)).view(count, times, 1, 1)
        s = (layer.angle.sin() * (1 + layer.zoom)).view(count, times, 1, 1)
        moved = torch.stack([p[..., 0] * c - p[..., 1] * s, p[..., 0] * s + p[..., 1] * c], -1) / depth
        moved = moved + layer.shift.permute(0, 2, 1).reshape(count, times, 1, 1, 2)
        # Written out, because a matrix product could run at a reduced precision that shifts texture by tenths of a
        # pixel.
        x, y, turn = moved[..., 0], moved[..., 1], layer.turn.view(count, 4, 1, 1, 1)
        texture = torch.stack([x * turn[:, 0] + y * turn[:, 1], x * turn[:, 2] + y * turn[:, 3]], -1)
        texture = (texture + layer.centre.view(count, 1, 1, 1, 2)).view(count, times * height, width, 2)
        grid = (texture + 0.5) * (2 / size) - 1
        sampled = F.grid_sample(layer.texture, grid, mode="bilinear", padding_mode="reflection", align_corners=False)
        sampled = sampled.view(count, 4, times, height, width).transpose(1, 2)
        if i == 0:
            picture = sampled[:, :, :3]
        else:
            picture = torch.lerp(picture, sampled[:, :, :3], sampled[:, :, 3:])
    return picture


def event_intensity(draw: Draw, pictures: Tensor) -> tuple[Tensor, Tensor]:
    """Input of the event pixels, [N,S,H,W]: luma, the mean, or a Bayer pattern; stored encoding or linear light.

    Also the exponent [N,1,1] from the stored encoding to it.
    """
    count, _, _, height, width = pictures.shape
    exponent = torch.where(draw.chance(0.5, count, 1, 1, 1, 1), 2.2, 1.0)
    luma = torch.tensor(LUMA, device=draw.device).view(1, 1, 3, 1, 1)
    weights = torch.where(draw.chance(0.7, count, 1, 1, 1, 1), luma, torch.full_like(luma, 1 / 3))
    rows, columns = torch.arange(height, device=draw.device) % 2, torch.arange(width, device=draw.device) % 2
    site = (rows.view(-1, 1) + columns.view(1, -1)).view(1, 1, 1, height, width)  # 0 red, 1 green, 2 blue
    bayer = (site == torch.arange(3, device=draw.device).view(1, 1, 3, 1, 1)).float()
    weights = torch.where(draw.chance(0.2, count, 1, 1, 1, 1), bayer, weights)
    return (pictures.clamp_min(1e-5).pow(exponent) * weights).sum(2), exponent.view(count, 1, 1)


@dataclass
class PixelThresholds:
    rise: Tensor  # [N,H,W] per pixel, in log units of the event pixels' input
    fall: Tensor
    nominal_rise: Tensor  # [N,1,1] known to EDI, in log units of the stored encoding
    nominal_fall: Tensor


def draw_thresholds(draw: Draw, options: SceneOptions, strength: Tensor, exponent: Tensor) -> PixelThresholds:
    """EDI works on the stored encoding, where the same events have thresholds smaller by the exponent."""
    count = options.batch
    rise = draw.log_uniform(options.threshold_min, options.threshold_max, count, 1, 1)
    high = draw.uniform((options.threshold_min + options.threshold_max) / 2, options.threshold_max, count, 1, 1)
    rise = torch.where(draw.chance(0.25, count, 1, 1), high, rise)  # more of the high ones, as slow or lossy sensors seem to have
    fall = rise * draw.uniform(0.72, 1.38, count, 1, 1)
    per_sample = strength.view(-1, 1, 1)
    spread = draw.uniform(0, 0.2, count, 1, 1) * per_sample
    shape = (count, options.height, options.width)
    drift = draw.chance(0.3, count, 1, 1) * draw.uniform(0, 0.15, count, 1, 1) * per_sample
    field = F.interpolate(draw.normal(count, 1, 4, 4), shape[1:], mode="bicubic", align_corners=True)[:, 0]
    return PixelThresholds(
        (rise * (1 + drift * field + spread * draw.normal(*shape))).clamp_min(0.02),
        (fall * (1 + drift * field + spread * draw.normal(*shape))).clamp_min(0.02),
        rise / exponent,
        fall / exponent,
    )


def events_of_step(
    level: Tensor, seen: Tensor, reference: Tensor, rise: Tensor, fall: Tensor, slow: Tensor, most: Tensor, lost: Tensor,
    reset: Tensor, shot: Tensor, leak: Tensor, chances: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """One time step of the threshold rule: the pixel's input, its reference, and the signed count.

    reset: the share of the change beyond the thresholds that an event discards, as in a pixel whose new reference
    is the level after its dead time.
    """
    seen = seen + (level - seen) * (1 - slow)
    change = seen - reference
    rising = change > 0
    threshold = torch.where(rising, rise, fall)
    number = (change.abs() / threshold).floor()
    reference = reference + change.sign() * number * threshold
    reference = reference + (seen - reference) * reset * (number > 0)
    kept = torch.minimum(number, most) * (chances[0] >= lost)
    signed = torch.where(rising, kept, -kept)
    noise = chances[1]
    return seen, reference, signed + (noise < shot / 2 + leak).float() - (noise > 1 - shot / 2).float()


event_step = events_of_step


def compile_events() -> None:
    """Makes torch.compile generate one kernel per time step; the numbers agree up to rounding."""
    global event_step
    event_step = torch.compile(events_of_step, dynamic=True)


def shift_in_time(level: Tensor, ahead: Tensor, margin: int) -> Tensor:
    """Shifts level [N,S+2*margin,H,W] to [N,S,H,W], by `ahead` [N,1,1] time steps later (negative: earlier): at most
    by the margin, or by one without a margin; extrapolates linearly beyond the ends.
    """
    count, times = level.shape[:2]
    first, last = 2 * level[:, :1] - level[:, 1:2], 2 * level[:, -1:] - level[:, -2:-1]
    level = torch.cat([first, level, last], 1)
    whole = ahead.floor().clamp(max=margin)  # the last step is reached from below
    steps = torch.arange(times - 2 * margin, device=level.device) + margin + 1
    index = steps + whole.view(count, 1).long()
    sample = torch.arange(count, device=level.device).view(count, 1)
    return torch.lerp(level[sample, index], level[sample, index + 1], (ahead - whole).unsqueeze(1))


def simulate_events(
    draw: Draw, intensity: Tensor, thresholds: PixelThresholds, strength: Tensor, options: SceneOptions, margin: int, weigh: bool
) -> tuple[Tensor, Tensor | None]:
    """Signed counts in equal windows [N,W,H,W], and the same weighted by the nominal thresholds. intensity: also of `margin` steps before
    the exposure and after it."""
    count, times, height, width = intensity.shape
    steps, windows = times - 2 * margin - 1, options.windows
    floor = draw.log_uniform(1e-3, 3e-2, count, 1, 1, 1)
    level = (intensity + floor).log()
    per_sample = strength.view(-1, 1, 1)
    # Frames are stamped at either end of their readout, so their clock differs from the events'.
    ahead = draw.chance(options.noise.share(options.noise.apart), count, 1, 1) * draw.uniform(-0.045, 0.045, count, 1, 1) * steps
    most_ahead = max(margin, 1)
    level = shift_in_time(level, ahead.clamp(-most_ahead, most_ahead), margin)
    # The stream begins before the exposure, so the reference is within a threshold of the first sample.
    offset = draw.uniform(-1, 1, count, height, width)
    reference = level[:, 0] - torch.where(offset > 0, offset * thresholds.rise, offset * thresholds.fall)
    # A lag of at most 2.3 steps: in dim light sensors reach some milliseconds.
    slow = draw.chance(0.3, count, 1, 1) * draw.uniform(0, 0.7, count, 1, 1) * per_sample
    limited = draw.chance(0.25, count, 1, 1) & (per_sample > 0.2)
    most = torch.where(limited, 1.0 + draw.index(3, count, 1, 1), torch.full_like(per_sample, 1e6))
    lost = draw.uniform(0, 0.12, count, 1, 1) * per_sample
    reset = draw.chance(0.3, count, 1, 1) * draw.uniform(0, 0.8, count, 1, 1) * per_sample
    shot = draw.log_uniform(1e-3, 0.4, count, 1, 1) * per_sample / steps
    leak = draw.chance(0.3, count, 1, 1) * draw.log_uniform(1e-3, 0.1, count, 1, 1) * per_sample / steps
    counts = torch.zeros(count, windows, height, width, device=draw.device)
    weighted = torch.zeros_like(counts) if weigh else None
    seen = level[:, 0].contiguous()
    for k in range(1, steps + 1):
        chances = draw.uniform(0, 1, 2, count, height, width)
        seen, reference, signed = event_step(
            level[:, k], seen, reference, thresholds.rise, thresholds.fall, slow, most, lost, reset, shot, leak, chances
        )
        window = (k - 1) * windows // steps
        counts[:, window] += signed
        if weighted is not None:
            weight = torch.where(signed > 0, thresholds.nominal_rise, thresholds.nominal_fall)
            weighted[:, window] += signed * weight
    hot = draw.uniform(0, 1, count, height, width) < per_sample * 3e-4 * draw.chance(0.5, count, 1, 1)
    burst = hot.unsqueeze(1) * (draw.normal(count, 1, height, width) * 24 / windows).round()
    counts += burst
    if weighted is not None:
        weighted += burst * thresholds.nominal_rise.unsqueeze(1)
    return counts, weighted


def splat(maps: Tensor, displacement: Tensor) -> Tensor:
    """Moves the values of each pixel of [N,C,H,W] by [N,H,W,2] pixels, bilinearly; values that leave the frame are
    lost.
    """
    count, channels, height, width = maps.shape
    y, x = torch.meshgrid(
        torch.arange(height, device=maps.device), torch.arange(width, device=maps.device), indexing="ij"
    )
    fx, fy = x + displacement[..., 0], y + displacement[..., 1]
    x0, y0 = fx.floor(), fy.floor()
    result = torch.zeros(count, channels, height * width, device=maps.device)
    for dx in (0, 1):
        for dy in (0, 1):
            xi, yi = x0 + dx, y0 + dy
            weight = (1 - (fx - xi).abs()) * (1 - (fy - yi).abs())
            weight = weight * ((xi >= 0) & (xi < width) & (yi >= 0) & (yi < height))
            index = (yi.clamp(0, height - 1) * width + xi.clamp(0, width - 1)).long().view(count, 1, -1)
            result.scatter_add_(2, index.expand(-1, channels, -1), (maps * weight.unsqueeze(1)).flatten(2))
    return result.view_as(maps)


def expose(draw: Draw, pictures: Tensor, options: SceneOptions, strength: Tensor) -> Tensor:
    """Mean over the exposure in linear light or the stored encoding, with shot, read and fixed-pattern noise.

    The first and the last picture have half weight, because the mean is over time. Some recordings are plain
    means of nine sharp frames instead.
    """
    count, number = pictures.shape[:2]
    gamma = torch.where(draw.chance(0.5, count, 1, 1, 1), 2.2, 1.0)
    values = pictures.clamp_min(1e-6).pow(gamma.unsqueeze(1))
    over_time = (values.sum(1) - (values[:, 0] + values[:, -1]) / 2) / (number - 1)
    nine = torch.linspace(0, number - 1, 9, device=draw.device).round().long()
    light = torch.where(draw.chance(0.2, count, 1, 1, 1), values[:, nine].mean(1), over_time)
    scale = strength.view(-1, 1, 1, 1)
    shot = draw.log_uniform(1e-5, 1.5e-3, count, 1, 1, 1) * scale
    read = draw.log_uniform(1e-3, 1.5e-2, count, 1, 1, 1) * scale
    pattern = draw.chance(0.3, count, 1, 1, 1) * draw.uniform(0, 0.02, count, 1, 1, 1) * scale
    grain, fixed = draw.normal(*light.shape), draw.normal(*light.shape)
    single = (draw.normal(count, 2, *light.shape[2:]).unsqueeze(2)).expand(-1, -1, 3, -1, -1)
    same = (pictures[:, 0, :1] == pictures[:, 0, 1:2]).flatten(1).all(1).view(-1, 1, 1, 1)
    grain, fixed = torch.where(same, single[:, 0], grain), torch.where(same, single[:, 1], fixed)
    light = light * (1 + pattern * fixed) + grain * (shot * light + read.square()).sqrt()
    blurry = light.clamp_min(0).pow(1 / gamma).clamp(0, 1)
    return (blurry * 255).round() / 255 if options.noise.quantise else blurry


def time_steps(blur_px: float, windows: int) -> int:
    """A multiple of the windows, usually with less than about a pixel of motion per step."""
    wanted = min(48, max(12, math.ceil(1.3 * blur_px)))
    return windows * math.ceil(wanted / windows)


def make_colours(draw: Draw, layers: list[Layer], count: int) -> None:
    """Makes whole samples gray, brightens some until highlights clip, and darkens others."""
    gray = draw.chance(0.25, count, 1, 1, 1)
    kind = draw.uniform(0, 1, count, 1, 1, 1)
    gain = torch.where(kind < 0.15, draw.uniform(1.0, 1.5, count, 1, 1, 1), torch.ones_like(kind))
    gain = torch.where(kind > 0.9, draw.log_uniform(0.15, 1.0, count, 1, 1, 1), gain)
    luma = torch.tensor(LUMA, device=draw.device).view(1, 3, 1, 1)
    for layer in layers:
        colour = layer.texture[:, :3]
        mean = (colour * luma).sum(1, keepdim=True).expand_as(colour)
        layer.texture[:, :3] = torch.where(gray, mean, colour) * gain


def draw_moments(draw: Draw, steps: int, options: SceneOptions) -> Tensor:
    """[N,M] indices of pictures: the middle for a quarter of them, an end for a third, else any."""
    shape = (options.batch, options.moments)
    middle = torch.full(shape, steps // 2, device=draw.device)
    if options.middle:
        return middle
    kind = draw.uniform(0, 1, *shape)
    end = draw.index(2, *shape) * steps
    return torch.where(kind < 0.25, middle, torch.where(kind < 0.58, end, draw.index(steps + 1, *shape)))


def soften(pictures: Tensor, sigma: Tensor) -> Tensor:
    """Blurs pictures [N,S,3,H,W] by a lens with a Gaussian point spread function of sigma [N] pixels, at most 0.8."""
    weights = (-0.5 * (torch.arange(-2, 3, device=pictures.device) / sigma.clamp_min(1e-3).view(-1, 1)).square()).exp()
    weights = (weights / weights.sum(1, keepdim=True)).view(-1, 5, 1, 1, 1, 1)
    count, times, channels, height, width = pictures.shape
    for axis in (3, 4):
        padding = (0, 0, 2, 2) if axis == 3 else (2, 2, 0, 0)
        wide = F.pad(pictures.flatten(1, 2), padding, mode="replicate").unflatten(1, (times, channels))
        length = pictures.shape[axis]
        pictures = sum(wide.narrow(axis, i, length) * weights[:, i] for i in range(5))
    return pictures


def draw_misplacement(draw: Draw, options: SceneOptions) -> Tensor:
    """[N,1,1,2] offset in pixels of an exposure's events from the frame, as after an imperfect calibration; zero for
    most.
    """
    shape = (options.batch, 1, 1)
    return draw.chance(options.noise.share(options.noise.apart), *shape, 1) * draw.uniform(-0.6, 0.6, *shape, 2)


def finish(draw: Draw, pictures: Tensor, seen: Tensor, displacement: Tensor | None, margin: int, options: SceneOptions,
           with_windows: bool) -> Sample:
    """Simulates both sensors for pictures [N,margin+S+1+margin,3,H,W]; `seen` is the event pixels' input."""
    count, steps = options.batch, pictures.shape[1] - 1 - 2 * margin
    strength = draw.uniform(options.noise.strength_min, options.noise.strength_max, count)
    sigma = draw.chance(options.noise.share(0.3), count) * draw.uniform(0, 0.8, count)
    if options.noise.strength_max > 0:
        other = seen is not pictures
        pictures = soften(pictures, sigma)
        seen = soften(seen, sigma) if other else pictures
    intensity, exponent = event_intensity(draw, seen)
    pictures = pictures[:, margin : margin + steps + 1]
    thresholds = draw_thresholds(draw, options, strength, exponent)
    counts, weighted = simulate_events(draw, intensity, thresholds, strength, options, margin, with_windows)
    if displacement is not None or options.noise.share(options.noise.apart) > 0:
        shape = (count, options.height, options.width, 2)
        displacement = draw_misplacement(draw, options) + (0 if displacement is None else displacement)
        counts = splat(counts, displacement.expand(shape))
        weighted = None if weighted is None else splat(weighted, displacement.expand(shape))
    counts = counts * ~draw.chance(options.noise.share(0.005), count, 1, 1, 1)
    blurry = expose(draw, pictures, options, strength)
    chosen = draw_moments(draw, steps, options)
    sharp = torch.stack([pictures[i].index_select(0, chosen[i]) for i in range(count)])
    ends = pictures[:, [0, -1]]
    return Sample(blurry, counts, chosen.float() / steps, sharp.clamp(0, 1), ends.clamp(0, 1), weighted)


@torch.no_grad()
def generate(draw: Draw, bank: Tensor, options: SceneOptions, with_windows: bool = False) -> Sample:
    """One batch of layered scenes. `bank` is [count,3,T,T] uint8 on the draw's device."""
    count = options.batch
    longest = math.exp(draw.scalar(math.log(options.blur_min_px), math.log(options.blur_max_px)))
    steps = options.steps or time_steps(longest, options.windows)
    blur = draw.uniform(0.4, 1.0, count) * longest
    time = torch.arange(-MARGIN, steps + MARGIN + 1, device=draw.device) / steps - 0.5
    layers = draw_layers(draw, bank, options, blur, time)
    make_colours(draw, layers, count)
    positions = pixel_grid(options, draw.device).unsqueeze(0)
    pictures = render(layers, positions)
    if draw.scalar() >= options.rectified:
        return finish(draw, pictures, pictures, None, MARGIN, options, with_windows)
    # A rectified recording: sensor pixels are offset from the picture's pixels by a smooth field.
    radius = max(options.height, options.width) / 2
    linear = draw.uniform(-0.6, 0.6, count, 2, 2) / radius
    displacement = (positions.unsqueeze(3) * linear.view(count, 1, 1, 2, 2)).sum(-1)
    displacement = displacement + draw.uniform(-0.5, 0.5, count, 1, 1, 2)
    return finish(draw, pictures, render(layers, positions + displacement), displacement, MARGIN, options, with_windows)


@torch.no_grad()
def generate_from_footage(draw: Draw, footage: Footage, options: SceneOptions, with_windows: bool = False) -> Sample:
    """One batch of films of 3-D scenes; a third of them shorter, thus with less blur."""
    whole = footage.longest() // options.windows * options.windows
    shorter = max(whole // 2 // options.windows, 1) * options.windows
    steps = shorter if draw.scalar() < 0.3 and not options.steps else whole
    margin = min(MARGIN, (footage.longest() - steps) // 2)
    pictures = footage.batch(draw, options.batch, steps + 2 * margin, options.height, options.width)
    flat = pictures.transpose(1, 2).flatten(2, 3)  # [N,3,S*H,W]
    flat = recolour(draw, flat)
    luma = torch.tensor(LUMA, device=draw.device).view(1, 3, 1, 1)
    gray = (flat * luma).sum(1, keepdim=True).expand_as(flat)
    flat = torch.where(draw.chance(0.25, options.batch, 1, 1, 1), gray, flat)
    pictures = flat.view(options.batch, 3, -1, options.height, options.width).transpose(1, 2)
    return finish(draw, pictures, pictures, None, margin, options, with_windows)


def validation_options(options: SceneOptions, strength: float) -> SceneOptions:
    """Options of four scenes at the size of a DAVIS346 frame after padding, at the middle."""
    noise = NoiseOptions(strength, strength)
    return replace(options, height=260, width=348, batch=4, steps=48, moments=1, middle=True, noise=noise)
