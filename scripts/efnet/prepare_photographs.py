# SPDX-License-Identifier: Apache-2.0
"""Cuts square training pictures from unpacked photograph packages (docs/engineering/restorer.md names them).

The pictures are for training only; they are not committed and not distributed.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

try:
    import cv2
    import numpy as np
except ImportError as error:
    print(f"prepare_photographs: {error}; run scripts/setup.sh --python-torch once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".webp"}
# Diagrams, icons and drawings are unlike photographs, and html pages contain mostly those.
SKIPPED = ("/html/", "charmap", "letter", "digits", "logo", "opencv4", "shape_sample", "GT.png", "screenshot",
           "720x1440", "1080x1920", "images_dark", "ml.png", "gradient", "pca_test")


def is_skipped(path: Path, folder: Path) -> bool:
    """Decides by the names below the folder alone: the location of the folder is irrelevant."""
    return any(word in f"/{path.relative_to(folder).as_posix()}" for word in SKIPPED)


def candidates(folders: list[Path]) -> list[Path]:
    files = {p for f in folders for p in f.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file() and not is_skipped(p, f)}
    files = [p for p in sorted(files) if p.stat().st_size > 30_000]
    largest: dict[str, Path] = {}
    for path in files:  # wallpaper packages contain one picture in many resolutions, in its own folder
        key = str(path.parent) if path.parent.name == "images" else re.sub(r"_\d+x\d+$", "", str(path.with_suffix("")))
        if key not in largest or path.stat().st_size > largest[key].stat().st_size:
            largest[key] = path
    return sorted(largest.values())


def shrink(image: np.ndarray, factor: float) -> np.ndarray:
    return cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


def detail(tile: np.ndarray) -> float:
    gray = cv2.cvtColor(tile, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return float(np.abs(cv2.Laplacian(gray, cv2.CV_32F)).mean())


def tiles(image: np.ndarray, size: int, most: int) -> list[np.ndarray]:
    """The whole picture shrunk to the size, then the most detailed tiles at half resolution."""
    height, width = image.shape[:2]
    short = min(height, width)
    if short < 0.55 * size:
        return []
    scale = size / short
    whole = shrink(image, scale) if scale < 1 else cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    y, x = (whole.shape[0] - size) // 2, (whole.shape[1] - size) // 2
    result = [whole[y : y + size, x : x + size]]
    if short >= 2.6 * size:
        half = shrink(image, 0.5)
        rows, columns = half.shape[0] // size, half.shape[1] // size
        grid = [half[r * size : (r + 1) * size, c * size : (c + 1) * size] for r in range(rows) for c in range(columns)]
        result += sorted(grid, key=detail, reverse=True)[:most]
    return [t for t in result if t.shape[:2] == (size, size) and detail(t) > 1.5]


def cut(arguments: argparse.Namespace) -> int:
    arguments.output.mkdir(parents=True, exist_ok=True)
    count, total = 0, 0
    for path in candidates(arguments.folders):
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            continue
        for tile in tiles(image, arguments.size, arguments.most_tiles):
            good, code = cv2.imencode(".jpg", tile, [cv2.IMWRITE_JPEG_QUALITY, arguments.quality])
            if total + code.size > arguments.max_mib * 2**20:
                break
            (arguments.output / f"{count:04d}_{path.stem[:24]}.jpg").write_bytes(code.tobytes())
            count, total = count + 1, total + code.size
    if count == 0:
        print(f"prepare_photographs: found no photograph that is large enough (30 kB, and --size {arguments.size}) and not "
              f"skipped by its name below {', '.join(map(str, arguments.folders))}; give folders of unpacked packages", file=sys.stderr)
        return 3
    print(f"{count} pictures, {total / 2**20:.1f} MiB in {arguments.output}")
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="unpacked packages")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--most-tiles", type=int, default=10, help="tiles of one large picture")
    parser.add_argument("--quality", type=int, default=90)
    parser.add_argument("--max-mib", type=float, default=35)
    arguments = parser.parse_args()
    for name, least in (("size", 1), ("most_tiles", 0), ("max_mib", 0)):
        if getattr(arguments, name) < least:
            parser.error(f"--{name.replace('_', '-')}: expected at least {least}, found {getattr(arguments, name)}")
    try:
        missing = [f for f in arguments.folders if not f.is_dir()]
        if missing:
            print(f"prepare_photographs: expected a folder, found none at {missing[0]}", file=sys.stderr)
            return 3
        return cut(arguments)
    except KeyboardInterrupt:
        print("prepare_photographs: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"prepare_photographs: {error.filename}: {error.strerror}; expected folders that can be read and written", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
