# SPDX-License-Identifier: Apache-2.0
"""python -m unittest discover tests/scripts"""

import io
import json
import sys
import tempfile
import unittest
import warnings
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from unittest import mock

import cv2
import h5py
import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "efnet"))
import evaluate_efnet  # noqa: E402
import export_efnet  # noqa: E402
import prepare_photographs  # noqa: E402
import restoration  # noqa: E402
import train_efnet  # noqa: E402
from model import EFNet, parameter_count  # noqa: E402
from draw import Draw  # noqa: E402
from footage import Footage  # noqa: E402
from synthetic import (  # noqa: E402
    NoiseOptions, PixelThresholds, SceneOptions, draw_misplacement, event_step, generate, generate_from_footage, procedural_textures,
    shift_in_time, simulate_events, soften, splat,
)

torch.set_num_threads(1)


class Architecture(unittest.TestCase):
    def test_parameter_counts_are_the_published_ones(self):
        counts = {8: 134989, 16: 533773, 24: 1196365, 32: 2122765, 48: 4766989, 64: 8466445}
        for width, count in counts.items():
            self.assertEqual(parameter_count(EFNet(width)), count)

    def test_state_has_the_official_keys_and_shapes(self):
        state = EFNet(64).state_dict()
        self.assertEqual(len(state), 183)
        gate = [k for k in state if ".emgc_" in k]
        self.assertEqual((len(gate), sum(state[k].numel() for k in gate)), (16, 738048))
        expected = {
            "conv_01.weight": (64, 3, 3, 3), "conv_ev1.weight": (64, 6, 3, 3), "cat12.weight": (64, 128, 1, 1),
            "sam12.conv2.weight": (3, 64, 3, 3), "down_path_1.0.downsample.weight": (64, 64, 4, 4),
            "down_path_1.2.image_event_transformer.attn.temperature": (4, 1, 1),
            "down_path_1.1.image_event_transformer.norm1_event.body.weight": (128,),
            "down_path_1.0.image_event_transformer.norm2.bias": (64,),
            "down_path_1.0.image_event_transformer.ffn.fc1.weight": (256, 64),
            "down_path_ev.2.conv_before_merge.weight": (256, 256, 1, 1),
            "down_path_2.1.emgc_dec_mask.bias": (128,), "up_path_2.0.up.weight": (256, 128, 2, 2),
            "up_path_1.1.conv_block.identity.weight": (64, 128, 1, 1), "skip_conv_2.0.weight": (128, 128, 3, 3),
        }
        for key, shape in expected.items():
            self.assertEqual(tuple(state[key].shape), shape, key)
        self.assertFalse([k for k in state if "2.downsample" in k], "the last level has no downsampling")

    def test_mask_gate_acts_only_with_a_mask(self):
        net = EFNet(8).eval()
        image, events = torch.rand(1, 3, 16, 24), torch.randn(1, 6, 16, 24)
        with torch.no_grad():
            without, ones = net(image, events)[1], net(image, events, torch.ones(1, 1, 16, 24))[1]
            zeros = net(image, events, torch.zeros(1, 1, 16, 24))[1]
        self.assertGreater(float((without - ones).abs().max()), 1e-6)
        self.assertGreater(float((zeros - ones).abs().max()), 1e-6)


class Input(unittest.TestCase):
    def test_scer_is_the_signed_sum_from_mid_exposure(self):
        bins = torch.randint(-3, 4, (2, 6, 5, 7)).float()
        cumulative = torch.cat([torch.zeros(2, 1, 5, 7), bins.cumsum(1)], 1)  # at t = 0, 1/6 .. 1
        expected = (cumulative - cumulative[:, 3:4])[:, [0, 1, 2, 4, 5, 6]]
        self.assertTrue(torch.equal(restoration.scer_from_bins(bins), expected))

    def test_normalised_by_the_largest_magnitude_after_the_map(self):
        bins = torch.randn(2, 6, 8, 8)
        events, _ = restoration.network_input(bins)
        scaled, _ = restoration.network_input(bins * 7)
        self.assertTrue(torch.allclose(events.abs().amax((1, 2, 3)), torch.ones(2)))
        self.assertTrue(torch.allclose(events, scaled, atol=1e-6))
        self.assertEqual(float(restoration.network_input(torch.zeros(1, 6, 8, 8))[0].abs().max()), 0)

    def test_mask_is_closed(self):
        events = torch.zeros(1, 6, 7, 9)
        events[0, 2, 3, 3], events[0, 4, 3, 5] = 1, -1
        mask = restoration.event_mask(events)
        self.assertEqual(float(mask[0, 0, 3, 4]), 1)  # the gap of one pixel closes
        self.assertEqual(float(mask.sum()), 3)
        events[0, 0, 0, 0] = 1
        self.assertEqual(float(restoration.event_mask(events)[0, 0, 0, 0]), 1)  # the border erodes nothing

    def test_double_integral_inverts_its_own_blur(self):
        windows = torch.randn(1, 8, 6, 5, dtype=torch.float64) * 0.3
        knots = torch.cat([torch.zeros(1, 1, 6, 5, dtype=torch.float64), windows.cumsum(1)], 1)
        sharp = torch.rand(1, 3, 6, 5, dtype=torch.float64)
        latents = sharp.unsqueeze(1) * (knots - knots[:, 4:5]).exp().unsqueeze(2)
        found = restoration.double_integral(latents.mean(1), windows)
        self.assertLess(float((found - sharp).abs().max()), 1e-12)
        self.assertTrue(torch.allclose(restoration.double_integral(sharp, windows * 0), sharp))

    def test_double_integral_at_any_border_shows_that_moment(self):
        windows = torch.randn(1, 8, 6, 5, dtype=torch.float64) * 0.3
        knots = torch.cat([torch.zeros(1, 1, 6, 5, dtype=torch.float64), windows.cumsum(1)], 1)
        latents = torch.rand(1, 1, 3, 6, 5, dtype=torch.float64) * knots.exp().unsqueeze(2)
        weights = torch.tensor([0.5] + [1.0] * 7 + [0.5], dtype=torch.float64).view(1, 9, 1, 1, 1) / 8
        blurry = (latents * weights).sum(1)
        for moment in (0, 3, 8):
            found = restoration.double_integral(blurry, windows, moment, trapezoid=True)
            self.assertLess(float((found - latents[:, moment]).abs().max()), 1e-12)

    def test_oracle_mix_is_never_worse(self):
        a, b, truth = (torch.rand(2, 3, 8, 8) for _ in range(3))
        best = restoration.psnr(restoration.oracle_mix(a, b, truth), truth)
        self.assertTrue(bool((best >= torch.maximum(restoration.psnr(a, truth), restoration.psnr(b, truth))).all()))


class AnyTime(unittest.TestCase):
    """moment_input against its definition, pixel by pixel."""

    def setUp(self):
        generator = torch.Generator().manual_seed(3)
        self.counts = torch.randint(-2, 3, (2, 16, 5, 6), generator=generator).float()
        self.counts[:, :, 0, 0] = 0

    def test_counts_are_cumulated_about_the_moment(self):
        time = torch.tensor([0.5, 0.28])
        events, mask, log_gain = restoration.moment_input(self.counts, time)
        self.assertEqual(events.shape[1], restoration.any_time_channels())
        for n, t in enumerate(time.tolist()):
            active = int((self.counts[n] != 0).any(0).sum())
            scale = float(self.counts[n].abs().sum()) / active
            for border in (0, 4, 5, 16):
                low, high = sorted((border / 16, t))
                share = [max(0.0, min(high, (w + 1) / 16) - max(low, w / 16)) * 16 for w in range(16)]
                sign = 1 if border / 16 >= t else -1
                expected = sign * sum(s * self.counts[n, w] for w, s in enumerate(share)) / scale
                self.assertLess(float((events[n, border] - expected.clamp(-8, 8)).abs().max()), 1e-5, (n, border))
            self.assertAlmostEqual(float(events[n, -2, 1, 1]), 2 * t - 1, places=5)
            self.assertAlmostEqual(float(events[n, -1, 1, 1]), float(torch.tensor(scale).log()), places=5)
            self.assertEqual(float(mask[n, 0, 2, 2]), 1)

    def test_candidates_are_double_integrals(self):
        blurry = torch.rand(2, 3, 5, 6)
        _, _, _, images = restoration.any_time_input(blurry, self.counts, torch.tensor([0.75, 0.75]))
        expected = restoration.double_integral(blurry, self.counts * 0.2, 12, trapezoid=True)
        self.assertLess(float((images[:, 3:6] - expected.clamp(0, 1.5)).abs().max()), 1e-5)

    def test_an_exposure_without_events_is_finite_and_its_candidates_are_the_frame(self):
        blurry = torch.rand(1, 3, 8, 8)
        inputs = restoration.any_time_input(blurry, torch.zeros(1, 16, 8, 8), torch.tensor([0.3]))
        self.assertTrue(all(bool(x.isfinite().all()) for x in inputs))
        self.assertLess(float((inputs[3] - blurry.repeat(1, restoration.CANDIDATES, 1, 1)).abs().max()), 1e-5)

    def test_a_pixel_mixes_the_frame_and_the_candidates(self):
        net = EFNet(8, restoration.any_time_channels(), restoration.CANDIDATES).eval()
        torch.nn.init.zeros_(net.last.weight)
        torch.nn.init.zeros_(net.last.bias)
        with torch.no_grad():
            net.last.bias[3 + 2] = 40  # all weight on the second candidate
            inputs = restoration.any_time_input(torch.rand(2, 3, 8, 8), self.counts[:, :, :4, :4].repeat(1, 1, 2, 2),
                                                torch.tensor([0.1, 0.9]))
            self.assertLess(float((net(*inputs)[1] - inputs[3][:, 3:6]).abs().max()), 1e-5)


class Generator(unittest.TestCase):
    options = SceneOptions(height=32, width=40, batch=2, blur_max_px=8)

    def make(self, seed: int, options: SceneOptions | None = None):
        draw = Draw(seed, "cpu")
        bank = procedural_textures(draw, 4, 64)
        return generate(draw, bank, options or self.options, with_windows=True)

    def test_a_seed_fixes_the_batch(self):
        first, second, other = self.make(3), self.make(3), self.make(4)
        for name in ("blurry", "sharp", "counts", "time", "ends", "weighted"):
            self.assertTrue(torch.equal(getattr(first, name), getattr(second, name)), name)
        self.assertFalse(torch.equal(first.blurry, other.blurry))

    def test_shapes_and_ranges(self):
        sample = self.make(5)
        self.assertEqual(tuple(sample.blurry.shape), (2, 3, 32, 40))
        self.assertEqual(tuple(sample.sharp.shape), (2, 2, 3, 32, 40))
        self.assertEqual(tuple(sample.counts.shape), (2, 16, 32, 40))
        self.assertEqual(tuple(sample.time.shape), (2, 2))
        for image in (sample.blurry, sample.sharp, sample.ends):
            self.assertTrue(0 <= float(image.min()) and float(image.max()) <= 1)
        self.assertTrue(torch.equal(sample.blurry, (sample.blurry * 255).round() / 255))

    def test_the_sharp_frame_is_that_of_its_moment(self):
        options = replace(self.options, batch=8, moments=4, noise=NoiseOptions(0, 0))
        sample = self.make(11, options)
        for moment, end in ((0.0, 0), (1.0, 1)):
            exposures, which = (sample.time == moment).nonzero(as_tuple=True)
            self.assertGreater(len(exposures), 0)
            self.assertTrue(torch.equal(sample.sharp[exposures, which], sample.ends[exposures, end]))
        self.assertTrue(bool(((sample.time > 0) & (sample.time < 1) & (sample.time != 0.5)).any()))
        self.assertTrue(bool((self.make(11, replace(options, middle=True)).time == 0.5).all()))

    def test_an_event_moves_the_reference_by_its_threshold(self):
        one, none = torch.ones(1, 1, 1), torch.zeros(1, 1, 1)
        chances = torch.full((2, 1, 1, 1), 0.5)
        seen, reference, signed = event_step(
            one * 0.7, none, none, one * 0.3, one * 0.2, none, one * 1e6, none, none, none, none, chances)
        self.assertAlmostEqual(float(signed), 2)
        self.assertAlmostEqual(float(reference), 0.6, places=6)
        _, reference, signed = event_step(
            none, seen, reference, one * 0.3, one * 0.2, none, one * 1e6, none, none, none, none, chances)
        self.assertAlmostEqual(float(signed), -3)
        self.assertAlmostEqual(float(reference), 0.0, places=6)

    def test_a_resetting_pixel_forgets_what_is_beyond_its_thresholds(self):
        one, none = torch.ones(1, 1, 1), torch.zeros(1, 1, 1)
        chances = torch.full((2, 1, 1, 1), 0.5)
        # the last one causes no event
        for level, expected in ((0.7, 0.6 + 0.25 * 0.1), (-0.5, -0.4 - 0.25 * 0.1), (0.1, 0.0)):
            _, reference, _ = event_step(
                one * level, none, none, one * 0.3, one * 0.2, none, one * 1e6, none, one * 0.25, none, none, chances)
            self.assertAlmostEqual(float(reference), expected, places=6)

    def test_a_shift_in_time_takes_the_level_of_later_or_earlier(self):
        level = torch.tensor([0.0, 1.0, 4.0, 5.0]).view(1, 4, 1, 1)
        for ahead, expected in ((0.0, [0, 1, 4, 5]), (0.5, [0.5, 2.5, 4.5, 5.5]), (-0.25, [-0.25, 0.75, 3.25, 4.75])):
            shifted = shift_in_time(level, torch.full((1, 1, 1), ahead), 0).flatten()
            torch.testing.assert_close(shifted, torch.tensor(expected, dtype=torch.float32))
        longer = torch.tensor([0.0, 1.0, 4.0, 5.0, 7.0, 8.0]).view(1, 6, 1, 1).repeat(2, 1, 1, 1)
        shifted = shift_in_time(longer, torch.tensor([-1.75, 2.0]).view(2, 1, 1), 2)
        torch.testing.assert_close(shifted.flatten(1), torch.tensor([[0.25, 1.75], [7.0, 8.0]]))

    def test_events_before_and_after_the_exposure_are_there_for_another_clock(self):
        """A longer film: with a clock offset, the ends see the parts of the film outside the exposure."""
        level = torch.linspace(0, 2, 21).view(1, 21, 1, 1)
        options = replace(self.options, height=1, width=1, batch=1, noise=NoiseOptions(0, 0))
        one = torch.full((1, 1, 1), 0.05)
        thresholds = PixelThresholds(one, one, one, one)
        counts, _ = simulate_events(Draw(1, "cpu"), level.exp(), thresholds, torch.zeros(1), options, 2, False)
        self.assertEqual(tuple(counts.shape), (1, 16, 1, 1))
        self.assertTrue(bool((counts.flatten() >= 1).all()))
        self.assertLess(abs(float(counts.sum()) - 1.6 / 0.05), 2)

    def test_half_of_the_exposures_have_their_events_beside_the_frame(self):
        many = draw_misplacement(Draw(1, "cpu"), replace(self.options, batch=400))
        beside = (many != 0).any(3).flatten()
        self.assertLess(abs(float(beside.float().mean()) - 0.5), 0.1)
        self.assertTrue(0.5 < float(many.abs().max()) <= 0.6)
        self.assertEqual(float(draw_misplacement(Draw(1, "cpu"), replace(self.options, noise=NoiseOptions(0, 0))).abs().max()), 0)

    def test_a_soft_lens_spreads_a_point_and_keeps_its_light(self):
        point = torch.zeros(2, 1, 1, 9, 9)
        point[:, :, :, 4, 4] = 1
        soft = soften(point, torch.tensor([0.0, 0.7]))
        torch.testing.assert_close(soft[0], point[0])
        self.assertAlmostEqual(float(soft[1].sum()), 1, places=5)
        x = torch.arange(9.0) - 4
        self.assertAlmostEqual(float((soft[1, 0, 0].sum(0) * x * x).sum()), 0.49, delta=0.02)
        self.assertAlmostEqual(float((soft[1, 0, 0].sum(1) * x * x).sum()), 0.49, delta=0.02)

    def test_footage_gives_the_same_kind_of_sample(self):
        with tempfile.TemporaryDirectory() as folder:
            film = torch.linspace(0.2, 0.8, 17 * 3 * 40 * 44).view(1, 17, 3, 40, 44)
            (Path(folder) / "a").mkdir()
            np.save(Path(folder) / "a" / "footage.npy", (film * 255).round().byte().numpy())
            footage = Footage(Path(folder), torch.device("cpu"))
            sample = generate_from_footage(Draw(1, "cpu"), footage, self.options)
            self.assertEqual(tuple(sample.sharp.shape), (2, 2, 3, 32, 40))
            self.assertEqual(tuple(sample.counts.shape), (2, 16, 32, 40))
            np.save(Path(folder) / "footage.npy", (film * 255).round().byte().numpy())
            footage.refresh()
            footage.refresh()
            self.assertEqual(len(footage), 2)

    def test_events_explain_the_blur_of_a_clean_scene(self):
        clean = replace(self.options, threshold_min=0.05, threshold_max=0.06, steps=48, rectified=0, batch=6,
                        blur_min_px=6, noise=NoiseOptions(0, 0))
        sample = self.make(8, replace(clean, moments=1, middle=True))
        truth = sample.sharp[:, 0]
        edi = restoration.double_integral(sample.blurry, sample.weighted)
        gain = restoration.psnr(edi, truth) - restoration.psnr(sample.blurry, truth)
        self.assertGreater(float(gain.median()), 0.5)
        wrong = restoration.double_integral(sample.blurry, -sample.weighted)
        self.assertTrue(bool((restoration.psnr(wrong, truth) < restoration.psnr(edi, truth)).all()))
        start = restoration.double_integral(sample.blurry, sample.weighted, 0)
        self.assertTrue(bool((restoration.psnr(start, sample.ends[:, 0]) > restoration.psnr(edi, sample.ends[:, 0])).all()))

    def test_splat_keeps_the_sum_inside_and_drops_what_leaves(self):
        maps = torch.zeros(1, 1, 6, 6)
        maps[0, 0, 2, 2], maps[0, 0, 0, 5] = 4, 2
        moved = splat(maps, torch.tensor([0.25, 0.5]).expand(1, 6, 6, 2))
        self.assertAlmostEqual(float(moved[0, 0, 2, 2]), 4 * 0.75 * 0.5, places=5)
        self.assertAlmostEqual(float(moved[0, 0, 3, 3]), 4 * 0.25 * 0.5, places=5)
        self.assertAlmostEqual(float(moved.sum()), 4 + 2 * 0.75, places=5)


class Export(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name)
        torch.manual_seed(0)
        self.net = EFNet(8).eval()
        # Official files have one key, and the prefix of parallel training.
        state = {"module." + k: v for k, v in self.net.state_dict().items()}
        torch.save({"params": state}, self.path / "official.pth")

    def tearDown(self):
        self.folder.cleanup()

    def export(self, *options: str):
        arguments = [str(self.path / "official.pth"), str(self.path / "out.pt"), *options]
        with redirect_stdout(io.StringIO()):
            export_efnet.export(export_efnet.parse_arguments(arguments))
        extra = {"jade_efnet.json": ""}
        module = torch.jit.load(str(self.path / "out.pt"), _extra_files=extra)
        return module, json.loads(extra["jade_efnet.json"])

    def test_official_checkpoint_runs_with_its_metadata(self):
        module, content = self.export("--channel-order", "bgr")
        keys = {"format", "format_version", "kind", "name", "width", "parameters", "input", "normalization",
                "channel_order", "padding_multiple", "minimum_size", "uses_mask", "dtype", "weights_sha256", "source"}
        self.assertEqual(set(content), keys)
        self.assertEqual((content["width"], content["parameters"], content["channel_order"]), (8, 134989, "bgr"))
        self.assertEqual(content["weights_sha256"], export_efnet.weights_sha256(module))
        self.assertEqual((len(list(module.parameters())), len(list(module.buffers()))), (183, 0))
        image, events, mask = export_efnet.example_inputs("efnet", 260, 348, seed=9)
        with torch.no_grad():
            expected = self.net(image.flip(1), events, mask)[1].flip(1)
            self.assertLess(float((module(image, events, mask) - expected).abs().max()), 1e-5)
            self.assertGreater(float((self.net(image, events, mask)[1] - expected).abs().max()), 1e-3)

    def test_smallest_size_and_batches_run(self):
        module, content = self.export()
        size = content["minimum_size"]
        image, events, mask = export_efnet.example_inputs("efnet", size, size + 4, seed=2)
        with torch.no_grad():
            pair = module(*(torch.cat([x, x]) for x in (image, events, mask)))
        self.assertEqual(tuple(pair.shape), (2, 3, size, size + 4))

    def test_without_mask_the_argument_is_ignored(self):
        module, content = self.export("--no-mask", "--input", "bins")
        self.assertEqual((content["uses_mask"], content["input"]), (False, "bins"))
        image, events, mask = export_efnet.example_inputs("efnet", 32, 32, seed=1)
        with torch.no_grad():
            self.assertTrue(torch.equal(module(image, events, mask), module(image, events, mask * 0)))

    def test_an_image_network_is_verified_at_multiples_of_its_padding(self):
        class Halved(torch.nn.Module):
            """Fails unless each side is a multiple of 16."""

            def __init__(self):
                super().__init__()
                self.gain = torch.nn.Parameter(torch.ones(1))

            def forward(self, image: torch.Tensor) -> torch.Tensor:
                small = image[:, :, ::16, ::16] * self.gain
                return image + torch.repeat_interleave(torch.repeat_interleave(small, 16, 2), 16, 3)

        torch.jit.script(Halved()).save(str(self.path / "official.pth"))
        _, content = self.export("--kind", "image", "--padding-multiple", "16")
        self.assertEqual((content["kind"], content["padding_multiple"]), ("image", 16))

    def any_time(self, *options: str):
        net = EFNet(8, restoration.any_time_channels(), restoration.CANDIDATES).eval()
        torch.save({"params": net.state_dict()}, self.path / "official.pth")
        return net, *self.export(*options)

    def test_an_any_time_network_becomes_version_2(self):
        net, module, content = self.any_time()
        self.assertEqual((content["format_version"], content["windows"], content["any_time"]), (2, 16, True))
        self.assertEqual((content["input"], content["normalization"], content["dtype"]), ("counts", "inside", "float32"))
        image, counts, _ = export_efnet.example_inputs("any_time", 40, 52, seed=4)
        times = torch.tensor([0.0, 0.37, 1.0])
        with torch.no_grad():
            batch = module(image.expand(3, -1, -1, -1), counts.expand(3, -1, -1, -1), times)
            for n in range(3):
                expected = net(*restoration.any_time_input(image, counts, times[n : n + 1]))[1]
                self.assertLess(float((batch[n] - expected[0]).abs().max()), 1e-5)
            self.assertGreater(float((batch[0] - batch[2]).abs().max()), 1e-4)

    def test_half_weights_are_those_of_the_hash(self):
        net, module, content = self.any_time("--half")
        self.assertEqual(content["dtype"], "float16")
        self.assertTrue(all(p.dtype == torch.float16 for p in module.parameters()))
        self.assertEqual(content["weights_sha256"], export_efnet.weights_sha256(module))
        image, counts, time = export_efnet.example_inputs("any_time", 32, 32, seed=1)
        with torch.no_grad():
            expected = net(*restoration.any_time_input(image, counts, time))[1]
            self.assertLess(float((module.float()(image, counts, time) - expected).abs().max()), 1e-2)

    def test_training_begins_with_exported_weights_and_checkpoints(self):
        net, _, _ = self.any_time()
        for name in ("official.pth", "out.pt"):
            read = train_efnet.read_weights(self.path / name)
            self.assertEqual(read.keys(), net.state_dict().keys())
            self.assertTrue(all(torch.equal(read[k], v) for k, v in net.state_dict().items()), name)

    def test_a_training_survives_steps_that_are_not_finite(self):
        options = "--width 4 --crop 16 --batch 2 --texture-size 64 --procedural 4 --device cpu --max-steps 12 --blur-max 4".split()
        for where in ("truth", "gradient"):
            folder = self.path / where
            with redirect_stdout(io.StringIO()):
                trainer = train_efnet.Trainer(train_efnet.parse_arguments(["--output", str(folder), *options]))
            trainer.REPORT_STEPS, trainer.validate, sample = 4, lambda final: None, trainer.sample

            def spoilt():
                drawn = sample()
                if where == "truth" and trainer.step == 5:
                    drawn.sharp[0, 0, 0, 0, 0] = float("nan")
                if where == "gradient" and trainer.step == 7:
                    next(trainer.model.parameters()).register_hook(lambda g: g * float("inf") if trainer.step == 7 else g)
                return drawn

            trainer.sample = spoilt
            with redirect_stdout(io.StringIO()) as said:
                trainer.run()
            self.assertIn("those of the last report are restored", said.getvalue() + (folder / "log.txt").read_text())
            for name in ("weights.pth", "state.pth"):
                kept = torch.load(folder / name, weights_only=True)["params"]
                self.assertTrue(all(bool(v.isfinite().all()) for v in kept.values()), (where, name))

    def test_an_any_time_network_takes_no_options_of_the_published_one(self):
        for option in (("--no-mask",), ("--channel-order", "bgr")):
            with self.assertRaises(export_efnet.DataError):
                self.any_time(*option)

    def test_a_network_that_takes_other_inputs_is_told(self):
        self.any_time()
        (self.path / "out.pt").rename(self.path / "in.pt")
        for options, pattern in ((("--kind", "image"), "the network cannot be run on 96x64 pixels .*missing value for argument 'counts'"),
                                 ((), "in.pt: expected a checkpoint of plain tensors")):
            code, said = run_script(export_efnet, self.path / "in.pt", self.path / "out.pt", *options)
            self.assertEqual(code, 3)
            self.assertRegex(said.splitlines()[-1], f"^export_efnet: .*{pattern}")
            self.assertEqual(list(self.path.glob("out.*")), [])

    def test_a_place_that_cannot_be_written_is_told(self):
        for output, pattern in ((self.path, "expected a file to write, such as efnet.pt, found a folder"),
                                (self.path / "none" / "out.pt", "no such folder")):
            code, said = run_script(export_efnet, self.path / "official.pth", output)
            self.assertEqual(code, 3)
            self.assertRegex(said, rf"^export_efnet: \S+: {pattern}\n$")

    def test_wrong_files_are_refused_in_one_line(self):
        state = {k: v for k, v in self.net.state_dict().items() if k != "last.bias"}
        for content in ({"params": state}, {"params": {"a": torch.zeros(1)}}, {"params": 3}):
            torch.save(content, self.path / "official.pth")
            with self.assertRaises(export_efnet.DataError) as caught:
                self.export()
            self.assertNotIn("\n", str(caught.exception))
        (self.path / "official.pth").write_text("no checkpoint")
        with self.assertRaises(export_efnet.DataError):
            self.export()
        self.assertFalse((self.path / "out.pt").exists())


def run_script(script, *arguments) -> tuple[int, str]:
    """Exit code of a script's main(), and its output."""
    said = io.StringIO()
    with mock.patch.object(sys, "argv", [script.__name__, *map(str, arguments)]), redirect_stdout(said), redirect_stderr(said), \
            warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unittest shows torch's warnings, which users do not see
        try:
            code = script.main()
        except SystemExit as stop:
            code = stop.code
    return code, said.getvalue()


class Training(unittest.TestCase):
    SMALL = "--width 4 --crop 16 --batch 2 --texture-size 64 --procedural 4 --device cpu --blur-max 4 --warmup 3".split()

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def train(self, name, *options, stop=None) -> dict[int, float]:
        """Learning rate of every step. stop: saves before this step, and ends as after a signal."""
        with redirect_stdout(io.StringIO()):
            trainer = train_efnet.Trainer(train_efnet.parse_arguments(["--output", str(self.path / name), *self.SMALL, *options]))
        trainer.validate, step, rates = lambda final: None, trainer.train_step, {}

        def recorded():
            if trainer.step == stop:
                trainer.save()
                raise KeyboardInterrupt
            rates[trainer.step] = trainer.learning_rate()
            return step()

        trainer.train_step = recorded
        try:
            with redirect_stdout(io.StringIO()):
                trainer.run()
        except KeyboardInterrupt:
            pass
        trainer.log_file.close()
        return rates

    def refused(self, code, pattern, *options):
        found, said = run_script(train_efnet, "--output", self.path / "out", *self.SMALL, "--max-steps", 2, *options)
        self.assertEqual(found, code, said)
        self.assertRegex(said.splitlines()[-1], rf"^train_efnet\S*: .*{pattern}")
        self.assertNotIn("Traceback", said)

    def film(self, name, frames=17, side=20, kind=np.uint8):
        (self.path / name).mkdir(parents=True, exist_ok=True)
        np.save(self.path / name / "footage.npy", np.zeros((1, frames, 3, side, side), kind))
        return self.path / name / "footage.npy"

    def test_an_interrupted_run_goes_on_with_its_schedule(self):
        whole = self.train("whole", "--max-steps", "9")
        first = self.train("first", "--max-steps", "9", stop=2)
        second = self.train("second", "--max-steps", "9", "--resume", str(self.path / "first"), stop=5)
        third = self.train("third", "--max-steps", "9", "--resume", str(self.path / "second"))
        self.assertEqual((list(first), list(second), list(third)), ([0, 1], [2, 3, 4], [5, 6, 7, 8]))
        self.assertEqual(first | second | third, whole)

    def test_a_finished_run_and_one_by_the_clock_begin_a_new_schedule(self):
        self.train("done", "--max-steps", "3")
        self.train("clock", "--max-minutes", "9", stop=3)
        fresh = self.train("fresh", "--max-steps", "6")
        for name in ("done", "clock"):
            more = self.train("more", "--max-steps", "9", "--resume", str(self.path / name))
            self.assertEqual(list(more.values()), list(fresh.values()))

    def test_a_folder_that_cannot_be_resumed_is_told(self):
        self.refused(3, "state.pth: missing; --resume expects", "--resume", self.path)
        self.train("done", "--max-steps", "2")
        done = self.path / "done"
        resume = ("--resume", done)
        self.refused(3, "max-steps 2: expected more than the 2 steps that", *resume)
        self.refused(3, r"state.pth: .*this network \(--width 6, .*, of width 4; give", *resume, "--width", "6", "--max-steps", "9")
        self.refused(3, "state.pth: .*this network .*give the --width and the --input", *resume, "--input", "bins", "--max-steps", "9")
        whole = (done / "state.pth").read_bytes()
        for name, content in (("state.pth", whole[:1000]), ("state.pth", b""), ("state.pth", (done / "weights.pth").read_bytes()),
                              ("weights.pth", b"none")):
            with self.subTest(name, size=len(content)):
                (done / "state.pth").write_bytes(whole)
                (done / name).write_bytes(content)
                self.refused(3, rf"{name}: expected ", *resume, "--max-steps", "9")

    def test_footage_that_cannot_be_used_is_told(self):
        (self.path / "empty").mkdir()
        self.refused(3, "held-out-footage .*empty: expected files footage.npy below", "--held-out-footage", self.path / "empty")
        self.film("cut").write_bytes(self.film("cut").read_bytes()[:-9])
        self.film("nothing").write_bytes(b"")
        self.film("lengths/a")
        self.film("lengths/b", frames=33)
        self.film("short", frames=9)
        self.film("small", side=12)
        self.film("real", kind=np.float32)
        for name, pattern in (("cut", "footage.npy: cannot be read .* cut short"), ("nothing", "cannot be read"),
                              ("lengths", "b/footage.npy: expected films of 17 frames, .* found 33"),
                              ("short", "expected films of at least 17 frames, found 9; make it with jade_simulate --footage 37"),
                              ("small", "expected frames of at least 16x16 pixels, found 12x12"), ("real", "expected uint8 .*float32")):
            for flag in ("--footage", "--held-out-footage"):
                with self.subTest(name, flag=flag):
                    self.refused(3, pattern, flag, self.path / name)

    def test_footage_that_arrives_damaged_costs_no_training(self):
        good = self.film("films/a").parent.parent
        with redirect_stdout(io.StringIO()) as said:
            trainer = train_efnet.Trainer(train_efnet.parse_arguments(
                ["--output", str(self.path / "out"), *self.SMALL, "--footage", str(good)]))
            arriving = self.film("films/b")
            whole = arriving.read_bytes()
            arriving.write_bytes(whole[:2000])
            trainer.refresh_footage()
            trainer.refresh_footage()
            self.assertEqual(len(trainer.footage), 1)
            arriving.write_bytes(whole)
            trainer.refresh_footage()
        trainer.log_file.close()
        self.assertEqual(len(trainer.footage), 2)
        self.assertEqual(said.getvalue().count("left out: "), 1)

    def test_mistakes_of_the_command_line_are_told(self):
        (self.path / "file").touch()
        for code, pattern, *options in ((2, "--width: expected at least 1, got 0", "--width", 0), (2, "--batch: .* got -2", "--batch", -2),
                                        (2, "--max-minutes: .*got nan", "--max-minutes", "nan"), (2, "--device: expected", "--device", "gpu"),
                                        (2, "--footage-share: expected from 0 to 1, got 7", "--footage-share", 7),
                                        (2, "--footage: no folder at", "--footage", self.path / "file"),
                                        (3, "expected pictures of at least 64x64", "--held-out", self.path),
                                        (3, "File exists: .*file", "--output", self.path / "file")):
            with self.subTest(pattern):
                self.refused(code, pattern, *options)


class Photographs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        # Words above the given folder are ignored.
        self.folder = Path(folder.name) / "logo" / "gradient_letters"
        self.folder.mkdir(parents=True)
        self.output = Path(folder.name) / "out"
        noise = np.random.default_rng(1).integers(0, 255, (160, 160, 3), dtype=np.uint8)
        for name in ("a.png", "logo.png", "html/b.png"):
            (self.folder / name).parent.mkdir(exist_ok=True)
            cv2.imwrite(str(self.folder / name), noise)

    def run_on(self, folder, *options):
        return run_script(prepare_photographs, folder, "--size", 128, "--output", self.output, *options)

    def test_words_are_skipped_below_the_given_folder_only(self):
        self.assertEqual(self.run_on(self.folder)[0], 0)
        self.assertEqual([path.name for path in self.output.iterdir()], ["0000_a.jpg"])

    def test_mistakes_are_told_in_one_line(self):
        for code, folder, options, pattern in (
                (3, self.folder / "none", (), "expected a folder, found none at"), (3, self.folder / "a.png", (), "expected a folder"),
                (3, self.folder, ("--size", "1000"), "found no photograph"), (2, self.folder, ("--size", "0"), "at least 1, found 0"),
                (3, self.folder, ("--output", self.folder / "a.png"), "a.png: File exists; expected folders")):
            with self.subTest(pattern):
                found, said = self.run_on(folder, *options)
                self.assertEqual(found, code, said)
                self.assertRegex(said.splitlines()[-1], rf"^prepare_photographs\S*: .*{pattern}")


class Evaluation(unittest.TestCase):
    """evaluate_efnet.py reads recordings as the programs do (docs/data.md)."""

    SIDE = 16
    BEGIN = 1_600_000_000_000_000  # us, so that no other unit fits

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.model = Path(folder.name) / "net.pt"
        torch.manual_seed(0)
        net = EFNet(4, restoration.any_time_channels(), restoration.CANDIDATES)
        torch.save({"params": net.state_dict()}, cls.model.with_suffix(".pth"))
        code, said = run_script(export_efnet, cls.model.with_suffix(".pth"), cls.model)
        assert code == 0, said

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "scene"
        # Twelve frames, so that names in order of text and of number differ; every third is the sharp one of the exposure before.
        k = np.arange(12)
        start = self.BEGIN + 10_000 * (k // 3 * 2 + k % 3)
        self.start, self.end = np.where(k % 3 == 2, start - 15_000, start), np.where(k % 3 == 2, start - 15_000, start + 10_000)
        draw = np.random.default_rng(5)
        self.pictures = draw.integers(40, 200, (12, self.SIDE, self.SIDE, 3), dtype=np.uint8)
        count = 4000
        self.events = {"x": draw.integers(0, self.SIDE, count), "y": draw.integers(0, self.SIDE, count),
                       "t": np.sort(draw.integers(self.BEGIN - 999, self.BEGIN + 90_000, count)), "p": draw.integers(0, 2, count)}

    def write(self, name="{:02d}.png", images="images_1", per_us=1, times=np.int64, middle=False):
        folder = self.path / images
        folder.mkdir(parents=True)
        for i, image in enumerate(self.pictures):
            cv2.imwrite(str(folder / name.format(i)), image)
        arrays = {"timestamps_start": (self.start * per_us).astype(times), "timestamps_end": (self.end * per_us).astype(times)}
        np.savez(folder / "timestamps.npz", **arrays, **({"timestamps": (self.start + self.end) // 2} if middle else {}))

    def write_events(self, name="events.h5", group="", offset=None, **lists):
        (self.path / name).parent.mkdir(exist_ok=True)
        with h5py.File(self.path / name, "w") as file:
            for field, values in (self.events | lists).items():
                file[group + field] = values
            if offset is not None:
                file["t_offset"] = offset

    def run_on(self, *options):
        return run_script(evaluate_efnet, self.model, self.path, *options)

    def scores(self, *options):
        code, said = self.run_on(*options)
        self.assertEqual(code, 0, said)
        self.assertRegex(said, "efnet +PSNR")
        self.said = said
        return [line for line in said.splitlines() if "PSNR" in line]

    def fresh(self):
        """Recreates the folder."""
        for path in sorted(self.path.rglob("*"), reverse=True):
            path.unlink() if path.is_file() else path.rmdir()
        self.path.rmdir()

    def test_every_layout_that_the_programs_read_gives_the_same_scores(self):
        self.write(middle=True)
        self.write_events()
        expected = self.scores()
        shuffled = np.random.default_rng(1).permutation(len(self.events["t"]))
        mixed = {name: values[shuffled] for name, values in self.events.items()}
        t = self.events["t"]
        table = [self.events[name] for name in "txyp"]

        def text(first, order=(0, 1, 2, 3)):
            rows = "".join("{} {},{}\t{}\n".format(*(row[i] for i in order)) for row in zip(*table))
            return lambda: (self.path / "events.txt").write_text(first + rows, encoding="utf-8")

        cases = {
            "names without zeros": (dict(name="frame_{}.png"), self.write_events),
            "in images": (dict(images="images"), self.write_events),
            "frames in ns": (dict(per_us=1000), self.write_events),
            "frames in s": (dict(per_us=1e-6, times=np.float64), self.write_events),
            "events in ns": ({}, lambda: self.write_events(t=t * 1000 + 7)),
            "events in s": ({}, lambda: self.write_events(t=t * 1e-6)),
            "signs": ({}, lambda: self.write_events(p=(2 * self.events["p"] - 1).astype(np.int8))),
            "truths": ({}, lambda: self.write_events(p=self.events["p"].astype(bool))),
            "unsorted": ({}, lambda: self.write_events(**mixed)),
            "DSEC": ({}, lambda: self.write_events("events/events.h5", "events/", self.BEGIN, t=(t - self.BEGIN).astype(np.int32))),
            "DSEC with axes": ({}, lambda: self.write_events("events.hdf5", "events/", [self.BEGIN], t=t - self.BEGIN)),
            "npz": ({}, lambda: np.savez(self.path / "events.npz", **{name + "s": values for name, values in self.events.items()})),
            "npy": ({}, lambda: np.save(self.path / "events.npy", np.stack(table, 1))),
            "npy, time third": ({}, lambda: np.save(self.path / "events.npy", np.stack([table[i] for i in (1, 2, 0, 3)], 1))),
            "text": ({}, text("")), "text with a header": ({}, text("# made by hand\nt x y p\n")),
            "text that names other columns": ({}, text("\ufeffp,x,timestamp,y\n", (3, 1, 0, 2))), "text, time third": ({}, text("", (1, 2, 0, 3))),
            "timestamps of something else": ({}, lambda: self.write_events(timestamps=t + self.BEGIN)),
        }
        for name, (frames, write_events) in cases.items():
            with self.subTest(name):
                self.fresh()
                self.write(**frames)
                write_events()
                self.assertEqual(self.scores(), expected)
                self.assertEqual("event times were not in order" in self.said, name == "unsorted")
        self.assertNotEqual(self.scores("--thresholds", "0.1", "0.4"), expected, "events count")

    def test_damaged_and_missing_files_are_told(self):
        def cut(path):
            path.write_bytes(path.read_bytes()[:100])

        images = self.path / "images_1"
        p = self.events["p"]
        cases = {
            "expected frames in images_1/": lambda: [path.unlink() for path in images.iterdir()],
            "timestamps.npz: missing": lambda: (images / "timestamps.npz").unlink(),
            "timestamps.npz: cannot be read as .npz": lambda: cut(images / "timestamps.npz"),
            "expected the arrays timestamps_start": lambda: np.savez(images / "timestamps.npz", timestamps=self.start),
            "3 times for 12 images": lambda: np.savez(images / "timestamps.npz", timestamps_start=self.start[:3], timestamps_end=self.end[:3]),
            "frame 0 ends before": lambda: np.savez(images / "timestamps.npz", timestamps_start=self.end, timestamps_end=self.start),
            "no plausible time": lambda: np.savez(images / "timestamps.npz", timestamps_start=self.start, timestamps_end=self.end * 10),
            "00.png: expected an image": lambda: cut(images / "00.png"),
            "expected frames of one size": lambda: cv2.imwrite(str(images / "00.png"), self.pictures[0][:8]),
            "no recording of events": lambda: (self.path / "events.h5").unlink(),
            "events.h5: cannot be read as HDF5": lambda: cut(self.path / "events.h5"),
            "expected event arrays x, y, t and p in one group, found x, y": lambda: self.write_only("xy"),
            "of one length, found 4000, 4000, 4000, 9": lambda: self.write_events(p=p[:9]),
            "expected polarities 0/1 or -1/.1, found -1, 0": lambda: self.write_events(p=p - 1),
            "they share no moment": lambda: self.write_events(t=self.events["t"] + 10 ** 9),
            "expected finite event times": lambda: self.write_events(t=self.events["t"] * np.nan),
        }
        for pattern, damage in cases.items():
            with self.subTest(pattern):
                self.setUp()
                images = self.path / "images_1"
                self.write()
                self.write_events()
                damage()
                code, said = self.run_on()
                self.assertEqual(code, 3, said)
                self.assertRegex(said, rf"^evaluate_efnet: .*{pattern}.*\n$")

    def write_only(self, names):
        with h5py.File(self.path / "events.h5", "w") as file:
            for name in names:
                file[name] = self.events[name]

    def test_other_files_are_told(self):
        self.write()
        self.write_events()
        (self.path / "file.pt").write_bytes(b"no network")
        film = self.path / "footage.npy"
        for code, pattern, model, data, *options in (
                (3, "expected a file made by export_efnet.py, found another", self.path / "file.pt", self.path),
                (3, "expected a file made by export_efnet.py, found none", self.path / "none.pt", self.path),
                (3, "expected a folder in the EvDeblur layout .* found nothing", self.model, self.path / "none"),
                (3, "expected a folder in the EvDeblur layout .* found a file", self.model, self.path / "file.pt"),
                (3, "footage.npy: cannot be read as .npy", self.model, self.path, "--footage", film),
                (2, "--thresholds: expected two numbers above 0", self.model, self.path, "--thresholds", "0", "1"),
                (3, "File exists: .*file.pt", self.model, self.path, "--pictures", self.path / "file.pt")):
            with self.subTest(pattern):
                found, said = run_script(evaluate_efnet, model, data, *options)
                self.assertEqual(found, code, said)
                self.assertRegex(said.splitlines()[-1], rf"^evaluate_efnet\S*: .*{pattern}")
                self.assertNotIn("Traceback", said)

    def test_footage_is_that_of_the_exposures(self):
        self.write()
        self.write_events()
        np.save(self.path / "footage.npy", np.zeros((8, 3, 3, self.SIDE, self.SIDE), np.uint8))
        self.assertRegex(" ".join(self.scores("--footage", self.path / "footage.npy")), "2/2 efnet +PSNR")
        for shape, pattern in (((3, 3, 3, self.SIDE, self.SIDE), "of 8 exposures, found 3 of 3"), ((8, 1, 3, 16, 16), "found 1 of 8"),
                               ((8, 3, 3, 9, 16), "footage.npy: expected 16x16 pixels .* found 16x9")):
            np.save(self.path / "footage.npy", np.zeros(shape, np.uint8))
            code, said = self.run_on("--footage", self.path / "footage.npy")
            self.assertEqual(code, 3)
            self.assertRegex(said, rf"^evaluate_efnet: .*{pattern}.*\n$")


class Shipped(unittest.TestCase):
    def test_shipped_file_is_small_and_whole(self):
        path = ROOT / "assets" / "efnet_anytime.pt"
        self.assertLess(path.stat().st_size, 16 * 2**20)
        extra = {"jade_efnet.json": ""}
        module = torch.jit.load(str(path), _extra_files=extra)
        content = json.loads(extra["jade_efnet.json"])
        self.assertEqual(content["weights_sha256"], export_efnet.weights_sha256(module))
        self.assertEqual((content["width"], content["format_version"]), (48, 2))


if __name__ == "__main__":
    unittest.main()
