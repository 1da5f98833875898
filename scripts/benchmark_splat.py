# SPDX-License-Identifier: Apache-2.0
"""Times the op from Python on the workloads of jade_bench, beside gsplat if that is installed.

  python scripts/benchmark_splat.py [--device cuda] [--workload W1,W2,W3,W4,W5] [--repeats 50] [--json FILE]

W1 to W5 are bit-identical to those of `jade_bench splat`: nine views in one call. "splat" is the op with the
parameters of jade_bench, "rasterization" the function with gsplat's interface, both with gradients of all
Gaussians and cameras, and both again as CUDA graphs. jade_bench's own figure is the backward pass from a given
cotangent, which "splat" repeats; gsplat is timed through (image * cotangent).sum(), and "rasterization" as well.

  OMP_NUM_THREADS=1 python scripts/benchmark_splat.py --host [--repeats 300] [--json FILE]

measures what the host does per call, on the CPU: one Gaussian, 16x16 px, nine views, both passes from a given
cotangent. "ops" are the two ops without autograd; "empty function" is an autograd.Function of as many tensors that
only allocates. Times are µs of the calling thread's processor time: least and median of batches of ten calls.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial

import torch
from jade_splat import _ops, rasterization, splat
from torch import Tensor

SIZES = {
    "W1": (30_000, 346, 260),
    "W2": (100_000, 346, 260),
    "W3": (100_000, 600, 400),
    "W4": (300_000, 600, 400),
    "W5": (1_000_000, 1600, 1060),
}
VIEWS = 9


def hand_shake_path() -> Tensor:
    poses = torch.zeros((VIEWS, 4, 4))
    for k in range(VIEWS):
        t = (k - 4) / 4
        angle = 1.2 * t * math.pi / 180
        poses[k, 0, 0] = poses[k, 2, 2] = math.cos(angle)
        poses[k, 0, 2], poses[k, 2, 0] = math.sin(angle), -math.sin(angle)
        poses[k, 0, 3], poses[k, 1, 3], poses[k, 2, 3] = 0.016 * t, 0.008 * t * t, 0.004 * t
        poses[k, 1, 1] = poses[k, 3, 3] = 1
    return poses


def make_workload(name: str, seed: int = 0) -> dict[str, Tensor]:
    """Makes the workload of make_workload() in apps/jade_bench/workload.cpp: the order of the samples is part of the format."""
    n, width, height = SIZES[name]
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator)

    focal = 0.9 * width
    z = 3.0 + 4.0 * uniform(n)
    x = (uniform(n) - 0.5) * 1.1 * width / focal * z
    y = (uniform(n) - 0.5) * 1.1 * height / focal * z
    spread = torch.exp(0.5 * normal(n, 3))
    scales = (2.0 * z / focal)[:, None] * spread
    quats = normal(n, 4)
    logit_opacities = 1.5 * normal(n)
    dc = 0.8 * normal(n, 1, 3)
    sh = torch.cat([dc, 0.1 * normal(n, 15, 3)], 1)
    K = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    cotangent = torch.randn((VIEWS, 3, height, width), generator=torch.Generator().manual_seed(seed + 1))
    return {
        "means": torch.stack([x, y, z], -1),
        "quats": quats,
        "log_scales": scales.log(),
        "logit_opacities": logit_opacities,
        "sh": sh,
        "viewmats": hand_shake_path(),
        "Ks": K.repeat(VIEWS, 1, 1),
        "intrinsics": torch.tensor([focal, focal, width / 2, height / 2]).repeat(VIEWS, 1),
        "cotangent": cotangent,
    }


def median_ms(work: Callable[[], None], repeats: int, device: torch.device) -> float:
    def wait() -> None:
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    for _ in range(max(3, repeats // 5)):
        work()
    wait()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        wait()
        times.append(1e3 * (time.perf_counter() - start))
    return sorted(times)[len(times) // 2]


def captured(work: Callable[[], None]) -> Callable[[], None]:
    """Captures the work as a CUDA graph, which the host launches by one call; returns its replay."""
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        for _ in range(3):
            work()
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph.replay


def measure(work: dict[str, Tensor], render: Callable, inputs: list[Tensor], backward: Callable[[Tensor], None],
            repeats: int, prepare: Callable[[Callable[[], None]], Callable[[], None]]) -> dict[str, float]:
    device = work["means"].device
    leaves = [t.detach().requires_grad_() for t in inputs]

    def forward() -> None:
        with torch.no_grad():
            render(*leaves)

    def both() -> None:
        for leaf in leaves:
            leaf.grad = None
        backward(render(*leaves))

    return {
        "forward_ms": round(median_ms(prepare(forward), repeats, device), 3),
        "forward_backward_ms": round(median_ms(prepare(both), repeats, device), 3),
    }


def ways_of(work: dict[str, Tensor], size: tuple[int, int, int]) -> dict[str, tuple]:
    """By name: a function from inputs to the image, the inputs, and the backward pass from an image."""
    _, width, height = size
    cotangent = work["cotangent"]
    in_pixels = cotangent.permute(0, 2, 3, 1).contiguous()

    def through_loss(image: Tensor) -> None:
        (image * in_pixels).sum().backward()

    raw = [work[name] for name in ("means", "quats", "log_scales", "logit_opacities", "sh", "viewmats")]
    activated = [raw[0], raw[1], raw[2].exp(), raw[3].sigmoid(), raw[4], raw[5]]

    def ours(*inputs: Tensor) -> Tensor:
        return rasterization(*inputs, work["Ks"], width, height, sh_degree=3, packed=False)[0]

    ways = {
        "splat": (
            lambda *inputs: splat(*inputs, work["intrinsics"], width, height)[0],
            raw,
            lambda image: image.backward(cotangent),
        ),
        "rasterization": (ours, activated, through_loss),
    }
    try:
        import gsplat
    except ImportError:
        return ways

    def theirs(*inputs: Tensor) -> Tensor:
        return gsplat.rasterization(*inputs, work["Ks"], width, height, sh_degree=3, packed=False)[0]

    ways[f"gsplat {gsplat.__version__}"] = (theirs, activated, through_loss)
    return ways


class Empty(torch.autograd.Function):
    """A function with as many inputs, outputs and gradients as the op, which only allocates."""

    @staticmethod
    def forward(ctx, shape, *inputs):
        ctx.inputs = inputs
        return torch.empty(shape), torch.empty((*shape[:1], 1, *shape[2:]))

    @staticmethod
    def backward(ctx, *_):
        return (None, *[torch.empty_like(tensor) for tensor in ctx.inputs[:-1]], None)


def arguments_of(name: str, call: Callable[[], None]) -> list:
    """The arguments, detached, with which call() calls the op of _ops."""
    op, seen = getattr(_ops, name), []

    def record(*arguments):
        seen.extend(arguments)
        return op(*arguments)

    setattr(_ops, name, record)
    call()
    setattr(_ops, name, op)

    def detached(value):
        if isinstance(value, (list, tuple)):
            return [detached(item) for item in value]
        return value.detach() if isinstance(value, Tensor) else value

    return detached(seen)


def host_ways() -> dict[str, Callable[[], None]]:
    size = 16
    raw = [
        torch.tensor([[0.0, 0, 4]]), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), -2.0), torch.zeros(1),
        torch.zeros(1, 16, 3), torch.eye(4).repeat(VIEWS, 1, 1),
    ]
    K = torch.tensor([[20.0, 0, 8], [0, 20, 8], [0, 0, 1]]).repeat(VIEWS, 1, 1)
    intrinsics = torch.tensor([[20.0, 20, 8, 8]]).repeat(VIEWS, 1)
    activated = [raw[0], raw[1], raw[2].exp(), raw[3].sigmoid(), *raw[4:]]
    leaves = [tensor.clone().requires_grad_() for tensor in raw]
    active_leaves = [tensor.clone().requires_grad_() for tensor in activated]
    cotangent = torch.rand((VIEWS, 3, size, size))
    in_pixels = cotangent.permute(0, 2, 3, 1).contiguous()
    calls = {
        "empty function": (lambda: Empty.apply(cotangent.shape, *leaves, intrinsics)[0], leaves, cotangent),
        "splat": (lambda: splat(*leaves, intrinsics, size, size)[0], leaves, cotangent),
        "rasterization": (
            lambda: rasterization(*active_leaves, K, size, size, sh_degree=3, packed=False)[0], active_leaves, in_pixels
        ),
    }

    def read_meta() -> None:
        with torch.no_grad():
            rasterization(*activated, K, size, size, sh_degree=3, packed=False)[2]["radii"]

    def without_gradients(render: Callable[[], Tensor]) -> None:
        with torch.no_grad():
            render()

    def both(render: Callable[[], Tensor], inputs: list[Tensor], grad: Tensor) -> None:
        for leaf in inputs:
            leaf.grad = None
        render().backward(grad)

    def direct(op: Callable, arguments: list) -> None:
        with torch._C._AutoDispatchBelowAutograd():
            op(*arguments)

    ways = {}
    for name in ("forward", "backward"):
        ways[f"ops, {name}"] = partial(direct, getattr(_ops, name), arguments_of(name, partial(both, *calls["splat"])))
    for name, call in calls.items():
        ways[f"{name}, no gradients"] = partial(without_gradients, call[0])
        ways[f"{name}, forward"] = call[0]
        ways[f"{name}, both"] = partial(both, *call)
    return ways | {"rasterization, no gradients, meta": read_meta}


def measure_host(repeats: int) -> list[dict]:
    """Batches of all ways take turns, so that other work on the machine affects them alike."""
    torch.set_num_threads(1)
    ways, batch = host_ways(), 10
    times: dict[str, list[float]] = {name: [] for name in ways}
    for round_ in range(repeats + 5):
        for name, call in ways.items():
            start = time.thread_time()
            for _ in range(batch):
                call()
            if round_ >= 5:
                times[name].append(1e6 * (time.thread_time() - start) / batch)
    return [
        {"way": name, "least_us": round(min(found), 1), "median_us": round(sorted(found)[len(found) // 2], 1)}
        for name, found in times.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--workload", default="W1,W2,W3,W4")
    parser.add_argument("--repeats", type=int)
    parser.add_argument("--host", action="store_true")
    parser.add_argument("--json")
    options = parser.parse_args()
    device = torch.device(options.device)
    rows = []
    if options.host:
        rows = measure_host(options.repeats or 300)
        for row in rows:
            print(f"{row['way']:34} {row['least_us']:7.1f} µs least {row['median_us']:7.1f} µs median")
    for name in [] if options.host else options.workload.split(","):
        if name not in SIZES:
            parser.error(f"--workload: expected names among {', '.join(SIZES)}, found {name}")
        work = {key: tensor.to(device) for key, tensor in make_workload(name).items()}
        for way, call in ways_of(work, SIZES[name]).items():
            # gsplat waits for the device within a call, so it cannot be captured.
            graphs = device.type == "cuda" and not way.startswith("gsplat")
            for prepare in [lambda work: work, captured][: 1 + graphs]:
                row = {"workload": name, "way": way + ", CUDA graph" * (prepare is captured), "device": str(device)}
                row |= measure(work, *call, options.repeats or 50, prepare)
                rows.append(row)
                times = f"{row['forward_ms']:9.3f} ms forward {row['forward_backward_ms']:9.3f} ms both"
                print(f"{name} {row['way']:28} {times}", flush=True)
    if options.json:
        with open(options.json, "w") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
