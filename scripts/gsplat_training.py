#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains the losses of the printed method, without the router, on gsplat, for a comparison of time to quality.

  jade_bench run --config scene.yaml --config configs/ablation/full.yaml --set objective.target=efnet \\
    --output RUN --write-input INPUT
  python scripts/gsplat_training.py INPUT --output gsplat.csv --seconds 60

INPUT is the output of `jade_bench run --write-input`: restorations, EDI factors, cameras, initial Gaussians and
settings. A step renders all moments in one call of gsplat, and has the target, blur, EDI (gray and colour),
simulation and intensity terms of Eq. (10) with EFNet as the target, and gsplat's own DefaultStrategy with the
same thresholds and the same limit on the number of Gaussians. The camera response is the fitted one, which
jade_train changes by 1e-7 per step. Writes step, seconds (without scoring) and mean PSNR of the test views. Needs
gsplat 1.5, numpy and torch on a GPU.
"""
import argparse
import json
import math
import sys
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

GRAY = (0.299, 0.587, 0.114)


def gray(image: torch.Tensor) -> torch.Tensor:
    """[3,H,W] to [1,H,W]."""
    r, g, b = GRAY
    return (r * image[0] + g * image[1] + b * image[2]).unsqueeze(0)


def window(device: str) -> torch.Tensor:
    taps = torch.exp(-((torch.arange(11, device=device) - 5.0) ** 2) / (2 * 1.5**2))
    return taps / taps.sum()


def dissimilarity(a: torch.Tensor, b: torch.Tensor, planes: list[int], dssim: float, taps: torch.Tensor) -> torch.Tensor:
    """Sum over pairs of (1 - dssim) L1 + dssim (1 - SSIM), Eq. (8); a, b [P,H,W] are the planes of all pairs in a row."""
    weight = torch.cat([torch.full((n,), 1.0 / n) for n in planes]).to(a.device)

    def blur(x: torch.Tensor) -> torch.Tensor:
        x = F.conv2d(x.unsqueeze(1), taps.view(1, 1, 1, 11), padding=(0, 5))
        return F.conv2d(x, taps.view(1, 1, 11, 1), padding=(5, 0)).squeeze(1)

    count = a.shape[0]
    means = blur(torch.cat([a, b, a * a, b * b, a * b]))
    mean_a, mean_b, aa, bb, ab = means.split(count)
    c1, c2 = 0.01**2, 0.03**2
    ssim = ((2 * mean_a * mean_b + c1) * (2 * (ab - mean_a * mean_b) + c2)) / (
        (mean_a**2 + mean_b**2 + c1) * (aa - mean_a**2 + bb - mean_b**2 + c2))
    l1 = (a - b).abs().mean((1, 2))
    return (weight * ((1 - dssim) * l1 + dssim * (1 - ssim.mean((1, 2))))).sum()


class Tone:
    """The camera response from its table over [0,2]."""

    def __init__(self, table: torch.Tensor):
        self.table, self.step = table, 2.0 / (table.numel() - 1)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        place = image.clamp(0, 2) / self.step
        left = place.detach().floor().clamp(max=self.table.numel() - 2).long()
        low = self.table[left]
        return low + (place - left) * (self.table[left + 1] - low)


class Training:
    def __init__(self, folder: Path, device: str, seed: int):
        self.device = device
        self.options = json.loads((folder / "training.json").read_text())
        self.draw = np.random.default_rng(seed)

        def load(name: str) -> torch.Tensor:
            return torch.from_numpy(np.load(folder / f"{name}.npy")).float().to(device)

        self.blurry, self.factors, self.targets = load("blurry"), load("edi_factors"), load("targets")
        self.cameras = load("camera_from_world")
        self.test_images, self.test_cameras = load("test_images"), load("test_camera_from_world")
        fx, fy, cx, cy = load("intrinsics").tolist()
        self.intrinsics = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], device=device)
        self.tone = Tone(load("response"))
        self.taps = window(device)
        sh = load("sh")
        values = {"means": load("means"), "quats": load("rotations"), "scales": load("log_scales"),
                  "opacities": load("logit_opacities"), "sh0": sh[:, :1], "shN": sh[:, 1:]}
        self.params = torch.nn.ParameterDict({k: torch.nn.Parameter(v.contiguous()) for k, v in values.items()})
        o = self.options
        rates = {"means": o["position_lr_start"] * o["extent"], "quats": o["rotation_lr"], "scales": o["scale_lr"],
                 "opacities": o["opacity_lr"], "sh0": o["sh_dc_lr"], "shN": o["sh_rest_lr"]}
        self.optimizers = {k: torch.optim.Adam([self.params[k]], lr=rates[k], eps=o["eps"], fused=True) for k in rates}
        from gsplat import DefaultStrategy
        self.strategy = DefaultStrategy(
            prune_opa=o["prune_opacity"], grow_grad2d=o["gradient_threshold"], grow_scale3d=o["split_scale"],
            prune_scale3d=o["prune_scale"], refine_start_iter=o["densify_from"], refine_stop_iter=o["densify_until"],
            reset_every=o["opacity_reset_every"], refine_every=o["densify_every"])
        self.strategy_state = self.strategy.initialize_state(scene_scale=o["extent"])
        self.order: list[int] = []

    def render(self, cameras: torch.Tensor, degree: int):
        from gsplat import rasterization
        p = self.params
        height, width = self.blurry.shape[-2:]
        images, _, info = rasterization(
            p["means"], p["quats"], p["scales"].exp(), p["opacities"].sigmoid(), torch.cat([p["sh0"], p["shN"]], 1),
            cameras, self.intrinsics.expand(len(cameras), 3, 3), width, height, near_plane=self.options["near_plane"],
            sh_degree=degree, packed=False)
        return images.permute(0, 3, 1, 2), info

    def next_view(self) -> int:
        if not self.order:
            self.order = self.draw.permutation(len(self.blurry)).tolist()
        return self.order.pop()

    def loss(self, renders: torch.Tensor, view: int, step: int) -> torch.Tensor:
        o = self.options
        moments = len(renders)
        one, two, three = (int(k) for k in self.draw.integers(0, moments, 3))
        blurry, factors = self.blurry[view], self.factors[view]
        mean, middle, target = renders.mean(0), renders[moments // 2], self.targets[view]
        toned = self.tone if step > o["warmup"] else lambda image: image

        def total(pairs: list) -> torch.Tensor:
            return dissimilarity(torch.cat([a for a, _ in pairs]), torch.cat([b for _, b in pairs]),
                                 [len(a) for a, _ in pairs], o["dssim"], self.taps)

        target_pairs = [(middle, target), (gray(middle), gray(target))]
        edi_pairs = [(gray(toned(renders[one])), gray(toned(blurry)) * factors[one]), (renders[two], blurry * factors[two])]
        pairs = [(mean, blurry)]
        if step > o["simulation_start"]:
            pairs.append((gray(toned(renders[three])), gray(toned(mean)) * factors[three]))
        if step > o["warmup"]:
            pairs.append((toned(renders).mean(0), toned(blurry)))
        if o["target_weight"] == 1 and o["edi_weight"] == 1:
            return total(target_pairs + edi_pairs + pairs)
        return o["target_weight"] * total(target_pairs) + o["edi_weight"] * total(edi_pairs) + total(pairs)

    def step(self, step: int) -> None:
        o = self.options
        share = min(1.0, step / o["position_lr_max_steps"])
        rate = math.exp(math.log(o["position_lr_start"]) * (1 - share) + math.log(o["position_lr_end"]) * share)
        self.optimizers["means"].param_groups[0]["lr"] = rate * o["extent"]
        # DefaultStrategy has no upper bound; jade_train stops at one.
        full = len(self.params["means"]) >= o["max_gaussians"]
        self.strategy.grow_grad2d = math.inf if full else o["gradient_threshold"]
        view = self.next_view()
        renders, info = self.render(self.cameras[view], min(3, step // o["sh_degree_every"]))
        self.strategy.step_pre_backward(self.params, self.optimizers, self.strategy_state, step, info)
        self.loss(renders, view, step).backward()
        for optimizer in self.optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        self.strategy.step_post_backward(self.params, self.optimizers, self.strategy_state, step, info, packed=False)

    @torch.no_grad()
    def score(self) -> float:
        renders, _ = self.render(self.test_cameras, 3)
        error = (renders.clamp(0, 1) - self.test_images).double().square().mean((1, 2, 3))
        return float((-10 * error.log10()).mean())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input", type=Path, help="folder of jade_bench run --write-input")
    parser.add_argument("--output", type=Path, required=True, help="CSV: step, seconds, psnr, gaussians")
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after so much training")
    parser.add_argument("--every", type=int, default=100, help="steps from score to score")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda")
    args = parser.parse_args()
    training = Training(args.input, args.device, args.seed)
    training.score()  # loads lazily loaded libraries before timing
    seconds, lines, began = 0.0, ["step,seconds,psnr,gaussians"], time.perf_counter()
    for step in range(1, training.options["iterations"] + 1):
        training.step(step)
        if step % args.every and step != training.options["iterations"]:
            continue
        torch.cuda.synchronize()
        seconds += time.perf_counter() - began
        psnr = training.score()
        lines.append(f"{step},{seconds:.3f},{psnr:.3f},{len(training.params['means'])}")
        args.output.write_text("\n".join(lines) + "\n")
        if seconds >= args.seconds:
            break
        torch.cuda.synchronize()
        began = time.perf_counter()
    print(lines[-1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
