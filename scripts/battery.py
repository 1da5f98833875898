#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Simulates recordings with the faults of real cameras, imports them, trains scenes without any flag, and compares
these with the true scenes.

    scripts/battery.py --bin build/bin --output runs/battery [--only NAME ...] [--jobs N] [--set KEY=VALUE ...]
[--true-poses]

Each file in configs/battery is a recording; a file of that folder that it extends is the same scene without the
fault, and is run too. --configs configs/battery/causes runs each fault separately. For each recording:
jade_simulate --recording, jade_import RECORDING, jade_train --config scene.yaml, jade_eval, jade_render and
compare_poses.py. Completed stages are kept: another call with the same --output runs failed and missing ones.
Each recording updates OUTPUT/battery.md and OUTPUT/battery.csv.

PSNR is against the true sharp frames of the plain scene: those at the middles of training exposures ("middles"),
and of the test views between them ("views"), each after fitting one brightness factor per picture. "loss" is the
difference from the plain scene. --true-poses also trains each import with the true poses: the remaining loss is
not caused by the poses.

Needs numpy, and what jade_import needs for COLMAP. Each job has its own share of the cores, and one of the GPUs.
"""
from __future__ import annotations

import argparse
import csv
import json
import os
import queue
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from compare_poses import DataError, Scene, compare

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = {
    "recording": "recording", "verdict": "verdict", "placed": "images placed", "blur": "blur explained, %", "pose_px": "pose error, px",
    "on": "Θ⁺ found", "off": "Θ⁻ found", "threshold_error": "error, %", "exposure_ms": "exposure found, ms", "exposure_error": "error, %",
    "middles_db": "middles, dB", "middles_loss": "loss, dB", "views_db": "views, dB", "views_loss": "loss, dB",
    "true_db": "middles with true poses, dB", "true_loss": "loss with true poses, dB",
    "simulate_s": "simulate, s", "import_s": "import, s", "poses_s": "of it poses, s", "train_s": "train, s",
}


class BatteryError(Exception):
    """A one-line error: what was expected, what was found."""


# ---- pictures


@lru_cache(maxsize=None)  # most recordings are compared with the same pictures
def read_png(path: Path) -> np.ndarray:
    """[H,W,3] in [0,1] of a file with 8 bits, gray or RGB, not interlaced, as this project's programs write them."""
    data = path.read_bytes()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise BatteryError(f"{path}: expected a PNG file")
    place, packed = 8, b""
    width = height = channels = 0
    while place + 8 <= len(data):
        size, kind = struct.unpack(">I4s", data[place:place + 8])
        body = data[place + 8:place + 8 + size]
        place += 12 + size
        if kind == b"IHDR":
            width, height, bits, color, _, _, interlaced = struct.unpack(">IIBBBBB", body)
            if bits != 8 or color not in (0, 2) or interlaced:
                raise BatteryError(f"{path}: expected 8 bits, gray or RGB, found {bits} bits of kind {color}")
            channels = 3 if color == 2 else 1
        elif kind == b"IDAT":
            packed += body
    size = width * channels
    packed, above, whole = zlib.decompress(packed), bytearray(size), bytearray()
    for y in range(height):
        begin = y * (1 + size)
        above = unfiltered(packed[begin], bytearray(packed[begin + 1:begin + 1 + size]), above, channels)
        whole += above
    image = np.frombuffer(whole, np.uint8).reshape(height, width, channels).astype(np.float32) / 255
    return np.repeat(image, 3, axis=2) if channels == 1 else image


def unfiltered(kind: int, row: bytearray, above: bytearray, step: int) -> bytearray:
    if kind == 1:
        for i in range(step, len(row)):
            row[i] = (row[i] + row[i - step]) & 255
    elif kind == 2:
        return bytearray((np.frombuffer(row, np.uint8) + np.frombuffer(above, np.uint8)).tobytes())
    elif kind == 3:
        for i in range(len(row)):
            row[i] = (row[i] + ((row[i - step] if i >= step else 0) + above[i]) // 2) & 255
    elif kind == 4:
        for i in range(len(row)):
            a, b, c = (row[i - step], above[i], above[i - step]) if i >= step else (0, above[i], 0)
            p, q, r = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            row[i] = (row[i] + (a if p <= q and p <= r else b if q <= r else c)) & 255
    return row


def psnr(render: np.ndarray, truth: np.ndarray) -> float:
    """PSNR in dB, after fitting a brightness factor."""
    factor = (render * truth).sum() / max((render * render).sum(), 1e-12)
    error = ((np.clip(factor * render, 0, 1) - truth) ** 2).mean()
    return float(10 * np.log10(1 / max(error, 1e-10)))


# ---- what a stage left


def attempt(read):
    """A result that is missing or invalid is a gap in the table."""
    try:
        return read()
    except (OSError, KeyError, ValueError, IndexError, BatteryError, DataError):
        return None


def frames_of(data: Path) -> list[dict[str, str]]:
    with open(data / "frames.csv", newline="") as file:
        return list(csv.DictReader(file))


def true_threshold(truth: Path, sign: str) -> float:
    found = re.search(rf"^\s*threshold_{sign}:\s*([0-9.e+-]+)", (truth / "simulation.yaml").read_text(), re.MULTILINE)
    if not found:
        raise BatteryError(f"{truth}/simulation.yaml: expected threshold_{sign}")
    return float(found[1])


def lengths_ms(data: Path, truth: Path) -> tuple[float, float]:
    """Mean length of the registered exposures, estimated and true."""
    times = np.load(truth / "images_1" / "timestamps.npz")
    true = times["timestamps_end"].astype(float) - times["timestamps_start"].astype(float)
    pairs = [(float(row["end_us"]) - float(row["start_us"]), true[int(row["name"])])
             for row in frames_of(data) if row["part"] in ("train", "held out")]
    found, wanted = np.array(pairs).mean(0) / 1000
    return float(found), float(wanted)


def seconds_of(stage: Path) -> float:
    found = re.search(r"^seconds ([0-9.e+-]+)$", stage.read_text(), re.MULTILINE)
    if not found:
        raise BatteryError(f"{stage}: expected its seconds")
    return round(float(found[1]), 1)


def same_path(a: Path, b: Path) -> bool:
    one, other = np.load(a / "poses_bounds.npy"), np.load(b / "poses_bounds.npy")
    return one.shape == other.shape and np.allclose(one[:, :15], other[:, :15], atol=1e-6)


def mean_psnr(renders: Path, data: Path, part: str, true_picture) -> float:
    """@param true_picture  maps a frame's name in the recording to its true picture"""
    scores = []
    for row in frames_of(data):
        if row["part"] != part:
            continue
        # A data set numbers its frames; names have as many digits as the largest number, at least two.
        files = [path for path in renders.glob("*.npy") if path.stem.isdigit() and int(path.stem) == int(row["frame"])]
        if files:
            scores.append(psnr(np.load(files[0]).transpose(1, 2, 0).astype(np.float64), read_png(true_picture(row["name"]))))
    if not scores:
        raise BatteryError(f"{renders}: expected renders of the {part} frames, found none")
    return float(np.mean(scores))


# ---- stages


@dataclass
class Recording:
    name: str
    config: Path
    folder: Path
    plain: str | None  # the recording that it extends
    seconds: dict[str, float] = field(default_factory=dict)
    refusal: str = ""
    simulated: threading.Event = field(default_factory=threading.Event)
    row: dict = field(default_factory=dict)

    @property
    def truth(self) -> Path:
        return self.folder / "recording" / "truth"

    @property
    def data(self) -> Path:
        return self.folder / "data"


def recordings_in(configs: Path, output: Path, only: list[str]) -> list[Recording]:
    """Plain ones first, because the others are compared with them."""
    found = {}
    for config in sorted(configs.glob("*.yaml")):
        extends = re.search(r"^extends:\s*([^\s/]+)\.yaml\s*$", config.read_text(), re.MULTILINE)
        found[config.stem] = Recording(config.stem, config.resolve(), output / config.stem, extends[1] if extends else None)
    unknown = [name for name in only if name not in found] + [r.plain for r in found.values() if r.plain and r.plain not in found]
    if not found or unknown:
        raise BatteryError(f"{configs}: expected recordings {' '.join(unknown)}, found {' '.join(found) or 'none'}")
    wanted = {name for each in (only or found) for name in (each, found[each].plain) if name}
    return sorted((found[name] for name in wanted), key=lambda r: (r.plain is not None, r.name))


class Battery:
    def __init__(self, options: argparse.Namespace, recordings: list[Recording]):
        self.options, self.recordings = options, recordings
        self.begun = time.monotonic()
        self.lock = threading.Lock()
        self.running: set[subprocess.Popen] = set()
        self.stopped = False
        jobs = min(options.jobs, len(recordings))
        cores = sorted(os.sched_getaffinity(0))
        self.slots: queue.Queue[tuple[set[int], str | None]] = queue.Queue()
        gpus = visible_gpus() if options.device != "cpu" else []
        for i in range(jobs):
            share = set(cores[i * len(cores) // jobs:(i + 1) * len(cores) // jobs]) or {cores[i % len(cores)]}
            self.slots.put((share, gpus[i % len(gpus)] if gpus else None))
        self.jobs = jobs

    def say(self, text: str) -> None:
        with self.lock:
            print(f"{time.monotonic() - self.begun:6.0f} s  {text}", flush=True)

    def call(self, recording: Recording, stage: str, command: list, made: Path | None) -> bool:
        """Runs one stage unless it is complete; its output goes to STAGE.log. @param made  removed before a new run"""
        words = [str(word) for word in command]
        note = recording.folder / f"{stage}.json"
        done = attempt(lambda: json.loads(note.read_text()))
        if done and done["command"] == words and done["code"] == 0:
            recording.seconds[stage] = done["seconds"]
            return True
        for later in self.later_than(stage):
            (recording.folder / f"{later}.json").unlink(missing_ok=True)
        if made and made.exists():
            shutil.rmtree(made)
        cores, gpu = self.place.cores, self.place.gpu
        environment = {**os.environ, "OMP_NUM_THREADS": str(len(cores)), "OPENBLAS_NUM_THREADS": str(len(cores))}
        if gpu is not None:
            environment["CUDA_VISIBLE_DEVICES"] = gpu
        begun = time.monotonic()
        log = recording.folder / f"{stage}.log"
        with open(log, "wb") as file:
            with self.lock:
                if self.stopped:
                    return False
                process = subprocess.Popen(words, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=environment)
                self.running.add(process)
            code = process.wait()
            with self.lock:
                self.running.discard(process)
                if self.stopped:
                    return False
        seconds = round(time.monotonic() - begun, 1)
        note.write_text(json.dumps({"command": words, "code": code, "seconds": seconds}) + "\n")
        recording.seconds[stage] = seconds
        if code != 0:
            recording.refusal = f"{stage}: {last_line(log) or f'exit code {code}'}"
        self.say(f"{recording.name}: {stage} {seconds} s" + (f", {recording.refusal}" if code else ""))
        return code == 0

    place = threading.local()
    STAGES = ("simulate", "import", "train", "eval", "middles", "views", "true_data", "true_train", "true_middles")

    def later_than(self, stage: str) -> tuple[str, ...]:
        return self.STAGES[self.STAGES.index(stage):] if stage in self.STAGES else ()

    def make(self, recording: Recording) -> None:
        if self.stopped:
            recording.simulated.set()
            return
        self.place.cores, self.place.gpu = slot = self.slots.get()
        try:
            os.sched_setaffinity(0, self.place.cores)  # for this thread, and for the programs that it starts
            recording.folder.mkdir(parents=True, exist_ok=True)
            self.stages(recording)
            recording.row = self.measured(recording)
            self.write_table()
        finally:
            recording.simulated.set()
            self.slots.put(slot)

    def stages(self, recording: Recording) -> None:
        o, folder = self.options, recording.folder

        def program(name: str) -> Path:
            return o.bin / name

        recorded, data, run = folder / "recording", recording.data, folder / "run"
        device = ["--device", o.device] if o.device else []
        settings = [word for each in o.set for word in ("--set", each)]
        steps = (
            ("simulate", [program("jade_simulate"), "--config", recording.config, "--recording", "--output", recorded], recorded),
            ("import", [program("jade_import"), recorded, "--output", data, *device], data),
            ("train", [program("jade_train"), "--config", data / "scene.yaml", "--output", run, *device, *settings], run),
            ("eval", [program("jade_eval"), "--run", run, "--output", folder / "eval", *device], None),
            ("middles", [program("jade_render"), "--run", run, "--cameras", "train", "--format", "npy", "--output", folder / "middles",
                         *device], folder / "middles"),
            ("views", [program("jade_render"), "--run", run, "--cameras", "test", "--format", "npy", "--output", folder / "views",
                       *device], folder / "views"),
        )
        if o.true_poses:
            true = folder / "true"
            steps += (
                ("true_data", [sys.executable, ROOT / "scripts/compare_poses.py", data, recording.truth, "--with-true-poses",
                               true / "data"], true / "data"),
                ("true_train", [program("jade_train"), "--config", true / "data/scene.yaml", "--output", true / "run", *device,
                                *settings], true / "run"),
                ("true_middles", [program("jade_render"), "--run", true / "run", "--cameras", "train", "--format", "npy", "--output",
                                  true / "middles", *device], true / "middles"),
            )
        for stage, command, made in steps:
            if stage == o.until:
                return
            if stage == "views" and not attempt(lambda: [1 for row in frames_of(data) if row["part"] == "test"]):
                continue
            if not self.call(recording, stage, command, made):
                return
            if stage == "simulate":
                recording.simulated.set()

    def run(self) -> bool:
        """Returns whether all recordings succeeded."""
        pool = ThreadPoolExecutor(self.jobs)
        try:
            for future in [pool.submit(self.make, recording) for recording in self.recordings]:
                future.result()
        except BaseException:
            with self.lock:
                self.stopped = True
                for process in self.running:
                    process.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            self.write_table()
        return not any(recording.refusal for recording in self.recordings)

    # ---- the table

    def measured(self, recording: Recording) -> dict:
        data, truth = recording.data, recording.truth
        by_name = {r.name: r for r in self.recordings}
        plain = by_name.get(recording.plain or "")
        if plain:
            plain.simulated.wait()  # it has started before this one
        judged_by = plain.truth if plain and attempt(lambda: same_path(truth, plain.truth)) else truth
        row = {"recording": recording.name, "verdict": verdict_of(recording)}
        for stage in ("simulate", "import", "train"):
            row[f"{stage}_s"] = recording.seconds.get(stage)
        row["poses_s"] = attempt(lambda: seconds_of(data / "import/poses/stage.txt"))
        poses = attempt(lambda: json.loads((data / "import/poses/poses.json").read_text()))
        if poses:
            chosen = next(each for each in poses["attempts"] if each["name"] == poses["chosen"])
            row["placed"] = f"{chosen['registered']} of {chosen['images']}"
            row["blur"] = round(100 * chosen["explained_blur"])
        row["pose_px"] = attempt(lambda: compare(Scene(data), Scene(truth))[0]["nine_px"])
        sensor = attempt(lambda: json.loads((data / "import/sensor/sensor.json").read_text()))
        if sensor:
            row["on"], row["off"] = (f"{sensor[f'threshold_{sign}']:.3f}" for sign in ("positive", "negative"))
            row["threshold_error"] = attempt(lambda: max(
                (100 * (sensor[f"threshold_{sign}"] / true_threshold(truth, sign) - 1) for sign in ("positive", "negative")), key=abs))
        if truth.is_dir() and not (recording.folder / "recording" / "exposures.csv").exists():
            found = attempt(lambda: lengths_ms(data, truth))
            if found:
                row["exposure_ms"] = f"{found[0]:.1f} (true {found[1]:.1f})"
                row["exposure_error"] = 100 * (found[0] / found[1] - 1)
        row["middles_db"] = attempt(lambda: mean_psnr(recording.folder / "middles", data, "train",
                                                      lambda name: judged_by / "sharp" / f"{name}.png"))
        row["views_db"] = attempt(lambda: mean_psnr(recording.folder / "views", data, "test",
                                                    lambda name: judged_by / "images_1" / f"{name}.png"))
        row["true_db"] = attempt(lambda: mean_psnr(recording.folder / "true/middles", data, "train",
                                                   lambda name: judged_by / "sharp" / f"{name}.png"))
        return row

    def write_table(self) -> None:
        with self.lock:
            rows = {recording.name: recording.row or {"recording": recording.name, "verdict": "not begun"}
                    for recording in self.recordings}
            for recording in self.recordings:
                row, plain = rows[recording.name], rows.get(recording.plain or "", {})
                for kind in ("middles", "views", "true"):
                    if row.get(f"{kind}_db") is not None and plain.get(f"{kind}_db") is not None:
                        row[f"{kind}_loss"] = plain[f"{kind}_db"] - row[f"{kind}_db"]
            ordered = list(rows.values())
            with open(self.options.output / "battery.csv", "w", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(COLUMNS)
                writer.writerows([text_of(row.get(key)) for key in COLUMNS] for row in ordered)
            lines = ["| " + " | ".join(COLUMNS.values()) + " |", "|---|---|" + "---:|" * (len(COLUMNS) - 2)]
            lines += ["| " + " | ".join(text_of(row.get(key)).replace("|", "\\|") for key in COLUMNS) + " |" for row in ordered]
            (self.options.output / "battery.md").write_text("\n".join(lines) + "\n")


def verdict_of(recording: Recording) -> str:
    if recording.refusal:
        return f"refused at {recording.refusal}"
    return next((word for stage, word in (("train", "trained"), ("import", "imported"), ("simulate", "simulated"))
                 if stage in recording.seconds), "stopped")


def text_of(value) -> str:
    if value is None:
        return ""
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def last_line(log: Path) -> str:
    """The last line of the error, without the progress bar before it."""
    lines = [line.rsplit("\r", 1)[-1].strip() for line in log.read_text(errors="replace").splitlines()]
    lines = [line for line in lines if line]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines or [""])[-1]


def visible_gpus() -> list[str]:
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [each for each in named.split(",") if each]
    try:
        said = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True)
    except OSError:
        return []
    return [str(i) for i, line in enumerate(said.stdout.splitlines()) if line.startswith("GPU ")]


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/bin", help="folder of the programs")
    parser.add_argument("--output", type=Path, required=True, help="folder of all that is made")
    parser.add_argument("--configs", type=Path, default=ROOT / "configs/battery", help="folder of the recordings")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="this recording (may be repeated), and its plain one")
    parser.add_argument("--jobs", type=int, default=max(1, len(os.sched_getaffinity(0)) // 4), help="recordings at a time (a quarter "
                        "of the cores)")
    parser.add_argument("--device", default="", help="of import, training and scores (auto)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of jade_train, for a short check")
    parser.add_argument("--true-poses", action="store_true", help="train with the true poses too")
    parser.add_argument("--until", choices=Battery.STAGES[1:], default="", help="stop before this stage")
    options = parser.parse_args(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if options.jobs < 1:
            raise BatteryError(f"--jobs: expected 1 or more, found {options.jobs}")
        if not (options.bin / "jade_simulate").exists():
            raise BatteryError(f"--bin: expected the programs, found no jade_simulate in {options.bin}")
        options.bin, options.output = options.bin.resolve(), options.output.resolve()
        recordings = recordings_in(options.configs, options.output, options.only)
        options.output.mkdir(parents=True, exist_ok=True)
        passed = Battery(options, recordings).run()
    except (BatteryError, OSError) as error:
        print(f"battery: {error}", file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        print("battery: stopped; called again it goes on", file=sys.stderr)
        return 130
    print((options.output / "battery.md").read_text(), end="")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
