# SPDX-License-Identifier: Apache-2.0
"""Turns an EFNet checkpoint (official or ours), or any image restorer in TorchScript, into a file JADE-GS can load.

The result is TorchScript with its metadata inside (docs/efnet.md, section 1); it is checked at three sizes against the
network it came from before it is kept.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import pickle
import sys
from pathlib import Path

import torch
from torch import Tensor, nn

sys.path.insert(0, str(Path(__file__).resolve().parent))
from model import PADDING_MULTIPLE, EFNet, parameter_count  # noqa: E402

METADATA_NAME = "jade_efnet.json"
TRACED_SIZE = (64, 96)
VERIFIED_SIZES = ((64, 96), (128, 160), (260, 348))
TOLERANCE = 1e-5


class DataError(Exception):
    """What the user gave cannot be exported; one line says why."""


class Restorer(nn.Module):
    """The signature JADE-GS calls: RGB in, RGB out, second stage only."""

    def __init__(self, net: EFNet, bgr: bool, uses_mask: bool):
        super().__init__()
        self.net = net
        self.bgr = bgr
        self.uses_mask = uses_mask

    def forward(self, image: Tensor, events: Tensor, mask: Tensor) -> Tensor:
        own = image.flip(1) if self.bgr else image
        restored = self.net(own, events, mask if self.uses_mask else None)[1]
        return restored.flip(1) if self.bgr else restored


def load_checkpoint(path: Path) -> dict[str, Tensor]:
    """State of a {"params": ...} checkpoint, or of a bare state dict, without the prefix of parallel training."""
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise DataError(f"{path}: expected a checkpoint of plain tensors, could not read one ({type(error).__name__})")
    state = content.get("params", content) if isinstance(content, dict) else None
    if not isinstance(state, dict) or not all(isinstance(v, Tensor) for v in state.values()):
        raise DataError(f"{path}: expected a dictionary of tensors under the key 'params'")
    return {key.removeprefix("module."): value.float() for key, value in state.items()}


def network_from_state(path: Path, state: dict[str, Tensor]) -> EFNet:
    if "conv_01.weight" not in state:
        raise DataError(f"{path}: expected EFNet weights, found no 'conv_01.weight'")
    net = EFNet(state["conv_01.weight"].shape[0])
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
    """Over the parameters in byte order of their names: name, zero byte, float32 little-endian data."""
    digest = hashlib.sha256()
    for name, value in sorted(module.named_parameters(), key=lambda item: item[0].encode()):
        digest.update(name.encode() + b"\0")
        digest.update(value.detach().cpu().float().contiguous().numpy().astype("<f4").tobytes())
    return digest.hexdigest()


def metadata(module: nn.Module, arguments: argparse.Namespace, width: int, minimum: int) -> dict[str, object]:
    efnet = arguments.kind == "efnet"
    return {
        "format": "jade-restorer",
        "format_version": 1,
        "kind": arguments.kind,
        "name": arguments.name or arguments.output.stem,
        "width": width,
        "parameters": parameter_count(module),
        "input": arguments.input if efnet else "none",
        "normalization": "max_abs" if efnet else "none",
        "channel_order": arguments.channel_order,
        "padding_multiple": arguments.padding_multiple,
        "minimum_size": minimum,
        "uses_mask": efnet and not arguments.no_mask,
        "dtype": "float32",
        "weights_sha256": weights_sha256(module),
        "source": arguments.source,
    }


def example_inputs(kind: str, height: int, width: int, seed: int) -> tuple[Tensor, ...]:
    generator = torch.Generator().manual_seed(seed)
    image = torch.rand(1, 3, height, width, generator=generator)
    if kind == "image":
        return (image,)
    events = torch.rand(1, 6, height, width, generator=generator) * 2 - 1
    return image, events, (torch.rand(1, 1, height, width, generator=generator) > 0.3).float()


@torch.no_grad()
def verify(reference: nn.Module, path: Path, kind: str) -> float:
    """Largest difference between the saved file and the module it came from, over three sizes."""
    saved, worst = torch.jit.load(str(path), map_location="cpu"), 0.0
    for seed, (height, width) in enumerate(VERIFIED_SIZES):
        inputs = example_inputs(kind, height, width, seed)
        expected, found = reference(*inputs), saved(*inputs)
        if not isinstance(found, Tensor) or found.shape != inputs[0].shape:
            raise DataError(f"{path}: expected one image of the input's size at {height}x{width}")
        worst = max(worst, float((expected - found).abs().max()))
    if not worst <= TOLERANCE:
        raise DataError(f"{path}: the exported module differs from its source by {worst:.2e}, allowed {TOLERANCE:.0e}")
    return worst


@torch.no_grad()
def scripted_module(arguments: argparse.Namespace) -> tuple[nn.Module, torch.jit.ScriptModule, int, int]:
    """(reference, scripted, width, minimum size)"""
    if arguments.kind == "image":
        try:
            module = torch.jit.load(str(arguments.checkpoint), map_location="cpu").eval()
        except (RuntimeError, ValueError) as error:
            raise DataError(f"{arguments.checkpoint}: expected TorchScript ({str(error).splitlines()[0]})")
        return module, module, 0, arguments.padding_multiple
    net = network_from_state(arguments.checkpoint, load_checkpoint(arguments.checkpoint))
    module = Restorer(net, arguments.channel_order == "bgr", not arguments.no_mask).eval()
    traced = torch.jit.trace(module, example_inputs("efnet", *TRACED_SIZE, seed=0), check_trace=False)
    return module, traced, net.width, 2 * PADDING_MULTIPLE


def export(arguments: argparse.Namespace) -> dict[str, object]:
    reference, module, width, minimum = scripted_module(arguments)
    content = metadata(module, arguments, width, minimum)
    temporary = arguments.output.with_suffix(".tmp")
    torch.jit.save(module, str(temporary), _extra_files={METADATA_NAME: json.dumps(content, indent=1)})
    try:
        difference = verify(reference, temporary, arguments.kind)
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
    p.add_argument("--padding-multiple", type=int, default=PADDING_MULTIPLE, help="for --kind image")
    p.add_argument("--source", default="", help="one line: where the weights come from")
    result = p.parse_args(arguments)
    if result.kind == "efnet" and result.padding_multiple != PADDING_MULTIPLE:
        p.error(f"--padding-multiple: an EFNet needs {PADDING_MULTIPLE}")
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
        print(json.dumps(export(arguments), indent=1))
    except DataError as error:
        print(f"export_efnet: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
