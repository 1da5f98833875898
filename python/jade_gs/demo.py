# SPDX-License-Identifier: Apache-2.0
"""jade_demo: simulates blurry frames and events, trains a scene from them, scores it and opens the report."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import webbrowser
from pathlib import Path

from jade_gs.launch import PROGRAMS, SHARE, Unusable, environment


def commands(output: Path, more: list[str]) -> list[list[str]]:
    """The remaining commands: existing data is kept, and an interrupted training is resumed."""
    data, run = output / "data", output / "run"
    todo = []
    if not (data / "simulation.yaml").is_file():
        todo.append(["jade_simulate", "--config", str(SHARE / "configs/simulate/demo.yaml"), "--output", str(data)])
    if not (run / "report.html").is_file():
        resume = ["--resume"] if any((run / "checkpoints").glob("*")) else []
        todo.append(["jade_train", "--config", str(SHARE / "configs/demo.yaml"), "--set", f"dataset.path={data}",
                     "--output", str(run), *resume, *more])
    return [*todo, ["jade_eval", "--run", str(run)]]


def main() -> int:
    parser = argparse.ArgumentParser(prog="jade_demo", description=__doc__.split(": ", 1)[1],
                                     epilog="What else is given goes to jade_train, such as --set train.iterations=500.")
    parser.add_argument("--output", type=Path, default=Path("jade-demo"), help="folder of data and run [jade-demo]")
    parser.add_argument("--no-open", action="store_true", help="do not open the report in a browser")
    given, more = parser.parse_known_args()
    output = given.output.absolute()
    try:
        surroundings = environment()
    except Unusable as problem:
        print(f"error: jade_demo: {problem}", file=sys.stderr)
        return 4
    for name, *arguments in commands(output, more):
        print("\n+ " + " ".join([name, *arguments]), file=sys.stderr, flush=True)
        try:
            code = subprocess.run([PROGRAMS / name, *arguments], env=surroundings).returncode
        except KeyboardInterrupt:
            # The program saves and says so itself; the same command resumes it.
            code = 130
        if code != 0:
            return code
    report = output / "run" / "report.html"
    print(f"\nreport: {report}\nscene:  {output / 'run' / 'point_cloud.ply'} (drop it into any 3D Gaussian viewer)")
    # On a desktop only; elsewhere a text browser would take over the terminal.
    if not given.no_open and sys.stdout.isatty() and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        webbrowser.open(report.as_uri())
    return 0
