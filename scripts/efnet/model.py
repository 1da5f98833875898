# SPDX-License-Identifier: Apache-2.0
"""EFNet (Sun et al., ECCV 2022), written from its specification.

State-dict keys and shapes equal those of the official checkpoints (183 tensors; 8,466,445 parameters at width 64), so an
official file loads here and a file trained here loads there. Sizes are generic: height and width divisible by 4.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

HEADS = (1, 2, 4)
SLOPE = 0.2
PADDING_MULTIPLE = 4


def conv3(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)


def downsampler(channels: int) -> nn.Conv2d:
    return nn.Conv2d(channels, channels, 4, stride=2, padding=1, bias=False)


class ConvBlock(nn.Module):
    """Two 3x3 convolutions with LeakyReLU after both, plus a 1x1 shortcut; no activation after the sum."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.identity = nn.Conv2d(inputs, outputs, 1)
        self.conv_1 = conv3(inputs, outputs)
        self.conv_2 = conv3(outputs, outputs)

    def block(self, x: Tensor) -> Tensor:
        y = F.leaky_relu(self.conv_1(x), SLOPE)
        return F.leaky_relu(self.conv_2(y), SLOPE) + self.identity(x)

    def forward(self, x: Tensor) -> Tensor:
        return self.block(x)


def channel_norm(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """LayerNorm over the channels of each pixel of an [N,C,H,W] tensor (biased variance, eps 1e-5)."""
    return F.layer_norm(x.permute(0, 2, 3, 1), weight.shape, weight, bias, 1e-5).permute(0, 3, 1, 2)


class NormBody(nn.Module):
    def __init__(self, channels: int):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        return channel_norm(x, self.weight, self.bias)


class ChannelNorm(nn.Module):
    def __init__(self, channels: int):
        super().__init__()
        self.body = NormBody(channels)

    def forward(self, x: Tensor) -> Tensor:
        return self.body(x)


class ChannelAttention(nn.Module):
    """Attention between channels: image queries, event keys and values; its cost is linear in the pixels."""

    def __init__(self, channels: int, heads: int):
        super().__init__()
        self.heads = heads
        self.temperature = nn.Parameter(torch.ones(heads, 1, 1))
        self.q = nn.Conv2d(channels, channels, 1, bias=False)
        self.k = nn.Conv2d(channels, channels, 1, bias=False)
        self.v = nn.Conv2d(channels, channels, 1, bias=False)
        self.project_out = nn.Conv2d(channels, channels, 1, bias=False)

    def forward(self, image: Tensor, event: Tensor) -> Tensor:
        q = self.q(image).unflatten(1, (self.heads, -1)).flatten(3)
        k = self.k(event).unflatten(1, (self.heads, -1)).flatten(3)
        v = self.v(event).unflatten(1, (self.heads, -1)).flatten(3)
        weights = (F.normalize(q, dim=-1) @ F.normalize(k, dim=-1).transpose(-2, -1)) * self.temperature
        mixed = weights.softmax(-1).to(v.dtype) @ v
        return self.project_out(mixed.flatten(1, 2).view_as(image))


class FeedForward(nn.Module):
    def __init__(self, channels: int):
        super().__init__()
        self.fc1 = nn.Linear(channels, 4 * channels)
        self.fc2 = nn.Linear(4 * channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        return self.fc2(F.gelu(self.fc1(x)))


class EventImageTransformer(nn.Module):
    """EICA: adds the event feature of the same level to the image feature by attention, then a per-pixel MLP."""

    def __init__(self, channels: int, heads: int):
        super().__init__()
        self.norm1_image = ChannelNorm(channels)
        self.norm1_event = ChannelNorm(channels)
        self.attn = ChannelAttention(channels, heads)
        self.norm2 = nn.LayerNorm(channels)
        self.ffn = FeedForward(channels)

    def forward(self, image: Tensor, event: Tensor) -> Tensor:
        fused = image + self.attn(self.norm1_image(image), self.norm1_event(event))
        pixels = fused.permute(0, 2, 3, 1)
        pixels = pixels + self.ffn(self.norm2(pixels))
        return pixels.permute(0, 3, 1, 2)


class EventLevel(ConvBlock):
    """Event encoder level: the merge convolution feeds the image branch; the event path continues without it."""

    def __init__(self, inputs: int, outputs: int, last: bool):
        super().__init__(inputs, outputs)
        self.conv_before_merge = nn.Conv2d(outputs, outputs, 1)
        self.downsample = None if last else downsampler(outputs)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        y = self.block(x)
        merged = self.conv_before_merge(y)
        return merged, merged if self.downsample is None else self.downsample(y)


class FusionLevel(ConvBlock):
    """Stage 1 encoder level: block, fusion with the events, then down."""

    def __init__(self, inputs: int, outputs: int, heads: int, last: bool):
        super().__init__(inputs, outputs)
        self.downsample = None if last else downsampler(outputs)
        self.image_event_transformer = EventImageTransformer(outputs, heads)

    def forward(self, x: Tensor, event: Tensor) -> tuple[Tensor, Tensor]:
        y = self.image_event_transformer(self.block(x), event)
        return y, y if self.downsample is None else self.downsample(y)


class GatedLevel(ConvBlock):
    """Stage 2 encoder level: with a mask, adds stage 1 features, gated by the presence of events (EMGC)."""

    def __init__(self, inputs: int, outputs: int, last: bool):
        super().__init__(inputs, outputs)
        self.downsample = None if last else downsampler(outputs)
        if not last:
            self.emgc_enc = conv3(outputs, outputs)
            self.emgc_dec = conv3(outputs, outputs)
            self.emgc_enc_mask = conv3(outputs, outputs)
            self.emgc_dec_mask = conv3(outputs, outputs)

    def forward(
        self, x: Tensor, encoded: Tensor | None, decoded: Tensor | None, mask: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        y = self.block(x)
        if self.downsample is None:
            return y, y
        if mask is not None:
            y = y + self.emgc_enc(encoded) + self.emgc_enc_mask((1 - mask) * encoded)
            y = y + self.emgc_dec(decoded) + self.emgc_dec_mask(mask * decoded)
        return y, self.downsample(y)


class UpLevel(nn.Module):
    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.up = nn.ConvTranspose2d(inputs, outputs, 2, stride=2)
        self.conv_block = ConvBlock(inputs, outputs)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        return self.conv_block(torch.cat([self.up(x), skip], 1))


def output_channels(candidates: int) -> int:
    """Number of output channels: a colour and, with candidates, the weights of the mix to which it is added."""
    return 3 + candidates + 1 if candidates > 0 else 3


def add_to_mix(output: Tensor, pictures: Tensor, candidates: int) -> Tensor:
    """A colour plus the blurry frame, or plus a mix of it and the candidates with per-pixel weights.

    output [N,output_channels,H,W]; pictures [N,3+3C,H,W], the blurry frame first.
    """
    if candidates == 0:
        return output + pictures
    weights = output[:, 3:].softmax(1)
    return output[:, :3] + (weights.unsqueeze(2) * pictures.unflatten(1, (-1, 3))).sum(1)


class SupervisedAttention(nn.Module):
    """SAM: computes the stage 1 restoration and gates with it the feature for stage 2."""

    def __init__(self, channels: int, candidates: int = 0):
        super().__init__()
        self.candidates = candidates
        self.conv1 = conv3(channels, channels)
        self.conv2 = conv3(channels, output_channels(candidates))
        self.conv3 = conv3(3, channels)

    def forward(self, x: Tensor, pictures: Tensor) -> tuple[Tensor, Tensor]:
        restored = add_to_mix(self.conv2(x), pictures, self.candidates)
        return self.conv1(x) * torch.sigmoid(self.conv3(restored)) + x, restored


class EFNet(nn.Module):
    """(blurry [N,3,H,W], events [N,C,H,W], mask [N,1,H,W] or None) -> [stage 1, stage 2]; the second is the result.

    The published network has six event channels and no candidates. The any-time variant gets further pictures
    [N,3C,H,W], which are inputs of the first stage and candidates of both stages' mixes.
    """

    def __init__(self, width: int = 64, event_channels: int = 6, candidates: int = 0):
        super().__init__()
        w = width
        widths = (w, 2 * w, 4 * w)
        inputs = (w, w, 2 * w)
        self.width = width
        self.candidates = candidates
        self.conv_01 = conv3(3 + 3 * candidates, w)
        self.conv_02 = conv3(3, w)
        self.conv_ev1 = conv3(event_channels, w)
        levels = [(inputs[i], widths[i], i == 2) for i in range(3)]
        self.down_path_1 = nn.ModuleList(FusionLevel(p, c, HEADS[i], end) for i, (p, c, end) in enumerate(levels))
        self.down_path_2 = nn.ModuleList(GatedLevel(p, c, end) for p, c, end in levels)
        self.down_path_ev = nn.ModuleList(EventLevel(p, c, end) for p, c, end in levels)
        self.up_path_1 = nn.ModuleList([UpLevel(4 * w, 2 * w), UpLevel(2 * w, w)])
        self.up_path_2 = nn.ModuleList([UpLevel(4 * w, 2 * w), UpLevel(2 * w, w)])
        self.skip_conv_1 = nn.ModuleList([conv3(2 * w, 2 * w), conv3(w, w)])
        self.skip_conv_2 = nn.ModuleList([conv3(2 * w, 2 * w), conv3(w, w)])
        self.sam12 = SupervisedAttention(w, candidates)
        self.cat12 = nn.Conv2d(2 * w, w, 1)
        self.last = conv3(w, output_channels(candidates))

    def encode_events(self, events: Tensor) -> list[Tensor]:
        merged, x = [], self.conv_ev1(events)
        for level in self.down_path_ev:
            feature, x = level(x)
            merged.append(feature)
        return merged

    def stage_1(self, seen: Tensor, events: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        encoded, x = [], self.conv_01(seen)
        for level, event in zip(self.down_path_1, self.encode_events(events)):
            feature, x = level(x, event)
            encoded.append(feature)
        half = self.up_path_1[0](x, self.skip_conv_1[0](encoded[1]))
        full = self.up_path_1[1](half, self.skip_conv_1[1](encoded[0]))
        return encoded, [full, half]

    def forward(
        self, blurry: Tensor, events: Tensor, mask: Tensor | None = None, candidates: Tensor | None = None
    ) -> list[Tensor]:
        pictures = blurry if candidates is None else torch.cat([blurry, candidates], 1)
        encoded, decoded = self.stage_1(pictures, events)
        feature, first = self.sam12(decoded[0], pictures)
        masks = [None, None] if mask is None else [mask, F.interpolate(mask, scale_factor=0.5, mode="nearest")]
        x = self.cat12(torch.cat([self.conv_02(blurry), feature], 1))
        own: list[Tensor] = []
        for i, level in enumerate(self.down_path_2):
            gate = (encoded[i], decoded[i], masks[i]) if i < 2 else (None, None, None)
            y, x = level(x, *gate)
            own.append(y)
        x = self.up_path_2[0](x, self.skip_conv_2[0](own[1]))
        x = self.up_path_2[1](x, self.skip_conv_2[1](own[0]))
        return [first, add_to_mix(self.last(x), pictures, self.candidates)]


def parameter_count(model: nn.Module) -> int:
    return sum(p.numel() for p in model.parameters())
