# SPDX-License-Identifier: Apache-2.0
"""Scores an exported EFNet beside EDI on an EvDeblur folder: exposures whose middle frame is also there, sharp, among the
test views or in sharp/ (jade_simulate).

Prints PSNR (of the global mean squared error) and SSIM (11x11 Gaussian window, sigma 1.5) of the blurry frame, EDI,
EFNet, their mean and their per-pixel oracle mix. With --footage, of an any-time EFNet, at the moments of these frames.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
import torch
from torch import Tensor

sys.path.insert(0, str(Path(__file__).resolve().parent))
import restoration  # noqa: E402


def splat_windows(events: dict[str, np.ndarray], start: int, end: int, windows: int, shape: tuple[int, int],
                  rise: float = 1.0, fall: float = 1.0) -> Tensor:
    """[1,windows,H,W]: weighted signed sums in equal half-open windows, bilinear, what falls outside is lost."""
    height, width = shape
    inside = slice(*np.searchsorted(events["t"], [start, end], side="left"))
    x, y, t, p = (events[k][inside] for k in "xytp")
    window = np.minimum((t - start) * windows // (end - start), windows - 1)
    value = np.where(p > 0, rise, -fall)
    x0, y0 = np.floor(x), np.floor(y)
    result = np.zeros(windows * height * width)
    for dx in (0, 1):
        for dy in (0, 1):
            xi, yi = (x0 + dx).astype(np.int64), (y0 + dy).astype(np.int64)
            weight = (1 - np.abs(x - xi)) * (1 - np.abs(y - yi))
            good = (xi >= 0) & (xi < width) & (yi >= 0) & (yi < height)
            index = (window[good] * height + yi[good]) * width + xi[good]
            np.add.at(result, index, value[good] * weight[good])
    return torch.from_numpy(result.reshape(1, windows, height, width)).float()


def picture(path: Path) -> Tensor:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise FileNotFoundError(f"{path}: expected a picture")
    return torch.from_numpy(image[:, :, ::-1].copy()).permute(2, 0, 1).unsqueeze(0).float() / 255


@torch.no_grad()
def restore_at(module: torch.jit.ScriptModule, blurry: Tensor, counts: Tensor, moment: float, multiple: int = 4) -> Tensor:
    """By a file of version 2."""
    height, width = blurry.shape[2:]
    pad = (0, -width % multiple, 0, -height % multiple)
    image = torch.nn.functional.pad(blurry, pad, mode="replicate")
    restored = module(image, torch.nn.functional.pad(counts, pad), torch.tensor([moment]))
    return restored[:, :, :height, :width].clamp(0, 1)


@torch.no_grad()
def restore(module: torch.jit.ScriptModule, blurry: Tensor, bins: Tensor, kind: str, multiple: int = 4) -> Tensor:
    events, mask = restoration.network_input(bins, kind)
    height, width = blurry.shape[2:]
    pad = (0, -width % multiple, 0, -height % multiple)
    image = torch.nn.functional.pad(blurry, pad, mode="replicate")
    events, mask = (torch.nn.functional.pad(x, pad) for x in (events, mask))
    return module(image, events, mask)[:, :, :height, :width].clamp(0, 1)


def ssim(a: Tensor, b: Tensor) -> float:
    """As in 3DGS: zero padding, biased moments, mean over pixels and channels."""
    line = torch.exp(-((torch.arange(11) - 5.0) ** 2) / (2 * 1.5**2))
    line = line / line.sum()
    window = (line.view(-1, 1) * line.view(1, -1)).expand(3, 1, 11, 11)
    blur = lambda x: torch.nn.functional.conv2d(x, window, padding=5, groups=3)  # noqa: E731
    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    return float(((2 * ma * mb + 1e-4) * (2 * vab + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4))).mean())


@dataclass
class Exposure:
    name: str
    blurry: Tensor  # [1,3,H,W]
    window: tuple[int, int]
    middle: int


class Recording:
    """An EvDeblur folder and a network."""

    def __init__(self, arguments: argparse.Namespace):
        metadata = {"jade_efnet.json": ""}
        self.module = torch.jit.load(str(arguments.model), map_location="cpu", _extra_files=metadata).float()
        self.about = json.loads(metadata["jade_efnet.json"])
        self.thresholds, self.images = arguments.thresholds, arguments.data / "images_1"
        self.times = {k: v for k, v in np.load(self.images / "timestamps.npz").items()}
        self.files = sorted(self.images.glob("*.png"))
        with h5py.File(arguments.data / "events.h5") as file:
            self.events = {k: file[k][:] for k in "xytp"}

    def exposures(self) -> list[Exposure]:
        start, middle, end = (self.times[k] for k in ("timestamps_start", "timestamps", "timestamps_end"))
        return [Exposure(self.files[i].name, picture(self.files[i]), (int(start[i]), int(end[i])), int(middle[i]))
                for i in range(len(self.files)) if end[i] > start[i]]

    def truths(self, folder: Path) -> dict[int, Path]:
        """By the time of the middle: sharp test views, and what the simulator keeps beside."""
        start, middle, end = (self.times[k] for k in ("timestamps_start", "timestamps", "timestamps_end"))
        found = {int(middle[i]): self.files[i] for i in range(len(self.files)) if end[i] <= start[i]}
        kept = {int(middle[i]): folder / "sharp" / self.files[i].name for i in range(len(self.files))}
        return found | {time: path for time, path in kept.items() if path.is_file()}

    def edi(self, exposure: Exposure, moment: float, windows: int = restoration.EDI_WINDOWS) -> Tensor:
        shape = tuple(exposure.blurry.shape[2:])
        maps = splat_windows(self.events, *exposure.window, windows, shape, *self.thresholds)
        return restoration.double_integral(exposure.blurry, maps, round(moment * windows)).clamp(0, 1)

    def efnet(self, exposure: Exposure, moment: float) -> Tensor:
        shape = tuple(exposure.blurry.shape[2:])
        counts = splat_windows(self.events, *exposure.window, self.about.get("windows", restoration.BINS), shape)
        if self.about["format_version"] > 1:
            return restore_at(self.module, exposure.blurry, counts, moment)
        if moment != 0.5:
            raise ValueError(f"a file of version 1 restores the middle only, not {moment}")
        return restore(self.module, exposure.blurry, counts, self.about["input"])


Scores = dict[str, dict[str, float]]


def means(rows: dict[str, list[tuple[float, float]]]) -> Scores:
    return {n: {"psnr": sum(v[0] for v in r) / len(r), "ssim": sum(v[1] for v in r) / len(r)} for n, r in rows.items()}


def score(image: Tensor, truth: Tensor) -> tuple[float, float]:
    return float(restoration.psnr(image, truth)), ssim(image, truth)


def save_sheet(folder: Path | None, name: str, images: list[Tensor]) -> None:
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    sheet = torch.cat(images, 3)[0].permute(1, 2, 0).flip(2) * 255
    cv2.imwrite(str(folder / name), sheet.round().byte().numpy())


def evaluate_middle(arguments: argparse.Namespace) -> Scores:
    recording = Recording(arguments)
    truths = recording.truths(arguments.data)
    rows: dict[str, list[tuple[float, float]]] = {}
    for exposure in recording.exposures():
        if exposure.middle not in truths:
            continue
        truth = picture(truths[exposure.middle])
        edi, efnet = recording.edi(exposure, 0.5), recording.efnet(exposure, 0.5)
        results = {"blurry": exposure.blurry, "edi": edi, "efnet": efnet, "mean": restoration.mean_mix(edi, efnet),
                   "oracle": restoration.oracle_mix(edi, efnet, truth)}
        for name, image in results.items():
            rows.setdefault(name, []).append(score(image, truth))
        save_sheet(arguments.pictures, exposure.name, [exposure.blurry, edi, efnet, truth])
    if not rows:
        raise FileNotFoundError(f"{arguments.data}: no exposure has a sharp frame at its middle")
    return means(rows)


def evaluate_footage(arguments: argparse.Namespace) -> Scores:
    """At the moments of frames [exposures,F,3,H,W] of the same exposures."""
    recording, footage = Recording(arguments), torch.from_numpy(np.load(arguments.footage))
    rows: dict[str, list[tuple[float, float]]] = {}
    last = footage.shape[1] - 1
    for exposure, film in zip(recording.exposures(), footage, strict=True):
        for i, frame in enumerate(film):
            truth = frame.unsqueeze(0).float() / 255
            edi, efnet = recording.edi(exposure, i / last, 8 * last), recording.efnet(exposure, i / last)
            for name, image in (("blurry", exposure.blurry), ("edi", edi), ("efnet", efnet)):
                rows.setdefault(f"{i}/{last} {name}", []).append(score(image, truth))
            save_sheet(arguments.pictures, f"{Path(exposure.name).stem}_{i}.png", [exposure.blurry, edi, efnet, truth])
    return means(rows)


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("model", type=Path, help="file made by export_efnet.py")
    p.add_argument("data", type=Path, help="folder in the EvDeblur layout")
    p.add_argument("--thresholds", type=float, nargs=2, default=(0.2, 0.2), metavar=("RISE", "FALL"))
    p.add_argument("--footage", type=Path, help="footage.npy that jade_simulate --footage N made with the same settings")
    p.add_argument("--pictures", type=Path, help="folder for blurry | EDI | EFNet | truth")
    arguments = p.parse_args()
    try:
        table = evaluate_footage(arguments) if arguments.footage else evaluate_middle(arguments)
    except (FileNotFoundError, RuntimeError, ValueError, KeyError) as error:
        print(f"evaluate_efnet: {str(error).splitlines()[0]}", file=sys.stderr)
        return 3
    for name, row in table.items():
        print(f"{name:11s} PSNR {row['psnr']:6.2f} dB  SSIM {row['ssim']:.4f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
