#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of --serve for docs/viewer.md: steps per second without it, without viewers, and with one
viewer.

    measure_serve.py BIN_FOLDER [--repeat N] -- FLAGS OF jade_train

The three variants alternate, so that a machine that slows down affects all of them. Steps per second are those
from the second logged line to the last; CPU seconds are the program's own, encoding included.
"""
import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from serve_test import Served, ask

WAYS = ("without --serve", "nobody looks", "one viewer")


def first_camera(url, state):
    """The page's initial view, as parameters of a frame."""
    while not state["stop"]:
        text = ask(url)[1].decode()
        if '"live"' in text:
            data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1]
            camera = json.loads(data)["scene"]["cameras"]["train"][0]
            lens = ",".join(str(camera[key]) for key in ("fx", "fy", "cx", "cy", "width", "height"))
            return f"pose={','.join(map(str, camera['poses'][4]))}&camera={lens}&view=train.0"
        time.sleep(0.1)
    return ""


def look(url, state):
    """Requests a frame as soon as the last one has arrived, like the page."""
    address = f"{url}frame?viewer=a&layer=color&{first_camera(url, state)}"
    asks = threading.Thread(target=ask_along, args=(url, state))
    asks.start()
    while not state["stop"]:
        status, _ = ask(address)
        state["frames"] += status == 200
        if status == 0:
            time.sleep(0.1)
    asks.join()


def ask_along(url, state):
    """The page's requests besides frames (front/live.js): each second the state and the current camera pose, every
    four seconds the picture of a layer that changes.
    """
    second, lines = 0, 0
    while not state["stop"]:
        status, body = ask(f"{url}state?viewer=a&generation=0&from={lines}")
        lines = json.loads(body)["count"] if status == 200 else 0
        ask(f"{url}camera?viewer=a&view=train.0")
        if second % 4 == 0:
            ask(f"{url}picture?viewer=a&view=train.0&name=render")
        second += 1
        time.sleep(1)


def one_run(program, flags, way):
    """(steps per second, CPU seconds, frames per second)"""
    with tempfile.TemporaryDirectory() as folder:
        run, state = Path(folder) / "run", {"stop": False, "frames": 0}
        command = [program, "--quiet", "--output", run, *flags]
        before, start = os.times(), time.monotonic()
        if way == WAYS[0]:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        else:
            served = Served(*command, "--serve=0")
            viewer = threading.Thread(target=look, args=(served.url, state)) if way == WAYS[2] else None
            if viewer:
                viewer.start()
            code = served.end()
            state["stop"] = True
            if viewer:
                viewer.join()
            if code != 0:
                raise RuntimeError(served.said())
        after, seconds = os.times(), time.monotonic() - start
        lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
        rates = [(line["step"], line["iterations_per_second"]) for line in lines if "iterations_per_second" in line]
        steps = rates[-1][0] - rates[0][0]
        spent = sum((b[0] - a[0]) / b[1] for a, b in zip(rates, rates[1:]))
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        return steps / spent, cpu, state["frames"] / seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("programs", type=Path)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("flags", nargs="+", help="of jade_train, after --")
    arguments = parser.parse_args()
    results = {way: [] for way in WAYS}
    for _ in range(arguments.repeat):
        for way in WAYS:
            results[way].append(one_run(arguments.programs / "jade_train", arguments.flags, way))
            print(f"{way}: {results[way][-1][0]:.3f} steps per second, {results[way][-1][1]:.1f} CPU s", file=sys.stderr, flush=True)
    print("| | steps per second | cost | CPU s | frames per second |\n|---|---:|---:|---:|---:|")
    base = statistics.median(rate for rate, _, _ in results[WAYS[0]])
    for way in WAYS:
        rate, cpu, frames = (statistics.median(values) for values in zip(*results[way]))
        print(f"| {way} | {rate:.3f} | {100 * (base / rate - 1):.1f} % | {cpu:.1f} | {frames:.1f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
