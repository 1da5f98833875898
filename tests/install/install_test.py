#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Installs with cmake --install into a folder that is then moved: installed files refer to no path of the build, the
programs find their files, and another project differentiates through the op.

  install_test.py BUILD_FOLDER SOURCE_FOLDER
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.request
from pathlib import Path

BUILD, SOURCE = (Path(argument).resolve() for argument in sys.argv[1:3])
TINY = ["simulate.width=64", "simulate.height=48", "simulate.focal_px=70", "simulate.exposures=4"]


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="jade-install-")
        root = Path(cls.folder.name)
        done = subprocess.run(["cmake", "--install", BUILD, "--prefix", root / "first"], capture_output=True, text=True)
        if done.returncode != 0:
            raise AssertionError(done.stdout + done.stderr)
        cls.prefix = root / "moved" / "jade"
        cls.prefix.parent.mkdir()
        (root / "first").rename(cls.prefix)
        cls.work = root / "work"
        cls.work.mkdir()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def environment(self):
        """Without variables that lead to the build."""
        kept = {name: os.environ[name] for name in ("HOME", "TMPDIR", "LANG") if name in os.environ}
        return kept | {"PATH": "/usr/bin:/bin", "JADE_CACHE": str(self.work / "cache")}

    def call(self, program, *arguments):
        """Runs a program in another folder."""
        done = subprocess.run([self.prefix / "bin" / program, *map(str, arguments)], cwd=self.work, env=self.environment(),
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def first_page(self, program, *arguments):
        """Starts a program that serves a page, and returns that page."""
        process = subprocess.Popen([self.prefix / "bin" / program, *arguments], cwd=self.work, env=self.environment(),
                                   stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True)
        try:
            said = ""
            for line in process.stdout:
                said += line
                if address := re.search(r"http://\S+", line):
                    with urllib.request.urlopen(address.group(), timeout=30) as page:
                        return page.read().decode()
            raise AssertionError(f"{program}: expected an address, found {said}")
        finally:
            process.terminate()
            process.communicate()

    def paths_of_the_build(self, folder):
        """Names of the folders of build and sources in files below `folder`, and how many files were searched."""
        found, searched = [], 0
        for path in sorted(folder.rglob("*")):
            if path.is_symlink() or not path.is_file():
                continue
            content = path.read_bytes()
            searched += 1
            for place in {str(BUILD), str(SOURCE)}:
                found += [f"{path}: {text.decode()}" for text in re.findall(re.escape(place.encode()) + rb"/[\w./+-]{3,}", content)]
        return found, searched

    def test_no_path_of_the_build_is_left(self):
        found, searched = self.paths_of_the_build(self.prefix)
        self.assertEqual(found[:3], [])
        self.assertGreater(searched, 50)
        # The search finds such a path in a program that is compiled without the project's flags.
        spoilt = self.work / "spoilt"
        spoilt.mkdir()
        (spoilt / "a.cpp").write_text(f'#line 1 "{SOURCE}/lib/a.cpp"\nconst char* name() {{ return __FILE__; }}\n')
        subprocess.run(["c++", "-c", "a.cpp", "-o", "a.o"], cwd=spoilt, check=True)
        (spoilt / "a.cpp").unlink()
        self.assertEqual(len(self.paths_of_the_build(spoilt)[0]), 1)
        for program in sorted((self.prefix / "bin").iterdir()):
            said = subprocess.run(["readelf", "-d", program], capture_output=True, text=True).stdout
            for entry in re.search(r"R(?:UN)?PATH.*\[(.*)\]", said).group(1).split(":"):
                self.assertTrue(entry.startswith("$ORIGIN/"), f"{program}: {entry}")

    def test_programs_find_their_files(self):
        self.call("jade_simulate", "--config", "configs/simulate/demo.yaml", *[w for s in TINY for w in ("--set", s)],
                  "--output", "data")
        self.assertIn("64", self.call("jade_inspect", "data"))
        self.call("jade_train", "--config", "configs/demo.yaml", "--set", "dataset.path=data", "--set", "train.iterations=20",
                  "--set", "init.points=500", "--device", "cpu", "--output", "run")
        self.assertTrue((self.work / "run" / "report.html").exists())
        self.call("jade_export", "--run", "run", "--output", "scene.spz")
        self.assertGreater((self.work / "scene.spz").stat().st_size, 1000)
        self.assertIn("<html", self.first_page("jade_view", "run", "--device", "cpu", "--serve=0"))

    def test_another_project_uses_the_op(self):
        project, built = self.work / "consumer", self.work / "consumer-build"
        shutil.copytree(SOURCE / "tests" / "install" / "consumer", project)
        for command in (["cmake", "-G", "Ninja", "-S", project, "-B", built, f"-DCMAKE_PREFIX_PATH={self.prefix}"],
                        ["cmake", "--build", built]):
            done = subprocess.run(command, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        said = subprocess.run([built / "consumer"], capture_output=True, text=True)
        self.assertEqual(said.returncode, 0, said.stderr)
        image, gradient = map(float, re.fullmatch(r"image ([\d.]+) gradient ([\d.]+)\n", said.stdout).groups())
        self.assertGreater(image, 1)
        self.assertGreater(gradient, 1e-3)

    def test_another_torch_is_refused(self):
        other = self.work / "torch"
        other.mkdir()
        (other / "version.py").write_text("__version__ = '1.0.0'\n")
        done = subprocess.run(["cmake", "-G", "Ninja", "-S", SOURCE / "tests" / "install" / "consumer", "-B", self.work / "refused",
                               f"-DCMAKE_PREFIX_PATH={self.prefix}", f"-DJADE_TORCH_ROOT={other}"],
                              capture_output=True, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertRegex(" ".join(done.stderr.split()), r"expected LibTorch [\d.+a-z]+, which jade was built with, found 1\.0\.0")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
