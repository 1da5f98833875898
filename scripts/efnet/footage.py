# SPDX-License-Identifier: Apache-2.0
"""Sharp films of real 3-D scenes, as `jade_simulate --footage` writes them, for training and validation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from draw import Draw


class Footage:
    """All footage.npy below a folder: [exposures,frames,3,H,W] uint8 each. More may appear while training goes on."""

    def __init__(self, folder: Path, device: torch.device, most: int = 100_000):
        self.folder, self.device, self.most = folder, device, most
        self.known: set[Path] = set()
        self.films: list[Tensor] = []
        self.refresh()

    def __len__(self) -> int:
        return len(self.films)

    def refresh(self) -> None:
        for path in sorted(self.folder.rglob("footage.npy")):
            if path in self.known or len(self.films) >= self.most:
                continue
            self.known.add(path)
            self.films.extend(torch.from_numpy(np.load(path)).to(self.device))

    def longest(self) -> int:
        """Steps between the frames of a film."""
        return self.films[0].shape[0] - 1

    def batch(self, draw: Draw, count: int, steps: int, height: int, width: int) -> Tensor:
        """[count,steps+1,3,height,width] in [0,1]: pieces of films in time and space, turned, mirrored, forwards or backwards."""
        pieces = []
        for _ in range(count):
            film = self.films[draw.below(len(self.films))]
            begin = draw.below(film.shape[0] - steps)
            piece = film[begin : begin + steps + 1]
            turned = draw.below(2) == 1 and piece.shape[-1] >= height and piece.shape[-2] >= width
            if turned:
                piece = piece.transpose(-1, -2)
            y, x = draw.below(piece.shape[-2] - height + 1), draw.below(piece.shape[-1] - width + 1)
            piece = piece[:, :, y : y + height, x : x + width]
            flips = [axis for axis in (0, 2, 3) if draw.below(2) == 1]
            pieces.append(piece.flip(flips) if flips else piece)
        return torch.stack(pieces).float() / 255
