# SPDX-License-Identifier: Apache-2.0
"""Tests of scripts/battery.py with stubs that write known results."""
import csv
import io
import json
import os
import struct
import sys
import tempfile
import unittest
import zlib
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "scripts")]
import battery  # noqa: E402
import compare_poses_test  # noqa: E402

# Every program records its call and copies the files of templates(). Data sets are those of compare_poses_test.py, four
# exposures (0 to 3) and a view (4), whose poses are exact.
PROGRAM = """#!/bin/bash
name=$(basename "$0"); words="$*"
while [ $# -gt 0 ]; do case $1 in --output) out=$2;; --cameras) cameras=$2;; esac; shift; done
what=$(basename "$(dirname "$out")")
echo "$name $what $words" >> {here}/asked
one_of() {{ [ -e {here}/$1_$2 ] && echo {here}/$1_$2 || echo {here}/$1; }}
case $name in
  jade_simulate) mkdir -p "$out" && cp -r "$(one_of truth $what)" "$out/truth"; [ $what = unknown_length ] || touch "$out/exposures.csv";;
  jade_import)
    [ $what != refused ] || {{ printf 'reading...\\rreading\\nerror: expected a moving camera, found none\\n' >&2; exit 3; }}
    cp -r "$(one_of data $what)" "$out";;
  jade_render) cp -r "$(one_of $cameras $what)" "$out";;
esac
"""


def templates(here: Path) -> None:
    for name, divisor in (("truth", 1), ("truth_dark", 4)):
        truth = compare_poses_test.write(here / name, compare_poses_test.true_path)
        (truth / "simulation.yaml").write_text("simulate:\n  events:\n    threshold_positive: 0.25\n    threshold_negative: 0.2\n")
        (truth / "sharp").mkdir()
        for i in range(5):
            write_png(truth / ("images_1" if i == 4 else "sharp") / f"{i:02d}.png", picture(i) // divisor)
    for name, longer in (("data", 0), ("data_unknown_length", 8000)):
        data = compare_poses_test.write(here / name, lambda t: compare_poses_test.moved(compare_poses_test.true_path(t)))
        (data / "import" / "poses").mkdir(parents=True), (data / "import" / "sensor").mkdir()
        attempts = [{"name": "usual", "registered": 12, "images": 13, "explained_blur": 0.91}]
        (data / "import/poses/poses.json").write_text(json.dumps({"chosen": "usual", "attempts": attempts}))
        (data / "import/poses/stage.txt").write_text("key\nseconds 7.25\n")
        (data / "import/sensor/sensor.json").write_text(json.dumps({"threshold_positive": 0.26, "threshold_negative": 0.18}))
        rows = [f"{i},train,0{i},{200000 * i},{200000 * i + 80000 + longer},9" for i in range(4)] + ["4,test,04,300000,300000,0"]
        (data / "frames.csv").write_text("frame,part,name,start_us,end_us,blur_px\n" + "\n".join(rows) + "\n")
    for suffix, fault in (("", 0), ("_fault", 0.01)):
        for name, frames in (("train", range(4)), ("test", [4])):
            (here / (name + suffix)).mkdir()
            for i in frames:
                render = 0.4 * (picture(i).transpose(2, 0, 1) / 255 + fault)
                np.save(here / (name + suffix) / f"0{i}.npy", render.astype(np.float32))


def picture(number: int) -> np.ndarray:
    return (np.random.default_rng(number).random((11, 9, 3)) * 255).astype(np.uint8)


def write_png(path: Path, image: np.ndarray, filters: bytes = b"\0") -> None:
    """Rows get the filters in turn."""
    height, width, channels = image.shape
    rows, above = b"", np.zeros(width * channels, int)
    for y in range(height):
        row = image[y].reshape(-1).astype(int)
        left, corner = (np.concatenate([np.zeros(channels, int), each])[:len(row)] for each in (row, above))
        estimate = left + above - corner
        distances = [np.abs(estimate - each) for each in (left, above, corner)]
        paeth = np.choose(np.argmin(distances, 0), [left, above, corner])
        kind = filters[y % len(filters)]
        guess = [0 * row, left, above, (left + above) // 2, paeth][kind]
        rows += bytes([kind]) + ((row - guess) % 256).astype(np.uint8).tobytes()
        above = row

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class Pictures(unittest.TestCase):
    def test_png_of_every_filter_is_read(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.png"
            write_png(path, picture(3), bytes(range(5)))
            self.assertTrue(np.allclose(battery.read_png(path), picture(3) / 255))
            gray = Path(folder) / "b.png"
            write_png(gray, picture(4)[:, :, :1], bytes([4, 3]))
            self.assertTrue(np.allclose(battery.read_png(gray), np.repeat(picture(4)[:, :, :1] / 255, 3, axis=2)))

    def test_another_brightness_is_no_error(self):
        truth = picture(1) / 255
        self.assertGreater(battery.psnr(0.3 * truth, truth), 90)
        self.assertAlmostEqual(battery.psnr(truth + 0.1 * np.sign(picture(2) - 127.5), truth), 20, delta=2)


class Battery(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.here = Path(temporary.name)
        self.bin, self.configs, self.output = self.here / "bin", self.here / "configs", self.here / "out"
        self.bin.mkdir(), self.configs.mkdir()
        for name in ("jade_simulate", "jade_import", "jade_train", "jade_eval", "jade_render"):
            path = self.bin / name
            path.write_text(PROGRAM.format(here=self.here))
            path.chmod(0o755)
        templates(self.here)
        self.configs.joinpath("plain.yaml").write_text("seed: 1\n")

    def config(self, *names: str) -> None:
        for name in names:
            (self.configs / f"{name}.yaml").write_text("# a fault\nextends: plain.yaml\n")

    def call(self, *words: str) -> tuple[int, str]:
        """Exit code and errors."""
        given = ["--bin", str(self.bin), "--configs", str(self.configs), "--output", str(self.output), *words]
        errors = io.StringIO()
        with redirect_stdout(io.StringIO()), redirect_stderr(errors), mock.patch.dict(os.environ, CUDA_VISIBLE_DEVICES=""):
            return battery.main(given), errors.getvalue()

    def rows(self) -> dict[str, dict[str, str]]:
        with open(self.output / "battery.csv", newline="") as file:
            return {row["recording"]: row for row in csv.DictReader(file)}

    def asked(self) -> list[str]:
        path = self.here / "asked"
        return path.read_text().splitlines() if path.exists() else []

    def test_a_fault_is_measured_against_the_plain_scene(self):
        self.config("fault", "dark", "unknown_length")
        self.assertEqual(self.call("--jobs", "4", "--set", "train.iterations=7"), (0, ""))
        rows = self.rows()
        self.assertEqual({row["verdict"] for row in rows.values()}, {"trained"})
        fault = rows["fault"]
        self.assertEqual((fault["placed"], fault["blur"], fault["poses_s"]), ("12 of 13", "91", "7.20"))
        self.assertLess(float(fault["pose_px"]), 0.01)
        self.assertEqual((fault["on"], fault["off"], fault["threshold_error"]), ("0.260", "0.180", "-10.00"))
        for kind in ("middles", "views"):
            self.assertGreater(float(rows["plain"][f"{kind}_db"]), 90)
            self.assertGreater(float(fault[f"{kind}_loss"]), 20)
        # The dark scene is compared with the pictures of the plain one.
        self.assertGreater(float(rows["dark"]["views_db"]), 90)
        self.assertEqual(fault["exposure_ms"], "")
        self.assertEqual((rows["unknown_length"]["exposure_ms"], rows["unknown_length"]["exposure_error"]),
                         ("88.0 (true 80.0)", "10.00"))
        self.assertIn("train.iterations=7", next(line for line in self.asked() if line.startswith("jade_train")))
        imported = next(line for line in self.asked() if line.startswith("jade_import fault"))
        self.assertEqual(imported.split()[3:5], ["--output", str(self.output.resolve() / "fault" / "data")])
        self.assertIn("| fault | trained | 12 of 13 |", (self.output / "battery.md").read_text())

    def test_a_refusal_is_told_and_ends_that_recording_alone(self):
        self.config("refused")
        self.assertEqual(self.call("--jobs", "1"), (1, ""))
        rows = self.rows()
        self.assertEqual(rows["refused"]["verdict"], "refused at import: error: expected a moving camera, found none")
        self.assertEqual(rows["plain"]["verdict"], "trained")
        self.assertFalse(any(line.startswith("jade_train refused") for line in self.asked()))

    def test_what_has_ended_is_kept_and_what_failed_is_made_again(self):
        self.config("fault", "refused")
        self.call("--only", "fault")
        first = len(self.asked())
        self.assertEqual(self.call("--only", "fault"), (0, ""))
        self.assertEqual(len(self.asked()), first)
        self.assertEqual(self.rows().keys(), {"plain", "fault"})
        self.call("--only", "fault", "--set", "train.iterations=9")
        again = self.asked()[first:]
        self.assertEqual({line.split()[0] for line in again}, {"jade_train", "jade_eval", "jade_render"})
        self.call("--only", "refused")
        self.call("--only", "refused")
        self.assertEqual(sum(line.startswith("jade_import refused") for line in self.asked()), 2)
        self.assertEqual(sum(line.startswith("jade_simulate refused") for line in self.asked()), 1)

    def test_true_poses_are_trained_on_beside_the_found_ones(self):
        self.config("fault")
        self.assertEqual(self.call("--true-poses"), (0, ""))
        trained = [line for line in self.asked() if line.startswith("jade_train")]
        true = self.output.resolve() / "fault" / "true"
        self.assertTrue(any(f"--config {true}/data/scene.yaml --output {true}/run" in line for line in trained), trained)
        self.assertIn("optimize: none", (true / "data/scene.yaml").read_text())
        self.assertGreater(float(self.rows()["plain"]["true_db"]), 90)
        self.assertLess(abs(float(self.rows()["fault"]["true_loss"])), 0.01)
        self.assertEqual(self.call("--only", "plain")[0], 0)
        self.assertEqual(len([line for line in self.asked() if line.startswith("jade_train")]), len(trained))

    def test_a_plain_scene_may_extend_one_elsewhere(self):
        self.configs.joinpath("plain.yaml").write_text("extends: ../base.yaml\nseed: 1\n")
        self.config("fault")
        self.assertEqual(self.call(), (0, ""))
        self.assertEqual(self.rows().keys(), {"plain", "fault"})

    def test_it_stops_where_it_is_told_to(self):
        self.assertEqual(self.call("--until", "train"), (0, ""))
        self.assertEqual({line.split()[0] for line in self.asked()}, {"jade_simulate", "jade_import"})
        self.assertEqual(self.rows()["plain"]["verdict"], "imported")

    def test_mistakes_are_refused_before_anything_is_made(self):
        for words, named in ((("--only", "nothing"), "nothing"), (("--jobs", "0"), "--jobs"), (("--bin", str(self.here)), "jade_simulate")):
            code, error = self.call(*words)
            self.assertEqual(code, 3)
            self.assertIn(named, error)
        self.assertFalse(self.output.exists())


if __name__ == "__main__":
    unittest.main()
