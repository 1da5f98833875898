# SPDX-License-Identifier: Apache-2.0
"""Trains EFNet on pairs simulated on the fly (docs/efnet.md describes the data and the recipe).

Writes into the output folder: weights.pth (official checkpoint format: {"params": ...}), state.pth (optimiser moments and
counters, for --resume), log.txt, validation.json and validation pictures. Nothing is read but the pictures given.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import torch
from torch import Tensor, nn

sys.path.insert(0, str(Path(__file__).resolve().parent))
import restoration  # noqa: E402
from model import EFNet, parameter_count  # noqa: E402
from synthetic import (  # noqa: E402
    Draw, NoiseOptions, Sample, SceneOptions, generate, photographs, procedural_textures, validation_options,
)

VALIDATION_SEED = 424_242
STRENGTHS = {"clean": 0.0, "moderate": 0.5, "strong": 1.0}


def psnr_loss(outputs: list[Tensor], truth: Tensor) -> Tensor:
    """Published loss: half the negative PSNR of both stages, summed."""
    losses = [(o.float() - truth).square().mean((1, 2, 3)).add(1e-8).log().mean() for o in outputs]
    return 0.5 * (10 / math.log(10)) * sum(losses)


def parse_arguments(arguments: list[str] | None = None) -> argparse.Namespace:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    p.add_argument("--output", type=Path, required=True)
    p.add_argument("--photographs", type=Path, help="folder of training pictures; procedural textures alone without it")
    p.add_argument("--held-out", type=Path, help="folder of pictures for validation only")
    p.add_argument("--procedural", type=int, default=160, help="procedural textures beside the photographs")
    p.add_argument("--texture-size", type=int, default=512)
    p.add_argument("--width", type=int, default=32, help="channels of the first level (64 is the published network)")
    p.add_argument("--input", choices=("scer", "bins"), default="scer")
    p.add_argument("--crop", type=int, default=256)
    p.add_argument("--batch", type=int, default=16)
    p.add_argument("--lr", type=float, default=6e-4, help="published: 2e-4")
    p.add_argument("--lr-min", type=float, default=1e-7)
    p.add_argument("--warmup", type=int, default=300, help="steps of linear warm-up (published: 0)")
    p.add_argument("--weight-decay", type=float, default=1e-4)
    p.add_argument("--grad-clip", type=float, default=0.01)
    p.add_argument("--no-mask", action="store_true", help="train without the event mask")
    p.add_argument("--max-steps", type=int, default=200_000)
    p.add_argument("--max-minutes", type=float, default=0, help="stop by the clock; the schedule then follows the time")
    p.add_argument("--validate-minutes", type=float, default=2.5)
    p.add_argument("--validation-batches", type=int, default=4, help="of four scenes, per noise level; twice as many at the end")
    p.add_argument("--blur-max", type=float, default=30)
    p.add_argument("--resume", type=Path, help="output folder of an earlier run (weights.pth, state.pth)")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    p.add_argument("--precision", choices=("bf16", "fp32"), default="bf16" if torch.cuda.is_available() else "fp32")
    result = p.parse_args(arguments)
    if result.crop % 4 or result.crop < 16:
        p.error(f"--crop: expected a multiple of 4, at least 16, got {result.crop}")
    for name in ("photographs", "held_out", "resume"):
        folder = getattr(result, name)
        if folder is not None and not folder.is_dir():
            p.error(f"--{name.replace('_', '-')}: no folder at {folder}")
    return result


class Trainer:
    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.begin = time.monotonic()
        self.device = torch.device(options.device)
        options.output.mkdir(parents=True, exist_ok=True)
        self.log_file = open(options.output / "log.txt", "a", encoding="utf-8")
        torch.manual_seed(options.seed)
        self.model = EFNet(options.width).to(self.device, memory_format=torch.channels_last)
        decayed = dict(lr=options.lr, betas=(0.9, 0.99), weight_decay=options.weight_decay)
        self.optimiser = torch.optim.AdamW(self.model.parameters(), fused=self.device.type == "cuda", **decayed)
        self.step, self.samples_seen = 0, 0
        if options.resume:
            self.load(options.resume)
        seed = options.seed + 1000 * self.step
        self.draw = Draw(seed, self.device)
        self.scenes = SceneOptions(
            options.crop, options.crop, options.batch, blur_max_px=options.blur_max, input=options.input
        )
        self.bank = self.textures(options.photographs, options.procedural, options.seed + 7)
        self.first_step = self.step

    def textures(self, folder: Path | None, procedural: int, seed: int) -> Tensor:
        size = self.options.texture_size
        made = procedural_textures(Draw(seed, self.device), max(procedural, 4 if folder is None else 1), size)
        return made if folder is None else torch.cat([photographs(folder, size).to(self.device), made])

    def log(self, text: str) -> None:
        line = f"[{time.monotonic() - self.begin:7.1f} s] {text}"
        print(line, flush=True)
        self.log_file.write(line + "\n")
        self.log_file.flush()

    def load(self, folder: Path) -> None:
        self.model.load_state_dict(torch.load(folder / "weights.pth", map_location=self.device)["params"])
        state = torch.load(folder / "state.pth", map_location=self.device)
        self.step, self.samples_seen = state["step"], state["samples_seen"]
        for parameter, (average, square) in zip(self.model.parameters(), state["moments"]):
            as_weights = dict(memory_format=torch.preserve_format)
            self.optimiser.state[parameter] = {
                "step": torch.tensor(float(self.step), device=self.device),
                "exp_avg": torch.empty_like(parameter, **as_weights).copy_(average),
                "exp_avg_sq": torch.empty_like(parameter, **as_weights).copy_(square),
            }

    def save(self) -> None:
        params = {k: v.detach().cpu().contiguous() for k, v in self.model.state_dict().items()}
        moments = []
        for parameter in self.model.parameters():
            entry = self.optimiser.state.get(parameter, {})
            pair = (entry.get("exp_avg"), entry.get("exp_avg_sq"))
            empty = torch.zeros(parameter.shape)
            moments.append(tuple((empty if m is None else m).to("cpu", torch.bfloat16).contiguous() for m in pair))
        state = {"step": self.step, "samples_seen": self.samples_seen, "moments": moments}
        for name, content in (("weights.pth", {"params": params}), ("state.pth", state)):
            target = self.options.output / name
            torch.save(content, target.with_suffix(".tmp"))
            target.with_suffix(".tmp").replace(target)

    def progress(self) -> float:
        """Fraction of the run that is done: by the clock when there is a time limit."""
        by_steps = (self.step - self.first_step) / max(self.options.max_steps - self.first_step, 1)
        if self.options.max_minutes <= 0:
            return by_steps
        return max(by_steps, (time.monotonic() - self.begin) / (60 * self.options.max_minutes))

    def learning_rate(self) -> float:
        o = self.options
        warm = min(1.0, (self.step - self.first_step + 1) / max(o.warmup, 1))
        return o.lr_min + (o.lr - o.lr_min) * warm * 0.5 * (1 + math.cos(math.pi * min(self.progress(), 1.0)))

    def train_step(self) -> Tensor:
        sample = generate(self.draw, self.bank, self.scenes)
        for group in self.optimiser.param_groups:
            group["lr"] = self.learning_rate()
        blurry = sample.blurry.contiguous(memory_format=torch.channels_last)
        events = sample.events.contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.options.precision == "bf16"):
            outputs = self.model(blurry, events, None if self.options.no_mask else sample.mask)
        loss = psnr_loss(outputs, sample.sharp)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), self.options.grad_clip)
        self.optimiser.step()
        self.step += 1
        self.samples_seen += self.options.batch
        return loss.detach()

    def data_seconds(self, times: int = 5) -> float:
        draw = Draw(1, self.device)
        for i in range(times + 1):
            if i == 1:
                start = time.monotonic()
            float(generate(draw, self.bank, self.scenes).events.sum())
        return (time.monotonic() - start) / times

    def run(self) -> None:
        o = self.options
        self.log(
            f"{parameter_count(self.model)} parameters, {len(self.bank)} textures, device {self.device}, "
            f"precision {o.precision}, batch {o.batch} of {o.crop}x{o.crop}, from step {self.step}"
        )
        torch.backends.cudnn.benchmark = True
        self.log(f"one batch of data takes {1e3 * self.data_seconds():.1f} ms")
        last_validation = last_report = time.monotonic()
        good = {k: v.clone() for k, v in self.model.state_dict().items()}
        reported = self.step
        while self.progress() < 1:
            loss = self.train_step()
            if self.step % 100 == 0 or self.step == self.first_step + 20:
                value, now = float(loss), time.monotonic()
                if math.isfinite(value):
                    good = {k: v.clone() for k, v in self.model.state_dict().items()}
                else:
                    self.log(f"step {self.step}: loss is {value}; the weights of the last report are restored")
                    self.model.load_state_dict(good)
                    self.optimiser.state.clear()
                rate = (self.step - reported) / (now - last_report)
                left = (1 - self.progress()) * (now - self.begin) / max(self.progress(), 1e-6)
                self.log(
                    f"step {self.step}  loss {value:7.3f}  lr {self.learning_rate():.2e}  {rate:5.2f} steps/s  "
                    f"{100 * self.progress():3.0f}%  about {left:4.0f} s left"
                )
                last_report, reported = now, self.step
            if time.monotonic() - last_validation > 60 * o.validate_minutes and self.progress() < 0.93:
                self.validate(final=False)
                self.save()
                last_validation = last_report = time.monotonic()
        self.save()
        self.validate(final=True)
        if self.device.type == "cuda":
            self.log(f"peak GPU memory {torch.cuda.max_memory_allocated() / 2**30:.2f} GiB")

    @torch.no_grad()
    def restore(self, sample: Sample) -> Tensor:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=False):
            return self.model(sample.blurry, sample.events, None if self.options.no_mask else sample.mask)[1].clamp(0, 1)

    def validate(self, final: bool) -> dict[str, dict[str, float]]:
        """Held-out pictures, seed and textures; always the same scenes. PSNR of the global error, mean over scenes."""
        self.model.eval()
        bank = self.textures(self.options.held_out, 6, VALIDATION_SEED)
        table = {}
        for level, strength in STRENGTHS.items():
            draw = Draw(VALIDATION_SEED, self.device)
            scenes = validation_options(self.scenes, strength)
            if self.options.crop < 128:  # a trial at tiny size
                scenes = replace(scenes, height=self.options.crop, width=self.options.crop, batch=2)
            rows: dict[str, list[Tensor]] = {}
            for batch in range(self.options.validation_batches * (2 if final else 1)):
                sample = generate(draw, bank, replace(scenes, blur_min_px=6), with_windows=True)
                edi = restoration.double_integral(sample.blurry, sample.windows).clamp(0, 1)
                efnet = self.restore(sample)
                images = {
                    "blurry": sample.blurry, "edi": edi, "efnet": efnet, "mean": restoration.mean_mix(edi, efnet),
                    "oracle": restoration.oracle_mix(edi, efnet, sample.sharp),
                }
                for name, image in images.items():
                    rows.setdefault(name, []).append(restoration.psnr(image, sample.sharp))
                if final and batch == 0:
                    save_picture(self.options.output / f"validation_{level}.jpg", sample, edi, efnet)
            table[level] = {name: round(float(torch.cat(values).mean()), 3) for name, values in rows.items()}
            table[level]["scenes"] = sum(len(v) for v in rows["blurry"])
            self.log(f"validation {level:9s}" + "".join(f"  {k} {v:6.2f}" for k, v in table[level].items()))
        content = {"step": self.step, "samples": self.samples_seen, "psnr_db": table,
                   "scenes": asdict(self.scenes), "strengths": STRENGTHS}
        (self.options.output / "validation.json").write_text(json.dumps(content, indent=1) + "\n")
        self.model.train()
        return table


def save_picture(path: Path, sample: Sample, edi: Tensor, efnet: Tensor) -> None:
    """Rows: scenes. Columns: blurry, EDI, EFNet, truth, events (first, last, middle channel as a colour)."""
    try:
        import cv2
    except ImportError:
        return
    shown = sample.events[:, [0, 5, 3]] * 2 + 0.5
    rows = torch.cat([sample.blurry, edi, efnet, sample.sharp, shown], 3).clamp(0, 1)
    sheet = torch.cat(list(rows), 1).permute(1, 2, 0).flip(2).mul(255).round().byte().cpu().numpy()
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88] if path.suffix == ".jpg" else [])


def main() -> int:
    options = parse_arguments()
    try:
        Trainer(options).run()
    except FileNotFoundError as error:
        print(f"train_efnet: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
