# SPDX-License-Identifier: Apache-2.0
"""Tests of compare_poses.py on poses of data sets written here."""
import io
import sys
import tempfile
import unittest
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import compare_poses  # noqa: E402
from compare_poses import Poses, Scene  # noqa: E402

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
EXPOSURE_US = 80_000


def true_path(times: np.ndarray) -> Poses:
    """A camera on a bent line that turns by some degrees."""
    u = times / 1e6
    turns = np.stack([0.2 * np.sin(3 * u), 0.3 * u, 0.1 * u**2], -1)
    return Poses(compare_poses.turned_by(turns), np.stack([2 * u, 0.3 * np.cos(4 * u), 0.2 * u**2], -1))


def moved(poses: Poses) -> Poses:
    """Returns the cameras in other axes and another unit."""
    turn = compare_poses.turned_by(np.array([[0.4, -2.1, 0.9]]))[0]
    return Poses(turn @ poses.axes, 0.37 * poses.centres @ turn.T + np.array([5.0, -3, 8]))


def write(folder: Path, poses_at, offset_us: float = 0) -> Path:
    """Four exposures and a sharp view; a dense path around them."""
    (folder / "images_1").mkdir(parents=True)
    start = np.array([0, 200_000, 400_000, 600_000, 300_000]) + offset_us
    length = np.array([EXPOSURE_US] * 4 + [0])
    np.savez(folder / "images_1" / "timestamps.npz", timestamps_start=start, timestamps_end=start + length)
    template = np.zeros((1, 17))
    template[:, :15].reshape(-1, 3, 5)[:, :, 4] = (HEIGHT, WIDTH, FOCAL)
    template[:, 15:] = (2, 6)

    def rows(times):
        return compare_poses.rows_with(template.repeat(len(times), 0), poses_at(times - offset_us))

    dense = np.arange(-10_000, 700_000, 1_000) + offset_us
    np.save(folder / "poses_bounds.npy", rows(start + length / 2))
    np.save(folder / "all_poses_bounds.npy", rows(dense))
    np.save(folder / "all_timestamps.npy", dense)
    np.savez(folder / "points.npz", points=np.ones((3, 3)))
    (folder / "scene.yaml").write_text("extends: base.yaml\n")
    return folder


class ComparePoses(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = Path(self.temporary.name)
        self.truth = write(self.folder / "truth", true_path)

    def tearDown(self):
        self.temporary.cleanup()

    def compare(self, data: Path) -> dict[str, float]:
        return compare_poses.compare(Scene(data), Scene(self.truth))[0]

    def test_other_axes_and_another_unit_are_no_error(self):
        found = self.compare(write(self.folder / "data", lambda t: moved(true_path(t))))
        self.assertEqual(found["exposures"], 4)
        self.assertEqual(max(v for k, v in found.items() if k.endswith("px")), 0)

    def test_a_turn_by_a_pixel_is_an_error_of_a_pixel(self):
        def to_the_side(times):
            poses = true_path(times)
            # To one side at the starts, to the other at the ends, so that the mean rotation is unchanged.
            phase = np.interp(times % 200_000, [0, EXPOSURE_US], [1, -1])
            turns = np.stack([0 * phase, phase / FOCAL, 0 * phase], -1)
            return moved(Poses(poses.axes @ compare_poses.turned_by(turns), poses.centres))

        found = self.compare(write(self.folder / "data", to_the_side))
        self.assertAlmostEqual(found["start_px"], 1, delta=0.15)  # more than a pixel at the sides of the image
        self.assertAlmostEqual(found["end_px"], 1, delta=0.15)
        self.assertLess(found["middle_px"], 0.05)
        self.assertGreater(found["nine_px"], 0.5)

    def test_a_shift_counts_by_depth(self):
        def nearer_at_the_ends(times):
            poses = true_path(times)
            phase = np.interp(times % 200_000, [0, EXPOSURE_US], [1, -1])
            return Poses(poses.axes, poses.centres + 0.01 * phase[:, None] * poses.axes[..., 0])

        found = self.compare(write(self.folder / "data", nearer_at_the_ends))
        inverse = np.linspace(1 / 2, 1 / 6, compare_poses.DEPTHS)
        self.assertAlmostEqual(found["start_px"], FOCAL * 0.01 * np.sqrt((inverse**2).mean()), delta=0.02)

    def test_the_true_poses_come_in_the_axes_of_the_data(self):
        rng = np.random.default_rng(0)

        def noisy(times):
            poses = moved(true_path(times))
            return Poses(poses.axes @ compare_poses.turned_by(rng.normal(0, 0.01, (len(times), 3))), poses.centres)

        data = write(self.folder / "data", noisy)
        self.assertGreater(self.compare(data)["nine_px"], 1)
        twin = self.folder / "twin"
        with mock.patch("sys.argv", ["compare_poses", str(data), str(self.truth), "--with-true-poses", str(twin)]), \
                redirect_stdout(io.StringIO()) as said:
            self.assertEqual(compare_poses.main(), 0)
        self.assertRegex(said.getvalue(), r"^exposures 4, start [\d.]+ px, middle .*, sharp views [\d.]+ px\n$")
        self.assertEqual(self.compare(twin)["nine_px"], 0)
        near = np.abs(Scene(twin).rows - Scene(data).rows).max()  # same axes, same unit, bounds untouched
        self.assertLess(near, 0.2)
        self.assertEqual((twin / "scene.yaml").read_text(), "extends: base.yaml\nposes: {optimize: none}\n")
        self.assertEqual((data / "scene.yaml").read_text(), "extends: base.yaml\n")
        self.assertTrue((twin / "points.npz").is_file())

    def test_settings_that_have_poses_are_refused_before_anything_is_copied(self):
        data, twin = write(self.folder / "data", true_path), self.folder / "twin"
        (data / "scene.yaml").write_text("poses: {optimize: path}\n")
        with mock.patch("sys.argv", ["compare_poses", str(data), str(self.truth), "--with-true-poses", str(twin)]), \
                redirect_stderr(io.StringIO()) as said:
            self.assertEqual(compare_poses.main(), 3)
        self.assertIn("expected no key 'poses' of its own", said.getvalue())
        self.assertFalse(twin.exists())

    def test_without_settings_the_copy_has_those_that_keep_the_poses(self):
        for k, (text, copied) in enumerate(((None, ""), ("seed: 3", "seed: 3\n"))):
            data, twin = write(self.folder / f"data{k}", true_path), self.folder / f"twin{k}"
            (data / "scene.yaml").unlink()
            if text is not None:
                (data / "scene.yaml").write_text(text)
            with mock.patch("sys.argv", ["compare_poses", str(data), str(self.truth), "--with-true-poses", str(twin)]), \
                    redirect_stdout(io.StringIO()):
                self.assertEqual(compare_poses.main(), 0)
            self.assertEqual((twin / "scene.yaml").read_text(), copied + "poses: {optimize: none}\n")

    def test_two_clocks_and_foreign_folders_are_one_line(self):
        late = write(self.folder / "late", true_path, offset_us=5e6)
        for data, line in ((late, "both data sets need one clock"), (self.folder, "expected a data set with poses_bounds.npy")):
            with mock.patch("sys.argv", ["compare_poses", str(data), str(self.truth)]), redirect_stderr(io.StringIO()) as said:
                self.assertEqual(compare_poses.main(), 3)
            self.assertIn(line, said.getvalue())
            self.assertEqual(said.getvalue().count("\n"), 1)


if __name__ == "__main__":
    unittest.main()
