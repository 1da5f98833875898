# SPDX-License-Identifier: Apache-2.0
"""Tests of gsplat_training.py with a stub for gsplat, which CI lacks: its loss, and that it learns."""
import json
import sys
import tempfile
import types
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import gsplat_training as training  # noqa: E402

HEIGHT, WIDTH, MOMENTS, VIEWS = 12, 14, 5, 2
OPTIONS = {
    "iterations": 40, "sh_degree_every": 10, "near_plane": 0.01, "extent": 1.0, "dssim": 0.3, "target_weight": 1, "edi_weight": 1,
    "warmup": 5, "simulation_start": 8, "position_lr_start": 1e-3, "position_lr_end": 1e-4, "position_lr_max_steps": 100,
    "sh_dc_lr": 0.05, "sh_rest_lr": 1e-3, "opacity_lr": 0.05, "scale_lr": 0.01, "rotation_lr": 0.01, "eps": 1e-15,
    "densify_from": 10, "densify_until": 20, "densify_every": 5, "gradient_threshold": 1e-3, "split_scale": 0.01, "prune_opacity": 0.005,
    "prune_scale": 0.1, "opacity_reset_every": 100, "max_gaussians": 10,
}


class Strategy:
    """Records the steps and does not change the Gaussians."""

    def __init__(self, **settings):
        self.settings = settings

    def initialize_state(self, scene_scale):
        return {}

    def step_pre_backward(self, *_):
        pass

    def step_post_backward(self, *_, packed):
        pass


def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, **_):
    """One colour everywhere: the mean of the Gaussians'."""
    color = (colors[:, 0] * opacities[:, None]).mean(0).expand(len(viewmats), height, width, 3)
    return color, None, {}


def plain_rec(a: torch.Tensor, b: torch.Tensor, dssim: float) -> float:
    """Eq. (8) pixel by pixel."""
    axis = torch.arange(11, dtype=torch.float64) - 5
    line = torch.exp(-axis**2 / (2 * 1.5**2))
    kernel = torch.outer(line, line) / line.sum() ** 2
    total = 0.0
    for x, y in zip(a.double(), b.double()):
        x_wide, y_wide = (torch.nn.functional.pad(i, (5, 5, 5, 5)) for i in (x, y))
        for row in range(x.shape[0]):
            for column in range(x.shape[1]):
                p, q = (i[row:row + 11, column:column + 11] for i in (x_wide, y_wide))
                mp, mq = (kernel * p).sum(), (kernel * q).sum()
                vp, vq, c = (kernel * p * p).sum() - mp**2, (kernel * q * q).sum() - mq**2, (kernel * p * q).sum() - mp * mq
                ssim = (2 * mp * mq + 1e-4) * (2 * c + 9e-4) / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4))
                total += float((1 - dssim) * (x[row, column] - y[row, column]).abs() + dssim * (1 - ssim))
    return total / a.numel()


class GsplatTraining(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        draw = np.random.default_rng(0)

        def save(name, *shape):
            np.save(self.folder / f"{name}.npy", draw.random(shape, dtype=np.float32))

        save("blurry", VIEWS, 3, HEIGHT, WIDTH)
        save("targets", VIEWS, 3, HEIGHT, WIDTH)
        save("edi_factors", VIEWS, MOMENTS, 1, HEIGHT, WIDTH)
        save("camera_from_world", VIEWS, MOMENTS, 4, 4)
        save("test_images", 1, 3, HEIGHT, WIDTH)
        save("test_camera_from_world", 1, 4, 4)
        save("intrinsics", 4)
        for name, shape in (("means", (6, 3)), ("rotations", (6, 4)), ("log_scales", (6, 3)), ("logit_opacities", (6,)), ("sh", (6, 16, 3))):
            save(name, *shape)
        np.save(self.folder / "response.npy", np.linspace(0, 2, 4097, dtype=np.float32) ** 2)
        (self.folder / "training.json").write_text(json.dumps(OPTIONS))
        gsplat = types.ModuleType("gsplat")
        gsplat.DefaultStrategy, gsplat.rasterization = Strategy, rasterization
        sys.modules["gsplat"] = gsplat
        self.addCleanup(sys.modules.pop, "gsplat")

    def test_the_distance_of_pairs_is_that_of_equation_8_each(self):
        generator = torch.Generator().manual_seed(1)
        pairs = [torch.rand((2, n, 9, 7), generator=generator) for n in (3, 1)]
        expected = sum(plain_rec(p[0], p[1], 0.3) for p in pairs)
        found = training.dissimilarity(torch.cat([p[0] for p in pairs]), torch.cat([p[1] for p in pairs]), [3, 1], 0.3,
                                       training.window("cpu"))
        self.assertAlmostEqual(float(found), expected, places=5)

    def test_the_terms_act_when_the_settings_say(self):
        state = training.Training(self.folder, "cpu", 0)
        renders = torch.rand((MOMENTS, 3, HEIGHT, WIDTH), generator=torch.Generator().manual_seed(2))
        drawn = []
        for step in (5, 6, 9):
            state.draw = np.random.default_rng(3)
            drawn.append(float(state.loss(renders, 0, step)))
        state.draw = np.random.default_rng(3)
        one, two, three = state.draw.integers(0, MOMENTS, 3)
        blurry, factors, target = state.blurry[0], state.factors[0], state.targets[0]
        gray, middle = training.gray, renders[MOMENTS // 2]
        first = (plain_rec(middle, target, 0.3) + plain_rec(gray(middle), gray(target), 0.3) + plain_rec(renders.mean(0), blurry, 0.3)
                 + plain_rec(renders[two], blurry * factors[two], 0.3))
        expected = [
            first + plain_rec(gray(renders[one]), gray(blurry) * factors[one], 0.3),
            first + plain_rec(gray(renders[one]**2), gray(blurry**2) * factors[one], 0.3) + plain_rec((renders**2).mean(0), blurry**2, 0.3)]
        expected.append(expected[1] + plain_rec(gray(renders[three]**2), gray(renders.mean(0)**2) * factors[three], 0.3))
        np.testing.assert_allclose(drawn, expected, rtol=1e-4)

    def test_it_learns_and_writes_its_curve(self):
        curve = self.folder / "curve.csv"
        arguments = ["gsplat_training.py", str(self.folder), "--output", str(curve), "--every", "20", "--device", "cpu"]
        with mock.patch.object(sys, "argv", arguments), mock.patch.object(torch.cuda, "synchronize"), mock.patch("builtins.print"):
            self.assertEqual(training.main(), 0)
        lines = curve.read_text().split()
        self.assertEqual(lines[0], "step,seconds,psnr,gaussians")
        rows = [line.split(",") for line in lines[1:]]
        self.assertEqual([row[0] for row in rows], ["20", "40"])
        self.assertEqual(rows[0][3], "6")
        self.assertGreater(float(rows[1][1]), float(rows[0][1]))

    def test_it_stops_adding_at_the_upper_bound(self):
        state = training.Training(self.folder, "cpu", 0)
        state.step(1)
        self.assertEqual(state.strategy.grow_grad2d, OPTIONS["gradient_threshold"])
        state.options["max_gaussians"] = 6
        state.step(2)
        self.assertEqual(state.strategy.grow_grad2d, float("inf"))


if __name__ == "__main__":
    unittest.main()
