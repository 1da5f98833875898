# SPDX-License-Identifier: Apache-2.0
"""Tests of colmap.py: its calls of pycolmap, which a stub replaces."""
import importlib.util
import subprocess
import sys
import tempfile
import types
import unittest
import unittest.mock
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/colmap.py"
PYCOLMAP = """
import types
__version__ = "9.9"
class CameraMode:
    SINGLE, AUTO = "single", "auto"
def options(**fields):
    return lambda: types.SimpleNamespace(**{k: v() if callable(v) else v for k, v in fields.items()})
ImageReaderOptions = options(camera_model="SIMPLE_RADIAL", camera_params="")
FeatureExtractionOptions = options(use_gpu=True, sift=options(first_octave=-1, max_num_features=8192, peak_threshold=0.0067))
FeatureMatchingOptions = options(use_gpu=True, guided_matching=False, sift=options(max_ratio=0.8))
ImportedPairingOptions = options(match_list_path=".", block_size=1225)
IncrementalPipelineOptions = options(min_num_matches=15, random_seed=-1, ba_refine_focal_length=True, ba_global_frames_ratio=1.1,
    mapper=options(init_min_tri_angle=16.0, filter_min_tri_angle=1.5), triangulation=options(min_angle=1.5))
def extract_features(*paths, **options): print("extract", paths, options)
def match_exhaustive(*paths, **options): print("exhaustive", paths, options)
def match_image_pairs(*paths, **options): print("listed", paths, options)
def incremental_mapping(*paths, **options): print("map", paths, options)
"""


class Scene:
    """The part of pycolmap.Reconstruction that reverse() uses: five cameras on an arc of 10 degrees about a scene at
    distance 4.
    """

    def __init__(self):
        import numpy as np

        self.poses, self.points3D = {}, {}
        for i in range(5):
            angle = np.radians(5 * (i - 2) / 2)
            turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
            middle = np.array([0, 0, 4.0])
            self.poses[i] = types.SimpleNamespace(rotation=types.SimpleNamespace(matrix=lambda turn=turn: turn),
                                                  translation=middle - turn @ middle)
        for k in range(25):
            depth = 4 + 0.05 * (k * 7 % 5)
            place = np.array([0.1 * (k % 5 - 2), 0.1 * (k // 5 - 2), 1]) * [depth / 4, depth / 4, depth]
            self.points3D[k] = types.SimpleNamespace(xyz=place)

    @property
    def images(self):
        return {i: types.SimpleNamespace(has_pose=True, frame_id=i, camera_id=1, cam_from_world=lambda i=i: self.poses[i])
                for i in self.poses}

    def frame(self, number):
        return types.SimpleNamespace(set_cam_from_world=lambda camera, pose: self.poses.update({number: pose}))

    def pictures(self):
        import numpy as np

        places = np.stack([point.xyz for point in self.points3D.values()])
        seen = [places @ pose.rotation.matrix().T + pose.translation for pose in self.poses.values()]
        return np.stack([300 * each[:, :2] / each[:, 2:] for each in seen]), seen[2][:, 2]


class ReversedDepths(unittest.TestCase):
    def test_other_depths_and_turns_give_nearly_the_same_pictures(self):
        import numpy as np

        stand_in = types.ModuleType("pycolmap")
        stand_in.Rotation3d = lambda matrix: types.SimpleNamespace(matrix=lambda: matrix)
        stand_in.Rigid3d = lambda rotation, translation: types.SimpleNamespace(rotation=rotation, translation=translation)
        with unittest.mock.patch.dict(sys.modules, {"pycolmap": stand_in}):
            script = importlib.util.spec_from_file_location("colmap_script", SCRIPT)
            module = importlib.util.module_from_spec(script)
            script.loader.exec_module(module)
            scene = Scene()
            before, depths = scene.pictures()
            turn = scene.poses[0].rotation.matrix()
            module.reverse(scene)
            after, other = scene.pictures()
        self.assertLess(np.abs(before[2] - after[2]).max(), 0.01)
        self.assertGreater(np.abs(before - before[2]).max(), 1)
        self.assertLess(np.abs(before - after).max(), 0.3)
        np.testing.assert_allclose(1 / depths + 1 / other, 2 / np.median(depths), atol=1e-3)
        self.assertGreater(np.abs(depths - other).max(), 0.15)
        np.testing.assert_allclose(scene.poses[0].rotation.matrix(), turn.T, atol=1e-9)


class Colmap(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        (Path(self.folder.name) / "pycolmap.py").write_text(PYCOLMAP)

    def tearDown(self):
        self.folder.cleanup()

    def call(self, *words, there=True):
        environment = {"PYTHONPATH": self.folder.name if there else ""}
        return subprocess.run([sys.executable, "-S", SCRIPT, *words], env=environment, capture_output=True, text=True)

    def test_features(self):
        done = self.call("feature_extractor", "--database_path", "d.db", "--image_path", "images", "--ImageReader.single_camera", "1",
                         "--ImageReader.camera_model", "PINHOLE", "--ImageReader.camera_params", "1,2,3,4",
                         "--SiftExtraction.use_gpu", "0", "--SiftExtraction.first_octave", "0",
                         "--SiftExtraction.peak_threshold", "0.003")
        self.assertEqual(done.returncode, 0, done.stderr)
        for part in ("('d.db', 'images')", "'camera_mode': 'single'", "camera_model='PINHOLE'", "camera_params='1,2,3,4'",
                     "use_gpu=False", "first_octave=0", "peak_threshold=0.003", "max_num_features=8192"):
            self.assertIn(part, done.stdout)

    def test_matches(self):
        done = self.call("exhaustive_matcher", "--database_path", "d.db", "--SiftMatching.use_gpu", "0",
                         "--SiftMatching.guided_matching", "1")
        self.assertIn("exhaustive ('d.db',)", done.stdout)
        self.assertIn("use_gpu=False, guided_matching=True", done.stdout)
        done = self.call("matches_importer", "--database_path", "d.db", "--match_list_path", "pairs.txt", "--match_type", "pairs")
        self.assertIn("listed ('d.db',)", done.stdout)
        self.assertIn("match_list_path='pairs.txt', block_size=100", done.stdout)

    def test_mapping(self):
        models = Path(self.folder.name) / "models"
        done = self.call("mapper", "--database_path", "d.db", "--image_path", "images", "--output_path", str(models),
                         "--Mapper.ba_refine_focal_length", "0", "--Mapper.init_min_tri_angle", "4",
                         "--Mapper.filter_min_tri_angle", "0.5", "--Mapper.tri_min_angle", "0.5", "--Mapper.min_num_matches", "10",
                         "--Mapper.ba_global_images_ratio", "1.2", "--Mapper.random_seed", "3")
        self.assertEqual(done.returncode, 0, done.stderr)
        for part in ("min_num_matches=10", "random_seed=3", "ba_global_frames_ratio=1.2", "ba_refine_focal_length=False", "init_min_tri_angle=4.0", "filter_min_tri_angle=0.5",
                     "triangulation=namespace(min_angle=0.5)"):
            self.assertIn(part, done.stdout)
        self.assertTrue(models.is_dir())

    def test_problems_are_one_line(self):
        for words, said in ((("version",), ""), (("feature_extractor", "--a"), "pairs of --name and value"),
                            (("exhaustive_matcher", "--database_path", "d", "--SiftMatching.none", "1"), "no such option"),
                            (("exhaustive_matcher", "--database_path", "d", "--Other.none", "1"), "no such option"),
                            (("exhaustive_matcher", "--SiftMatching.use_gpu", "0"), "expected --database_path"),
                            (("matches_importer", "--database_path", "d", "--match_type", "raw"), "expected pairs, found raw"),
                            (("image_undistorter", "--database_path", "d"), "expected feature_extractor")):
            done = self.call(*words)
            self.assertEqual(done.returncode != 0, bool(said), words)
            self.assertIn(said, done.stderr)
            self.assertEqual(done.stderr.count("\n"), bool(said), done.stderr)
        missing = self.call("version", there=False)
        self.assertIn("needs the Python package pycolmap", missing.stderr)
        self.assertNotEqual(missing.returncode, 0)


if __name__ == "__main__":
    unittest.main()
