#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Interrupts training at random moments and checks that only the steps since the last checkpoint are lost.

    kill_test.py BIN_FOLDER [KILLS]

Simulates a tiny scene and trains it twice: once without interruption, and once with kill -9, SIGTERM, SIGHUP and
Ctrl-C at random moments, resumed each time. Both must give bit-identical Gaussians. Then the disk "fills up" (a
limit on file size) while a checkpoint is saved. The target is routed, so that the router and its Adam state are
covered too.
"""
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SIMULATION = """
seed: 3
simulate:
  scene: desk
  width: 48
  height: 36
  focal_px: 62
  exposures: 3
  test_views: 1
  seen_test_views: 1
  motion: {blur_px: 4}
"""
ITERATIONS = 300
EVERY = 10
ROOT = Path(__file__).resolve().parents[2]
RESTORER = ROOT / "assets" / "efnet_anytime.pt"
TRAINING = f"""
extends: {ROOT / "configs" / "paper.yaml"}
device: cpu
efnet: {{path: {RESTORER}}}
events: {{threshold_positive: 0.25}}
init: {{points: 300}}
densify: {{every: 50, until: 300, max_gaussians: 800, gradient_threshold: 1e-5}}
objective: {{target: routed, warmup: 60}}
train: {{iterations: {ITERATIONS}, log_every: 1, evaluate_every: 0, picture_every: 0}}
checkpoint: {{every: {EVERY}}}
"""


def fail(message):
    sys.exit(f"FAILED: {message}")


class Scene:
    def __init__(self, programs, folder):
        self.programs, self.folder = programs, folder
        (folder / "simulation.yaml").write_text(SIMULATION)
        (folder / "training.yaml").write_text(TRAINING)
        self.check([self.program("jade_simulate"), "--config", folder / "simulation.yaml", "--output",
                    folder / "data"])

    def program(self, name):
        return self.programs / name

    def check(self, command):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            fail(f"{command}: exit code {done.returncode}\n{done.stderr}")

    def train_command(self, run, resume):
        command = [self.program("jade_train"), "--config", self.folder / "training.yaml", "--set",
                   f"dataset.path={self.folder / 'data'}", "--set",
                   f"cache.folder={self.folder / 'cache'}", "--output", run, "--quiet"]
        return command + (["--resume"] if resume else [])

    def train(self, run, resume=False):
        self.check(self.train_command(run, resume))


def checkpoints(run):
    return sorted(int(path.stem.split("_")[1]) for path in (run / "checkpoints").glob("step_*.pt"))


def metrics(run):
    path = run / "metrics.jsonl"
    return path.read_text() if path.exists() else ""


def last_logged_step(run):
    steps = [0]
    for line in metrics(run).splitlines():
        try:
            steps.append(json.loads(line)["step"])
        except ValueError:
            pass  # the line that was being written
    return max(steps)


def interrupted_runs(scene, kills, whole_seconds):
    """Trains with `kills` interruptions of running steps; returns the finished run's folder."""
    draw = random.Random(1)
    names = {signal.SIGKILL: "kill -9", signal.SIGTERM: "SIGTERM", signal.SIGINT: "Ctrl-C", signal.SIGHUP: "SIGHUP"}
    done, early, attempt, lost = 0, 0, 0, []
    run = scene.folder / "killed"
    while done < kills:
        attempt += 1
        if attempt > 5 * kills:
            fail(f"only {done} of {kills} interruptions hit a running program")
        process = subprocess.Popen(scene.train_command(run, resume=True), stdout=subprocess.DEVNULL,
                                   stderr=subprocess.PIPE, text=True)
        started_at, logged_before = (checkpoints(run) or [0])[-1], metrics(run)
        time.sleep(draw.uniform(0.1, min(whole_seconds, 4)))
        how = draw.choice(list(names))
        process.send_signal(how)
        error = process.communicate(timeout=60)[1]
        reached, saved = last_logged_step(run), (checkpoints(run) or [0])[-1]
        if process.returncode == 0:  # finished before the signal: start again
            run = scene.folder / f"killed-{attempt}"
            continue
        expected = {-9} if how == signal.SIGKILL else {130, -how}
        if process.returncode not in expected:
            fail(f"{names[how]}: exit code {process.returncode}, expected one of {expected}\n{error}")
        # Stopped while preparing the views, it has not changed the log of the previous run.
        prepared = metrics(run) != logged_before
        if process.returncode == 130 and prepared and reached != saved:
            fail(f"{names[how]}: stopped at step {reached}, but the newest checkpoint is {saved}")
        if reached - saved > EVERY:
            fail(f"{names[how]}: {reached - saved} steps lost at step {reached}")
        if prepared and reached > started_at:
            lost.append(reached - saved)
            done += 1
        else:
            early += 1
    scene.train(run, resume=True)
    print(f"{done} interruptions of running steps and {early} before the first one, "
          f"{max(lost)} steps lost at most")
    return run


def gone_reader(scene):
    """Ctrl-C under `| tee` ends tee first: the program's output is lost, but it must save."""
    run = scene.folder / "tee"
    process = subprocess.Popen(scene.train_command(run, resume=False), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    while last_logged_step(run) < 3 and process.poll() is None:
        time.sleep(0.01)
    process.stderr.close()
    process.send_signal(signal.SIGINT)
    if process.wait(timeout=60) != 130 or not checkpoints(run):
        fail(f"nobody reads stderr: exit code {process.returncode}, checkpoints {checkpoints(run)}")
    print(f"nobody reads stderr: saved at step {checkpoints(run)[-1]}")
    scene.train(run, resume=True)
    return run


def full_disk(scene):
    run = scene.folder / "full"
    scene_command = scene.train_command(run, resume=False)

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

    done = subprocess.run(scene_command, capture_output=True, text=True, preexec_fn=limit)
    if done.returncode != 3 or "disk full" not in done.stderr or done.stderr.count("\n") != 1:
        fail(f"full disk: exit code {done.returncode}, stderr:\n{done.stderr}")
    print(f"full disk: {done.stderr.strip()}")
    left = [path.name for path in (run / "checkpoints").iterdir() if path.suffix != ".pt"]
    if left:
        fail(f"full disk: left {left} behind")
    scene.train(run, resume=True)
    return run


def main():
    programs, kills = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 20
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(programs, Path(folder))
        start = time.monotonic()
        whole = scene.folder / "whole"
        scene.train(whole)
        seconds = time.monotonic() - start
        expected = (whole / "point_cloud.ply").read_bytes()
        for run in (interrupted_runs(scene, kills, seconds), gone_reader(scene), full_disk(scene)):
            if (run / "point_cloud.ply").read_bytes() != expected:
                fail(f"{run.name}: the Gaussians differ from those of the run in peace")
        lock = subprocess.Popen(scene.train_command(scene.folder / "twice", False),
                                stderr=subprocess.DEVNULL)
        while not (scene.folder / "twice" / "config.yaml").exists():
            time.sleep(0.01)
        second = subprocess.run(scene.train_command(scene.folder / "twice", True),
                                capture_output=True, text=True)
        lock.send_signal(signal.SIGKILL)
        lock.wait()
        if second.returncode != 3 or "another process" not in second.stderr:
            fail(f"two runs in a folder: exit code {second.returncode}, stderr:\n{second.stderr}")
        print(f"two runs in a folder: {second.stderr.strip()}")


if __name__ == "__main__":
    main()
