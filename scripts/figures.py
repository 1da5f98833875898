#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the paper's figures from run directories of jade_train or folders of jade_sweep.

    .venv/bin/python scripts/figures.py RUN_OR_SWEEP ... --output figures [--crop X,Y,SIZE ...]

losses            every loss term over the steps, one panel per run
trajectories      the metrics on the test views over the steps
alpha_maps_*      blurry frame, event density, EDI, EFNet, α, the better of the two if a true image is known, and
                  the mix, of a few views
alpha_statistics  α and its Pearson correlation with event density, each view, mean and deviation (also as CSV)
qualitative_*     one scene: blurry frame, every row of the sweep, truth, with zoomed crops
training_cost     wall clock, speed and memory of every row, and quality over memory

A figure without data is skipped with a message. Needs matplotlib (scripts/setup.sh --figures).
"""
import argparse
import base64
import csv
import io
import json
import re
import statistics
import sys
from dataclasses import dataclass, field
from pathlib import Path

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
except ImportError as error:
    print(f"figures: {error}; run scripts/setup.sh --figures once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

METRICS = {"psnr_channel_mean": "PSNR (mean of channels), dB", "ssim": "SSIM", "lpips_alex01": "LPIPS"}
# Logged beside the loss terms.
NEARER = "EDI nearer"
NOT_LOSSES = {"step", "loss", "psnr_train", "alpha_mean", "alpha_std", "gaussians", "iterations_per_second", "seconds", "memory_bytes"}


class DataError(Exception):
    """An error for the user: what was expected, what was found, what to do, in one line."""

    code = 3


class UsageError(DataError):
    """An error in the command line."""

    code = 2


@dataclass
class Run:
    path: Path
    row: str
    scene: str
    seed: str = ""
    seconds: float | None = None
    metrics: list[dict] = field(default_factory=list)
    evaluation: dict = field(default_factory=dict)
    allocation: dict = field(default_factory=dict)
    report: dict = field(default_factory=dict)

    @property
    def name(self) -> str:
        return "/".join(part for part in (self.row, self.scene, self.seed) if part)

    def series(self, key: str) -> tuple[list[float], list[float]]:
        points = [(line["step"], line[key]) for line in self.metrics if isinstance(line.get(key), (int, float))]
        return [p[0] for p in points], [p[1] for p in points]

    def test_series(self, key: str) -> tuple[list[float], list[float]]:
        """A metric on the test views: the intermediate evaluations and the final one."""
        steps, values = self.series("test_" + key)
        last, final = max((line["step"] for line in self.metrics), default=0), self.evaluation.get("mean", {}).get(key)
        if final is not None and (not steps or steps[-1] < last):
            steps, values = steps + [last], values + [final]
        return steps, values

    def peak_gib(self) -> float | None:
        peaks = self.series("memory_bytes")[1]
        return max(peaks) / 2**30 if peaks else None

    def rate(self) -> float | None:
        rates = self.series("iterations_per_second")[1]
        return statistics.median(rates) if rates else None


def read_json(path: Path) -> dict:
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text())
    except ValueError as error:
        raise DataError(f"{path}: damaged: {error}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path}: expected what jade_train writes, found a {type(content).__name__}; train or evaluate again")
    return content


def read_metrics(path: Path) -> list[dict]:
    lines = []
    for text in path.read_text(errors="replace").splitlines() if path.exists() else []:
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue  # a killed run may leave an incomplete line
        if not isinstance(line, dict) or "step" not in line:
            raise DataError(f"{path}: expected lines with a step, as jade_train writes them, found {text[:40]}")
        lines.append(line)
    return lines


def read_report(path: Path) -> dict:
    """The data inside report.html, including pictures."""
    if not path.exists():
        return {}
    # Older reports contain it in their script.
    found = re.search(r'^(?:<script type="application/json" id="data">(.*)</script>|const data = (.*);)$',
                      path.read_text(errors="replace"), re.MULTILINE)
    try:
        data = json.loads(found[1] or found[2]) if found else None
    except json.JSONDecodeError:
        data = None
    if not isinstance(data, dict):
        raise DataError(f"{path}: expected a report of jade_train, found no data in it; train again")
    return data


def read_run(path: Path, row: str = "", scene: str = "", seed: str = "", outcome: Path | None = None) -> Run:
    # The time of a failed run says nothing about its cost.
    outcome_data = read_json(outcome) if outcome and (path / "point_cloud.ply").exists() else {}
    return Run(path, row or path.name, scene, seed, outcome_data.get("seconds") or None,
               read_metrics(path / "metrics.jsonl"), read_json(path / "eval.json"),
               read_json(path / "allocation.json"), read_report(path / "report.html"))


def collect(paths: list[Path]) -> list[Run]:
    """Finished and unfinished runs of all the folders, in the sweep's own order if there is one."""
    runs = []
    for path in paths:
        if (path / "runs.csv").exists():
            with (path / "runs.csv").open(errors="replace") as table:
                for line in csv.DictReader(table):
                    if not all(line.get(name) for name in ("row", "scene", "seed")):
                        raise DataError(f"{path / 'runs.csv'}: expected columns row, scene and seed, as jade_sweep writes them")
                    key = Path(line["row"]) / line["scene"] / line["seed"]
                    if (path / "runs" / key / "metrics.jsonl").exists():
                        runs.append(read_run(path / "runs" / key, line["row"], line["scene"], line["seed"],
                                             (path / "tasks" / key).with_name(key.name + ".json")))
        elif (path / "metrics.jsonl").exists():
            runs.append(read_run(path))
        else:
            raise DataError(f"{path}: expected a run (metrics.jsonl) or a sweep (runs.csv), found neither")
    if not runs:
        raise DataError("none of the folders holds a run that has begun")
    return runs


def grid(count: int, width: float = 3.4, height: float = 2.5, columns: int = 4):
    columns = min(columns, count)
    rows = -(-count // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(width * columns, height * rows), squeeze=False, layout="constrained")
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    return figure, list(axes.flat[:count])


def losses(runs: list[Run]):
    runs = [run for run in runs if len(run.series("loss")[0]) > 1]
    if not runs:
        return None
    terms = {key for run in runs for line in run.metrics for key in line if key not in NOT_LOSSES and not key.startswith("test_")}
    figure, axes = grid(len(runs))
    lines = {}  # a term has the same colour in every panel
    for index, term in enumerate(["loss", *sorted(terms)]):
        style = {"color": f"C{index % 10}", "linestyle": "--" if index > 9 else "-", "linewidth": 0.8 if index else 1.6}
        for run, axis in zip(runs, axes):
            steps, values = run.series(term)
            if len(steps) > 1 and max(values) > 0:
                lines[term], = axis.plot(steps, values, **style)
    for run, axis in zip(runs, axes):
        axis.set(title=run.name, xlabel="step", yscale="log")
    figure.legend(lines.values(), lines.keys(), fontsize=7, loc="outside right upper")
    return figure


def trajectories(runs: list[Run]):
    keys = [key for key in METRICS if any(run.test_series(key)[0] for run in runs)]
    if not keys:
        return None
    figure, axes = grid(len(keys), 4.5, 3.2)
    for key, axis in zip(keys, axes):
        for run in runs:
            steps, values = run.test_series(key)
            if steps:
                axis.plot(steps, values, marker=".", label=run.name)
        axis.set(xlabel="step", ylabel=METRICS[key])
    axes[0].legend(fontsize=6)
    return figure


def picture(entry: dict) -> np.ndarray:
    try:
        image = plt.imread(io.BytesIO(base64.b64decode(entry["src"].split(",", 1)[1])), format="png")
    except (KeyError, IndexError, ValueError, SyntaxError, OSError) as error:
        raise DataError(f"a report's picture '{entry.get('name', '')}' cannot be read; train again") from error
    return image[..., :3] if image.ndim == 3 else image


def pictures_of(view: dict) -> dict[str, np.ndarray]:
    return {entry["name"]: picture(entry) for entry in view["pictures"]}


def show(axis, image: np.ndarray | None, title: str = ""):
    if image is None:
        axis.set(xticks=[], yticks=[], frame_on=False)  # its label stays
        return
    axis.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    axis.set(xticks=[], yticks=[])
    if title:
        axis.set_title(title, fontsize=8)


def gray(image: np.ndarray) -> np.ndarray:
    return image.mean(axis=2) if image.ndim == 3 else image


def edi_is_nearer(images: dict[str, np.ndarray]) -> np.ndarray:
    """White where EDI is nearer to the truth than EFNet, black where EFNet is, gray where both are equally near."""
    distance = {name: gray(np.abs(images[name] - images["truth"])) for name in ("EDI", "EFNet")}
    return 0.5 + 0.5 * np.sign(distance["EFNet"] - distance["EDI"])


def chosen_right(images: dict[str, np.ndarray]) -> float:
    """Share of the pixels where α favours the nearer one, ignoring equally near ones."""
    nearer = images[NEARER]
    return float(np.mean(((gray(images["α"]) > 0.5) == (nearer > 0.5))[nearer != 0.5]))


def alpha_maps(run: Run):
    views = [(view["name"], pictures_of(view)) for view in run.report.get("views", [])]
    views = [(name, images) for name, images in views if "α" in images]
    if not views:
        return None
    for _, images in views:
        if {"EDI", "EFNet", "truth"} <= images.keys():
            images[NEARER] = edi_is_nearer(images)
    shown = ("blurry", "event density", "EDI", "EFNet", "α", NEARER, "fused", "render")
    rows = [name for name in shown if any(name in images for _, images in views)]
    figure, axes = plt.subplots(len(rows), len(views), figsize=(2.6 * len(views), 2.0 * len(rows)), squeeze=False, layout="constrained")
    for column, (name, images) in enumerate(views):
        for axis, row in zip(axes[:, column], rows):
            title = f"α chose right: {chosen_right(images):.0%}" if row == NEARER and row in images else ""
            show(axis, images.get(row), name if axis is axes[0, column] else title)
            if column == 0:
                axis.set_ylabel(row, fontsize=8)
    return figure


def deviation(values: list[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else 0.0


def alpha_statistics(runs: list[Run]):
    runs = [run for run in runs if run.allocation.get("views")]
    if not runs:
        return None
    figure, axes = plt.subplots(1, 2, figsize=(10, 0.6 + 0.4 * len(runs)), layout="constrained", sharey=True)
    for place, run in enumerate(runs):
        views, whole = run.allocation["views"], run.allocation["mean"]
        axes[0].errorbar(whole["alpha_mean"], place, xerr=whole["alpha_std"], fmt="o", capsize=3, color="tab:green")
        values = [view["alpha_correlation"] for view in views]
        axes[1].plot(values, [place] * len(values), ".", color="tab:gray", alpha=0.6)
        axes[1].errorbar(statistics.mean(values), place, xerr=deviation(values), fmt="o", capsize=3, color="tab:green")
    axes[0].set(yticks=range(len(runs)), yticklabels=[run.name for run in runs], xlabel="α: mean and deviation over pixels and views")
    axes[1].axvline(0, color="black", linewidth=0.5)
    axes[1].set(xlabel="Pearson's r of α and event density: views, mean, deviation", xlim=(-1, 1))
    return figure


def alpha_table(runs: list[Run]) -> list[list]:
    rows = [["run", "alpha_mean", "alpha_std", "correlation_mean", "correlation_deviation", "views"]]
    for run in runs:
        if run.allocation.get("views"):
            values = [view["alpha_correlation"] for view in run.allocation["views"]]
            whole = run.allocation["mean"]
            rows.append([run.name, whole["alpha_mean"], whole["alpha_std"], statistics.mean(values), deviation(values), len(values)])
    return rows


def test_views(run: Run) -> dict[str, dict[str, np.ndarray]]:
    return {view["name"].removeprefix("test view "): pictures_of(view) for view in run.report.get("tests", [])}


def blurry_near(runs: list[Run], view: str) -> tuple[str, np.ndarray | None]:
    """The blurry frame of the same name, else the first one that a report shows, with its caption."""
    frames = {entry["name"].removeprefix("training view "): pictures_of(entry)["blurry"]
              for run in runs for entry in run.report.get("views", [])}
    if view in frames:
        return "blurry", frames[view]
    other, image = next(iter(frames.items()), ("", None))
    return f"blurry (view {other})", image


def busiest_crop(truth: np.ndarray) -> tuple[int, int, int]:
    """The square, a quarter of the height wide, with the most edges."""
    gray = truth if truth.ndim == 2 else truth.mean(axis=2)
    edges = np.abs(np.diff(gray, axis=0))[:, :-1] + np.abs(np.diff(gray, axis=1))[:-1]
    size = max(8, gray.shape[0] // 4)
    sums = np.pad(edges, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    boxes = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    y, x = np.unravel_index(boxes.argmax(), boxes.shape)
    return int(x), int(y), size


def qualitative(runs: list[Run], crops: list[tuple[int, int, int]], view: str | None):
    """Runs of one scene and seed, side by side on one test view."""
    shown = [(run, test_views(run)) for run in runs]
    shown = [(run, views) for run, views in shown if views]
    if not shown:
        return None
    view = view if view in shown[0][1] else next(iter(shown[0][1]))
    truth = shown[0][1][view]["truth"]
    columns = [blurry_near([run for run, _ in shown], view)]
    columns += [(run.row, views[view]["render"]) for run, views in shown if view in views]
    columns.append(("truth", truth))
    height, width = truth.shape[:2]
    for x, y, size in crops:
        if x + size > width or y + size > height:
            raise UsageError(f"--crop {x},{y},{size}: expected X,Y,SIZE within the {width}x{height} pixels of test view {view}, found "
                             f"a square that ends at {x + size},{y + size}")
    crops = crops or [busiest_crop(truth)]
    figure, axes = plt.subplots(1 + len(crops), len(columns), figsize=(2.3 * len(columns), 1.8 + 2.1 * len(crops)),
                                squeeze=False, layout="constrained")
    for column, (name, image) in enumerate(columns):
        show(axes[0, column], image, name)
        for index, (x, y, size) in enumerate(crops):
            color = f"C{index}"
            show(axes[1 + index, column], None if image is None else image[y:y + size, x:x + size])
            axes[0, column].add_patch(plt.Rectangle((x, y), size, size, fill=False, edgecolor=color, linewidth=1))
            for spine in axes[1 + index, column].spines.values():
                spine.set(edgecolor=color, linewidth=2)
    figure.suptitle(", ".join(filter(None, (shown[0][0].scene, f"test view {view}"))), fontsize=9)
    return figure


def training_cost(runs: list[Run]):
    rows: dict[str, list[Run]] = {}
    for run in runs:
        rows.setdefault(run.row, []).append(run)
    bars = {"minutes (wall clock)": lambda run: run.seconds / 60 if run.seconds else None,
            "steps per second": Run.rate, "peak memory, GiB": Run.peak_gib}
    values = {title: {row: [v for v in map(get, members) if v is not None] for row, members in rows.items()} for title, get in bars.items()}
    values = {title: by_row for title, by_row in values.items() if any(by_row.values())}
    if not values:
        return None
    panels = len(values) + 1
    figure, axes = plt.subplots(1, panels, figsize=(3.75 * panels, 1.2 + 0.35 * len(rows)), layout="constrained")
    for axis, (title, by_row) in zip(axes, values.items()):
        for place, found in enumerate(by_row.values()):
            if found:
                axis.barh(place, statistics.mean(found), xerr=deviation(found), color="tab:green", capsize=2)
        axis.set(title=title, yticks=range(len(rows)), yticklabels=list(rows))
        axis.invert_yaxis()
    metric = next((key for key in ("lpips_alex01", "psnr_channel_mean") if any(run.evaluation.get("mean", {}).get(key) is not None for run in runs)), None)
    for row, members in rows.items():
        points = [(run.peak_gib(), run.evaluation.get("mean", {}).get(metric)) for run in members]
        points = [p for p in points if None not in p]
        if points:
            x, y = (statistics.mean(p[i] for p in points) for i in (0, 1))
            axes[-1].plot(x, y, "o")
            axes[-1].annotate(row, (x, y), fontsize=7, xytext=(3, 3), textcoords="offset points")
    axes[-1].set(xlabel="peak memory, GiB", ylabel=METRICS.get(metric, ""), title="quality over memory")
    return figure


def crop_of(text: str) -> tuple[int, int, int]:
    try:
        x, y, size = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected X,Y,SIZE in pixels, found '{text}'") from None
    if x < 0 or y < 0 or size < 1:
        raise argparse.ArgumentTypeError(f"expected X and Y from 0 and SIZE from 1, found '{text}'")
    return x, y, size


def draw_all(runs: list[Run], output: Path, suffix: str, crops: list[tuple[int, int, int]], view: str | None) -> list[Path]:
    output.mkdir(parents=True, exist_ok=True)
    figures = {"losses": losses(runs), "trajectories": trajectories(runs), "alpha_statistics": alpha_statistics(runs),
               "training_cost": training_cost(runs)}
    for run in runs:
        figures["alpha_maps_" + run.name.replace("/", "_")] = alpha_maps(run) if run.allocation else None
    scenes: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        scenes.setdefault((run.scene, run.seed), []).append(run)
    for (scene, seed), members in scenes.items():
        figures["_".join(filter(None, ("qualitative", scene, seed)))] = qualitative(members, crops, view)
    written = []
    for name, figure in figures.items():
        if figure is None:
            if not name.startswith("alpha_maps"):
                print(f"figures: {name}: left out, no run has what it shows", file=sys.stderr)
            continue
        figure.savefig(output / f"{name}.{suffix}", dpi=150)
        plt.close(figure)
        written.append(output / f"{name}.{suffix}")
    table = alpha_table(runs)
    if len(table) > 1:
        with (output / "alpha_statistics.csv").open("w", newline="") as file:
            csv.writer(file).writerows(table)
        written.append(output / "alpha_statistics.csv")
    return written


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="run directories or sweep folders")
    parser.add_argument("--output", type=Path, default=Path("figures"))
    parser.add_argument("--format", choices=("png", "pdf", "svg"), default="png")
    parser.add_argument("--rows", help="only these rows of sweeps, separated by commas")
    parser.add_argument("--scenes", help="only these scenes")
    parser.add_argument("--view", help="the test view of the qualitative panels (default: the first)")
    parser.add_argument("--crop", action="append", type=crop_of, default=[], help="X,Y,SIZE of a zoomed crop (repeatable; default: the busiest square)")
    arguments = parser.parse_args()
    try:
        runs = collect(arguments.folders)
        for name, words in (("row", arguments.rows), ("scene", arguments.scenes)):
            if words:
                runs = [run for run in runs if getattr(run, name) in words.split(",")]
        if not runs:
            raise UsageError("--rows and --scenes leave no run")
        views = {view for run in runs for view in test_views(run)}
        if arguments.view and arguments.view not in views:
            raise UsageError(f"--view {arguments.view}: expected a test view that a report shows ({', '.join(sorted(views)) or 'none'})")
        for path in draw_all(runs, arguments.output, arguments.format, arguments.crop, arguments.view):
            print(path)
    except DataError as error:
        print(f"figures: {error}", file=sys.stderr)
        return error.code
    except OSError as error:
        print(f"figures: {error.filename}: {error.strerror}; expected runs that can be read and a folder that can be written",
              file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
