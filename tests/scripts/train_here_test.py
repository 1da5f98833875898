# SPDX-License-Identifier: Apache-2.0
"""Tests of scripts/efnet/train_here.sh with stubs that only print their arguments."""

import os
import signal
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "efnet" / "train_here.sh"
SIMULATE = """#!/bin/bash
echo "$*" >> {here}/asked
while [ $# -gt 0 ]; do case $1 in --output) out=$2;; --seed) seed=$2;; esac; shift; done
[ "$seed" != {slow} ] || sleep 60
[ "$seed" != {bad} ] || {{ echo "error: no room"; exit 3; }}
mkdir -p "$out" && echo film > "$out/footage.npy"
"""
PYTHON = """#!/bin/bash
[ "$1" != -c ] || {{ printf '%s\\n' "${{@:3}}" > {here}/checked; echo {gpus}; exit {refused}; }}
printf '%s\\n' "$@" > {here}/trained
{then}
"""


class TrainHere(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.here = Path(folder.name)
        self.output = self.here / "my run"

    def program(self, name: str, text: str) -> Path:
        path = self.here / name
        path.write_text(text)
        path.chmod(0o755)
        return path

    def start(self, *options: str, gpus: int = 1, slow: int = 0, bad: int = 0, refused: int = 0, then: str = "exit 0",
              deaf: bool = False) -> subprocess.Popen:
        """deaf: as started by nohup in the background, with SIGINT ignored."""
        self.program("jade_simulate", SIMULATE.format(here=self.here, slow=slow, bad=bad))
        python = self.program("python", PYTHON.format(here=self.here, gpus=gpus, refused=refused, then=then))
        return subprocess.Popen(
            [SCRIPT, "--output", self.output, "--films", "3", "--first", "11", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, env={**os.environ, "JADE_BIN": str(self.here), "PYTHON": str(python)}, cwd=self.here,
            preexec_fn=(lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) if deaf else None)

    def run_script(self, *options: str, **how) -> tuple[int, str]:
        process = self.start(*options, **how)
        _, said = process.communicate(timeout=50)
        return process.returncode, said

    def films(self, folder: str) -> list[str]:
        return sorted(p.parent.name for p in (self.output / folder).rglob("footage.npy"))

    def asked(self) -> list[str]:
        path = self.here / "asked"
        return path.read_text().splitlines() if path.exists() else []

    def trained(self) -> list[str]:
        return (self.here / "trained").read_text().splitlines()

    def test_trains_on_what_it_renders(self):
        code, said = self.run_script("--size", "64x48", "--compile", "--max-minutes", "9")
        self.assertEqual((code, said), (0, ""))
        self.assertEqual(self.films("held_out"), [str(900001 + i) for i in range(8)])
        self.assertGreaterEqual(len(self.films("films")), 2)
        self.assertEqual(self.trained(), [
            str(SCRIPT.parent / "train_efnet.py"), "--output", str(self.output), "--footage", str(self.output / "films"),
            "--held-out-footage", str(self.output / "held_out"), "--compile", "--max-minutes", "9"])
        odd = next(line for line in self.asked() if "--seed 11 " in line)
        self.assertRegex(odd, "world=gallery --set simulate.width=64 --set simulate.height=48 --footage 37 ")
        even = next(line for line in self.asked() if "--seed 12 " in line)
        self.assertIn("world=clutter", even)

    def test_a_second_start_renders_what_is_missing(self):
        wait = f"while [ $(find '{self.output}/films' -name footage.npy | wc -l) -lt 3 ]; do sleep 0.1; done"
        self.assertEqual(self.run_script(then=wait)[0], 0)
        (self.here / "asked").unlink()
        (self.output / "films" / "12" / "footage.npy").unlink()
        (self.output / "films" / "12").rmdir()
        self.assertEqual(self.run_script(then=wait)[0], 0)
        self.assertEqual([line.split("--seed ")[1].split()[0] for line in self.asked()], ["12"])

    def test_several_gpus_have_a_process_each(self):
        self.assertEqual(self.run_script(gpus=4)[0], 0)
        self.assertEqual(self.trained()[:4], ["-m", "torch.distributed.run", "--nproc-per-node", "4"])

    def test_ends_as_the_training_ends_and_takes_its_renderers_along(self):
        begin = time.monotonic()
        code, _ = self.run_script("--jobs", "2", slow=13, then="exit 7")
        self.assertEqual(code, 7)
        self.assertLess(time.monotonic() - begin, 40)
        self.assert_nothing_renders()

    def interrupted(self, number: int, **how) -> int:
        process = self.start("--jobs", "2", slow=13, then="exec sleep 60", **how)
        self.addCleanup(process.kill)
        begin = time.monotonic()
        while not (self.here / "trained").exists():
            self.assertLess(time.monotonic() - begin, 30)
            time.sleep(0.05)
        time.sleep(0.3)
        process.send_signal(number)
        process.communicate(timeout=20)
        return process.returncode

    def test_a_signal_reaches_the_training_and_ends_the_renderers(self):
        for number, code, deaf in ((signal.SIGINT, 130, False), (signal.SIGTERM, 143, False), (signal.SIGTERM, 143, True),
                                   (signal.SIGHUP, 143, False)):
            with self.subTest(number, deaf=deaf):
                (self.here / "trained").unlink(missing_ok=True)
                self.assertEqual(self.interrupted(number, deaf=deaf), code)
                self.assert_nothing_renders()

    def assert_nothing_renders(self):
        time.sleep(0.3)
        left = subprocess.run(["pgrep", "-f", f"{self.here}/my run/(rendering|films)"], capture_output=True, text=True).stdout
        self.assertEqual(left, "")

    def test_a_film_that_fails_is_named_and_costs_no_training(self):
        code, said = self.run_script(bad=12)
        self.assertEqual(code, 0)
        self.assertRegex(said, r"train_here: film 12 failed, see .*rendering/12.log\n")
        self.assertIn("no room", (self.output / "rendering" / "12.log").read_text())

    def test_what_the_training_refuses_renders_nothing(self):
        self.assertEqual(self.run_script("--width", "0", refused=2)[0], 2)
        self.assertEqual((self.here / "checked").read_text().splitlines(),
                         [str(SCRIPT.parent), "320x288", "--output", str(self.output), "--width", "0"])
        self.assertEqual(self.asked(), [])

    def test_a_python_that_is_not_there_is_named(self):
        self.program("jade_simulate", "#!/bin/bash")
        done = subprocess.run([SCRIPT, "--output", self.output], capture_output=True, text=True,
                              env={**os.environ, "JADE_BIN": str(self.here), "PYTHON": "/nowhere/python"})
        self.assertEqual((done.returncode, done.stderr), (2, "train_here: PYTHON: no program at /nowhere/python\n"))

    def test_bad_arguments_are_refused_in_one_line(self):
        for options, pattern in ((["--films", "many"], "--films: expected a whole number from 1 to 999999, found 'many'"),
                                 (["--size", "64"], "--size: expected WxH such as 320x288, found '64'"),
                                 (["--films", "1"], "--films: expected at least 2"),
                                 (["--first", "900000"], "--first: expected seeds below 900001, which are held out, found up to 900002"),
                                 (["--jobs"], "--jobs: expected a value"), (["--output", ""], "--output: expected a folder")):
            with self.subTest(options):
                code, said = self.run_script(*options)
                self.assertEqual(code, 2)
                self.assertRegex(said, f"^train_here: {pattern}.*\n$")
        self.assertEqual(self.asked(), [])


if __name__ == "__main__":
    unittest.main()
