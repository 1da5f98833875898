# SPDX-License-Identifier: Apache-2.0
"""Scores an exported EFNet beside EDI on an EvDeblur folder: exposures whose middle frame is also there, sharp, among the
test views or in sharp/ (jade_simulate).

Prints PSNR (of the global mean squared error) and SSIM (11x11 Gaussian window, sigma 1.5) of the blurry frame, EDI,
EFNet, their mean and their per-pixel oracle mix.
"""

from __future__ import annotations

import argparse
import json
import sys
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


def evaluate(arguments: argparse.Namespace) -> dict[str, dict[str, float]]:
    metadata = {"jade_efnet.json": ""}
    module = torch.jit.load(str(arguments.model), map_location="cpu", _extra_files=metadata).float()
    about = json.loads(metadata["jade_efnet.json"])
    images = arguments.data / "images_1"
    times = np.load(images / "timestamps.npz")
    start, middle, end = times["timestamps_start"], times["timestamps"], times["timestamps_end"]
    with h5py.File(arguments.data / "events.h5") as file:
        events = {k: file[k][:] for k in "xytp"}
    files = sorted(images.glob("*.png"))
    truths = {int(middle[i]): files[i] for i in range(len(files)) if end[i] <= start[i]}
    truths |= {int(middle[i]): arguments.data / "sharp" / files[i].name for i in range(len(files))
               if (arguments.data / "sharp" / files[i].name).is_file()}
    rows: dict[str, list[tuple[float, float]]] = {}
    for i in (i for i in range(len(files)) if end[i] > start[i] and int(middle[i]) in truths):
        blurry, truth = picture(files[i]), picture(truths[int(middle[i])])
        window = int(start[i]), int(end[i])
        shape = tuple(blurry.shape[2:])
        maps = splat_windows(events, *window, restoration.EDI_WINDOWS, shape, *arguments.thresholds)
        edi = restoration.double_integral(blurry, maps).clamp(0, 1)
        number = about.get("windows", restoration.BINS)
        counts = splat_windows(events, *window, number, shape)
        at_any_time = about["format_version"] > 1
        efnet = restore_at(module, blurry, counts, 0.5) if at_any_time else restore(module, blurry, counts, about["input"])
        results = {"blurry": blurry, "edi": edi, "efnet": efnet, "mean": restoration.mean_mix(edi, efnet),
                   "oracle": restoration.oracle_mix(edi, efnet, truth)}
        for name, image in results.items():
            rows.setdefault(name, []).append((float(restoration.psnr(image, truth)), ssim(image, truth)))
        if arguments.pictures:
            sheet = torch.cat([blurry, edi, efnet, truth], 3)[0].permute(1, 2, 0).flip(2) * 255
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(arguments.pictures / f"{files[i].stem}.png"), sheet.round().byte().numpy())
    if not rows:
        raise FileNotFoundError(f"{images}: no exposure has a sharp frame at its middle")
    count = len(rows["blurry"])
    return {n: {"psnr": sum(v[0] for v in r) / count, "ssim": sum(v[1] for v in r) / count} for n, r in rows.items()}


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("model", type=Path, help="file made by export_efnet.py")
    p.add_argument("data", type=Path, help="folder in the EvDeblur layout")
    p.add_argument("--thresholds", type=float, nargs=2, default=(0.2, 0.2), metavar=("RISE", "FALL"))
    p.add_argument("--pictures", type=Path, help="folder for blurry | EDI | EFNet | truth")
    arguments = p.parse_args()
    try:
        table = evaluate(arguments)
    except (FileNotFoundError, RuntimeError, ValueError, KeyError) as error:
        print(f"evaluate_efnet: {str(error).splitlines()[0]}", file=sys.stderr)
        return 3
    for name, row in table.items():
        print(f"{name:8s} PSNR {row['psnr']:6.2f} dB  SSIM {row['ssim']:.4f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
