#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares PSNR and SSIM of jade_eval with scikit-image on random and real pictures.

    pip install scikit-image        # in an environment of its own
    python scripts/check_metrics.py [--bin build/bin]

scikit-image mirrors pictures at their border, whereas jade_eval, like the published tables, pads with zeros; so
scikit-image gets pictures with a margin of zeros, and its map of SSIM is averaged without the margin.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from skimage import data, io, metrics, transform

MARGIN = 16
TOLERANCE = {"psnr": 1e-3, "psnr_channel_mean": 1e-3, "ssim": 1e-5}


def ssim(image: np.ndarray, truth: np.ndarray) -> float:
    margin = ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0))
    _, values = metrics.structural_similarity(
        np.pad(image, margin), np.pad(truth, margin), data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5,
        use_sample_covariance=False, full=True)
    return float(values[MARGIN:-MARGIN, MARGIN:-MARGIN].mean())


def expected(image: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    channels = [metrics.peak_signal_noise_ratio(truth[..., c], image[..., c], data_range=1.0) for c in range(3)]
    return {"psnr": float(metrics.peak_signal_noise_ratio(truth, image, data_range=1.0)),
            "psnr_channel_mean": float(np.mean(channels)), "ssim": ssim(image, truth)}


def pairs() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    random = np.random.default_rng(0)
    made = {}
    for i, (height, width) in enumerate([(64, 80), (31, 47), (11, 200)]):
        truth = random.random((height, width, 3))
        made[f"random_{i}"] = (np.clip(truth + 0.1 * i * random.standard_normal(truth.shape) + 0.01, 0, 1), truth)
    for name in ("astronaut", "coffee", "rocket"):
        truth = transform.resize(getattr(data, name)()[..., :3], (260, 346), anti_aliasing=True)
        made[name + "_noise"] = (np.clip(truth + 0.05 * random.standard_normal(truth.shape), 0, 1), truth)
        made[name + "_blur"] = ((truth + np.roll(truth, 4, 1) + np.roll(truth, -4, 1)) / 3, truth)
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bin", type=Path, default=Path(__file__).resolve().parents[1] / "build" / "bin")
    program = parser.parse_args().bin / "jade_eval"
    wanted = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, images in pairs().items():
            eight_bit = [np.round(255 * image).astype(np.uint8) for image in images]
            for kind, image in zip(("renders", "truth"), eight_bit):
                path = Path(folder) / kind / f"{name}.png"
                path.parent.mkdir(exist_ok=True)
                io.imsave(path, image, check_contrast=False)
            wanted[name] = expected(*(image / 255.0 for image in eight_bit))
        command = [program, "--renders", f"{folder}/renders", "--truth", f"{folder}/truth", "--json", "--device", "cpu"]
        views = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["views"]
    worst = dict.fromkeys(TOLERANCE, 0.0)
    for view in views:
        for metric in TOLERANCE:
            worst[metric] = max(worst[metric], abs(view[metric] - wanted[view["name"]][metric]))
    print(f"{len(views)} pairs; largest differences: " + ", ".join(f"{k} {v:.1e}" for k, v in worst.items()))
    return int(any(worst[metric] > limit for metric, limit in TOLERANCE.items()))


if __name__ == "__main__":
    sys.exit(main())
