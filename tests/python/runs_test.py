# SPDX-License-Identifier: Apache-2.0
"""Tests of the package jade: its readers and renders, against jade_render if JADE_BIN names its folder."""

import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "python/jade_splat"))
import jade  # noqa: E402

COUNT, WIDTH, HEIGHT = 60, 40, 30
ORIGIN = (1000.0, -2000.0, 500.0)


def write_ply(path, degree=1, comments=(), count=COUNT, tail=b"", changes=None, kinds=None):
    """Gaussians in front of the camera; returns their parameters. `changes` are columns to replace or add, `kinds` the
    types of properties that are no floats.
    """
    random = np.random.default_rng(0)
    rest = 3 * ((degree + 1) ** 2 - 1)
    z = random.uniform(2, 5, COUNT)
    means = np.stack([random.uniform(-0.5, 0.5, COUNT) * z, random.uniform(-0.4, 0.4, COUNT) * z, z], -1)
    dc, other = random.normal(0, 0.8, (COUNT, 3)), random.normal(0, 0.2, (COUNT, rest))
    opacity, scales = random.normal(0, 1.5, (COUNT, 1)), random.uniform(-3, -1.5, (COUNT, 3))
    quats = random.normal(size=(COUNT, 4))
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(rest)] + ["opacity", "scale_0", "scale_1", "scale_2"] + [f"rot_{i}" for i in range(4)]
    table = dict(zip(names, np.concatenate([means, np.zeros((COUNT, 3)), dc, other, opacity, scales, quats], 1).T))
    table |= changes or {}
    types = {name: (kinds or {}).get(name, "float") for name in table}
    header = ["ply", "format binary_little_endian 1.0", *[f"comment {c}" for c in comments], f"element vertex {count}"]
    header += [f"property {kind} {name}" for name, kind in types.items()] + ["end_header", ""]
    codes = {"float": "<f4", "double": "<f8", "uchar": "u1"}
    rows = np.zeros(COUNT, [(name, codes[kind]) for name, kind in types.items()])
    for name, column in table.items():
        rows[name] = column
    path.write_bytes("\n".join(header).encode() + rows.tobytes() + tail)
    return {"means": means, "dc": dc, "rest": other, "quats": quats}


CAMERA = {
    "name": "one", "width": WIDTH, "height": HEIGHT, "fx": 36.0, "fy": 37.0, "cx": 19.0, "cy": 16.0,
    "camera_from_world": [[0.995004165, 0, 0.099833417, 0.1], [0, 1, 0, -0.05], [-0.099833417, 0, 0.995004165, 0.2]],
}


class Runs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def write_run(self, **options):
        written = write_ply(self.folder / "point_cloud.ply", **options)
        (self.folder / "cameras.json").write_text(json.dumps([CAMERA]))
        (self.folder / "eval.json").write_text('{"psnr": 31.5}')
        (self.folder / "metrics.jsonl").write_text('{"step": 10, "loss": 0.5}\n{"step": 20, "loss": 0.25, "psnr": 30}\n')
        return written

    def test_load_run(self):
        written = self.write_run(degree=1, comments=["SplatRenderMode: mip", "origin 1 2 3.5"])
        run = jade.load_run(self.folder)
        self.assertTrue(run.gaussians.antialiased)
        self.assertEqual(run.gaussians.origin, (1.0, 2.0, 3.5))
        np.testing.assert_allclose(run.gaussians.means, written["means"], rtol=1e-6)
        np.testing.assert_allclose(run.gaussians.quats, written["quats"], rtol=1e-6)
        # Coefficient 2 of green is the second of green's three.
        np.testing.assert_allclose(run.gaussians.sh[:, 2, 1], written["rest"][:, 3 + 1], rtol=1e-6)
        np.testing.assert_allclose(run.gaussians.sh[:, 0], written["dc"], rtol=1e-6)
        self.assertEqual(run.cameras[0].camera_from_world.shape, (4, 4))
        self.assertEqual(run.scores, {"psnr": 31.5})
        np.testing.assert_array_equal(run.metrics["loss"], [0.5, 0.25])
        np.testing.assert_array_equal(run.metrics["psnr"], [np.nan, 30])

    def test_only_the_scene_is_needed(self):
        write_ply(self.folder / "point_cloud.ply", degree=3)
        run = jade.load_run(self.folder)
        self.assertEqual((run.cameras, run.scores, run.metrics), ([], {}, {}))
        self.assertEqual(run.gaussians.sh.shape, (COUNT, 16, 3))

    def test_origin_moves_with_the_cameras(self):
        self.write_run()
        here = jade.render(self.folder, jade.load_run(self.folder).cameras[0])
        self.write_run(comments=["origin {} {} {}".format(*ORIGIN)])
        camera = jade.load_run(self.folder).cameras[0]
        camera.camera_from_world[:3, 3] -= camera.camera_from_world[:3, :3] @ np.array(ORIGIN)
        torch.testing.assert_close(jade.render(self.folder / "point_cloud.ply", camera), here, atol=1e-5, rtol=0)

    def test_render_has_gradients_and_a_background(self):
        self.write_run()
        run = jade.load_run(self.folder)
        run.gaussians.means.requires_grad_()
        image = jade.render(run, run.cameras[0], background=(0.0, 0.5, 1.0))
        self.assertEqual(image.shape, (HEIGHT, WIDTH, 3))
        image.sum().backward()
        self.assertGreater(run.gaussians.means.grad.abs().sum(), 0)
        with torch.no_grad():
            black = jade.render(run, run.cameras[0])
        self.assertGreater((image - black)[..., 2].max(), 0.1)
        torch.testing.assert_close((image - black)[..., 0], torch.zeros(HEIGHT, WIDTH))

    def test_a_small_scene_has_the_same_picture(self):
        self.write_run()
        run = jade.load_run(self.folder)
        shrunk = replace(run.gaussians, means=run.gaussians.means * 1e-3, log_scales=run.gaussians.log_scales + math.log(1e-3))
        near = replace(run.cameras[0], camera_from_world=run.cameras[0].camera_from_world.copy())
        near.camera_from_world[:3, 3] *= 1e-3
        torch.testing.assert_close(jade.render(shrunk, near), jade.render(run, run.cameras[0]), atol=1e-3, rtol=0)

    def test_a_run_keeps_its_near_plane(self):
        self.write_run()
        without = jade.load_run(self.folder)
        (self.folder / "config.yaml").write_text("splat:  # how\n  near_plane: 3.5  # Gaussians nearer than 0.2\n")
        run = jade.load_run(self.folder)
        self.assertEqual((without.gaussians.near_plane, run.gaussians.near_plane), (0, 3.5))
        pose, g = run.cameras[0].camera_from_world, without.gaussians
        seen = torch.from_numpy(g.means.numpy() @ pose[2, :3] + pose[2, 3] >= 3.5)
        names = ("means", "quats", "log_scales", "logit_opacities", "sh")
        left = replace(g, **{name: getattr(g, name)[seen] for name in names})
        found = jade.render(self.folder, run.cameras[0])
        torch.testing.assert_close(found, jade.render(left, run.cameras[0]))
        self.assertFalse(torch.equal(found, jade.render(without, run.cameras[0])))

    @unittest.skipUnless("JADE_BIN" in os.environ, "needs the programs")
    def test_draws_what_jade_render_draws(self):
        thin, full = np.full(COUNT, -1.0), np.full(COUNT, 0.5)
        thin[::2], full[::3], full[1::3] = -np.inf, np.inf, -np.inf
        far = self.write_run()["means"] + np.array([4e6, 5e6, 0])
        away = {**CAMERA, "camera_from_world": [[1, 0, 0, -4e6], [0, 1, 0, -5e6], [0, 0, 1, 0]]}
        for options in (
            {"degree": 0},
            {"degree": 3, "comments": ["SplatRenderMode: mip"]},
            {"comments": ["by a tool; SplatRenderMode: mip", "origin of the scene: a garden", "origin 0 0 0.25"]},
            {"changes": {"filter_3D": np.linspace(0, 0.3, COUNT)}},
            {"changes": {"scale_1": thin, "opacity": full}},
            {"changes": dict(zip("xyz", far.T)), "kinds": dict.fromkeys("xyz", "double")},
        ):
            self.write_run(**options)
            if "kinds" in options:
                (self.folder / "cameras.json").write_text(json.dumps([away]))
            program = Path(os.environ["JADE_BIN"]) / "jade_render"
            subprocess.run(
                [program, "--ply", self.folder / "point_cloud.ply", "--cameras", self.folder / "cameras.json", "--format",
                 "npy", "--device", "cpu", "--quiet", "--output", self.folder / "views"],
                check=True,
            )
            expected = np.load(next((self.folder / "views").rglob("*.npy")))
            run = jade.load_run(self.folder)
            found = jade.render(run, run.cameras[0]).permute(2, 0, 1).numpy()
            self.assertGreater(found.max(), 0.1)
            # Cameras far from the origin are rounded once more.
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 if "kinds" in options else 0, err_msg=str([*options]))

    def expect(self, error, names, call):
        with self.assertRaises(error) as caught:
            call()
        self.assertIn(names, str(caught.exception))
        self.assertNotIn("\n", str(caught.exception))

    def test_bad_files(self):
        ply = self.folder / "point_cloud.ply"
        self.expect(FileNotFoundError, "point_cloud.ply", lambda: jade.load_run(self.folder))
        for content in (b"", b"PK\3\4", b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", b"ply\nformat"):
            ply.write_bytes(content)
            self.expect(ValueError, "point_cloud.ply", lambda: jade.load_run(self.folder))
        write_ply(ply, count=COUNT + 1)
        self.expect(ValueError, "61", lambda: jade.load_run(self.folder))
        ply.write_bytes(b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nend_header\n")
        self.expect(ValueError, "f_dc_0", lambda: jade.load_run(self.folder))
        self.write_run()
        (self.folder / "metrics.jsonl").write_text('{"step": 1}\n{"st')
        self.expect(ValueError, "metrics.jsonl:2", lambda: jade.load_run(self.folder))
        (self.folder / "metrics.jsonl").write_text('{"loss": 1}\n{"loss": null}\n{"loss": "low"}\n')
        self.expect(ValueError, "metrics.jsonl:3", lambda: jade.load_run(self.folder))
        self.write_run()
        for name, content in (
            ("eval.json", b"{"), ("eval.json", b"[]"), ("eval.json", b"\xff"), ("metrics.jsonl", b"3\n"),
            ("metrics.jsonl", b"\xff\n"), ("cameras.json", b"{}"), ("cameras.json", b"[1]"),
            ("cameras.json", b'[{"id": 0, "position": [0, 0, 0]}]'),
            ("cameras.json", json.dumps([{**CAMERA, "camera_from_world": [1, 2]}]).encode()),
        ):
            self.write_run()
            (self.folder / name).write_bytes(content)
            self.expect(ValueError, name, lambda: jade.load_run(self.folder))

    def test_scenes_that_are_not_read(self):
        ply = self.folder / "point_cloud.ply"
        for content in (b"NGSP", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n",
                        b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nelement vertex 1\nend_header\n"):
            ply.write_bytes(content)
            self.expect(ValueError, f"jade_export --ply {ply}", lambda: jade.load_gaussians(ply))
        for count in ("", "many", -1, 10**18):
            write_ply(ply, count=count)
            self.expect(ValueError, "point_cloud.ply", lambda: jade.load_gaussians(ply))
        write_ply(ply, kinds={"opacity": "uchar"})
        self.expect(ValueError, "opacity as float", lambda: jade.load_gaussians(ply))
        write_ply(ply, count=COUNT - 1)
        with self.assertWarnsRegex(UserWarning, "found 60"):
            self.assertEqual(len(jade.load_gaussians(ply).means), COUNT - 1)
        write_ply(ply, comments=["x" * 2000 + " element vertex 3"])
        self.assertEqual(len(jade.load_gaussians(ply).means), COUNT)

    def test_bad_arguments_of_render(self):
        self.write_run()
        run = jade.load_run(self.folder)
        for background in (0.5, (1, 1), "white", None):
            self.expect(ValueError, "background", lambda: jade.render(run, run.cameras[0], background=background))
        pose = run.cameras[0].camera_from_world
        bad = [("camera_from_world", value) for value in (pose[:3], None, "turned", np.full((4, 4), np.nan))]
        bad += [("camera_from_world", value) for value in (2 * pose, pose * [[1], [1], [-1], [1]], pose[[0, 1, 2, 2]])]
        bad += [("fx", value) for value in (0, -36.0, np.inf, np.nan, "36", None)] + [("cy", np.nan), ("cx", "19")]
        bad += [("height", -1)]
        for name, value in bad:
            with self.subTest(name=name, value=value):
                self.expect(ValueError, name, lambda: jade.render(run, replace(run.cameras[0], **{name: value})))
        for name, value in (("looks transposed", pose.T), ("determinant 8", pose @ np.diag([2, 2, 2, 1]))):
            self.expect(ValueError, name, lambda: jade.render(run, replace(run.cameras[0], camera_from_world=value)))
        learned = replace(run.cameras[0], camera_from_world=torch.from_numpy(pose).requires_grad_())
        self.expect(NotImplementedError, "camera_from_world", lambda: jade.render(run, learned))
        self.expect(TypeError, "camera", lambda: jade.render(run, 0))
        self.expect(TypeError, "dict", lambda: jade.render({}, run.cameras[0]))
        for means in (run.gaussians.means.numpy(), run.gaussians.means.long()):
            self.expect(TypeError, "means", lambda: jade.render(replace(run.gaussians, means=means), run.cameras[0]))

    def test_poses_of_any_kind(self):
        self.write_run()
        run = jade.load_run(self.folder)
        pose = run.cameras[0].camera_from_world
        expected = jade.render(run, run.cameras[0])
        for same in (pose.tolist(), torch.from_numpy(pose)):
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = jade.render(run, replace(run.cameras[0], camera_from_world=same))
            self.assertTrue(torch.equal(found, expected))


if __name__ == "__main__":
    unittest.main()
