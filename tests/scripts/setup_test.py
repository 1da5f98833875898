# SPDX-License-Identifier: Apache-2.0
"""Tests of setup.sh with stubs for apt, pip and Python: optional and required packages; and how all shell scripts
print their usage.
"""
import os
import re
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
# $UNKNOWN names packages unknown to apt, $BROKEN those that it cannot install.
APT_CACHE = """for word in $UNKNOWN; do [ "$word" != "$2" ] || exit 100; done; [ "$UNKNOWN" != all ]"""
APT_GET = """echo "apt $*" >>"$LOG"
case "$* " in *" install "*) for word in $BROKEN; do case "$* " in *" $word "*) exit 100 ;; esac; done
  for word; do echo "$word" >>"$INSTALLED"; done ;; esac"""
DPKG = """[ -n "$COMPLETE" ] && [ "$3" != hdf5-plugin-lzf ] || grep -qx "$3" "$INSTALLED" || exit 1; echo ii"""
# `python3 -m venv [--clear] .venv`
PYTHON = """echo "python3 $*" >>"$LOG"; [ -z "$NO_VENV" ] || exit 1
for last; do :; done
mkdir -p "$last/bin"; cp "$STUB" "$last/bin/python"; touch "$last/pip" """
# Stub of .venv's Python without any wheel.
VENV_PYTHON = """case "$*" in
  "-m pip --version") [ -e .venv/pip ] ;;
  "-m pip"*) echo "pip $*" >>"$LOG"; [ -z "$OFFLINE" ] ;;
  "- "*) shift; echo "$*" ;;
esac"""


class Setup(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name).resolve()
        self.log, self.installed = self.root / "log", self.root / "installed"
        self.installed.touch()
        (self.root / "scripts").mkdir()
        for path in SCRIPTS.glob("*"):
            if path.is_file():
                shutil.copy(path, self.root / "scripts")
        for name, body in (("apt-cache", APT_CACHE), ("apt-get", APT_GET), ("dpkg-query", DPKG), ("python3", PYTHON), ("id", "echo 0"),
                           ("venv-python", VENV_PYTHON), ("node", ":"), ("google-chrome", ":")):
            self.program(f"bin/{name}", body)

    def program(self, name, body):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)

    def run_setup(self, *flags, **settings):
        """Exit code, output, and recorded calls, in one text."""
        self.log.write_text("")
        names = {"UNKNOWN": "", "BROKEN": "", "COMPLETE": "", "NO_VENV": "", "OFFLINE": ""} | settings
        names |= {"LOG": str(self.log), "INSTALLED": str(self.installed), "STUB": str(self.root / "bin/venv-python")}
        path = f"{self.root / 'bin'}:{os.environ['PATH']}"
        done = subprocess.run([self.root / "scripts" / "setup.sh", *flags], capture_output=True, text=True,
                              env=os.environ | names | {"PATH": path})
        return done.returncode, done.stderr, self.log.read_text()

    def refused(self, pattern, **settings):
        """The last line gives the reason, and nothing was installed into .venv."""
        code, said, called = self.run_setup(**settings)
        self.assertEqual(code, 3, said)
        self.assertRegex(said.splitlines()[-1], f"^setup: .*{pattern}")
        self.assertNotIn("pip -m pip install", called)

    def test_all_that_is_missing_is_installed(self):
        code, said, called = self.run_setup()
        self.assertEqual(code, 0, said)
        self.assertRegex(called, r"apt -qq install -y --no-install-recommends g\+\+ cmake .*libcpp-httplib-dev\n")
        self.assertRegex(called, "apt -qq install .* hdf5-plugin-lzf\n")
        self.assertRegex(called, "pip -m pip install .*--no-deps torch==")
        self.assertTrue(said.endswith("setup: everything is there\n"))
        self.assertNotIn("apt ", self.run_setup(COMPLETE="yes")[2])

    def test_only_what_is_optional_may_be_left_out(self):
        for setting in ({"UNKNOWN": "hdf5-plugin-lzf"}, {"BROKEN": "hdf5-plugin-lzf"}):
            self.installed.write_text("")
            code, said, _ = self.run_setup(**setting)
            self.assertEqual(code, 0, said)
            self.assertIn("setup: optional, cannot be had and is left out: hdf5-plugin-lzf\n", said)
        self.installed.write_text("")
        self.refused("apt does not know these packages, which are needed: cmake libzip-dev; is there a network", UNKNOWN="cmake libzip-dev")
        self.refused(r"apt does not know these packages, which are needed: g\+\+ .*; is there a network", UNKNOWN="all")
        self.refused(r"apt could not install: g\+\+ cmake .*; its own words are above", BROKEN="cmake")

    def test_without_apt_or_pip_one_line_says_so(self):
        (self.root / "bin/python3").unlink()
        self.program("bin/python3", "exit 1")
        self.refused("python3 -m venv could not make .venv", COMPLETE="yes")
        self.program("bin/python3", PYTHON)
        code, said, _ = self.run_setup(COMPLETE="yes", OFFLINE="yes")
        self.assertEqual(code, 3)
        self.assertRegex(said.splitlines()[-1], "^setup: pip could not install .*[Cc]heck the network")

    def test_a_half_made_environment_is_made_anew(self):
        self.assertIn("venv --clear .venv", self.run_setup(COMPLETE="yes")[2])
        self.assertNotIn("venv --clear .venv", self.run_setup(COMPLETE="yes")[2])
        (self.root / ".venv/pip").unlink()
        code, said, called = self.run_setup(COMPLETE="yes")
        self.assertEqual(code, 0, said)
        self.assertIn("venv --clear .venv", called)
        self.assertIn("setup: making .venv anew: its pip does not work\n", said)

    def test_python_torch_brings_what_the_restorers_scripts_import(self):
        pinned = re.findall(r"^(?:h5py|opencv-python-headless)==\S+", (SCRIPTS / "requirements-import.txt").read_text(), re.M)
        self.assertEqual(len(pinned), 2)
        with_flag, without = self.run_setup("--python-torch", COMPLETE="yes")[2], self.run_setup(COMPLETE="yes")[2]
        for name in pinned:
            self.assertIn(f" {name} ", with_flag.replace("\n", " \n"))
            self.assertNotIn(name, without)

    def test_another_flag_is_told(self):
        code, said, called = self.run_setup("--figure")
        self.assertEqual((code, called), (2, ""))
        self.assertRegex(said, r"^setup: expected a flag of those below, found '--figure'\n")
        self.assertIn("scripts/setup.sh [--python-torch]", said)


class Usage(unittest.TestCase):
    def run_script(self, name, *arguments):
        return subprocess.run([f"./{name}", *arguments], cwd=SCRIPTS, capture_output=True, text=True)

    def test_every_script_says_its_usage_wherever_it_is_called_from(self):
        names = sorted(path.name for path in SCRIPTS.glob("*.sh"))
        self.assertIn("setup.sh", names)
        for name in names:
            with self.subTest(name):
                done = self.run_script(name, "--help")
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertIn(f"scripts/{name}", done.stdout)
                self.assertNotIn("set -euo", done.stdout)

    def test_other_words_start_nothing(self):
        for name, *arguments in (("setup.sh", "--no"), ("format.sh", "--chek"), ("lint.sh", "--quick"), ("fuzz.sh", "evt"),
                                 ("slurm_local.sh",), ("slurm_local.sh", "start"), ("slurm_local.sh", "begin", "folder")):
            with self.subTest(name):
                done = self.run_script(name, *arguments)
                self.assertEqual(done.returncode, 2)
                self.assertIn("expected ", done.stderr.splitlines()[0])
        self.assertFalse((SCRIPTS / "folder").exists())


if __name__ == "__main__":
    unittest.main()
