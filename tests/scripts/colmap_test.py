# SPDX-License-Identifier: Apache-2.0
"""colmap.py: what it asks of pycolmap, which a module of the test's own stands in for."""
import subprocess
import sys
import tempfile
import unittest
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
IncrementalPipelineOptions = options(min_num_matches=15, ba_refine_focal_length=True, ba_global_frames_ratio=1.1,
    mapper=options(init_min_tri_angle=16.0, filter_min_tri_angle=1.5), triangulation=options(min_angle=1.5))
def extract_features(*paths, **options): print("extract", paths, options)
def match_exhaustive(*paths, **options): print("exhaustive", paths, options)
def match_image_pairs(*paths, **options): print("listed", paths, options)
def incremental_mapping(*paths, **options): print("map", paths, options)
"""


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
                         "--Mapper.ba_global_images_ratio", "1.2")
        self.assertEqual(done.returncode, 0, done.stderr)
        for part in ("min_num_matches=10", "ba_global_frames_ratio=1.2", "ba_refine_focal_length=False", "init_min_tri_angle=4.0", "filter_min_tri_angle=0.5",
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
