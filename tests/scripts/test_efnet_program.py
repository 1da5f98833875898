# SPDX-License-Identifier: Apache-2.0
"""Tests of the restorer in the C++ programs against the independent network in Python.

Runs `jade_bench restorer --input … --dump …` from $JADE_BIN (default: build/bin).
"""

import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
import unittest
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "efnet"))
import export_efnet  # noqa: E402
import restoration  # noqa: E402
from model import EFNet  # noqa: E402

BENCH = Path(os.environ.get("JADE_BIN", ROOT / "build" / "bin")) / "jade_bench"


def frame(height: int, width: int, windows: int = 6) -> tuple[torch.Tensor, torch.Tensor]:
    """An image, and bins of a moving camera: whole numbers where there are events."""
    generator = torch.Generator().manual_seed(height * width)
    image = torch.rand(1, 3, height, width, generator=generator)
    bins = torch.randint(-3, 4, (1, windows, height, width), generator=generator).float()
    return image, bins * (torch.rand(1, 1, height, width, generator=generator) > 0.6)


def restore(net: EFNet, image: torch.Tensor, bins: torch.Tensor, bgr: bool = False) -> torch.Tensor:
    height, width = image.shape[2:]
    right, bottom = -width % 4, -height % 4
    events, mask = restoration.network_input(bins)
    image = F.pad(image.flip(1) if bgr else image, (0, right, 0, bottom), mode="replicate")
    with torch.no_grad():
        out = net(image, F.pad(events, (0, right, 0, bottom)), F.pad(mask, (0, right, 0, bottom)))[1]
    out = out[..., :height, :width].clamp(0, 1)
    return out.flip(1) if bgr else out


class ProgramCase(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def run_program(self, network: Path, frames: dict, flags: list = ()) -> dict:
        command = [str(BENCH), "restorer", "--device", "cpu", "--efnet", str(network), "--warm-up", "0",
                   "--repeats", "1", "--dump", str(self.path / "out"), *flags]
        for name, (image, bins) in frames.items():
            (self.path / name).mkdir()
            np.save(self.path / name / "image.npy", image[0].numpy())
            np.save(self.path / name / "bins.npy", bins[0].numpy())
            command += ["--input", str(self.path / name)]
        subprocess.run(command, check=True, capture_output=True)
        return {name: torch.from_numpy(np.load(self.path / "out" / f"{name}.npy")) for name in frames}


class SameAsPython(ProgramCase):
    def test_shipped_network_at_three_sizes(self):
        module = torch.jit.load(str(ROOT / "assets" / "efnet_anytime.pt"))
        net = EFNet(48, restoration.any_time_channels(), restoration.CANDIDATES).eval()
        net.load_state_dict({name.removeprefix("net.net."): value.float() for name, value in module.named_parameters()})
        frames = {"davis": frame(260, 346, 16), "multiple": frame(64, 96, 16), "odd": frame(77, 131, 16)}
        times = torch.tensor([0.0, 0.5, 0.8])
        flags = ["--times", ",".join(str(float(t)) for t in times)]
        for name, restored in self.run_program(ROOT / "assets" / "efnet_anytime.pt", frames, flags).items():
            image, counts = frames[name]
            height, width = image.shape[2:]
            right, bottom = -width % 4, -height % 4
            image = F.pad(image, (0, right, 0, bottom), mode="replicate").expand(3, -1, -1, -1)
            counts = F.pad(counts, (0, right, 0, bottom)).expand(3, -1, -1, -1)
            with torch.no_grad():
                expected = net(*restoration.any_time_input(image, counts, times))[1][..., :height, :width].clamp(0, 1)
            difference = float((restored - expected).abs().max())
            print(f"{name}: largest difference {difference:.1e}", file=sys.stderr)
            self.assertLess(difference, 1e-5, name)
            self.assertGreater(float((restored[0] - restored[2]).abs().max()), 1e-3, name)

    def test_checkpoint_in_the_official_format(self):
        torch.manual_seed(3)
        net = EFNet(16).eval()
        torch.save({"params": {"module." + k: v for k, v in net.state_dict().items()}}, self.path / "official.pth")
        with redirect_stdout(io.StringIO()):
            export_efnet.export(export_efnet.parse_arguments(
                [str(self.path / "official.pth"), str(self.path / "out.pt"), "--channel-order", "bgr"]))
        frames = {"small": frame(50, 67)}
        restored = self.run_program(self.path / "out.pt", frames)["small"]
        self.assertLess(float((restored - restore(net, *frames["small"], bgr=True)[0]).abs().max()), 1e-5)


class AnyTimeLines(torch.nn.Module):
    """A restorer of version 2 of a few lines: a 3x3 convolution over image, events and moment."""

    def __init__(self, half: bool):
        super().__init__()
        kernel = (0.2 * torch.randn(3, 6, 3, 3, generator=torch.Generator().manual_seed(7))).half()
        self.kernel = torch.nn.Parameter(kernel if half else kernel.float())

    def forward(self, image: torch.Tensor, counts: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
        t = time.view(-1, 1, 1, 1)
        edges = torch.linspace(0, 1, counts.size(1) + 1)
        after = ((edges[1:].view(1, -1, 1, 1) - t) * counts.size(1)).clamp(0, 1)
        scale = counts.abs().amax([1, 2, 3], keepdim=True).clamp(min=1)
        late = (counts * after).sum(1, keepdim=True) / scale
        early = (counts * (1 - after)).sum(1, keepdim=True) / scale
        channels = torch.cat([image, late, early, t.expand_as(late)], 1)
        return image + 0.2 * torch.tanh(torch.conv2d(channels, self.kernel, padding=[1, 1]))


def any_time_module(half: bool) -> torch.jit.ScriptModule:
    return torch.jit.script(AnyTimeLines(half))


def save_any_time(path: Path, windows: int, half: bool) -> None:
    module = any_time_module(half)
    digest = hashlib.sha256()
    for name, values in sorted(module.named_parameters()):
        digest.update(name.encode() + b"\0" + values.detach().float().numpy().tobytes())
    metadata = {"format": "jade-restorer", "format_version": 2, "kind": "efnet", "name": "lines", "width": 3,
                "parameters": 162, "input": "counts", "windows": windows, "normalization": "inside",
                "any_time": True, "channel_order": "rgb", "padding_multiple": 4, "minimum_size": 8,
                "uses_mask": False, "dtype": "float16" if half else "float32",
                "weights_sha256": digest.hexdigest(), "source": "test"}
    torch.jit.save(module, str(path), _extra_files={"jade_efnet.json": json.dumps(metadata)})


class AnyTime(ProgramCase):
    def test_three_moments_at_three_sizes(self):
        windows, times = 16, [0.0, 0.3, 1.0]
        frames = {"davis": frame(260, 346, windows), "small": frame(8, 8, windows), "odd": frame(77, 131, windows)}
        for half in (False, True):
            with self.subTest(half=half):
                self.setUp()
                save_any_time(self.path / "lines.pt", windows, half)
                found = self.run_program(self.path / "lines.pt", frames, ["--times", "0,0.3,1"])
                module = any_time_module(half).float()
                for name, (image, counts) in frames.items():
                    height, width = image.shape[2:]
                    right, bottom = -width % 4, -height % 4
                    padded = F.pad(image, (0, right, 0, bottom), mode="replicate").expand(3, -1, -1, -1)
                    padded_counts = F.pad(counts, (0, right, 0, bottom)).expand(3, -1, -1, -1)
                    with torch.no_grad():
                        expected = module(padded, padded_counts, torch.tensor(times))
                    expected = expected[..., :height, :width].clamp(0, 1)
                    self.assertEqual(found[name].shape, expected.shape)
                    self.assertLess(float((found[name] - expected).abs().max()), 1e-5, name)
                    self.assertGreater(float((found[name][0] - found[name][2]).abs().max()), 0.01, name)


if __name__ == "__main__":
    if not BENCH.exists():
        print(f"SKIPPED: {BENCH} is not built")
        sys.exit(77)
    unittest.main()
