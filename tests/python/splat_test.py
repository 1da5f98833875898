# SPDX-License-Identifier: Apache-2.0
"""Tests of jade_splat against plain torch, finite differences and bad input. Takes the library from
JADE_SPLAT_LIBRARY.

  python tests/python/splat_test.py        with a GPU, the comparisons run there too
"""

import itertools
import os
import subprocess
import sys
import unittest
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "python/jade_splat")]
import splat_reference as reference  # noqa: E402
from jade_splat import _library, _ops, rasterization, splat  # noqa: E402

torch.set_num_threads(2)
WIDTH, HEIGHT, VIEWS = 37, 29, 2
NAMES = ("means", "quats", "scales", "opacities", "colors", "viewmats", "backgrounds")
DEVICES = [("cpu", torch.float64), ("cpu", torch.float32)]
if torch.cuda.is_available():
    DEVICES.append(("cuda", torch.float32))


def make_scene(
    count=30, channels=3, coefficients=None, per_view=False, device="cpu", dtype=torch.float64, seed=0
):
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    def uniform(*shape):
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    z = 2 + 3 * uniform(count)
    means = torch.stack([(uniform(count) - 0.5) * 1.3 * z, (uniform(count) - 0.5) * z, z], -1)
    shape = (VIEWS,) * per_view + (count,)
    if coefficients:
        colors = 0.4 * normal(*shape, coefficients, 3)
    else:
        colors = normal(*shape, channels)
        colors.flatten()[:3] = 0  # black is a colour with a gradient
    viewmats = torch.eye(4, dtype=torch.float64).repeat(VIEWS, 1, 1)
    angle = torch.tensor(0.1, dtype=torch.float64)
    viewmats[1, 0, 0], viewmats[1, 0, 2] = angle.cos(), angle.sin()
    viewmats[1, 2, 0], viewmats[1, 2, 2] = -angle.sin(), angle.cos()
    viewmats[1, :3, 3] = torch.tensor([0.1, -0.05, 0.2])
    Ks = torch.tensor([[30.0, 0, 19], [0, 32, 13], [0, 0, 1]], dtype=torch.float64).repeat(VIEWS, 1, 1)
    scene = {
        "means": means,
        "quats": normal(count, 4),
        "scales": 0.05 + 0.2 * uniform(count, 3),
        "opacities": 0.05 + 0.94 * uniform(count),
        "colors": colors,
        "viewmats": viewmats,
        "Ks": Ks,
        "backgrounds": uniform(VIEWS, 3 if coefficients else channels),
    }
    return {name: tensor.to(device, dtype) for name, tensor in scene.items()}


def with_gradients(scene):
    return {name: t.clone().requires_grad_(name != "Ks") for name, t in scene.items()}


def run(render, scene, **options):
    """Image, alpha, gradients by name and dL/dmeans2d [C,N,2] of a fixed random loss."""
    scene = with_gradients(scene)
    if options.get("render_mode") in ("D", "ED"):
        scene.pop("backgrounds")
    image, alpha, meta = render(**scene, width=WIDTH, height=HEIGHT, **options)
    if isinstance(meta, list):
        screens = meta
    else:
        meta["means2d"].retain_grad()
        screens = [meta["means2d"]]
    generator = torch.Generator().manual_seed(1)
    loss = sum(
        (value * torch.randn(value.shape, generator=generator, dtype=torch.float64).to(value)).sum()
        for value in (image, alpha)
    )
    loss.backward()
    grads = {name: scene[name].grad for name in NAMES if name in scene and scene[name].grad is not None}
    grads["means2d"] = torch.stack([s.grad for s in screens]).reshape(VIEWS, -1, 2)
    return image.detach(), alpha.detach(), grads


class AgainstReference(unittest.TestCase):
    known = {}  # results of the slow reference in float64

    def compare(self, device, dtype, options, **scene_options):
        scene = make_scene(**scene_options)
        key = (*options.items(), *scene_options.items())
        if key not in self.known:
            self.known[key] = run(reference.rasterization, scene, **options)
        expected = self.known[key]
        scene = {name: t.to(device, dtype) for name, t in scene.items()}
        found = run(rasterization, scene, packed=False, **options)
        tolerance = 1e-9 if dtype == torch.float64 else 2e-3
        for name, a, b in [("image", found[0], expected[0]), ("alpha", found[1], expected[1])]:
            self.assertEqual(a.shape, b.shape, name)
            error = (a.cpu().double() - b).abs().max() / b.abs().max().clamp(min=1)
            self.assertLess(error, tolerance, f"{name} {options} {device}")
        self.assertEqual(set(found[2]), set(expected[2]))
        for name, b in expected[2].items():
            a = found[2][name].cpu().double()
            self.assertEqual(a.shape, b.shape, name)
            if name == "viewmats":
                a, b = a[:, :3], b[:, :3]
            self.assertGreater(b.abs().max(), 0, name)
            self.assertLess((a - b).norm() / b.norm(), tolerance, f"gradient of {name} {options} {device}")

    def test_modes(self):
        for (device, dtype), mode, rasterize in itertools.product(
            DEVICES, ("RGB", "D", "ED", "RGB+D", "RGB+ED"), ("classic", "antialiased")
        ):
            with self.subTest(device=device, dtype=dtype, mode=mode, rasterize=rasterize):
                self.compare(device, dtype, {"render_mode": mode, "rasterize_mode": rasterize})

    def test_colors(self):
        for (device, dtype), per_view, channels in itertools.product(DEVICES, (False, True), (1, 3, 7)):
            with self.subTest(device=device, dtype=dtype, per_view=per_view, channels=channels):
                self.compare(device, dtype, {"render_mode": "RGB+D"}, channels=channels, per_view=per_view)

    def test_harmonics(self):
        for (device, dtype), per_view, (degree, coefficients) in itertools.product(
            DEVICES, (False, True), ((0, 1), (2, 16), (3, 16), (1, 6))
        ):
            with self.subTest(device=device, dtype=dtype, per_view=per_view, degree=degree):
                self.compare(device, dtype, {"sh_degree": degree}, coefficients=coefficients, per_view=per_view)

    def test_batches(self):
        for device, dtype in DEVICES:
            scenes = [make_scene(device=device, dtype=dtype, seed=seed) for seed in range(2)]
            batch = {name: torch.stack([s[name] for s in scenes])[:, None] for name in scenes[0]}
            image, alpha, meta = rasterization(**batch, width=WIDTH, height=HEIGHT, packed=False)
            self.assertEqual(image.shape, (2, 1, VIEWS, HEIGHT, WIDTH, 3))
            self.assertEqual(alpha.shape, (2, 1, VIEWS, HEIGHT, WIDTH, 1))
            self.assertEqual(meta["radii"].shape, (2, 1, VIEWS, 30, 2))
            for b, scene in enumerate(scenes):
                alone, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
                self.assertTrue(torch.equal(image[b, 0], alone))

    def test_batches_without_gaussians(self):
        scene = make_scene(count=0, per_view=True)
        batch = {name: t[None] for name, t in scene.items()}
        image, _, meta = rasterization(**batch, width=WIDTH, height=HEIGHT, render_mode="RGB+D")
        self.assertTrue(torch.equal(image[0, ..., :3], scene["backgrounds"][:, None, None].expand(-1, HEIGHT, WIDTH, -1)))
        self.assertEqual(meta["radii"].shape, (0, 2))

    def test_planes_cull(self):
        scene = make_scene()
        near, far = 3.0, 4.0
        between = (scene["means"][:, 2] >= near) & (scene["means"][:, 2] <= far)
        first = {name: t[:1] if name in ("viewmats", "Ks", "backgrounds") else t for name, t in scene.items()}
        found, _, meta = rasterization(**first, width=WIDTH, height=HEIGHT, near_plane=near, far_plane=far)
        first |= {name: scene[name][between] for name in ("means", "quats", "scales", "opacities", "colors")}
        expected, _, _ = rasterization(**first, width=WIDTH, height=HEIGHT)
        self.assertTrue(torch.equal(found, expected))
        self.assertTrue(between[meta["gaussian_ids"]].all())

    def test_extreme_parameters_keep_their_gradients(self):
        """Opacity 1 and a scale of 0 have no logit and no logarithm."""
        scene = make_scene(count=6)
        scene["opacities"][:2] = 1
        scene["scales"][2:4, 1] = 0
        expected = run(reference.rasterization, scene)[2]
        found = run(rasterization, scene, packed=False)[2]
        for name in ("opacities", "scales", "means"):
            self.assertLess((found[name] - expected[name]).abs().max(), 1e-9, name)


    def test_opacity_above_one(self):
        """A wider opaque middle, as in gsplat; the Gaussian must not vanish."""
        scene = make_scene()
        scene["opacities"] *= 2.5
        self.assertGreater(scene["opacities"].max(), 1)
        for (device, dtype), rasterize in itertools.product(DEVICES, ("classic", "antialiased")):
            expected = run(reference.rasterization, scene, rasterize_mode=rasterize)
            moved = {name: t.to(device, dtype) for name, t in scene.items()}
            found = run(rasterization, moved, packed=False, rasterize_mode=rasterize)
            tolerance = 1e-9 if dtype == torch.float64 else 2e-3
            self.assertLess((found[0].cpu().double() - expected[0]).abs().max(), tolerance)
            for name in ("opacities", "means", "scales"):
                a, b = found[2][name].cpu().double(), expected[2][name]
                self.assertLess((a - b).norm() / b.norm(), tolerance, name)

    def test_cap_of_alpha(self):
        """A pixel in the middle of an opaque Gaussian: 0.999 of it, as in gsplat; 0.99 in the programs."""
        for device, dtype in DEVICES:
            scene = make_scene(count=1, coefficients=1, device=device, dtype=dtype)
            scene["means"][:] = torch.tensor([0.0, 0.0, 2.0])
            scene["scales"][:], scene["opacities"][:] = 10, 1
            _, alpha, _ = rasterization(**scene, width=WIDTH, height=HEIGHT, sh_degree=0)
            intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]].contiguous()
            logits = torch.full_like(scene["opacities"], 20)
            _, other, _ = splat(*[scene[name] for name in NAMES[:2]], scene["scales"].log(), logits, scene["colors"],
                                scene["viewmats"], intrinsics, WIDTH, HEIGHT)
            self.assertLess(abs(alpha[0].max() - 0.999), 1e-6)
            self.assertLess(abs(other[0].max() - 0.99), 1e-6)


class Gradients(unittest.TestCase):
    def inputs(self):
        scene = make_scene(count=5, coefficients=4)
        intrinsics = torch.stack([scene["Ks"][:, 0, 0], scene["Ks"][:, 1, 1], scene["Ks"][:, 0, 2], scene["Ks"][:, 1, 2]], -1)
        parameters = [scene["means"], scene["quats"], scene["scales"].log(), scene["opacities"].logit(), scene["colors"]]
        parameters[3] = parameters[3].clamp(-2, 2)
        return [t.requires_grad_() for t in parameters] + [scene["viewmats"].requires_grad_()], intrinsics

    def function(self, intrinsics, change=lambda x: x):
        def rendered(*inputs):
            return splat(*map(change, inputs), intrinsics, 12, 9, sh_degree=1, depth=True, smooth_cutoff=True)

        return rendered

    def test_gradcheck(self):
        inputs, intrinsics = self.inputs()
        self.assertTrue(torch.autograd.gradcheck(self.function(intrinsics), inputs, atol=1e-6, rtol=1e-4))

    def test_gradcheck_finds_a_wrong_gradient(self):
        class Wrong(torch.autograd.Function):
            @staticmethod
            def forward(ctx, x):
                return x.clone()

            @staticmethod
            def backward(ctx, grad):
                return 1.01 * grad

        inputs, intrinsics = self.inputs()
        with self.assertRaises(torch.autograd.gradcheck.__globals__["GradcheckError"]):
            torch.autograd.gradcheck(self.function(intrinsics, Wrong.apply), inputs, atol=1e-6, rtol=1e-4)

    def test_second_backward_is_the_first(self):
        for device, dtype in DEVICES:
            scene = with_gradients(make_scene(device=device, dtype=dtype))
            image, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
            grads = [
                torch.autograd.grad(image.square().sum(), [scene["means"], scene["viewmats"]], retain_graph=True)
                for _ in range(2)
            ]
            for a, b in zip(*grads):
                self.assertLess((a - b).norm() / b.norm(), 1e-5)

    def test_no_second_derivatives(self):
        scene = with_gradients(make_scene(count=4))
        image, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
        (grad,) = torch.autograd.grad(image.square().sum(), scene["means"], create_graph=True)
        with self.assertRaisesRegex(RuntimeError, "once_differentiable"):
            grad.sum().backward()

    def test_no_forward_mode(self):
        """A tangent must not be lost: the image is no constant."""
        scene = make_scene(count=4)
        others = [scene[name] for name in (*NAMES[1:6], "Ks")]

        def rendered(means):
            return rasterization(means, *others, WIDTH, HEIGHT)[0]

        with self.assertRaisesRegex(NotImplementedError, "tangents"):
            torch.func.jvp(rendered, (scene["means"],), (torch.ones_like(scene["means"]),))
        with torch.autograd.forward_ad.dual_level():
            self.assertTrue(rendered(scene["means"]).isfinite().all())
        for transform in (torch.func.grad(lambda means: rendered(means).sum()), torch.func.vmap(rendered)):
            with self.assertRaisesRegex(NotImplementedError, "torch.func"):
                transform(scene["means"][None] if transform.__name__ == "rendered" else scene["means"])

    def test_some_inputs_need_gradients(self):
        full = with_gradients(make_scene())
        rasterization(**full, width=WIDTH, height=HEIGHT)[0].square().sum().backward()
        for name in NAMES:
            scene = make_scene()
            scene[name].requires_grad_()
            rasterization(**scene, width=WIDTH, height=HEIGHT)[0].square().sum().backward()
            self.assertTrue(torch.equal(scene[name].grad, full[name].grad), name)


@unittest.skipUnless(torch.cuda.is_available(), "needs a GPU")
class OnAGpu(unittest.TestCase):
    def step(self, scene):
        for tensor in scene.values():
            tensor.grad = None
        image, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
        (image * image).sum().backward()
        return image

    def test_graph_capture(self):
        """Both passes in a CUDA graph, replayed with other Gaussians."""
        scene = with_gradients(make_scene(count=200, device="cuda", dtype=torch.float32))
        with torch.cuda.stream(torch.cuda.Stream()):
            for _ in range(3):
                self.step(scene)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            image = self.step(scene)
        with torch.no_grad():
            scene["means"] += 0.05
        graph.replay()
        found = image.detach().clone(), scene["means"].grad.clone()
        expected = self.step(scene).detach(), scene["means"].grad
        for a, b in zip(found, expected):
            self.assertLess((a - b).norm() / b.norm(), 1e-5)

    def test_current_stream(self):
        """Work is queued on the current stream, after its earlier work."""
        scene = make_scene(count=200, device="cuda", dtype=torch.float32)
        expected, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
        late = scene["means"].clone()
        scene["means"] = torch.zeros_like(late)
        torch.cuda.synchronize()
        stream = torch.cuda.Stream()
        with torch.cuda.stream(stream):
            torch.cuda._sleep(200_000_000)
            scene["means"].copy_(late)
            found, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
        stream.synchronize()
        self.assertTrue(torch.equal(found, expected))

    def test_deterministic(self):
        scene = with_gradients(make_scene(count=500, device="cuda", dtype=torch.float32))
        torch.use_deterministic_algorithms(True)
        self.addCleanup(torch.use_deterministic_algorithms, False)
        grads = []
        for _ in range(3):
            self.step(scene)
            grads.append(scene["means"].grad)
        self.assertTrue(torch.equal(grads[0], grads[1]) and torch.equal(grads[0], grads[2]))


class Operations(TorchDispatchMode):
    """The operations of torch below autograd, except detach(), which autograd uses to store and return tensors."""

    def __init__(self):
        super().__init__()
        self.names = []

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        if function is not torch.ops.aten.detach.default:
            self.names.append(str(function))
        return function(*args, **(kwargs or {}))


class HostTime(unittest.TestCase):
    """Small scenes are limited by the host, where each operation and each node costs time."""

    def test_operations_of_a_step(self):
        both = ["jade_splat.forward.default", "jade_splat.backward.default"]
        for coefficients, options in ((None, {}), (16, {"sh_degree": 3}), (4, {"sh_degree": 1, "packed": False})):
            scene = make_scene(coefficients=coefficients)
            scene.pop("backgrounds")
            with Operations() as seen, torch.no_grad():
                rasterization(**scene, width=WIDTH, height=HEIGHT, **options)
            self.assertEqual(seen.names, both[:1])
            scene = with_gradients(scene)
            with Operations() as seen:
                image, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT, **options)
                image.backward(torch.ones(image.shape, dtype=image.dtype))
            seen.names = [name for name in seen.names if "ones" not in name]
            self.assertEqual(seen.names, ["aten.new_empty.default", *both], options)  # means2d, then the op

    def test_operations_of_meta(self):
        _, _, meta = rasterization(**make_scene(), width=WIDTH, height=HEIGHT, packed=False)
        with Operations() as seen:
            self.assertTrue("radii" in meta and "isect_ids" not in meta)
        self.assertEqual(seen.names, [])
        with Operations() as seen:
            meta["radii"]
        self.assertLess(len(seen.names), 135)
        self.assertEqual([name for name in seen.names if "lift" in name or "_local_scalar" in name], [])  # wait for a GPU

    def test_without_gradients_only_images_are_made(self):
        scene = make_scene()
        inputs = [scene[name] for name in (*NAMES[:6], "Ks")]
        scalars = (WIDTH, HEIGHT, -1, 0.01, 1e10, 0.999, True, False, False, False, False, True)
        self.assertEqual(len(_ops.forward(*inputs, *scalars, False)), 2)

    def test_operations_of_the_bare_op(self):
        scene = make_scene(coefficients=16)
        intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]].contiguous()
        inputs = [scene[name].requires_grad_() for name in NAMES[:6]]
        with Operations() as seen:
            image, _, _ = splat(*inputs, intrinsics, WIDTH, HEIGHT)
            image.backward(image.detach())
        self.assertEqual(seen.names, ["jade_splat.forward.default", "jade_splat.backward.default"])

    def test_one_node_of_autograd(self):
        for coefficients in (None, 16):
            scene = make_scene(coefficients=coefficients)
            scene.pop("backgrounds")
            scene = with_gradients(scene)
            image, alpha, _ = rasterization(**scene, width=WIDTH, height=HEIGHT, sh_degree=3 if coefficients else None)
            self.assertIs(image.grad_fn, alpha.grad_fn)
            before = [node.name() for node, _ in image.grad_fn.next_functions if node is not None]
            self.assertEqual(before, ["torch::autograd::AccumulateGrad"] * 7)  # six inputs and means2d


class Meta(unittest.TestCase):
    def densify(self, packed):
        """Sums as in gsplat's default strategy."""
        scene = with_gradients(make_scene())
        image, _, meta = rasterization(**scene, width=WIDTH, height=HEIGHT, packed=packed)
        self.assertEqual((meta["width"], meta["height"], meta["n_cameras"]), (WIDTH, HEIGHT, VIEWS))
        meta["means2d"].retain_grad()
        image.square().mean().backward()
        grads, radii, ids = meta["means2d"].grad.clone(), meta["radii"], meta["gaussian_ids"]
        if not packed:
            shown = (radii > 0).all(-1)
            ids, grads, radii = torch.where(shown)[1], grads[shown], radii[shown]
        norms, counts = torch.zeros(30, dtype=grads.dtype), torch.zeros(30)
        norms.index_add_(0, ids, grads.norm(dim=-1))
        counts.index_add_(0, ids, torch.ones(len(ids)))
        return norms, counts, radii

    def test_packed_and_dense_tell_the_same(self):
        for a, b in zip(self.densify(True), self.densify(False)):
            self.assertTrue(torch.equal(a, b))
            self.assertGreater(a.sum(), 0)

    def test_screen_values(self):
        scene = make_scene()
        _, _, meta = rasterization(**scene, width=WIDTH, height=HEIGHT, packed=False)
        for view in range(VIEWS):
            means2d, z, xx, xy, yy, _ = reference.project(
                scene["means"], scene["quats"], scene["scales"], scene["viewmats"][view], scene["Ks"][view], WIDTH, HEIGHT
            )
            covariance = torch.stack([xx + 0.3, xy, xy, yy + 0.3], -1).reshape(-1, 2, 2)
            inverse = torch.linalg.inv(covariance)
            conics = torch.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], -1)
            for name, expected in (("means2d", means2d), ("depths", z), ("conics", conics)):
                self.assertLess((meta[name][view] - expected).abs().max(), 1e-9, name)

    def test_what_is_drawn_has_a_radius(self):
        """A Gaussian with a screen gradient is visible according to radii."""
        scene = with_gradients(make_scene(count=200, seed=3))
        image, _, meta = rasterization(**scene, width=WIDTH, height=HEIGHT, packed=False)
        means2d = meta["means2d"]
        image.square().sum().backward()
        drawn = (means2d.grad != 0).any(-1)
        self.assertTrue((meta["radii"] > 0).all(-1)[drawn].all())
        self.assertGreater((~drawn).sum(), 0)


    def test_autocast_does_not_round(self):
        scene = make_scene(dtype=torch.float32)
        _, _, expected = rasterization(**scene, width=WIDTH, height=HEIGHT, packed=False)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            image, _, meta = rasterization(**scene, width=WIDTH, height=HEIGHT, packed=False)
            for name in ("means2d", "radii", "depths", "conics", "opacities"):
                self.assertTrue(torch.equal(meta[name], expected[name]), name)
        self.assertEqual(image.dtype, torch.float32)

    def test_values_of_changed_gaussians_are_reported(self):
        for read_first in (False, True):
            scene = with_gradients(make_scene())
            _, _, meta = rasterization(**scene, width=WIDTH, height=HEIGHT)
            if read_first:
                meta["means2d"]
            with torch.no_grad():
                scene["means"] += 1
            with warnings.catch_warnings(record=True) as seen:
                warnings.simplefilter("always")
                meta["radii"]
            self.assertEqual(["before optimizer.step()" in str(w.message) for w in seen], [True] * (not read_first))

    def test_in_inference_mode(self):
        with torch.inference_mode():
            _, _, meta = rasterization(**make_scene(), width=WIDTH, height=HEIGHT)
            self.assertGreater(len(meta["gaussian_ids"]), 0)


class Compiled(unittest.TestCase):
    def test_opcheck(self):
        for device, dtype in DEVICES:
            scene = make_scene(count=8, device=device, dtype=dtype)
            inputs = [scene[name].requires_grad_() for name in NAMES[:4]]
            inputs += [scene["colors"][:, None].clone().requires_grad_(), scene["viewmats"].requires_grad_()]
            intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]].contiguous()
            arguments = (*inputs, intrinsics, WIDTH, HEIGHT, -1, 0.01, 1e10, 0.999, True, False, True, False, True, True, True)
            # On a GPU the lists have unused capacity with undefined content, which a comparison of two calls would
            # read.
            checks = ("test_schema", "test_autograd_registration", "test_faketensor", "test_aot_dispatch_dynamic")
            torch.library.opcheck(torch.ops.jade_splat.forward, arguments, test_utils=checks[: 3 if device == "cuda" else 4])

    def test_torch_compile(self):
        def loss(means, quats, scales, opacities, colors, viewmats, Ks, backgrounds):
            image, alpha, meta = rasterization(
                means, quats, scales, opacities, colors, viewmats, Ks, WIDTH, HEIGHT, backgrounds=backgrounds,
                render_mode="RGB+ED",
            )
            return (image.square() * meta["width"]).mean() + alpha.mean()

        for device, dtype in DEVICES:
            scene = make_scene(device=device, dtype=dtype)
            eager, compiled = with_gradients(scene), with_gradients(scene)
            expected = loss(**eager)
            expected.backward()
            found = torch.compile(loss, backend="aot_eager", fullgraph=True)(**compiled)
            found.backward()
            self.assertLess((found - expected).abs(), 1e-4 * expected.abs())
            for name in NAMES:
                a, b = compiled[name].grad, eager[name].grad
                self.assertLess((a - b).norm() / b.norm(), 1e-4, name)


class BadInput(unittest.TestCase):
    def expect(self, error, name, scene=None, **options):
        with self.assertRaises(error) as caught:
            rasterization(**(scene or make_scene(count=4)), **({"width": WIDTH, "height": HEIGHT} | options))
        self.assertIn(name, str(caught.exception))
        self.assertNotIn("\n", str(caught.exception))
        # One exception, even where the op refused its input first.
        self.assertTrue(caught.exception.__context__ is None or caught.exception.__suppress_context__)

    def test_unsupported_arguments(self):
        some = torch.zeros(1)
        for name, value in {
            "radius_clip": 1.0, "eps2d": 0.1, "sparse_grad": True, "absgrad": True, "distributed": True,
            "camera_model": "fisheye", "covars": some, "with_ut": True, "with_eval3d": True, "radial_coeffs": some,
            "tangential_coeffs": some, "thin_prism_coeffs": some, "ftheta_coeffs": object(), "viewmats_rs": some,
            "rolling_shutter": object(),
        }.items():
            self.expect(NotImplementedError, name, **{name: value})
        scene = make_scene(count=4)
        scene["Ks"].requires_grad_()
        self.expect(NotImplementedError, "Ks.detach()", scene)

    def test_values(self):
        self.expect(ValueError, "render_mode", render_mode="RGBD")
        self.expect(ValueError, "rasterize_mode", rasterize_mode="sharp")
        self.expect(ValueError, "sh_degree", make_scene(count=4, coefficients=25), sh_degree=4)
        self.expect(ValueError, "colors", make_scene(count=4, coefficients=4), sh_degree=2)
        self.expect(ValueError, "width", width=0)
        self.expect(TypeError, "32.5", width=32.5)
        self.expect(TypeError, "sh_degree", make_scene(count=4, coefficients=16), sh_degree=1.5)
        self.expect(ValueError, "near_plane", near_plane=2.0, far_plane=1.0)
        self.expect(TypeError, "far_plane", far_plane=None)
        self.expect(TypeError, "radius_clip", radius_clip=None)
        self.expect(ValueError, "tile_size", tile_size=0)
        self.expect(TypeError, "tile_size", tile_size=None)
        self.expect(ValueError, "batch", {name: t[None][:0] for name, t in make_scene(count=4).items()})

    def test_transposed_view_matrices(self):
        scene = make_scene(count=4)
        scene["viewmats"] = scene["viewmats"].mT.contiguous()
        self.expect(ValueError, "viewmats: expected 0, 0, 0, 1", scene)
        self.expect(ValueError, ".mT", {name: t[None] for name, t in scene.items()})
        scene = make_scene(count=4, coefficients=1)
        with self.assertRaisesRegex(ValueError, "viewmats: expected 0, 0, 0, 1"):
            splat(*[scene[name] for name in NAMES[:5]], scene["viewmats"].mT.contiguous(), scene["Ks"].flatten(1)[:, [0, 4, 2, 5]], WIDTH, HEIGHT)
        scene["viewmats"] = scene["viewmats"].clone()
        scene["viewmats"][:, 3, :] += 1e-6
        rasterization(**scene, width=WIDTH, height=HEIGHT, sh_degree=0)

    def test_types_of_numbers(self):
        """Whole numbers of any type; never rounded."""
        expected, _, _ = rasterization(**make_scene(count=4), width=WIDTH, height=HEIGHT)
        for kind in (np.int64, torch.tensor):
            found, _, meta = rasterization(**make_scene(count=4), width=kind(WIDTH), height=kind(HEIGHT))
            self.assertTrue(torch.equal(found, expected))
            self.assertEqual(meta["tile_width"], 3)
        for wrong in (torch.tensor(37.5), np.float32(37), [37], "37", None):
            self.expect(TypeError, "height: expected an integer", height=wrong)

    def test_shapes(self):
        for name in (*NAMES, "Ks"):
            scene = make_scene(count=4)
            scene[name] = scene[name][..., :-1] if name != "opacities" else scene[name][:-1]
            if name == "colors":  # of two channels: then the background does not fit
                name = "backgrounds"
            self.expect(ValueError, name, scene)

    def test_tensors_that_the_op_refuses(self):
        """Tensors of the common call, which only the op checks before it runs."""
        for degree in (None, 1):
            good = make_scene(count=4, coefficients=4 if degree else None)
            good.pop("backgrounds")
            rows = good["Ks"].flatten(1)[:, [0, 4, 2, 5]]
            for name, tensor in good.items():
                wrong = [(TypeError, change(tensor)) for change in (Tensor.half, Tensor.long, Tensor.numpy, Tensor.to_sparse)]
                wrong += [(ValueError, tensor[0] if name == "means" else tensor[None]), (ValueError, tensor.to("meta"))]
                # The number of Gaussians is that of the means, and that of cameras that of viewmats.
                wrong += [(ValueError, tensor[:, :-1] if name in ("means", "viewmats") else tensor[:-1])]
                wrong += [(ValueError, rows)] if name == "Ks" else [(TypeError, None)]
                for (error, value), other in itertools.product(wrong, (None, "quats", "scales")):
                    scene = good | {name: value}
                    if other not in (None, name):
                        scene[other] = scene[other].clone().requires_grad_()
                    with self.subTest(degree=degree, name=name, error=error, gradient=other):
                        self.expect(error, name, scene, sh_degree=degree)
        everything = {name: tensor.to("meta") for name, tensor in good.items()}
        self.expect(ValueError, "meta", everything, sh_degree=1)

    def test_the_bare_op(self):
        scene = make_scene(count=4, coefficients=4)
        intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]]
        good = {
            "means": scene["means"], "quats": scene["quats"], "log_scales": scene["scales"].log(),
            "logit_opacities": scene["opacities"].logit(), "sh": scene["colors"], "viewmats": scene["viewmats"],
            "intrinsics": intrinsics, "width": WIDTH, "height": HEIGHT,
        }
        splat(**good)
        bad = {name: good[name][:-1] for name in ("quats", "log_scales", "logit_opacities", "sh", "intrinsics")}
        bad |= {"means": scene["means"][:, :2], "viewmats": scene["viewmats"][:0], "width": -3, "height": 10**6}
        bad |= {"near_plane": 0.0, "sh_degree": 4, "intrinsics": scene["Ks"], "quats": scene["quats"].to("meta")}
        for name, value in bad.items():
            with self.assertRaisesRegex(ValueError, f"^([a-z]+, )?{name}(, [a-z]+)?: expected"):
                splat(**(good | {name: value}))
        wrong = {"width": 32.5, "sh_degree": 1.5, "quats": None, "sh": scene["colors"].half(), "depth": "no"}
        for name, value in wrong.items():
            with self.assertRaisesRegex(TypeError, f"^{name}"):
                splat(**(good | {name: value}))
        with self.assertRaisesRegex(NotImplementedError, r"intrinsics\.detach\(\)"):
            splat(**(good | {"intrinsics": intrinsics.clone().requires_grad_()}))

    def test_types_and_devices(self):
        for name in (*NAMES, "Ks"):
            scene = make_scene(count=4)
            scene[name] = scene[name].half()
            self.expect(TypeError, "float16", scene)
            scene[name] = make_scene(count=4)[name].float()
            self.expect(TypeError, "float", scene)
            if name != "means":
                scene[name] = torch.empty(scene[name].shape, dtype=torch.float64, device="meta")
                self.expect(ValueError, name, scene)
        self.expect(TypeError, "Ks", {**make_scene(count=4), "Ks": None})

    @unittest.skipUnless(torch.cuda.is_available(), "needs a GPU")
    def test_on_a_gpu(self):
        scene = make_scene(count=4, device="cuda", dtype=torch.float32)
        self.expect(ValueError, "quats", {**scene, "quats": scene["quats"].cpu()})
        self.expect(TypeError, "float64", make_scene(count=4, device="cuda"))

    def test_op_refuses_what_would_be_misread(self):
        scene = make_scene(count=4)
        intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]].contiguous()
        inputs = [*[scene[name] for name in NAMES[:4]], scene["colors"][:, None], scene["viewmats"], intrinsics]
        rest = (WIDTH, HEIGHT, -1, 0.01, 1e10, 0.999, True, False, False, False, False, False, False)
        _ops.forward(*inputs, *rest)
        for index, wrong in ((0, inputs[0].T.contiguous().T), (1, inputs[1].float()), (2, inputs[2][:-1])):
            bad = [wrong if i == index else t for i, t in enumerate(inputs)]
            with self.assertRaisesRegex(RuntimeError, ("means", "quats", "scales")[index]):
                _ops.forward(*bad, *rest)

    def test_layouts_agree(self):
        """Colours by plane or by pixel, intrinsics as rows or as matrices."""
        for device, dtype in DEVICES:
            scene = make_scene(device=device, dtype=dtype)
            intrinsics = scene["Ks"].flatten(1)[:, [0, 4, 2, 5]].contiguous()
            inputs = [*[scene[name] for name in NAMES[:4]], scene["colors"][:, None], scene["viewmats"]]
            found = []
            for cameras, by_pixel in ((intrinsics, False), (scene["Ks"], True)):
                scalars = (WIDTH, HEIGHT, -1, 0.01, 1e10, 0.999, True, False, True, False, True, by_pixel)
                color, alpha, depth_sum, *state = _ops.forward(*inputs, cameras, *scalars, True)
                grads = [color.square(), alpha.square(), depth_sum.square()]
                saved = (*inputs, cameras, color, alpha, depth_sum, *(state[:-1] if color.is_cuda else state))
                gradients = _ops.backward(saved, None, *grads, *scalars, True, True)
                images = [image.movedim(-1, 1) if by_pixel else image for image in (color, alpha, depth_sum)]
                found.append((*images, *gradients))
            for a, b in zip(*found):
                self.assertTrue(torch.equal(a, b))

    def test_no_gaussians(self):
        for device, dtype in DEVICES:
            scene = with_gradients(make_scene(count=0, device=device, dtype=dtype) if device else None)
            image, alpha, meta = rasterization(**scene, width=WIDTH, height=HEIGHT)
            expected = scene["backgrounds"][:, None, None].expand(-1, HEIGHT, WIDTH, -1)
            self.assertTrue(torch.equal(image, expected))
            self.assertEqual(alpha.abs().max(), 0)
            self.assertEqual(meta["means2d"].shape, (0, 2))
            image.sum().backward()
            self.assertEqual(scene["means"].grad.shape, (0, 3))

    def test_layout_of_memory_does_not_matter(self):
        scene = make_scene()
        expected, _, _ = rasterization(**scene, width=WIDTH, height=HEIGHT)
        strided = {name: t.repeat_interleave(2, dim=-1)[..., ::2] for name, t in scene.items()}
        self.assertFalse(strided["means"].is_contiguous())
        found, _, _ = rasterization(**strided, width=WIDTH, height=HEIGHT)
        self.assertTrue(torch.equal(found, expected))

    def test_other_torch(self):
        build = {"torch": "2.10", "cuda": 13}
        _library.check_torch(build, "2.12.1", "13.2")
        _library.check_torch({"torch": "2.10", "cuda": None}, "2.10.0+cpu", None)
        for version, cuda, found in (("2.9.1", "13.0", "2.9.1"), ("2.11.0", "12.8", "12.8"), ("2.11.0+cpu", None, "the CPU")):
            with self.assertRaises(ImportError) as caught:
                _library.check_torch(build, version, cuda)
            self.assertIn(found, str(caught.exception))

    def test_no_library(self):
        environment = {**os.environ, "JADE_SPLAT_LIBRARY": str(ROOT / "nowhere"), "PYTHONPATH": str(ROOT / "python/jade_splat")}
        ended = subprocess.run([sys.executable, "-c", "import jade_splat"], env=environment, capture_output=True, text=True)
        self.assertRegex(ended.stderr.splitlines()[-1], "ImportError: .*nowhere")


class Library(unittest.TestCase):
    def test_needs_the_stable_abi_alone(self):
        folder = os.environ.get("JADE_SPLAT_LIBRARY") or Path(_library.__file__).parent
        listing = subprocess.run(
            ["nm", "-D", "--undefined-only", "-C", Path(folder) / "_C.abi3.so"], capture_output=True, text=True, check=True
        ).stdout
        names = [line.split(maxsplit=1)[1] for line in listing.splitlines()]
        self.assertTrue(any(name.startswith("aoti_torch_") for name in names))
        self.assertEqual([name for name in names if "at::" in name or "c10::" in name or name.startswith("Py")], [])


if __name__ == "__main__":
    unittest.main()
