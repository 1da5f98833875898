# SPDX-License-Identifier: Apache-2.0
"""Converts an EFNet checkpoint (official or own), or any image restorer in TorchScript, to a file that JADE-GS can
load.

The result is TorchScript with embedded metadata (docs/engineering/restorer.md, section 1); it is compared with
the original network at three sizes before it is kept.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import warnings
from pathlib import Path

try:
    import numpy  # noqa: F401, which torch needs for the hash of the weights
    import torch
    from torch import Tensor, nn
except ImportError as error:
    print(f"export_efnet: {error}; run scripts/setup.sh --python-torch once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

sys.path.insert(0, str(Path(__file__).resolve().parent))
import restoration  # noqa: E402
from model import PADDING_MULTIPLE, EFNet, parameter_count  # noqa: E402

METADATA_NAME = "jade_efnet.json"
TRACED_SIZE = (64, 96)
VERIFIED_SIZES = ((64, 96), (128, 160), (260, 348))
VERIFIED_TIMES = (0.5, 0.0, 0.8125)
TOLERANCE = 1e-5


class DataError(Exception):
    """The input cannot be exported; a one-line reason."""


class Restorer(nn.Module):
    """The interface that JADE-GS calls: RGB in, RGB out, second stage only."""

    def __init__(self, net: EFNet, bgr: bool, uses_mask: bool):
        super().__init__()
        self.net = net
        self.bgr = bgr
        self.uses_mask = uses_mask

    def forward(self, image: Tensor, events: Tensor, mask: Tensor) -> Tensor:
        own = image.flip(1) if self.bgr else image
        restored = self.net(own, events, mask if self.uses_mask else None)[1]
        return restored.flip(1) if self.bgr else restored


class AnyTimeRestorer(nn.Module):
    """The interface of version 2: RGB, signed counts of equal windows and moments in, RGB out."""

    def __init__(self, net: nn.Module):
        super().__init__()
        self.net = net

    def forward(self, image: Tensor, counts: Tensor, time: Tensor) -> Tensor:
        blurry, events, mask, candidates = restoration.any_time_input(image, counts, time)
        return self.net(blurry, events, mask, candidates)


class SecondStage(nn.Module):
    def __init__(self, net: EFNet):
        super().__init__()
        self.net = net

    def forward(self, blurry: Tensor, events: Tensor, mask: Tensor, candidates: Tensor) -> Tensor:
        return self.net(blurry, events, mask, candidates)[1]


def load_tensors(path: Path) -> object:
    """The content of a torch.save file, on the CPU."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of TorchScript, which is rejected below
            return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle can raise any exception
        raise DataError(f"{path}: expected a checkpoint of plain tensors, could not read one ({type(error).__name__})")


def load_checkpoint(path: Path) -> dict[str, Tensor]:
    """State of a {"params": ...} checkpoint, or of a bare state dict, without the prefix of parallel training."""
    content = load_tensors(path)
    state = content.get("params", content) if isinstance(content, dict) else None
    if not isinstance(state, dict) or not all(isinstance(v, Tensor) for v in state.values()):
        raise DataError(f"{path}: expected a dictionary of tensors under the key 'params'")
    return {key.removeprefix("module."): value.float() for key, value in state.items()}


def network_from_state(path: Path, state: dict[str, Tensor]) -> EFNet:
    if "conv_01.weight" not in state:
        raise DataError(f"{path}: expected EFNet weights, found no 'conv_01.weight'")
    width, pictures = state["conv_01.weight"].shape[:2]
    events = state["conv_ev1.weight"].shape[1] if "conv_ev1.weight" in state else restoration.BINS
    net = EFNet(width, events, pictures // 3 - 1)
    if net.candidates and events != restoration.any_time_channels():
        raise DataError(f"{path}: expected {restoration.any_time_channels()} event channels of an any-time network, "
                        f"found {events}")
    expected = net.state_dict()
    wrong = [k for k in expected if k not in state or state[k].shape != expected[k].shape]
    wrong += [k for k in state if k not in expected]
    if wrong:
        raise DataError(f"{path}: {len(wrong)} tensors do not fit an EFNet of width {net.width}, first '{wrong[0]}'")
    if not all(bool(torch.isfinite(v).all()) for v in state.values()):
        raise DataError(f"{path}: weights hold NaN or infinity")
    net.load_state_dict(state)
    return net


def weights_sha256(module: nn.Module) -> str:
    """SHA-256 over the parameters in byte order of their names: name, zero byte, float32 little-endian data."""
    digest = hashlib.sha256()
    for name, value in sorted(module.named_parameters(), key=lambda item: item[0].encode()):
        digest.update(name.encode() + b"\0")
        digest.update(value.detach().cpu().float().contiguous().numpy().astype("<f4").tobytes())
    return digest.hexdigest()


def metadata(module: nn.Module, arguments: argparse.Namespace, net: EFNet | None, minimum: int) -> dict[str, object]:
    any_time = net is not None and net.candidates > 0
    content: dict[str, object] = {
        "format": "jade-restorer",
        "format_version": 2 if any_time else 1,
        "kind": arguments.kind,
        "name": arguments.name or arguments.output.stem,
        "width": 0 if net is None else net.width,
        "parameters": parameter_count(module),
        "input": "none" if net is None else "counts" if any_time else arguments.input,
        "normalization": "none" if net is None else "inside" if any_time else "max_abs",
        "channel_order": arguments.channel_order,
        "padding_multiple": arguments.padding_multiple,
        "minimum_size": minimum,
        "uses_mask": net is not None and not arguments.no_mask,
        "dtype": "float16" if arguments.half else "float32",
        "weights_sha256": weights_sha256(module),
        "source": arguments.source,
    }
    if any_time:
        content |= {"windows": restoration.WINDOWS, "any_time": True}
    return content


def example_inputs(kind: str, height: int, width: int, seed: int) -> tuple[Tensor, ...]:
    generator = torch.Generator().manual_seed(seed)
    image = torch.rand(1, 3, height, width, generator=generator)
    if kind == "image":
        return (image,)
    if kind == "any_time":
        counts = torch.randint(-2, 3, (1, restoration.WINDOWS, height, width), generator=generator).float()
        return image, counts, torch.tensor([VERIFIED_TIMES[seed % len(VERIFIED_TIMES)]])
    events = torch.rand(1, 6, height, width, generator=generator) * 2 - 1
    return image, events, (torch.rand(1, 1, height, width, generator=generator) > 0.3).float()


@torch.no_grad()
def verify(reference: nn.Module, path: Path, kind: str, multiple: int) -> float:
    """Largest difference between the saved file, used as in JADE-GS, and the original module, over three sizes,
    padded to a multiple in the same way.
    """
    saved, worst = torch.jit.load(str(path), map_location="cpu").float(), 0.0
    for seed, size in enumerate(VERIFIED_SIZES):
        height, width = (math.ceil(side / multiple) * multiple for side in size)
        inputs = example_inputs(kind, height, width, seed)
        try:
            expected, found = reference(*inputs), saved(*inputs)
        except RuntimeError as error:
            said = str(error).strip().splitlines()
            raise DataError(f"the network cannot be run on {width}x{height} pixels as --kind and --padding-multiple have it: "
                            f"{said[0] if kind != 'image' else said[-1]}") from error
        if not isinstance(found, Tensor) or found.shape != inputs[0].shape:
            raise DataError(f"{path}: expected one image of the input's size at {height}x{width}")
        worst = max(worst, float((expected - found).abs().max()))
    if not worst <= TOLERANCE:
        raise DataError(f"{path}: the exported module differs from its source by {worst:.2e}, allowed {TOLERANCE:.0e}")
    return worst


@torch.no_grad()
def scripted_module(arguments: argparse.Namespace) -> tuple[nn.Module, torch.jit.ScriptModule, EFNet | None, str]:
    """(reference, scripted, network, kind of its inputs)"""
    if arguments.kind == "image":
        try:
            module = torch.jit.load(str(arguments.checkpoint), map_location="cpu").eval()
        except (RuntimeError, ValueError) as error:
            raise DataError(f"{arguments.checkpoint}: expected TorchScript ({str(error).splitlines()[0]})")
        return module, module, None, "image"
    state = load_checkpoint(arguments.checkpoint)
    if arguments.half:  # the file's weights are those of the reference
        state = {name: value.half().float() for name, value in state.items()}
    net = network_from_state(arguments.checkpoint, state).eval()
    if net.candidates == 0:
        module = Restorer(net, arguments.channel_order == "bgr", not arguments.no_mask).eval()
        traced = torch.jit.trace(module, example_inputs("efnet", *TRACED_SIZE, seed=0), check_trace=False)
        return module, traced, net, "efnet"
    if arguments.channel_order == "bgr" or arguments.no_mask:
        raise DataError(f"{arguments.checkpoint}: an any-time network takes RGB and makes its mask itself; "
                        "leave out --channel-order and --no-mask")
    image, counts, time = example_inputs("any_time", *TRACED_SIZE, seed=0)
    traced = torch.jit.trace(
        SecondStage(net).eval(), restoration.any_time_input(image, counts, time), check_trace=False
    )
    return AnyTimeRestorer(SecondStage(net)).eval(), torch.jit.script(AnyTimeRestorer(traced).eval()), net, "any_time"


def export(arguments: argparse.Namespace) -> dict[str, object]:
    reference, module, net, inputs = scripted_module(arguments)
    content = metadata(module, arguments, net, arguments.padding_multiple if net is None else 2 * PADDING_MULTIPLE)
    temporary = arguments.output.with_suffix(".tmp")
    if arguments.half:
        module.half()
    try:
        torch.jit.save(module, str(temporary), _extra_files={METADATA_NAME: json.dumps(content, indent=1)})
    except RuntimeError as error:
        temporary.unlink(missing_ok=True)
        raise DataError(f"{temporary}: cannot be written; check the free space and the rights of the folder") from error
    module.float()  # its parameters are those of the reference
    try:
        difference = verify(reference, temporary, inputs, content["padding_multiple"])
        temporary.replace(arguments.output)
    finally:
        temporary.unlink(missing_ok=True)
    print(f"{arguments.output}: {content['parameters']} parameters, differs from its source by at most {difference:.1e}")
    return content


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("checkpoint", type=Path, help="official or own .pth; a TorchScript file with --kind image")
    p.add_argument("output", type=Path, help="file to write, e.g. efnet.pt")
    p.add_argument("--kind", choices=("efnet", "image"), default="efnet")
    p.add_argument("--name", default="", help="short name for logs and caches (default: the output's name)")
    p.add_argument("--input", choices=("scer", "bins"), default="scer", help="event form the weights were trained on")
    p.add_argument("--channel-order", choices=("rgb", "bgr"), default="rgb",
                   help="order the weights were trained on; the official ones are most likely bgr")
    p.add_argument("--no-mask", action="store_true", help="the network runs without the event mask")
    p.add_argument("--half", action="store_true", help="store float16 weights; they are computed with in float32")
    p.add_argument("--padding-multiple", type=int, default=PADDING_MULTIPLE, help="for --kind image")
    p.add_argument("--source", default="", help="one line: where the weights come from")
    result = p.parse_args(arguments)
    if result.kind == "efnet" and result.padding_multiple != PADDING_MULTIPLE:
        p.error(f"--padding-multiple: an EFNet needs {PADDING_MULTIPLE}")
    if result.half and result.kind != "efnet":
        p.error("--half: for --kind efnet")
    if result.padding_multiple < 1:
        p.error("--padding-multiple: expected at least 1")
    return result


def main() -> int:
    arguments = parse_arguments()
    try:
        if not arguments.checkpoint.is_file():
            raise DataError(f"{arguments.checkpoint}: no such file")
        if not arguments.output.parent.is_dir():
            raise DataError(f"{arguments.output.parent}: no such folder")
        if arguments.output.is_dir():
            raise DataError(f"{arguments.output}: expected a file to write, such as efnet.pt, found a folder")
        print(json.dumps(export(arguments), indent=1))
    except (DataError, OSError) as error:
        print(f"export_efnet: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
