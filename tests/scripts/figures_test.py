# SPDX-License-Identifier: Apache-2.0
"""Tests of figures.py on run directories written here."""
import base64
import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import figures  # noqa: E402
from figures import plt  # noqa: E402


def png(image: np.ndarray) -> str:
    buffer = io.BytesIO()
    plt.imsave(buffer, image, format="png", cmap="gray", vmin=0, vmax=1)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def pictures(*names: str) -> list[dict]:
    return [{"name": name, "src": png(np.random.default_rng(0).random((24, 32)))} for name in names]


def write_run(path: Path, routed: bool = True):
    path.mkdir(parents=True)
    lines = [{"step": s, "loss": 1 / s, "blur": 0.5 / s, "psnr_train": 20, "gaussians": 9, "iterations_per_second": 4.0 + s,
              "memory_bytes": 2**30 * s} for s in (1, 2, 3)]
    lines += [{"step": s, "test_psnr_channel_mean": 20.0 + s, "test_ssim": 0.5} for s in (1, 3)]
    (path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines) + '{"step": 4, "lo')
    (path / "point_cloud.ply").write_text("")
    (path / "eval.json").write_text(json.dumps({"mean": {"psnr_channel_mean": 25.0, "lpips_alex01": None}}))
    if routed:
        views = [{"name": str(i), "alpha_mean": 0.1, "alpha_std": 0.2, "alpha_min": 0, "alpha_max": 1, "alpha_correlation": r}
                 for i, r in enumerate((0.1, 0.2, 0.6))]
        (path / "allocation.json").write_text(json.dumps({"views": views, "mean": {"alpha_mean": 0.1, "alpha_std": 0.2}}))
    shown = ["blurry", "EDI", "EFNet", *(["α", "fused"] if routed else []), "event density", "render"]
    data = {"views": [{"name": "training view 0", "show": 0, "pictures": pictures(*shown)}],
            "tests": [{"name": "test view 7", "show": 0, "pictures": pictures("render", "truth")}]}
    text = json.dumps(data, ensure_ascii=False).replace("</", "<\\/")
    (path / "report.html").write_text(f'<p>\n<script type="application/json" id="data">{text}</script>\n<script>1</script>')


class Figures(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = Path(self.folder.name)
        for row in ("full", "half"):
            write_run(self.root / "sweep/runs" / row / "desk/0", routed=row == "full")
            outcome = self.root / "sweep/tasks" / row / "desk/0.json"
            outcome.parent.mkdir(parents=True)
            outcome.write_text(json.dumps({"seconds": 90}))
        (self.root / "sweep/runs.csv").write_text(
            "row,scene,seed,state,reason\nfull,desk,0,finished,\nhalf,desk,0,finished,\nhalf,desk,1,new,\n")

    def tearDown(self):
        self.folder.cleanup()

    def test_every_figure_of_a_sweep(self):
        runs = figures.collect([self.root / "sweep"])
        self.assertEqual([run.name for run in runs], ["full/desk/0", "half/desk/0"])
        self.assertEqual((runs[0].seconds, runs[0].peak_gib(), runs[0].rate()), (90, 3.0, 6.0))
        written = {path.name for path in figures.draw_all(runs, self.root / "out", "png", [(2, 3, 8)], None)}
        self.assertEqual(written, {"losses.png", "trajectories.png", "alpha_statistics.png", "alpha_statistics.csv", "training_cost.png",
                                   "alpha_maps_full_desk_0.png", "qualitative_desk_0.png"})
        for name in written:
            self.assertGreater((self.root / "out" / name).stat().st_size, 100, name)

    def test_the_nearer_restoration_and_how_often_alpha_leans_to_it(self):
        truth = np.zeros((1, 4, 3))
        images = {"truth": truth, "EDI": truth + np.array([0.1, 0.1, 0.3, 0.2])[None, :, None],
                  "EFNet": truth + np.array([0.2, 0.3, 0.1, 0.2])[None, :, None], "α": np.array([[0.9, 0.2, 0.1, 0.9]])}
        images[figures.NEARER] = figures.edi_is_nearer(images)
        self.assertEqual(images[figures.NEARER].tolist(), [[1, 1, 0, 0.5]])
        self.assertAlmostEqual(figures.chosen_right(images), 2 / 3)

    def test_correlation_has_the_sample_deviation_over_the_views(self):
        row = figures.alpha_table(figures.collect([self.root / "sweep"]))[1]
        self.assertAlmostEqual(row[3], 0.3)
        self.assertAlmostEqual(row[4], ((0.04 + 0.01 + 0.09) / 2) ** 0.5)

    def test_curves_of_metrics_end_with_the_final_evaluation(self):
        run = figures.collect([self.root / "sweep/runs/full/desk/0"])[0]
        self.assertEqual(run.test_series("psnr_channel_mean"), ([1, 3], [21.0, 23.0]))
        run.metrics.append({"step": 5, "loss": 1})
        self.assertEqual(run.test_series("psnr_channel_mean"), ([1, 3, 5], [21.0, 23.0, 25.0]))
        self.assertEqual(run.test_series("lpips_alex01"), ([], []))

    def test_a_term_has_one_colour_in_every_panel(self):
        runs = figures.collect([self.root / "sweep"])
        for line in runs[0].metrics:
            line.pop("blur", None)
        for step, line in enumerate(runs[0].metrics):
            line.setdefault("step", step)
            line["aaa"] = 0.1
        for line in runs[1].metrics:
            line["zzz"] = 0.2
        figure = figures.losses(runs)
        legend = {text.get_text(): handle.get_color() for text, handle in
                  zip(figure.legends[0].get_texts(), figure.legends[0].get_lines())}
        self.assertEqual(set(legend), {"loss", "aaa", "blur", "zzz"})
        self.assertEqual(len(set(legend.values())), 4)
        drawn = [{line.get_color() for line in axis.get_lines()} for axis in figure.axes[:2]]
        self.assertEqual(drawn[0], {legend["loss"], legend["aaa"]})
        self.assertEqual(drawn[1], {legend["loss"], legend["blur"], legend["zzz"]})
        plt.close(figure)

    def test_a_single_run(self):
        runs = figures.collect([self.root / "sweep/runs/full/desk/0"])
        cost = figures.training_cost(runs)
        self.assertEqual([axis.get_title() for axis in cost.axes], ["steps per second", "peak memory, GiB", "quality over memory"])
        plt.close(cost)
        self.assertEqual(runs[0].series("blur"), ([1, 2, 3], [0.5, 0.25, 0.5 / 3]))

    def test_the_busiest_square_is_found(self):
        image = np.zeros((40, 60))
        image[20:30, 35:45] = np.indices((10, 10)).sum(0) % 2
        x, y, size = figures.busiest_crop(image)
        self.assertTrue(x <= 35 and x + size >= 45 and y <= 20 and y + size >= 30, (x, y, size))

    def test_wrong_folders_and_files_are_refused(self):
        with self.assertRaises(figures.DataError):
            figures.collect([self.root])
        (self.root / "sweep/runs/full/desk/0/eval.json").write_text("{")
        with self.assertRaises(figures.DataError):
            figures.collect([self.root / "sweep"])

    def refused(self, code, pattern, *flags):
        said = io.StringIO()
        arguments = ["figures.py", str(self.root / "sweep"), "--output", str(self.root / "out"), *flags]
        with mock.patch.object(sys, "argv", arguments), contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            try:
                found = figures.main()
            except SystemExit as stop:
                found = stop.code
        plt.close("all")
        self.assertEqual(found, code, said.getvalue())
        self.assertRegex(said.getvalue().splitlines()[-1], pattern)
        self.assertNotIn("Traceback", said.getvalue())

    def test_a_crop_outside_the_picture_is_told(self):
        for crop, end in (("30,20,8", "38,28"), ("900,0,4", "904,4"), ("0,0,33", "33,33")):
            self.refused(2, rf"^figures: --crop {crop}: expected X,Y,SIZE within the 32x24 pixels of test view 7, found .* {end}$",
                         "--crop", crop)
        for crop in ("-1,0,8", "0,0,0", "1,2"):
            self.refused(2, f"argument --crop: expected .*'{crop}'", f"--crop={crop}")

    def test_what_is_asked_for_and_not_there_is_told(self):
        self.refused(2, r"^figures: --view 99: expected a test view that a report shows \(7\)$", "--view", "99")
        self.refused(2, "^figures: --rows and --scenes leave no run$", "--rows", "none")
        (self.root / "file").touch()
        self.refused(3, "^figures: .*file: File exists; ", "--output", str(self.root / "file"))

    def test_damaged_files_are_told(self):
        run = self.root / "sweep/runs/full/desk/0"
        for name, content, pattern in (("report.html", '<script type="application/json" id="data">{"vi</script>', "found no data in it"),
                                       ("report.html", '<script type="application/json" id="data">{"tests": [{"name": "test view 7", '
                                        '"pictures": [{"name": "truth", "src": "data:,AAAA"}]}]}</script>', "picture 'truth' cannot"),
                                       ("metrics.jsonl", "[1]\n", "expected lines with a step"),
                                       ("eval.json", "[1]", "found a list"), ("allocation.json", "\xff", "damaged")):
            with self.subTest(pattern):
                kept = (run / name).read_bytes()
                (run / name).write_text(content, encoding="latin-1")
                self.refused(3, f"^figures: .*{pattern}")
                (run / name).write_bytes(kept)
        (self.root / "sweep/runs.csv").write_text("a,b\n1,2\n")
        self.refused(3, "^figures: .*runs.csv: expected columns row, scene and seed")


if __name__ == "__main__":
    unittest.main()
