# SPDX-License-Identifier: Apache-2.0
"""Frames, times and events of a folder in the EvDeblur layout, by the rules of docs/data.md, which the programs
follow too.
"""

from __future__ import annotations

import re
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
import torch
from torch import Tensor

from export_efnet import DataError

UNITS = {"us": 1.0, "ns": 1e-3, "s": 1e6}  # microseconds of each
ONLY_NS = 1e17  # whole numbers above begin in 1973 as ns, and as us in the year 5138
SHORTEST_US, LONGEST_US = 10, 5e6
IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm", ".pnm"}
FIELDS = {"x": "x", "xs": "x", "y": "y", "ys": "y", "t": "t", "ts": "t", "timestamp": "t", "timestamps": "t",
          "p": "p", "ps": "p", "pol": "p", "polarity": "p", "polarities": "p"}
EVENT_FILES = ("events.h5", "events.hdf5", "events/events.h5", "events.npz", "events.npy", "events.txt", "events.csv")


def natural(path: Path) -> tuple:
    """Sorts 2 before 10."""
    parts = re.findall(r"[0-9]+|[^0-9]", path.name)
    return [(ord("0"), int(part)) if part.isdigit() and part.isascii() else (ord(part), 0) for part in parts], path.name


def list_images(folder: Path) -> list[Path]:
    return sorted((p for p in folder.iterdir() if p.suffix.lower() in IMAGES and p.is_file()), key=natural)


def find_images(root: Path) -> list[Path]:
    others = sorted(p for p in root.glob("images_*") if p.name != "images_edi")
    for folder in (root / "images_1", root / "images", *others):
        if folder.is_dir() and (files := list_images(folder)):
            return files
    raise DataError(f"{root}: expected frames in images_1/ or images/, found none; give a folder in the EvDeblur layout (docs/data.md)")


def picture(path: Path) -> Tensor:
    """[1,3,H,W] in [0,1], RGB."""
    image = None
    if path.suffix == ".npy":
        values = read_arrays(path)
        values = values[None] if isinstance(values, np.ndarray) and values.ndim == 2 else values
        if not isinstance(values, np.ndarray) or values.ndim != 3 or values.shape[0] not in (1, 3) or values.dtype.kind != "f":
            raise DataError(f"{path}: expected a float image [3,H,W], [1,H,W] or [H,W]")
        return torch.from_numpy(values).float().expand(3, -1, -1).unsqueeze(0)
    if path.is_file():
        image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    peaks = {"uint8": 255, "uint16": 65535, "float32": 1}
    if image is None or image.dtype.name not in peaks:
        raise DataError(f"{path}: expected an image of 8 or 16 bits, found a file that cannot be decoded; is it damaged?")
    image = image[..., None].repeat(3, 2) if image.ndim == 2 else image[..., 2::-1]
    return torch.from_numpy(image.astype(np.float32)).permute(2, 0, 1).unsqueeze(0) / peaks[image.dtype.name]


def read_arrays(path: Path) -> np.ndarray | dict[str, np.ndarray]:
    """The array of an .npy file, or the arrays of an .npz file by name."""
    try:
        content = np.load(path)
        if isinstance(content, np.ndarray):
            return content
        with content:
            return dict(content)
    except FileNotFoundError:
        raise DataError(f"{path}: missing") from None
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise DataError(f"{path}: cannot be read as {path.suffix}, it is damaged or was cut short; write it again") from error


def whole_us(times: np.ndarray, unit: str, path: Path) -> np.ndarray:
    """Times of frames to the nearest microsecond; whole nanoseconds without the rounding of floats."""
    values = times * UNITS[unit]
    if not np.isfinite(values).all() or np.abs(values).max(initial=0) > 4e18:
        raise DataError(f"{path}: expected finite times, found others; export the times again")
    if times.dtype.kind != "f" and unit == "ns":
        times = times.astype(np.int64)
        return times // 1000 + (times % 1000 >= 500)
    return times.astype(np.int64) if times.dtype.kind != "f" and unit == "us" else np.floor(values + 0.5).astype(np.int64)


def exposure_unit(start: np.ndarray, end: np.ndarray, path: Path) -> str:
    """The unit in which the median exposure is between 10 us and 5 s; us not at one frame in 10 s, as ns look like that."""
    floating = start.dtype.kind == "f"
    if not floating and start.max(initial=0) > ONLY_NS:
        return "ns"
    lengths = (end - start)[end > start].astype(np.float64)
    if len(lengths) == 0:
        return "s" if floating else "us"
    median = np.sort(lengths)[(len(lengths) - 1) // 2]
    period = np.median(np.diff(np.sort(start.astype(np.float64)))) if len(start) > 2 else 0
    for unit, factor in UNITS.items():
        if unit == "us" and median >= 5e5 and period >= 1e7:
            continue
        if SHORTEST_US <= median * factor <= LONGEST_US and (floating or unit != "s"):
            return unit
    raise DataError(f"{path}: the median exposure is {median:g}, which is no plausible time in us, ns or s; give --time-unit")


def frame_times(path: Path, unit: str) -> tuple[np.ndarray, np.ndarray]:
    """Start and end of each frame's exposure, in us."""
    arrays = read_arrays(path)
    names = ("timestamps_start", "timestamps_end")
    if not isinstance(arrays, dict) or any(name not in arrays for name in names):
        raise DataError(f"{path}: expected the arrays timestamps_start and timestamps_end, one number for each frame")
    start, end = (arrays[name] for name in names)
    if start.ndim != 1 or start.shape != end.shape or any(x.dtype.kind not in "iuf" for x in (start, end)):
        raise DataError(f"{path}: expected timestamps_start and timestamps_end of one length, found {start.dtype} {list(start.shape)} "
                        f"and {end.dtype} {list(end.shape)}")
    if start.dtype.kind == "u":  # differences of unsigned numbers would wrap
        start, end = start.astype(np.int64), end.astype(np.int64)
    known = exposure_unit(start, end, path) if unit == "auto" else unit
    starts, ends = whole_us(start, known, path), whole_us(end, known, path)
    if (ends < starts).any():
        raise DataError(f"{path}: frame {int(np.argmax(ends < starts))} ends before it starts; swap the two arrays")
    return starts, ends


def take(name: str, values: object, fields: dict[str, object]) -> None:
    """Adds an array to the fields; a one-letter name has priority over longer names."""
    field = FIELDS.get(name)
    if field is not None and (name == field or field not in fields):
        fields[field] = values


def hdf5_events(path: Path) -> dict[str, np.ndarray]:
    """The lists of the group nearest to the root that has all four, and the t_offset of DSEC."""
    groups: dict[tuple[int, str], dict[str, h5py.Dataset]] = {}

    def visit(name: str, item: object) -> None:
        group, _, field = name.rpartition("/")
        if isinstance(item, h5py.Dataset):
            take(field, item, groups.setdefault((len(group.split("/")) if group else 0, group), {}))

    try:
        with h5py.File(path) as file:
            file.visititems(visit)
            fields = next((found for _, found in sorted(groups.items()) if len(found) == 4), None)
            if fields is None:
                raise DataError(f"{path}: expected event arrays x, y, t and p in one group, found {', '.join(file) or 'nothing'}")
            events = {name: fields[name][()] for name in "xytp"}
            if "t_offset" in file:
                offset = np.asarray(file["t_offset"][()])
                if offset.size != 1:
                    raise DataError(f"{path}: expected one number in 't_offset', found {offset.size}")
                events["t"] = events["t"].astype(np.float64 if events["t"].dtype.kind == "f" else np.int64) + offset.item()
            return events
    except (OSError, RuntimeError, KeyError) as error:
        raise DataError(f"{path}: cannot be read as HDF5 ({str(error).splitlines()[0]}); is it damaged or cut short?") from error


def columns(path: Path, table: np.ndarray) -> dict[str, np.ndarray]:
    """Chooses t x y p or x y t p: time is the column that never decreases, else the larger one."""
    if table.ndim != 2 or table.shape[1] != 4:
        raise DataError(f"{path}: expected an array [N,4] of t x y p or x y t p, found shape {list(table.shape)}")
    rises = [bool((np.diff(table[:, i]) >= 0).all()) for i in (0, 2)]
    first = rises[0] if rises[0] != rises[1] else len(table) == 0 or table[:, 0].max() >= table[:, 2].max()
    return dict(zip("txyp" if first else "xytp", table.T))


def named_order(line: str) -> str | None:
    """The order of x, y, t and p if a line consists of their four names."""
    order = "".join(FIELDS.get(word, "?") for word in re.split(r"[ \t,;]+", line.lstrip("#").strip().lower()))
    return order if sorted(order) == sorted("xytp") else None


def likely_order(rows: np.ndarray) -> str:
    """The order of columns without names: t x y p, unless in the first events only the third can be the time."""
    t, y = rows[:4096, 0], rows[:4096, 2]
    third = (np.diff(t) < 0).any() and (np.diff(y) >= 0).all() and y[0] < y[-1]
    return "xytp" if third else "txyp"


def text_events(path: Path) -> dict[str, np.ndarray]:
    """Lines of four numbers separated by blanks, commas or semicolons; one line of names may come first."""
    rows, header_seen, order = [], False, None
    for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines()):
        if not rows and order is None:
            order = named_order(line)
        words = re.split(r"[ \t,;]+", line.strip()) if line.strip() and not line.startswith("#") else []
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) == 4:
            rows.append(values)
        elif words and (rows or header_seen):
            raise DataError(f'{path}:{number + 1}: expected "t x y p"')
        elif words:
            header_seen = True
    table = np.array(rows).reshape(-1, 4)
    return dict(zip(order or likely_order(table), table.T))


def stored_events(path: Path) -> dict[str, np.ndarray]:
    """The lists x, y, t, p as stored."""
    if path.suffix in (".h5", ".hdf5"):
        return hdf5_events(path)
    if path.suffix in (".txt", ".csv"):
        return text_events(path)
    arrays = read_arrays(path)
    if isinstance(arrays, np.ndarray):
        return columns(path, arrays)
    found: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        take(name, values, found)
    if not found and len(arrays) == 1:
        return columns(path, next(iter(arrays.values())))
    if len(found) < 4:
        raise DataError(f"{path}: expected arrays named x, y, t and p, found {', '.join(arrays) or 'none'}")
    return found


def event_unit(t: np.ndarray, begin: int, end: int, path: Path) -> str:
    """The unit in which events cover most of the exposures, from `begin` to `end` us, and span a similar time."""
    first, last = float(t.min()), float(t.max())
    fraction = t.dtype.kind == "f" and bool((t != np.floor(t)).any())
    best, best_match = "", 0.0
    for unit, factor in UNITS.items():
        if not fraction and last > ONLY_NS and unit != "ns":
            continue
        a, b = first * factor, last * factor
        shared = min(b, end) - max(a, begin)
        share = [(shared + 1e-9) / span if span > 0 else 1 for span in (end - begin, max(b, end) - min(a, begin))]
        match = 0.0 if shared < 0 else share[0] * share[1] ** 0.5
        if match > best_match:
            best, best_match = unit, match
    if not best:
        raise DataError(f"{path}: events run from {first:g} to {last:g}, exposures from {begin} to {end} us: they share no moment in us, "
                        "ns or s; are they of one recording?")
    return best


def read_events(path: Path, unit: str, begin: int, end: int) -> dict[str, np.ndarray]:
    """x, y, t (us, in order), p (-1 or 1) of a recording whose exposures run from `begin` to `end` us."""
    events = {name: np.asarray(values).reshape(-1) for name, values in stored_events(path).items()}
    lengths = [len(events[name]) for name in "xytp"]
    if len(set(lengths)) != 1 or any(values.dtype.kind not in "biuf" for values in events.values()):
        raise DataError(f"{path}: expected x, y, t and p of numbers and of one length, found {', '.join(map(str, lengths))}; the recording "
                        "is damaged or was cut short")
    values = set(np.unique(events["p"]).astype(float))
    if not (values <= {0, 1} or values <= {-1, 1}):
        raise DataError(f"{path}: expected polarities 0/1 or -1/+1, found {', '.join(f'{v:g}' for v in sorted(values)[:4])}")
    t = events["t"].astype(np.float64 if events["t"].dtype.kind == "f" else np.int64)
    if not np.isfinite(t).all():
        raise DataError(f"{path}: expected finite event times, found NaN or Inf")
    if len(t):
        known = event_unit(t, begin, end, path) if unit == "auto" else unit
        if t.dtype.kind == "f":
            # Seconds are decimal fractions: round to the nearest microsecond.
            t = (np.round if known == "s" else np.floor)(t * UNITS[known]).astype(np.int64)
        else:
            t = t // 1000 if known == "ns" else t * int(UNITS[known])
    if (np.diff(t) < 0).any():
        print(f"{path}: event times were not in order; they have been sorted", file=sys.stderr)
    order = np.argsort(t, kind="stable")
    order = order[np.isfinite(events["x"][order]) & np.isfinite(events["y"][order])]
    return {"x": events["x"][order].astype(np.float64), "y": events["y"][order].astype(np.float64), "t": t[order],
            "p": np.where(events["p"][order] > 0, 1, -1)}


@dataclass
class Frame:
    path: Path
    start: int  # us
    end: int

    @property
    def middle(self) -> int:
        return self.start + (self.end - self.start) // 2


def read_frames(root: Path, unit: str) -> list[Frame]:
    """Frames in the order of their numbers."""
    if not root.is_dir():
        raise DataError(f"{root}: expected a folder in the EvDeblur layout (docs/data.md), found {'a file' if root.exists() else 'nothing'}")
    files = find_images(root)
    beside = files[0].parent / "timestamps.npz"
    path = beside if beside.is_file() or not (root / "timestamps.npz").is_file() else root / "timestamps.npz"
    starts, ends = frame_times(path, unit)
    if len(starts) != len(files):
        raise DataError(f"{path}: {len(starts)} times for {len(files)} images in {files[0].parent.name}/; there must be one for each")
    return [Frame(file, int(start), int(end)) for file, start, end in zip(files, starts, ends)]


def find_events(root: Path) -> Path:
    path = next((root / name for name in EVENT_FILES if (root / name).is_file()), None)
    if path is None:
        raise DataError(f"{root}: no recording of events, expected one of {', '.join(EVENT_FILES)}")
    return path
