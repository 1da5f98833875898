# SPDX-License-Identifier: Apache-2.0
"""Tests of to_tensorboard.py with a stand-in for torch.utils.tensorboard, which writes its calls as text."""
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "to_tensorboard.py"
STAND_IN = '''
from pathlib import Path
class SummaryWriter:
    def __init__(self, folder):
        Path(folder).mkdir(exist_ok=True)
        self.file = (Path(folder) / "events.out.tfevents.new").open("w")
    def __enter__(self): return self
    def __exit__(self, *_): self.file.close()
    def add_scalar(self, key, value, step): self.file.write(f"{key} {value} {step}\\n")
    def flush(self): self.file.flush()
'''


class ToTensorboard(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        self.run = self.root / "run"
        self.run.mkdir()

    def call(self, stand_in=STAND_IN):
        for package in ("torch", "torch/utils"):
            (self.root / package).mkdir(exist_ok=True)
            (self.root / package / "__init__.py").touch()
        (self.root / "torch/utils/tensorboard.py").write_text(stand_in)
        return subprocess.run([sys.executable, SCRIPT, self.run], capture_output=True, text=True,
                              env={**os.environ, "PYTHONPATH": str(self.root)})

    def test_numbers_of_whole_lines_become_scalars(self):
        (self.run / "metrics.jsonl").write_text('{"step": 100, "loss": 0.5, "phase": "scene", "psnr_train": 20, "done": true}\n'
                                                '{"step": 200, "loss": 0.25}\n{"step": 300, "lo')
        (self.run / "tensorboard").mkdir()
        (self.run / "tensorboard/events.out.tfevents.old").write_text("old")
        done = self.call()
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        files = list((self.run / "tensorboard").iterdir())
        self.assertEqual([file.name for file in files], ["events.out.tfevents.new"])
        self.assertEqual(files[0].read_text().splitlines(), ["loss 0.5 100", "psnr_train 20 100", "loss 0.25 200"])

    def test_what_is_missing_is_named_in_one_line(self):
        done = self.call()
        self.assertEqual(done.returncode, 3)
        self.assertRegex(done.stderr, r"^error: .*metrics\.jsonl.*\n$")
        (self.run / "metrics.jsonl").write_text("{}\n")
        done = self.call("import tensorboard_of_no_package")
        self.assertEqual(done.returncode, 3)
        self.assertRegex(done.stderr, r"^error: .*tensorboard.*\n$")


if __name__ == "__main__":
    unittest.main()
