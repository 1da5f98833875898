# SPDX-License-Identifier: Apache-2.0
"""Sharp films of real 3-D scenes, as `jade_simulate --footage` writes them, for training and validation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from draw import Draw
from export_efnet import DataError

MARGIN = 2  # time steps simulated before and after an exposure, for events of another clock


def read_films(path: Path) -> np.ndarray:
    """[exposures,frames,3,H,W] uint8."""
    try:
        films = np.load(path)
    except (OSError, EOFError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as .npy, it is damaged or was cut short; make it again "
                        "(jade_simulate --footage)") from error
    if not isinstance(films, np.ndarray) or films.ndim != 5 or films.shape[2] != 3 or films.dtype != np.uint8:
        found = f"{films.dtype} {list(films.shape)}" if isinstance(films, np.ndarray) else "an archive"
        raise DataError(f"{path}: expected uint8 [exposures,frames,3,H,W], found {found}; make it with jade_simulate --footage")
    return films


class Footage:
    """All footage.npy below a folder: [exposures,frames,3,H,W] uint8 each, with the same number of frames. Files may
    appear during training.

    smallest: height and width of the pieces that batch() returns; fewest: their number of time steps.
    """

    def __init__(self, folder: Path, device: torch.device, smallest: tuple[int, int] = (1, 1), fewest: int = 1, most: int = 100_000):
        self.folder, self.device, self.most = folder, device, most
        self.smallest, self.fewest = smallest, fewest
        self.known: set[Path] = set()
        self.films: list[Tensor] = []
        self.problems: list[str] = []  # of the files that the last refresh() skipped
        self.refresh()

    def __len__(self) -> int:
        return len(self.films)

    def refresh(self) -> None:
        """Reads new files. Unusable ones are skipped until the next call: they may still be copied from another
        machine.
        """
        self.problems = []
        for path in sorted(self.folder.rglob("footage.npy")):
            if path in self.known or len(self.films) >= self.most:
                continue
            try:
                films = self.read(path)
            except DataError as error:
                self.problems.append(str(error))
                continue
            self.known.add(path)
            self.films.extend(torch.from_numpy(films).to(self.device))

    def read(self, path: Path) -> np.ndarray:
        films = read_films(path)
        frames, height, width = films.shape[1], *films.shape[3:]
        if frames <= self.fewest:
            raise DataError(f"{path}: expected films of at least {self.fewest + 1} frames, found {frames}; "
                            f"make it with jade_simulate --footage {2 * (self.fewest + MARGIN) + 1}")
        if height < self.smallest[0] or width < self.smallest[1]:
            raise DataError(f"{path}: expected frames of at least {self.smallest[1]}x{self.smallest[0]} pixels, "
                            f"found {width}x{height}; make larger ones or choose a smaller --crop")
        if self.films and frames != self.longest() + 1:
            raise DataError(f"{path}: expected films of {self.longest() + 1} frames, as the others below {self.folder}, found {frames}; "
                            "make all of them with one number of frames")
        return films

    def longest(self) -> int:
        """Steps between the frames of a film."""
        return self.films[0].shape[0] - 1

    def batch(self, draw: Draw, count: int, steps: int, height: int, width: int) -> Tensor:
        """[count,steps+1,3,height,width] in [0,1]: pieces of films in time and space, rotated, mirrored, forwards or
        backwards.
        """
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
