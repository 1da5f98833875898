#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the wheel's Python side, with stubs for a program and torch."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "jade_gs"
PROGRAM = '#!/bin/sh\necho "$(basename "$0") $* $JADE_PYTHON $LD_LIBRARY_PATH"\nexit 5\n'


class Launch(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.site = Path(folder.name) / "site"
        shutil.copytree(PACKAGE, self.site / "jade_gs", ignore=shutil.ignore_patterns("__pycache__"))
        (self.site / "jade_gs" / "build.py").write_text('VERSION = "0.2.0"\nTORCH = "2.11.0"\n')
        for name in ("jade_simulate", "jade_train", "jade_eval"):
            program = self.site / "jade_gs" / "bin" / name
            program.parent.mkdir(exist_ok=True)
            program.write_text(PROGRAM)
            program.chmod(program.stat().st_mode | stat.S_IXUSR)

    def add_torch(self, site, version):
        (site / "torch").mkdir(parents=True)
        (site / "torch" / "__init__.py").write_text("raise ImportError('nobody imports torch, which takes seconds')\n")
        (site / f"torch-{version}.dist-info").mkdir()
        (site / f"torch-{version}.dist-info" / "METADATA").write_text(f"Metadata-Version: 2.1\nName: torch\nVersion: {version}\n")

    def call(self, module, *arguments, argv0="jade_train", paths=()):
        code = f"import sys; sys.argv[0] = {argv0!r}; from jade_gs.{module} import main; sys.exit(main())"
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (self.site, *paths)))}
        environment.pop("JADE_PYTHON", None)
        environment.pop("LD_LIBRARY_PATH", None)
        # -S: without the packages of this interpreter, torch among them.
        return subprocess.run([sys.executable, "-S", "-c", code, *arguments], env=environment, capture_output=True, text=True)

    def test_the_program_takes_over(self):
        self.add_torch(self.site, "2.11.0")
        done = self.call("launch", "--set", "a=b c")
        self.assertEqual((done.returncode, done.stderr), (5, ""))
        self.assertEqual(done.stdout, f"jade_train --set a=b c {sys.executable} \n")

    def test_a_torch_elsewhere_is_handed_on(self):
        elsewhere = self.site.parent / "elsewhere"
        self.add_torch(elsewhere, "2.11.0+cpu")
        done = self.call("launch", paths=[elsewhere])
        self.assertEqual(done.returncode, 5)
        self.assertIn(f" {elsewhere.resolve()}/torch/lib:{elsewhere.resolve()}/nvidia/cu13/lib:", done.stdout)

    def test_metrics_speaks_of_itself(self):
        script = self.site / "jade_gs" / "share" / "jade" / "scripts" / "export_lpips.py"
        script.parent.mkdir(parents=True)
        script.write_text(
            "import argparse\n\n\ndef main():\n    print(argparse.ArgumentParser().prog)\n    return 3\n"
        )
        done = self.call("metrics", argv0="/usr/bin/jade_metrics")
        self.assertEqual((done.returncode, done.stdout, done.stderr), (3, "jade_metrics\n", ""))

    def test_no_torch_and_another_torch_are_one_line(self):
        done = self.call("launch")
        self.assertEqual(done.returncode, 4)
        self.assertRegex(done.stderr, r"^error: jade_train: expected torch 2\.11\.0, found none; run .* install torch==2\.11\.0\n$")
        self.add_torch(self.site, "2.12.1")
        done = self.call("launch")
        self.assertEqual(done.returncode, 4)
        self.assertRegex(done.stderr, r"^error: jade_train: expected torch 2\.11\.0, .*, found 2\.12\.1; run .*\n$")
        self.assertEqual(self.call("demo", argv0="jade_demo").returncode, 4)

    def test_the_demo_does_what_is_left_and_stops_at_a_failure(self):
        self.add_torch(self.site, "2.11.0")
        output = self.site.parent / "out"
        done = self.call("demo", "--output", str(output), "--set", "train.iterations=5", argv0="jade_demo")
        self.assertEqual(done.returncode, 5)
        self.assertRegex(done.stdout, r"^jade_simulate --config .*configs/simulate/demo\.yaml .*\n$")
        (output / "data").mkdir(parents=True)
        (output / "data" / "simulation.yaml").touch()
        (output / "run" / "checkpoints").mkdir(parents=True)
        (output / "run" / "checkpoints" / "a").touch()
        done = self.call("demo", "--output", str(output), "--set", "train.iterations=5", argv0="jade_demo")
        self.assertRegex(done.stdout, r"^jade_train .* --resume --set train\.iterations=5 .*\n$")
        (output / "run" / "report.html").touch()
        done = self.call("demo", "--output", str(output), argv0="jade_demo")
        self.assertRegex(done.stdout, r"^jade_eval --run .*\n$")


if __name__ == "__main__":
    unittest.main()
