# SPDX-License-Identifier: Apache-2.0
"""Tests of demo.sh with stubs for all slow steps: when the report is opened, and that opening it never fails the
demo.
"""
import os
import pty
import shutil
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "demo.sh"
# Variables that a desktop or a CI machine sets.
SESSION = ("DISPLAY", "WAYLAND_DISPLAY", "CI")


class Demo(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name).resolve()
        self.opened = self.root / "opened"
        for name in ("scripts/setup.sh", "scripts/build.sh", "build/bin/jade_simulate", "build/bin/jade_train", "build/bin/jade_eval"):
            self.program(name, "exit 0")
        self.program("desktop/xdg-open", f"echo \"$@\" >'{self.opened}.part' && mv '{self.opened}.part' '{self.opened}'")
        shutil.copy(SCRIPT, self.root / "scripts" / "demo.sh")

    def program(self, name, body):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # the last one may still run, and such a file cannot be written
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)

    def demo(self, terminal=True, *arguments, **session):
        """The exit code; standard output is a terminal or a pipe."""
        environment = {name: value for name, value in os.environ.items() if name not in SESSION} | session
        environment["PATH"] = f"{self.root / 'desktop'}:{environment['PATH']}"
        reader, writer = pty.openpty() if terminal else os.pipe()
        try:
            done = subprocess.run([self.root / "scripts" / "demo.sh", *arguments], env=environment, stdout=writer,
                                  stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
            self.said = done.stderr
            return done.returncode
        finally:
            os.close(reader)
            os.close(writer)

    def wait_for_opening(self):
        end = time.monotonic() + 20
        while not self.opened.exists() and time.monotonic() < end:
            time.sleep(0.01)

    def test_a_desktop_opens_the_report(self):
        for session in ({"DISPLAY": ":0"}, {"WAYLAND_DISPLAY": "wayland-0"}):
            with self.subTest(session):
                self.assertEqual(self.demo(**session), 0)
                self.wait_for_opening()
                self.assertEqual(self.opened.read_text(), f"{self.root}/runs/demo/report.html\n")
                self.opened.unlink()

    def test_nothing_is_opened_elsewhere(self):
        for terminal, session in ((True, {}), (False, {"DISPLAY": ":0"}), (True, {"DISPLAY": ":0", "CI": "true"})):
            with self.subTest(terminal=terminal, **session):
                self.assertEqual(self.demo(terminal, **session), 0)
        time.sleep(0.5)
        self.assertFalse(self.opened.exists())

    def test_settings_that_come_too_late_are_not_dropped_in_silence(self):
        self.demo(False, "--set", "train.iterations=500")
        self.assertIn("jade_train --config configs/demo.yaml --output runs/demo --set train.iterations=500", self.said)
        (self.root / "runs/demo").mkdir(parents=True)
        (self.root / "runs/demo/report.html").touch()
        self.assertEqual(self.demo(False, "--set", "train.iterations=500"), 0)
        self.assertIn("demo: runs/demo is trained already, without '--set train.iterations=500'", self.said)

    def test_the_table_of_scores_is_printed_once(self):
        self.demo(False)
        self.assertIn("jade_train --config", self.said)  # which prints it
        self.assertNotIn("jade_eval --run", self.said)
        (self.root / "runs/demo").mkdir(parents=True)
        (self.root / "runs/demo/report.html").touch()
        self.demo(False)
        self.assertNotIn("jade_train --config", self.said)
        self.assertIn("jade_eval --run", self.said)

    def test_what_opens_it_may_fail_or_take_long(self):
        self.program("desktop/xdg-open", "exit 3")
        self.assertEqual(self.demo(DISPLAY=":0"), 0)
        self.program("desktop/xdg-open", "sleep 5")
        begin = time.monotonic()
        self.assertEqual(self.demo(DISPLAY=":0"), 0)
        self.assertLess(time.monotonic() - begin, 4)


if __name__ == "__main__":
    unittest.main()
