# SPDX-License-Identifier: Apache-2.0
"""Trains EFNet on exposures simulated on the fly (docs/engineering/restorer.md describes the data and the recipe).

Writes into the output folder: weights.pth (official checkpoint format: {"params": ...}, the running mean of the weights),
state.pth (weights, optimiser moments and counters, for --resume), log.txt, validation.json and validation pictures.
Nothing is read but the pictures and the footage given. Several GPUs: torchrun --nproc-per-node N train_efnet.py ...
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

try:
    import numpy  # noqa: F401, for what is imported below
    import torch
    import torch.distributed as distributed
    from torch import Tensor, nn
except ImportError as error:
    print(f"train_efnet: {error}; run scripts/setup.sh --python-torch once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

sys.path.insert(0, str(Path(__file__).resolve().parent))
import restoration  # noqa: E402
from draw import Draw  # noqa: E402
from export_efnet import DataError, load_checkpoint, load_tensors  # noqa: E402
from footage import Footage  # noqa: E402
from model import EFNet, parameter_count  # noqa: E402
from synthetic import (  # noqa: E402
    Sample, SceneOptions, compile_events, generate, generate_from_footage, photographs, procedural_textures, validation_options,
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
    p.add_argument("--footage", type=Path, help="folder of footage.npy files (jade_simulate --footage); more may appear")
    p.add_argument("--held-out-footage", type=Path, help="the same for validation only")
    p.add_argument("--footage-share", type=float, default=0.5, help="share of batches from footage")
    p.add_argument("--procedural", type=int, default=160, help="procedural textures beside the photographs")
    p.add_argument("--texture-size", type=int, default=512)
    p.add_argument("--width", type=int, default=48, help="channels of the first level (64 is the published network)")
    p.add_argument("--input", choices=("counts", "scer", "bins"), default="counts",
                   help="counts: any moment, from 16 windows (restoration.py); scer, bins: the published inputs, the middle")
    p.add_argument("--crop", type=int, default=256)
    p.add_argument("--batch", type=int, default=16, help="moments in a step of one GPU; two of each exposure with counts")
    p.add_argument("--lr", type=float, default=6e-4, help="published: 2e-4")
    p.add_argument("--lr-min", type=float, default=1e-7)
    p.add_argument("--warmup", type=int, default=300, help="steps of linear warm-up (published: 0)")
    p.add_argument("--weight-decay", type=float, default=1e-4)
    p.add_argument("--grad-clip", type=float, default=0.01)
    p.add_argument("--mean-decay", type=float, default=0.999, help="of the running mean of the weights")
    p.add_argument("--compile", action="store_true", help="let torch.compile fuse the network")
    p.add_argument("--max-steps", type=int, default=200_000)
    p.add_argument("--max-minutes", type=float, default=0, help="stop by the clock; the schedule then follows the time")
    p.add_argument("--validate-minutes", type=float, default=2.5)
    p.add_argument("--validation-batches", type=int, default=4, help="of four scenes, per noise level; twice as many at the end")
    p.add_argument("--blur-max", type=float, default=40)
    p.add_argument("--resume", type=Path, help="output folder of an earlier run (weights.pth, state.pth): a run by steps that was "
                   "interrupted goes on with its schedule, otherwise a new one begins")
    p.add_argument("--weights", type=Path, help="begin with these weights, a .pth or an exported .pt; all else anew")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    p.add_argument("--precision", choices=("bf16", "fp32"), default="bf16" if torch.cuda.is_available() else "fp32")
    result = p.parse_args(arguments)
    if result.crop % 4 or result.crop < 16:
        p.error(f"--crop: expected a multiple of 4, at least 16, got {result.crop}")
    if result.input == "counts" and result.batch % 2:
        p.error(f"--batch: expected an even number, got {result.batch}")
    if result.resume and result.weights:
        p.error("--weights: --resume brings its own")
    for name, least in (("width", 1), ("batch", 1), ("max_steps", 1), ("texture_size", 16), ("validation_batches", 1), ("procedural", 0),
                        ("warmup", 0), ("max_minutes", 0), ("validate_minutes", 0), ("blur_max", 0), ("lr", 0)):
        if not getattr(result, name) >= least:  # nor NaN
            p.error(f"--{name.replace('_', '-')}: expected at least {least}, got {getattr(result, name)}")
    for name in ("footage_share", "mean_decay"):
        if not 0 <= getattr(result, name) <= 1:
            p.error(f"--{name.replace('_', '-')}: expected from 0 to 1, got {getattr(result, name)}")
    try:
        there = torch.device(result.device).type == "cpu" or torch.cuda.is_available()
    except RuntimeError:
        there = False
    if not there:
        p.error(f"--device: expected cpu, or cuda where torch finds a GPU, got {result.device}")
    if (result.photographs or result.held_out) and importlib.util.find_spec("cv2") is None:
        p.error("--photographs, --held-out: need OpenCV: run scripts/setup.sh --python-torch")
    try:
        for name in ("photographs", "held_out", "footage", "held_out_footage", "resume"):
            folder = getattr(result, name)
            if folder is not None and not folder.is_dir():
                p.error(f"--{name.replace('_', '-')}: no folder at {folder}")
        if result.weights is not None and not result.weights.is_file():
            p.error(f"--weights: no file at {result.weights}")
    except OSError as error:
        p.error(f"{error.filename}: {error.strerror}")
    return result


def read_weights(path: Path) -> dict[str, Tensor]:
    """State of an EFNet from a checkpoint, or from a file that export_efnet.py wrote."""
    try:
        exported = torch.jit.load(str(path), map_location="cpu")
    except RuntimeError:
        return load_checkpoint(path)
    return {name.rpartition("net.")[2]: value.detach().float() for name, value in exported.named_parameters()}


class Machines:
    """This process among those of torchrun; a single one without it."""

    def __init__(self, device: str):
        self.rank, self.count = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
        local = int(os.environ.get("LOCAL_RANK", 0))
        self.device = torch.device(f"cuda:{local}" if device == "cuda" and self.count > 1 else device)
        if self.device.type == "cuda" and self.count > 1:
            torch.cuda.set_device(self.device)
        if self.count > 1:
            distributed.init_process_group("nccl" if self.device.type == "cuda" else "gloo")

    def from_first(self, value: float) -> float:
        if self.count == 1:
            return value
        shared = torch.tensor([value], device=self.device, dtype=torch.float64)
        distributed.broadcast(shared, 0)
        return float(shared)

    def close(self) -> None:
        if self.count > 1:
            distributed.destroy_process_group()


class AnyInput(nn.Module):
    """The network with the preparation of its input."""

    def __init__(self, kind: str, width: int):
        super().__init__()
        self.kind = kind
        any_time = (restoration.any_time_channels(), restoration.CANDIDATES)
        self.net = EFNet(width, *(any_time if kind == "counts" else (restoration.BINS, 0)))

    def prepare(self, blurry: Tensor, counts: Tensor, time: Tensor) -> tuple[Tensor, ...]:
        """The network's arguments, in full precision."""
        if self.kind != "counts":
            return blurry, *restoration.network_input(counts, self.kind)
        return restoration.any_time_input(blurry, counts, time)

    def forward(self, *inputs: Tensor) -> list[Tensor]:
        return self.net(*inputs)


class Trainer:
    REPORT_STEPS = 100
    CLOCK_STEPS = 20  # interval at which the machines agree on the time

    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.begin = time.monotonic()
        self.machines = Machines(options.device)
        self.device = self.machines.device
        options.output.mkdir(parents=True, exist_ok=True)
        self.log_file = open(options.output / "log.txt", "a", encoding="utf-8") if self.machines.rank == 0 else None
        torch.manual_seed(options.seed)
        self.model = AnyInput(options.input, options.width).to(self.device, memory_format=torch.channels_last)
        decayed = dict(lr=options.lr, betas=(0.9, 0.99), weight_decay=options.weight_decay)
        self.optimiser = torch.optim.AdamW(self.model.parameters(), fused=self.device.type == "cuda", **decayed)
        self.step, self.samples_seen, self.fraction = 0, 0, 0.0
        self.schedule_begin = 0  # the step where the warm-up and the cosine began
        if options.weights:
            try:
                self.model.net.load_state_dict(read_weights(options.weights))
            except RuntimeError as error:
                raise DataError(f"{options.weights}: expected weights of this network ({str(error).splitlines()[-1].strip()})")
        self.mean = [p.clone() for p in self.values()]
        if options.resume:
            self.load(options.resume)
        self.first_step = self.step
        self.runner: nn.Module = self.model
        if self.machines.count > 1:
            self.runner = nn.parallel.DistributedDataParallel(
                self.model, device_ids=[self.device.index] if self.device.type == "cuda" else None
            )
        if options.compile:
            self.runner = torch.compile(self.runner)
            compile_events()
        self.draw = Draw(options.seed + 1000 * self.step + 7919 * self.machines.rank, self.device)
        moments = 2 if options.input == "counts" else 1
        self.scenes = SceneOptions(
            options.crop, options.crop, options.batch // moments, blur_max_px=options.blur_max,
            windows=restoration.WINDOWS if options.input == "counts" else restoration.BINS,
            moments=moments, middle=options.input != "counts",
        )
        self.bank = self.textures(options.photographs, options.procedural, options.seed + 7)
        self.footage = self.films_of(options.footage, options.crop) if options.footage else None
        self.told: set[str] = set()  # of the footage that was left out
        self.check_data()

    def films_of(self, folder: Path, side: int) -> Footage:
        return Footage(folder, self.device, (side, side), self.scenes.windows)

    def check_data(self) -> None:
        """Checks the data before the training, not at its first validation."""
        held_out = self.options.held_out_footage
        if self.options.held_out:
            photographs(self.options.held_out, self.options.texture_size)
        for films in (self.footage, self.films_of(held_out, self.film_side()) if held_out else None):
            if films is not None and films.problems:
                raise DataError(films.problems[0])
        if held_out and len(films) == 0:
            raise DataError(f"--held-out-footage {held_out}: expected files footage.npy below this folder, found none; make them with "
                            "jade_simulate --footage")

    def film_side(self) -> int:
        """Size in pixels of the film pieces for validation."""
        return 256 if self.options.crop >= 128 else self.options.crop

    def textures(self, folder: Path | None, procedural: int, seed: int) -> Tensor:
        size = self.options.texture_size
        made = procedural_textures(Draw(seed, self.device), max(procedural, 4 if folder is None else 1), size)
        return made if folder is None else torch.cat([photographs(folder, size).to(self.device), made])

    def values(self) -> list[Tensor]:
        """The parameters' memory, outside of any graph."""
        return [p.detach() for p in self.model.parameters()]

    def learned(self) -> list[Tensor]:
        """The parameters and their running mean."""
        return self.values() + self.mean

    def keep_or_restore(self, good: list[Tensor], loss: float) -> None:
        """Copies the learned values to `good` if they are finite, else restores them from `good`. A finite loss is
        not sufficient: it is of the weights before its own step, and the running mean keeps NaN from a step
        between two calls.
        """
        if math.isfinite(loss) and all(bool(p.isfinite().all()) for p in self.learned()):
            torch._foreach_copy_(good, self.learned())
            return
        self.log(f"step {self.step}: a loss of {loss} or weights that are not finite; those of the last report are restored")
        torch._foreach_copy_(self.learned(), good)
        self.optimiser.state.clear()

    def log(self, text: str) -> None:
        if self.log_file is None:
            return
        line = f"[{time.monotonic() - self.begin:7.1f} s] {text}"
        print(line, flush=True)
        self.log_file.write(line + "\n")
        self.log_file.flush()

    def load(self, folder: Path) -> None:
        for name in ("state.pth", "weights.pth"):
            if not (folder / name).is_file():
                raise DataError(f"{folder / name}: missing; --resume expects the output folder of a run that has saved")
        state, mean = load_tensors(folder / "state.pth"), load_checkpoint(folder / "weights.pth")
        self.check_state(folder / "state.pth", state, mean)
        self.model.net.load_state_dict(state["params"])
        self.step, self.samples_seen = state["step"], state["samples_seen"]
        for (name, parameter), average, (first, second) in zip(
            self.model.net.named_parameters(), self.mean, state["moments"], strict=True
        ):
            average.copy_(mean[name])
            as_weights = dict(memory_format=torch.preserve_format)
            self.optimiser.state[parameter] = {
                "step": torch.tensor(float(self.step), device=self.device),
                "exp_avg": torch.empty_like(parameter, **as_weights).copy_(first),
                "exp_avg_sq": torch.empty_like(parameter, **as_weights).copy_(second),
            }
        if self.step >= self.options.max_steps:
            raise DataError(f"--max-steps {self.options.max_steps}: expected more than the {self.step} steps that {folder} has already")
        # Files of earlier versions lack this; a complete schedule starts again.
        schedule = state.get("schedule")
        goes_on = schedule is not None and self.options.max_minutes <= 0 and self.step < schedule["end"]
        self.schedule_begin = schedule["begin"] if goes_on else self.step

    def check_state(self, path: Path, state: object, mean: dict[str, Tensor]) -> None:
        if not isinstance(state, dict) or not {"params", "moments", "step", "samples_seen"} <= state.keys():
            raise DataError(f"{path}: expected what train_efnet.py saves; give the output folder of an earlier run")
        shapes = {name: p.shape for name, p in self.model.net.named_parameters()}
        found = {name: p.shape for name, p in state["params"].items()}
        if found != shapes:
            width = found["conv_01.weight"][0] if "conv_01.weight" in found else "unknown"
            raise DataError(f"{path}: expected the weights of this network (--width {self.options.width}, --input {self.options.input}), "
                            f"found others, of width {width}; give the --width and the --input of that run")
        moments = [m.shape for pair in state["moments"] for m in pair]
        if {name: p.shape for name, p in mean.items()} != shapes or moments != [s for s in shapes.values() for _ in range(2)]:
            raise DataError(f"{path}: does not fit the weights.pth beside it; give the output folder of an earlier run as it was")

    def save(self) -> None:
        if self.machines.rank != 0:
            return
        names = [name for name, _ in self.model.net.named_parameters()]
        params = {name: p.detach().cpu().contiguous() for name, p in zip(names, self.model.parameters())}
        mean = {name: m.cpu().contiguous() for name, m in zip(names, self.mean)}
        moments = []
        for parameter in self.model.parameters():
            entry = self.optimiser.state.get(parameter, {})
            pair = (entry.get("exp_avg"), entry.get("exp_avg_sq"))
            empty = torch.zeros(parameter.shape)
            moments.append(tuple((empty if m is None else m).to("cpu", torch.bfloat16).contiguous() for m in pair))
        by_steps = self.options.max_minutes <= 0
        schedule = {"begin": self.schedule_begin, "end": self.options.max_steps} if by_steps else None
        state = {"step": self.step, "samples_seen": self.samples_seen, "params": params, "moments": moments, "schedule": schedule}
        for name, content in (("weights.pth", {"params": mean}), ("state.pth", state)):
            target = self.options.output / name
            try:
                torch.save(content, target.with_suffix(".tmp"))
                target.with_suffix(".tmp").replace(target)
            except (OSError, RuntimeError) as error:
                raise DataError(f"{target}: cannot be written; check the free space and the rights of the folder") from error

    def progress(self) -> float:
        """Completed share of the schedule: by the clock if there is a time limit."""
        by_steps = (self.step - self.schedule_begin) / (self.options.max_steps - self.schedule_begin)
        if self.options.max_minutes <= 0:
            self.fraction = by_steps
        elif (self.step - self.first_step) % self.CLOCK_STEPS == 0:
            clock = (time.monotonic() - self.begin) / (60 * self.options.max_minutes)
            self.fraction = self.machines.from_first(max(by_steps, clock))
        return self.fraction

    def learning_rate(self) -> float:
        o = self.options
        warm = min(1.0, (self.step - self.schedule_begin + 1) / max(o.warmup, 1))
        return o.lr_min + (o.lr - o.lr_min) * warm * 0.5 * (1 + math.cos(math.pi * min(self.fraction, 1.0)))

    def sample(self) -> Sample:
        if self.footage is not None and len(self.footage) >= 12 and self.draw.scalar() < self.options.footage_share:
            return generate_from_footage(self.draw, self.footage, self.scenes)
        return generate(self.draw, self.bank, self.scenes)

    def train_step(self) -> Tensor:
        sample = self.sample()
        for group in self.optimiser.param_groups:
            group["lr"] = self.learning_rate()
        moments = sample.time.shape[1]
        blurry, counts = (x.repeat_interleave(moments, 0) for x in (sample.blurry, sample.counts))
        inputs = self.model.prepare(blurry, counts, sample.time.flatten())
        inputs = [x.contiguous(memory_format=torch.channels_last) for x in inputs]
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.options.precision == "bf16"):
            outputs = self.runner(*inputs)
        loss = psnr_loss(outputs, sample.sharp.flatten(0, 1))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), self.options.grad_clip)
        self.optimiser.step()
        self.step += 1
        decay = min(self.options.mean_decay, (1 + self.step) / (10 + self.step))
        torch._foreach_lerp_(self.mean, self.values(), 1 - decay)
        self.samples_seen += self.options.batch * self.machines.count
        return loss.detach()

    def data_seconds(self, times: int = 5) -> float:
        draw = Draw(1, self.device)
        for i in range(times + 1):
            if i == 1:
                start = time.monotonic()
            float(generate(draw, self.bank, self.scenes).counts.sum())
        return (time.monotonic() - start) / times

    def run(self) -> None:
        o = self.options
        self.log(
            f"{parameter_count(self.model)} parameters, {len(self.bank)} textures, "
            f"{len(self.footage) if self.footage else 0} films, {self.machines.count} x {self.device}, "
            f"precision {o.precision}, batch {o.batch} of {o.crop}x{o.crop}, from step {self.step}"
            + (f" of the schedule that began at step {self.schedule_begin}" if self.schedule_begin < self.step else "")
        )
        torch.backends.cudnn.benchmark = True
        self.log(f"one batch of drawn data takes {1e3 * self.data_seconds():.1f} ms")
        last_validation = last_report = time.monotonic()
        good = [p.clone() for p in self.learned()]
        reported = self.step
        self.fraction = 0.0
        done_before = self.progress()
        while self.progress() < 1:
            loss = self.train_step()
            if self.step % self.REPORT_STEPS == 0 or self.step == self.first_step + 20:
                value, now = self.machines.from_first(float(loss)), time.monotonic()
                self.keep_or_restore(good, value)
                rate = (self.step - reported) / (now - last_report)
                left = (1 - self.fraction) * (now - self.begin) / max(self.fraction - done_before, 1e-6)
                self.log(
                    f"step {self.step}  loss {value:7.3f}  lr {self.learning_rate():.2e}  {rate:5.2f} steps/s  "
                    f"{100 * self.fraction:3.0f}%  about {left:4.0f} s left"
                )
                self.refresh_footage()
                last_report, reported = now, self.step
            if self.machines.rank == 0 and time.monotonic() - last_validation > 60 * o.validate_minutes:
                self.save()
                if self.fraction < 0.9:
                    self.validate(final=False)
                last_validation = last_report = time.monotonic()
        self.keep_or_restore(good, 0.0)
        self.save()
        if self.machines.rank == 0:
            self.validate(final=True)
        if self.device.type == "cuda":
            self.log(f"{len(self.footage) if self.footage else 0} films, "
                     f"peak GPU memory {torch.cuda.max_memory_allocated() / 2**30:.2f} GiB")
        self.machines.close()

    def refresh_footage(self) -> None:
        """An unusable file is reported once and does not stop the training."""
        if self.footage is None:
            return
        self.footage.refresh()
        for problem in self.footage.problems:
            if problem not in self.told:
                self.log(f"left out: {problem}")
        self.told.update(self.footage.problems)

    @torch.no_grad()
    def restore(self, sample: Sample, moment: float) -> Tensor:
        at = torch.full((len(sample.blurry),), moment, device=self.device)
        return self.model(*self.model.prepare(sample.blurry, sample.counts, at))[1].clamp(0, 1)

    def validation_sets(self) -> dict[str, object]:
        """Maps names to functions that make a batch at a noise level: generated scenes, and held-out films."""
        bank = self.textures(self.options.held_out, 6, VALIDATION_SEED)
        sets = {"drawn": lambda draw, scenes: generate(draw, bank, scenes, with_windows=True)}
        if self.options.held_out_footage:
            films = self.films_of(self.options.held_out_footage, self.film_side())
            steps = films.longest() // self.scenes.windows * self.scenes.windows
            sets["films"] = lambda draw, scenes: generate_from_footage(
                draw, films, replace(scenes, steps=steps), with_windows=True)
        return sets

    @torch.no_grad()
    def validate(self, final: bool) -> dict[str, dict[str, float]]:
        """Validates on held-out pictures, films, seed and textures, always the same scenes. PSNR of the global
        error, mean over scenes.
        """
        self.model.eval()
        own = [p.clone() for p in self.values()]
        torch._foreach_copy_(self.values(), self.mean)
        table = {}
        for kind, make in self.validation_sets().items():
            for level, strength in STRENGTHS.items():
                table[f"{kind} {level}"] = self.validate_level(kind, level, strength, make, final)
        content = {"step": self.step, "samples": self.samples_seen, "psnr_db": table,
                   "scenes": asdict(self.scenes), "strengths": STRENGTHS}
        (self.options.output / "validation.json").write_text(json.dumps(content, indent=1) + "\n")
        torch._foreach_copy_(self.values(), own)
        self.model.train()
        return table

    def validate_level(self, kind: str, level: str, strength: float, make, final: bool) -> dict[str, float]:
        draw = Draw(VALIDATION_SEED, self.device)
        scenes = validation_options(self.scenes, strength)
        if kind == "films":
            scenes = replace(scenes, height=self.film_side(), width=self.film_side())
        if self.options.crop < 128:  # a trial at tiny size
            scenes = replace(scenes, height=self.options.crop, width=self.options.crop, batch=2)
        rows: dict[str, list[Tensor]] = {}
        for batch in range(self.options.validation_batches * (2 if final else 1)):
            sample = make(draw, replace(scenes, blur_min_px=6))
            truth = sample.sharp[:, 0]
            edi = restoration.double_integral(sample.blurry, sample.weighted).clamp(0, 1)
            efnet = self.restore(sample, 0.5)
            images = {
                "blurry": (sample.blurry, truth), "edi": (edi, truth), "efnet": (efnet, truth),
                "mean": (restoration.mean_mix(edi, efnet), truth),
                "oracle": (restoration.oracle_mix(edi, efnet, truth), truth),
            }
            if self.options.input == "counts":
                for i, name in ((0, "start"), (1, "end")):
                    images[name] = (self.restore(sample, float(i)), sample.ends[:, i])
            for name, (image, reference) in images.items():
                rows.setdefault(name, []).append(restoration.psnr(image, reference))
            if final and batch == 0:
                save_picture(self.options.output / f"validation_{kind}_{level}.jpg", sample, edi, efnet)
        table = {name: round(float(torch.cat(values).mean()), 3) for name, values in rows.items()}
        table["scenes"] = sum(len(v) for v in rows["blurry"])
        self.log(f"validation {kind} {level:9s}" + "".join(f"  {k} {v:6.2f}" for k, v in table.items()))
        return table


def save_picture(path: Path, sample: Sample, edi: Tensor, efnet: Tensor) -> None:
    """Rows: scenes. Columns: blurry, EDI, EFNet, truth, all at the middle, and the events of the exposure."""
    try:
        import cv2
    except ImportError:
        return
    shown = (sample.counts.sum(1, keepdim=True) * 0.1 + 0.5).expand(-1, 3, -1, -1)
    rows = torch.cat([sample.blurry, edi, efnet, sample.sharp[:, 0], shown], 3).clamp(0, 1)
    sheet = torch.cat(list(rows), 1).permute(1, 2, 0).flip(2).mul(255).round().byte().cpu().numpy()
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88] if path.suffix == ".jpg" else [])


def main() -> int:
    options = parse_arguments()
    try:
        Trainer(options).run()
    except torch.OutOfMemoryError as error:
        print(f"train_efnet: {str(error).splitlines()[0]} Give a smaller --batch or --crop", file=sys.stderr)
        return 4
    except (DataError, OSError) as error:
        print(f"train_efnet: {error}", file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        saved = (options.output / "state.pth").is_file()
        print("train_efnet: interrupted; " + (f"--resume {options.output} goes on from where it was saved last" if saved
                                              else "nothing was saved yet"), file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
