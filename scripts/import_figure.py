#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the result of each stage of an import, from the files that jade_import keeps.

    .venv/bin/python scripts/import_figure.py DATA OUT.png [--frame NAME]

DATA is a folder written by jade_import. --frame: the frame to show, by default the middle one of the blurry
frames. Needs matplotlib and h5py (scripts/setup.sh --figures --import).
"""
from __future__ import annotations

import argparse
import json
import sys
import textwrap
from pathlib import Path

try:
    import h5py
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
except ImportError as error:
    print(f"import_figure: {error}; run scripts/setup.sh --figures --import once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)


class DataError(Exception):
    """An error for the user: what was expected, what was found, what to do, in one line."""


def stage(data: Path, name: str) -> Path:
    folder = data / "import" / name
    if not folder.is_dir():
        raise DataError(f"{folder}: expected the stage {name} of jade_import, found none; import without --until")
    return folder


class Capture:
    """Frames and events of a stage, and the offset of the events' clock relative to that of the frames."""

    def __init__(self, folder: Path, ahead_us: float = 0):
        self.folder, self.ahead_us = folder, ahead_us
        told = json.loads((folder / "capture.json").read_text())
        self.frames, self.size = told["frames"], (told["sensor_height"], told["sensor_width"])

    def image(self, frame: dict) -> np.ndarray:
        return plt.imread(self.folder / "frames" / frame["file"])[..., :3]

    def events(self, begin_us: float, end_us: float) -> tuple[np.ndarray, ...]:
        with h5py.File(self.folder / "events.h5") as file:
            t = file["t"][:]
            part = slice(*np.searchsorted(t, (begin_us + self.ahead_us, end_us + self.ahead_us)))
            return file["x"][part], file["y"][part], file["p"][part]


def levelled(data: Path) -> Capture:
    """Result of the stage undistort: without a calibration the input, on one clock."""
    if (stage(data, "undistort") / "capture.json").exists():
        return Capture(data / "import/undistort")
    clock = json.loads((stage(data, "time") / "clock.json").read_text())
    return Capture(stage(data, "read"), 1000 * clock["offset_ms"])


def counts(x, y, p, height: int, width: int) -> np.ndarray:
    """Sum of polarities and number of events of each pixel, [2,H,W]."""
    column, row = np.round(x).astype(int), np.round(y).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place = row[inside] * width + column[inside]
    signs = np.where(p[inside] > 0, 1.0, -1.0)
    maps = [np.bincount(place, weights, height * width) for weights in (signs, np.ones(len(place)))]
    return np.stack(maps).reshape(2, height, width)


def polarity_picture(polarity: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
    """Red for brighter, blue for darker, over a gray image or over white."""
    strength = np.clip(np.abs(polarity) / max(1.0, np.percentile(np.abs(polarity), 98)), 0, 1)[..., None]
    colour = np.where(polarity[..., None] > 0, (0.85, 0.1, 0.15), (0.1, 0.25, 0.85))
    under = np.ones((*polarity.shape, 3)) if base is None else 0.25 + 0.75 * np.repeat(base.mean(-1, keepdims=True), 3, -1)
    return (1 - strength) * under + strength * colour


def blank(axis, text: str):
    axis.text(0.5, 0.5, textwrap.fill(text, 32), ha="center", va="center", transform=axis.transAxes)


def draw_clock(axis, data: Path):
    clock = json.loads((stage(data, "time") / "clock.json").read_text())
    curve = clock.get("curve", {})
    correlation = curve.get("correlation", [])
    axis.set_title(f"time: {clock['offset_ms']:.1f} ms taken off the events" if clock["offset_ms"] else "time: one clock")
    axis.set_box_aspect(0.75)
    if not correlation:
        blank(axis, f"no offset was sought: {clock['said']}")
        return
    offsets = np.linspace(curve["from_ms"], curve["to_ms"], len(correlation))
    axis.plot(offsets, correlation, color="black", linewidth=1)
    best = offsets[int(np.argmax(correlation))]
    axis.axvline(best, color="tab:red", linewidth=1)
    axis.set_xticks([-40, -20, 0, 20, 40])
    axis.yaxis.set_major_locator(plt.AutoLocator())
    axis.set_xlabel("events ahead by, ms")
    axis.set_ylabel("correlation with the frames")


def draw_sensor(axis, capture: Capture, data: Path):
    found = json.loads((stage(data, "sensor") / "sensor.json").read_text())
    x, y, p = capture.events(-np.inf, np.inf)
    number = counts(x, y, p, *capture.size)[1]
    axis.imshow(np.log1p(number), cmap="gray")
    for pixel in found["hot_pixels"]:
        axis.plot(pixel["column"], pixel["row"], "o", markersize=5, markerfacecolor="none", markeredgecolor="tab:red", markeredgewidth=0.8)
    axis.set_title(f"sensor: all events, {len(found['hot_pixels'])} hot pixels; Θ {found['threshold_positive']:.2f}, {found['threshold_negative']:.2f}")


def draw_poses(axis, data: Path):
    folder = stage(data, "poses")
    told = json.loads((folder / "poses.json").read_text())
    points = np.load(folder / "points.npz")
    place, colour = points["points"], points["colors"]
    if colour.dtype.kind == "u" or colour.max() > 1:
        colour = colour / 255
    centres = np.array([-np.reshape(pose["rotation"], (3, 3)).T @ pose["translation"] for pose in told["poses"]])
    near = place[:, 2] < np.percentile(place[:, 2], 97)
    axis.scatter(place[near, 0], place[near, 2], s=1, c=np.clip(colour[near], 0, 1), linewidths=0)
    axis.plot(centres[:, 0], centres[:, 2], "o-", color="tab:red", markersize=2, linewidth=0.7)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_box_aspect(0.75)
    axis.set_title(f"poses: {len(told['poses'])} images from above")


def chosen(capture: Capture, name: str | None) -> dict:
    blurry = [frame for frame in capture.frames if frame["end_us"] - frame["start_us"] > 1]
    if name is None:
        if not blurry:
            raise DataError("expected frames with an exposure, found none; name one with --frame")
        return blurry[len(blurry) // 2]
    for frame in capture.frames:
        if frame["name"] == name:
            return frame
    raise DataError(f"--frame: expected one of {', '.join(frame['name'] for frame in capture.frames)}, found {name}")


def draw(data: Path, name: str | None) -> plt.Figure:
    raw, level = Capture(stage(data, "read")), levelled(data)
    frame = chosen(raw, name)
    index = [each["name"] for each in raw.frames].index(frame["name"])
    after = next((each for each in level.frames if each["name"] == frame["name"]), None)
    plt.rcParams.update({"axes.titlesize": 9, "font.size": 8})
    figure, axes = plt.subplots(3, 3, figsize=(10, 8), constrained_layout=True)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    (read, seen, clock), (sensor, straight, start), (middle, end, poses) = axes
    read.imshow(raw.image(frame))
    read.set_title(f"read: frame {frame['name']}, {(frame['end_us'] - frame['start_us']) / 1000:.0f} ms")
    seen.imshow(polarity_picture(counts(*raw.events(frame["start_us"], frame["end_us"]), *raw.size)[0]))
    seen.set_title("read: events at these times, as they came")
    draw_clock(clock, data)
    draw_sensor(sensor, raw, data)
    if after is None:
        blank(straight, "this frame was left out")
    else:
        image = level.image(after)
        events = counts(*level.events(after["start_us"], after["end_us"]), *image.shape[:2])
        straight.imshow(polarity_picture(events[0], image))
        straight.set_title("undistort: events where the frame has them")
    latents = json.loads((stage(data, "restore") / "images.json").read_text())
    of_frame = [each for each in latents if each["shot"] == index] if isinstance(latents, list) else []
    of_frame.sort(key=lambda each: each["t_us"])
    for axis, when, k in ((start, "start", 0), (middle, "middle", len(of_frame) // 2), (end, "end", -1)):
        axis.set_title(f"restore: {when}")
        if of_frame:
            axis.imshow(plt.imread(stage(data, "restore") / "images" / of_frame[k]["file"])[..., :3])
        else:
            blank(axis, "not restored")
    draw_poses(poses, data)
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, help="folder that jade_import wrote")
    parser.add_argument("output", type=Path, help="picture to write")
    parser.add_argument("--frame", help="name of the frame to show")
    options = parser.parse_args()
    try:
        figure = draw(options.data, options.frame)
    except (DataError, OSError, KeyError, ValueError) as error:
        print(f"import_figure: {error}", file=sys.stderr)
        sys.exit(3)
    figure.savefig(options.output, dpi=84)


if __name__ == "__main__":
    main()
