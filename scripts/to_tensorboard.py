#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the numbers in a run's metrics.jsonl as scalars for TensorBoard, to RUN/tensorboard.

    .venv/bin/pip install tensorboard
    .venv/bin/python scripts/to_tensorboard.py RUN [--follow]
    .venv/bin/tensorboard --logdir RUN/tensorboard

Replaces what an earlier call wrote. --follow adds new lines as training writes them, until Ctrl-C. Needs torch and
tensorboard.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

SECONDS_BETWEEN_READS = 2


def scalars(line: str) -> dict:
    """The numbers of a line of metrics.jsonl; empty if the line is not whole."""
    try:
        values = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return {key: value for key, value in values.items() if isinstance(value, (int, float)) and not isinstance(value, bool)}


def write(writer, metrics: Path, follow: bool) -> int:
    """Adds every line of `metrics` to the writer; returns their number."""
    count = 0
    with metrics.open() as lines:
        while True:
            at = lines.tell()
            line = lines.readline()
            if line.endswith("\n"):
                values = scalars(line)
                for key, value in values.items():
                    if key != "step":
                        writer.add_scalar(key, value, int(values.get("step", count)))
                count += 1
                continue
            if not follow:
                return count
            lines.seek(at)
            writer.flush()
            time.sleep(SECONDS_BETWEEN_READS)


def fail(message: str):
    print(f"error: {message}", file=sys.stderr)
    sys.exit(3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="run directory of jade_train")
    parser.add_argument("--follow", action="store_true", help="go on while training writes")
    options = parser.parse_args()
    metrics = options.run / "metrics.jsonl"
    if not metrics.is_file():
        fail(f"{metrics}: expected the metrics of a run directory of jade_train, found no file")
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as problem:
        fail(f"expected the Python packages torch and tensorboard, found {problem}; pip install tensorboard")
    folder = options.run / "tensorboard"
    for earlier in folder.glob("events.out.tfevents.*"):
        earlier.unlink()
    with SummaryWriter(str(folder)) as writer:
        try:
            count = write(writer, metrics, options.follow)
        except KeyboardInterrupt:
            return
    print(f"{folder}: {count} lines")


if __name__ == "__main__":
    main()
