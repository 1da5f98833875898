# SPDX-License-Identifier: Apache-2.0
"""Adds no-reference quality metrics of a run's renders to its eval.json, under the key "perceptual".

MUSIQ, CLIP-IQA and NIQE come from pyiqa, BRISQUE from the package `brisque`; the first two download 104 and 244
MB of weights on first use. For an unavailable metric the reason is written, and the others still run.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable
from pathlib import Path

try:
    import cv2
    import numpy as np
except ImportError as error:
    print(f"evaluate_perceptual: {error}; in an environment of its own run pip install -r scripts/requirements-perceptual.txt",
          file=sys.stderr)
    sys.exit(2)

METRICS = {
    "musiq": "MUSIQ (pyiqa, KonIQ-10k weights), RGB in [0,1], higher is better",
    "clipiqa": "CLIP-IQA (pyiqa, RN50, five prompt pairs), RGB in [0,1], higher is better",
    "niqe": "NIQE (pyiqa), lower is better",
    "brisque": "BRISQUE (package brisque), 8-bit RGB, lower is better",
}
SUFFIXES = {".png", ".jpg", ".jpeg"}


class DataError(Exception):
    """The input cannot be scored; a one-line reason."""


def brisque_metric() -> Callable[[np.ndarray], float]:
    # The package still imports a module path that newer SciPy dropped.
    import scipy.ndimage

    sys.modules.setdefault("scipy.ndimage.filters", scipy.ndimage)
    from brisque import BRISQUE

    scorer = BRISQUE(url=False)
    return lambda image: float(scorer.score(image))


def pyiqa_metric(name: str, device: str) -> Callable[[np.ndarray], float]:
    import pyiqa
    import torch

    metric = pyiqa.create_metric(name, device=device)

    def score(image: np.ndarray) -> float:
        tensor = torch.from_numpy(image).permute(2, 0, 1).unsqueeze(0).float() / 255
        with torch.no_grad():
            return float(metric(tensor.to(device)))

    return score


def pictures(folder: Path) -> dict[str, np.ndarray]:
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES) if folder.is_dir() else []
    if not files:
        raise DataError(f"{folder}: expected rendered pictures, found none")
    images = {p.stem: cv2.imread(str(p), cv2.IMREAD_COLOR) for p in files}
    broken = [name for name, image in images.items() if image is None]
    if broken:
        raise DataError(f"{folder}/{broken[0]}: expected a picture")
    return {name: np.ascontiguousarray(image[:, :, ::-1]) for name, image in images.items()}


def score_all(images: dict[str, np.ndarray], name: str, device: str) -> dict[str, object]:
    result: dict[str, object] = {"definition": METRICS[name]}
    try:
        with contextlib.redirect_stdout(sys.stderr):
            metric = brisque_metric() if name == "brisque" else pyiqa_metric(name, device)
            views = {view: metric(image) for view, image in images.items()}
        broken = [view for view, value in views.items() if not np.isfinite(value)]
        if broken:
            raise ValueError(f"not a number on {broken[0]}")
    except Exception as error:  # a missing package, weights that cannot be fetched, a picture too small
        reason = (str(error).strip().splitlines() or [""])[0][:200]
        return result | {"available": False, "reason": f"{type(error).__name__}: {reason}"}
    return result | {"available": True, "mean": float(np.mean(list(views.values()))), "views": views}


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("eval_json", type=Path, help="eval.json of a run (made when missing)")
    p.add_argument("renders", type=Path, help="folder of the rendered test views")
    p.add_argument("--metrics", nargs="+", choices=tuple(METRICS), default=list(METRICS))
    p.add_argument("--device", default="cpu")
    arguments = p.parse_args()
    try:
        content = json.loads(arguments.eval_json.read_text()) if arguments.eval_json.exists() else {}
        if not isinstance(content, dict):
            raise DataError(f"{arguments.eval_json}: expected a JSON object")
        images = pictures(arguments.renders)
        rows = content.setdefault("perceptual", {})
        for name in arguments.metrics:
            rows[name] = score_all(images, name, arguments.device)
            shown = f"{rows[name]['mean']:.4f}" if rows[name]["available"] else f"not available: {rows[name]['reason']}"
            print(f"{name:8s} {shown}")
        temporary = arguments.eval_json.with_suffix(".json.tmp")
        temporary.write_text(json.dumps(content, indent=1) + "\n")
        temporary.replace(arguments.eval_json)
    except (DataError, OSError, json.JSONDecodeError) as error:
        print(f"evaluate_perceptual: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
