#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how well the stage `time` of jade_import finds exposure lengths and clock offsets of simulated recordings.

    scripts/time_estimates.py --bin build/bin --output runs/time_estimates --csv docs/results/import/time_estimates.csv

Simulates small recordings of two worlds and four true exposure lengths: 96x72, 16 frames every 33 ms, about 8 px of
motion from frame to frame, rendered at least every millisecond, one clock. Each exists twice: without exposure lengths,
which the import then estimates, and with exposures.csv. OUTPUT keeps the recordings and the log of each import. CSV is
written after every recording.

Columns: world, seed, true_ms; found_ms, standard_error_ms and scatter_ms (jackknife) of the exposure length, empty in
recordings with exposures.csv; offset_ms (true: 0) and offset_error_ms, the standard error, to 0.1 ms; doubtful: what the
import doubts or refuses. The scatter is what remains of the standard error without the constants of exposure_length.cpp.
"""
from __future__ import annotations

import argparse
import csv
import json
import re
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = ("world", "seed", "true_ms", "found_ms", "standard_error_ms", "scatter_ms", "offset_ms", "offset_error_ms", "doubtful")
WORLDS, SEEDS, LENGTHS_MS = ("desk", "clutter"), (1, 2), (3, 5, 10, 20)
PERIOD_MS, MOTION_PX = 33, 8  # from one frame to the next
LATENESS_MS, SHAPE_SHARE = 0.5, 0.02  # kLateness_us and kShapeShare of exposure_length.cpp


class EstimateError(Exception):
    """A one-line error: what was expected, what was found."""


def call(words: list, log: Path) -> bool:
    """Runs a program; its output goes to a file. Returns whether it succeeded."""
    with open(log, "wb") as file:
        done = subprocess.run([str(word) for word in words], stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
    return done.returncode == 0


def simulate(program: Path, folder: Path, world: str, seed: int, true_ms: float, timed: bool) -> None:
    settings = {"world": world, "width": 96, "height": 72, "focal_px": 125, "exposures": 16, "test_views": 0, "seen_test_views": 0,
                "exposure_ms": true_ms, "gap_ms": PERIOD_MS - true_ms, "motion.blur_px": MOTION_PX * true_ms / PERIOD_MS,
                "sampling.min_fps": 1000, "recording.exposure_times": str(timed).lower()}
    words = [word for key, value in settings.items() for word in ("--set", f"simulate.{key}={value}")]
    log = folder / "simulate.log"
    if not call([program, "--recording", "--seed", seed, *words, "--output", folder / "recording"], log):
        raise EstimateError(f"{folder}: expected a recording, found none; see {log}")


def scatter_ms(exposure: dict) -> float | None:
    """The jackknife's part of a standard error; None at either end of the tried lengths, where the import makes none."""
    losses, length_ms = exposure["curve"]["loss"], exposure["length_us"] / 1000
    square = (exposure["standard_error_us"] / 1000) ** 2 - (LATENESS_MS + SHAPE_SHARE * length_ms) ** 2
    inside = 0 < losses.index(min(losses)) < len(losses) - 1
    return max(square, 0) ** 0.5 if inside else None


def estimates(program: Path, folder: Path) -> dict:
    """Imports a recording until the stage `time`, and reads what it found."""
    log = folder / "import.log"
    if not call([program, folder / "recording", "--output", folder / "data", "--until", "time"], log):
        errors = re.findall(r"error: (.*)", log.read_text(errors="replace"))
        if not errors:
            raise EstimateError(f"{folder}: expected an import or an error, found neither; see {log}")
        return {"doubtful": f"refused: {errors[-1].replace(f'{folder}/', '')}"}
    clock = json.loads((folder / "data/import/time/clock.json").read_text())
    row, doubts = {}, []
    if exposure := clock.get("exposure"):
        row = {"found_ms": exposure["length_us"] / 1000, "standard_error_ms": exposure["standard_error_us"] / 1000,
               "scatter_ms": scatter_ms(exposure)}
        doubts += re.findall(r"doubtful.*", exposure["said"])
    if found := re.match(r"(\S+) \+- (\S+) ms found", clock["said"]):
        row |= {"offset_ms": float(found[1]), "offset_error_ms": float(found[2])}
    if not found or "although" in clock["said"]:
        doubts.append(f"offset {clock['said']}")
    return row | {"doubtful": "; ".join(doubts)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/bin", help="folder of the programs")
    parser.add_argument("--output", type=Path, required=True, help="folder of the recordings and imports")
    parser.add_argument("--csv", type=Path, required=True, help="write the table here")
    o = parser.parse_args()
    try:
        rows = [COLUMNS]
        for timed, world, true_ms, seed in product((False, True), WORLDS, LENGTHS_MS, SEEDS):
            folder = o.output.resolve() / f"{world}_{true_ms}_ms_{seed}{'_timed' if timed else ''}"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            simulate(o.bin / "jade_simulate", folder, world, seed, true_ms, timed)
            row = {"world": world, "seed": seed, "true_ms": true_ms, **estimates(o.bin / "jade_import", folder)}
            rows.append([f"{value:.2f}" if isinstance(value := row.get(column), float) else str(value or "") for column in COLUMNS])
            print(",".join(rows[-1]), flush=True)
            with open(o.csv, "w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)
    except (EstimateError, OSError, KeyError, ValueError) as error:
        print(f"time_estimates: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
