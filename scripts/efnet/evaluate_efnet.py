# SPDX-License-Identifier: Apache-2.0
"""Scores an exported EFNet beside EDI on an EvDeblur folder: exposures with a sharp middle frame among the test
views or in sharp/ (jade_simulate).

Prints PSNR (of the global mean squared error) and SSIM (11x11 Gaussian window, sigma 1.5) of the blurry frame,
EDI, EFNet, their mean and their per-pixel oracle mix. With --footage, for an any-time EFNet, at the moments of
these frames.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path

try:
    import cv2
    import h5py  # noqa: F401, for recording.py
    import numpy as np
    import torch
    from torch import Tensor
except ImportError as error:
    print(f"evaluate_efnet: {error}; run scripts/setup.sh --python-torch once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

sys.path.insert(0, str(Path(__file__).resolve().parent))
import restoration  # noqa: E402
from export_efnet import METADATA_NAME, DataError  # noqa: E402
from footage import read_films  # noqa: E402
from recording import Frame, find_events, picture, read_events, read_frames  # noqa: E402


def splat_windows(events: dict[str, np.ndarray], start: int, end: int, windows: int, shape: tuple[int, int],
                  rise: float = 1.0, fall: float = 1.0) -> Tensor:
    """[1,windows,H,W]: weighted signed sums in equal half-open windows, bilinear; events outside are dropped."""
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


@torch.no_grad()
def restore_at(module: torch.jit.ScriptModule, blurry: Tensor, counts: Tensor, moment: float, multiple: int = 4) -> Tensor:
    """Restores with a file of version 2."""
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
    """SSIM as in 3DGS: zero padding, biased moments, mean over pixels and channels."""
    line = torch.exp(-((torch.arange(11) - 5.0) ** 2) / (2 * 1.5**2))
    line = line / line.sum()
    window = (line.view(-1, 1) * line.view(1, -1)).expand(3, 1, 11, 11)
    blur = lambda x: torch.nn.functional.conv2d(x, window, padding=5, groups=3)  # noqa: E731
    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    return float(((2 * ma * mb + 1e-4) * (2 * vab + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4))).mean())


def load_network(path: Path) -> tuple[torch.jit.ScriptModule, dict]:
    """The module and its metadata."""
    metadata = {METADATA_NAME: ""}
    try:
        module = torch.jit.load(str(path), map_location="cpu", _extra_files=metadata).float()
        about = json.loads(metadata[METADATA_NAME])
    except (RuntimeError, ValueError):
        found = "another or a damaged one" if path.is_file() else "none"
        raise DataError(f"{path}: expected a file made by export_efnet.py, found {found}") from None
    if about.get("kind") != "efnet":
        raise DataError(f"{path}: expected an EFNet, found a restorer of kind '{about.get('kind')}', which takes no events")
    return module, about


@dataclass
class Exposure:
    name: str
    blurry: Tensor  # [1,3,H,W]
    window: tuple[int, int]
    middle: int


class Recording:
    """An EvDeblur folder and a network."""

    def __init__(self, arguments: argparse.Namespace):
        self.module, self.about = load_network(arguments.model)
        self.root, self.thresholds = arguments.data, arguments.thresholds
        self.frames = read_frames(arguments.data, arguments.time_unit)
        blurred = self.blurred()
        if not blurred:
            raise DataError(f"{arguments.data}: expected frames whose timestamps_end is after timestamps_start, found none")
        self.events = read_events(find_events(arguments.data), arguments.events_unit, blurred[0].start, max(f.end for f in blurred))

    def blurred(self) -> list[Frame]:
        return sorted((frame for frame in self.frames if frame.end > frame.start), key=lambda frame: frame.start)

    def exposures(self) -> list[Exposure]:
        found = [Exposure(f.path.name, picture(f.path), (f.start, f.end), f.middle) for f in self.blurred()]
        for exposure in found:
            if exposure.blurry.shape != found[0].blurry.shape:
                raise DataError(f"{self.root}: expected frames of one size, found {size_of(found[0].blurry)} ({found[0].name}) and "
                                f"{size_of(exposure.blurry)} ({exposure.name})")
        return found

    def truth(self, exposure: Exposure) -> Tensor | None:
        """The simulator's sharp image, else a sharp test view at the middle. Times in ns or s are rounded to us."""
        stem = Path(exposure.name).stem
        kept = [self.root / "sharp" / (stem + kind) for kind in (".png", ".tiff", ".npy")]
        views = [f.path for f in self.frames if f.end == f.start and abs(f.start - exposure.middle) <= 1]
        path = next((path for path in kept + views if path.is_file()), None)
        if path is None:
            return None
        return fitting(picture(path), exposure, path)

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
            raise DataError(f"a file of version 1 restores the middle only, not {moment}; leave out --footage")
        return restore(self.module, exposure.blurry, counts, self.about["input"])


Scores = dict[str, dict[str, float]]


def size_of(image: Tensor) -> str:
    return f"{image.shape[3]}x{image.shape[2]}"


def fitting(truth: Tensor, exposure: Exposure, path: Path) -> Tensor:
    if truth.shape != exposure.blurry.shape:
        raise DataError(f"{path}: expected {size_of(exposure.blurry)} pixels as the blurry frame {exposure.name}, found {size_of(truth)}")
    return truth


def means(rows: dict[str, list[tuple[float, float]]]) -> Scores:
    return {n: {"psnr": sum(v[0] for v in r) / len(r), "ssim": sum(v[1] for v in r) / len(r)} for n, r in rows.items()}


def score(image: Tensor, truth: Tensor) -> tuple[float, float]:
    return float(restoration.psnr(image, truth)), ssim(image, truth)


def save_sheet(folder: Path | None, name: str, images: list[Tensor]) -> None:
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    sheet = torch.cat(images, 3)[0].permute(1, 2, 0).flip(2) * 255
    if not cv2.imwrite(str(folder / name), sheet.clamp(0, 255).round().byte().numpy()):
        raise DataError(f"{folder / name}: cannot be written; check the free space and the rights of the folder")


def evaluate_middle(arguments: argparse.Namespace) -> Scores:
    recording = Recording(arguments)
    rows: dict[str, list[tuple[float, float]]] = {}
    for exposure in recording.exposures():
        truth = recording.truth(exposure)
        if truth is None:
            continue
        edi, efnet = recording.edi(exposure, 0.5), recording.efnet(exposure, 0.5)
        results = {"blurry": exposure.blurry, "edi": edi, "efnet": efnet, "mean": restoration.mean_mix(edi, efnet),
                   "oracle": restoration.oracle_mix(edi, efnet, truth)}
        for name, image in results.items():
            rows.setdefault(name, []).append(score(image, truth))
        save_sheet(arguments.pictures, exposure.name, [exposure.blurry, edi, efnet, truth])
    if not rows:
        raise DataError(f"{arguments.data}: expected a sharp frame at the middle of an exposure, among the test views or in sharp/, "
                        "found none")
    return means(rows)


def evaluate_footage(arguments: argparse.Namespace) -> Scores:
    """Evaluates at the moments of frames [exposures,F,3,H,W] of the same exposures."""
    recording, footage = Recording(arguments), torch.from_numpy(read_films(arguments.footage))
    exposures = recording.exposures()
    if len(footage) != len(exposures) or footage.shape[1] < 2:
        raise DataError(f"{arguments.footage}: expected at least two frames of each of {len(exposures)} exposures, found {footage.shape[1]} "
                        f"of {len(footage)}; make it with jade_simulate --footage and the settings of {arguments.data}")
    rows: dict[str, list[tuple[float, float]]] = {}
    last = footage.shape[1] - 1
    for exposure, film in zip(exposures, footage):
        for i, frame in enumerate(film):
            truth = fitting(frame.unsqueeze(0).float() / 255, exposure, arguments.footage)
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
    units = ("auto", "us", "ns", "s")
    p.add_argument("--time-unit", choices=units, default="auto", help="of the frames' times")
    p.add_argument("--events-unit", choices=units, default="auto", help="of the events' times")
    arguments = p.parse_args()
    if not all(0 < threshold < 100 for threshold in arguments.thresholds):
        p.error(f"--thresholds: expected two numbers above 0, found {' '.join(map(str, arguments.thresholds))}")
    try:
        table = evaluate_footage(arguments) if arguments.footage else evaluate_middle(arguments)
    except KeyboardInterrupt:
        print("evaluate_efnet: interrupted", file=sys.stderr)
        return 130
    except (DataError, OSError) as error:
        print(f"evaluate_efnet: {error}", file=sys.stderr)
        return 3
    for name, row in table.items():
        print(f"{name:11s} PSNR {row['psnr']:6.2f} dB  SSIM {row['ssim']:.4f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
