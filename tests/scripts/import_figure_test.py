# SPDX-License-Identifier: Apache-2.0
"""Tests of import_figure.py on stages of an import written here."""
import json
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/import_figure.py"
sys.path.insert(0, str(SCRIPT.parent))
import import_figure  # noqa: E402
from import_figure import plt  # noqa: E402

WIDTH, HEIGHT = 16, 12


def write_capture(folder: Path):
    (folder / "frames").mkdir(parents=True)
    random = np.random.default_rng(0)
    frames = [{"name": f"f{k}", "file": f"{k}.png", "start_us": 1000 * k, "end_us": 1000 * k + (800 if k else 1)} for k in range(3)]
    for frame in frames:
        plt.imsave(folder / "frames" / frame["file"], random.random((HEIGHT, WIDTH, 3)))
    (folder / "capture.json").write_text(json.dumps({"frames": frames, "sensor_height": HEIGHT, "sensor_width": WIDTH}))
    with h5py.File(folder / "events.h5", "w") as file:
        file["x"], file["y"] = random.integers(0, WIDTH, 60), random.integers(0, HEIGHT, 60)
        file["t"], file["p"] = np.arange(60) * 50, random.choice([-1, 1], 60)


def write_import(data: Path, curve: bool):
    stages = data / "import"
    for name in ("read", "undistort"):
        write_capture(stages / name)
    for name in ("time", "sensor", "restore/images", "poses"):
        (stages / name).mkdir(parents=True)
    clock = {"offset_ms": 10.0, "said": "found"}
    if curve:
        clock["curve"] = {"from_ms": -50, "to_ms": 50, "correlation": [0.1, 0.2, 0.4, 0.9, 0.5]}
    (stages / "time/clock.json").write_text(json.dumps(clock))
    (stages / "sensor/sensor.json").write_text(json.dumps(
        {"hot_pixels": [{"row": 3, "column": 5}], "threshold_positive": 0.25, "threshold_negative": 0.2}))
    images = []
    for shot, moments in ((0, (0,)), (1, (1000, 1400, 1800)), (2, (2000, 2400, 2800))):
        for t in moments:
            images.append({"file": f"{shot}_{t}.png", "shot": shot, "t_us": t})
            plt.imsave(stages / "restore/images" / images[-1]["file"], np.full((HEIGHT, WIDTH, 3), t / 3000))
    (stages / "restore/images.json").write_text(json.dumps(images))
    poses = [{"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0.1 * k, 0, 0]} for k in range(7)]
    (stages / "poses/poses.json").write_text(json.dumps({"poses": poses}))
    np.savez(stages / "poses/points.npz", points=np.random.rand(20, 3), colors=np.zeros((20, 3), np.uint8))


class ImportFigure(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.data = Path(self.folder.name) / "data"

    def tearDown(self):
        self.folder.cleanup()

    def call(self, *words):
        return subprocess.run([sys.executable, SCRIPT, self.data, self.data / "out.png", *words], capture_output=True, text=True)

    def test_each_stage_has_its_picture(self):
        write_import(self.data, True)
        figure = import_figure.draw(self.data, None)
        read, seen, clock, sensor, straight, start, middle, end, poses = figure.axes
        self.assertEqual([axis.get_title().split(":")[0] for axis in figure.axes],
                         ["read", "read", "time", "sensor", "undistort", "restore", "restore", "restore", "poses"])
        self.assertIn("frame f2, 1 ms", read.get_title())
        self.assertIn("10.0 ms taken off", clock.get_title())
        self.assertEqual([line.get_xdata()[0] for line in clock.lines][1], 25)
        self.assertIn("1 hot pixels; Θ 0.25, 0.20", sensor.get_title())
        self.assertEqual((sensor.lines[0].get_xdata()[0], sensor.lines[0].get_ydata()[0]), (5, 3))
        shown = [axis.images[0].get_array()[0, 0, 0] for axis in (start, middle, end)]
        for found, t in zip(shown, (2000, 2400, 2800)):
            self.assertAlmostEqual(found, t / 3000, delta=0.01)
        self.assertEqual(len(poses.lines[0].get_xdata()), 7)

    def test_an_import_without_a_calibration(self):
        write_import(self.data, True)
        shutil.rmtree(self.data / "import/undistort")
        (self.data / "import/undistort").mkdir()
        done = self.call()
        self.assertEqual(done.returncode, 0, done.stderr)
        level, raw = import_figure.levelled(self.data), import_figure.Capture(self.data / "import/read")
        # The events' clock is 10 ms ahead, so the frames' events are later in the stage `read`.
        self.assertEqual(level.events(-10000, -9000)[0].tolist(), raw.events(0, 1000)[0].tolist())

    def test_polarities_and_places(self):
        found = import_figure.counts(np.array([1, 1, 2, 99]), np.array([0, 0, 1, 0]), np.array([1, 1, -1, 1]), 2, 3)
        self.assertEqual(found[0].tolist(), [[0, 2, 0], [0, 0, -1]])
        self.assertEqual(found[1].sum(), 3)
        picture = import_figure.polarity_picture(found[0])
        self.assertGreater(picture[0, 1, 0], picture[0, 1, 2])
        self.assertGreater(picture[1, 2, 2], picture[1, 2, 0])

    def test_an_older_import_and_mistakes(self):
        write_import(self.data, False)
        self.assertEqual(self.call("--frame", "f1").returncode, 0)
        self.assertTrue((self.data / "out.png").stat().st_size > 1000)
        wrong = self.call("--frame", "f9")
        self.assertEqual(wrong.returncode, 3)
        self.assertIn("expected one of f0, f1, f2, found f9", wrong.stderr)
        (self.data / "import/poses/poses.json").unlink()
        self.assertEqual(self.call().returncode, 3)
        self.assertEqual(self.call().stderr.count("\n"), 1)


if __name__ == "__main__":
    unittest.main()
