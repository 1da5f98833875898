// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/simulator.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/data/dataset.h"
#include "jade/gaussians/ply.h"
#include "jade/recording/recording.h"
#include "support/drifting_pattern.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::simulate;

namespace {

SimulateRun tiny() {
  set_progress_enabled(false);
  SimulateRun run;
  run.seed = 4;
  run.simulate = preset_options(Preset::kCdavis);
  run.simulate.world = "clutter";
  run.simulate.width = 40, run.simulate.height = 30, run.simulate.focal_px = 50;
  run.simulate.exposures = 3, run.simulate.exposure_ms = 30, run.simulate.gap_ms = 6;
  run.simulate.test_views = 2, run.simulate.seen_test_views = 1;
  run.simulate.motion.blur_px = 4;
  return run;
}

/// A drifting pattern in red before even green and blue.
class RedChanges : public test::DriftingPattern {
 public:
  RedChanges() : DriftingPattern(24, 16, 300, 1000) {}
  void frame(int64_t t_us, int samples, world::SharpFrame& frame) const override {
    DriftingPattern::frame(t_us, samples, frame);
    const auto plane = static_cast<std::ptrdiff_t>(frame.rgb.size() / 3);
    std::fill(frame.rgb.begin() + plane, frame.rgb.end(), 0.05f);
  }
};

}  // namespace

TEST_CASE("simulate: footage is the sharp film of every exposure", "[simulate]") {
  SimulateRun run = tiny();
  run.simulate.sampling.samples = run.simulate.sampling.sharp_samples;
  const torch::Tensor footage = exposure_footage(run, 5);
  CHECK(footage.sizes() == torch::IntArrayRef({3, 5, 3, 30, 40}));
  CHECK(footage.scalar_type() == torch::kU8);
  const SimulateResult result = simulate::simulate(run);
  for (int64_t e = 0; e < 3; ++e) {
    const auto middle = result.content.sharp_mid[static_cast<size_t>(e)];
    CHECK(torch::equal(footage[e][2], (middle * 255).round().to(torch::kU8)));
    CHECK_FALSE(torch::equal(footage[e][0], footage[e][4]));
  }
  CHECK_THROWS_AS(exposure_footage(run, 1), ContractError);
}

TEST_CASE("simulate: written and loaded, the exposures are the same", "[simulate]") {
  const SimulateRun run = tiny();
  const SimulateResult result = simulate::simulate(run);
  CHECK(result.blur_px == Approx(4).epsilon(0.05));
  CHECK((result.largest_flow_px > 0.2 && result.largest_flow_px <= 1));
  test::TempDir folder;
  write(result, run, folder.path());
  CHECK(std::filesystem::exists(folder / "simulation.yaml"));
  data::DatasetOptions options;
  options.path = folder.path();
  std::vector<std::string> warnings;
  const data::Dataset loaded = data::load_dataset(options, &warnings);
  REQUIRE(loaded.train.size() == 3);
  REQUIRE(loaded.test.size() == 2);
  CHECK(loaded.events.size() == result.content.events.size());
  for (size_t i = 0; i < 3; ++i) {
    const auto &a = loaded.train[i], &b = result.content.train[i];
    CHECK((a.blurry - b.blurry).abs().max().item<double>() < 1e-6);
    CHECK((a.t_start_us == b.t_start_us && a.t_end_us == b.t_end_us));
    CHECK(a.events.size() > 100);
    for (size_t k = 0; k < 9; ++k) {
      CHECK(geometry::rotation_angle(a.poses[k], b.poses[k]) < 1e-4);
      const auto c = geometry::centre(a.poses[k]), d = geometry::centre(b.poses[k]);
      CHECK(std::hypot(c[0] - d[0], c[1] - d[1], c[2] - d[2]) < 1e-4);
    }
  }
  CHECK((loaded.test[0].image - result.content.test[0].image).abs().max().item<double>() < 1e-6);
  CHECK(loaded.near == Approx(result.content.near).epsilon(1e-4));
}

TEST_CASE("simulate: a recording has the same frames and events, its poses in truth/ alone",
          "[simulate]") {
  const SimulateRun run = tiny();
  const SimulateResult result = simulate::simulate(run);
  test::TempDir folder;
  write_recording(result, run, folder.path());
  const recording::Recording read = recording::read_recording(folder.path());
  CHECK(read.width == 40);
  CHECK(read.height == 30);
  CHECK(read.events.t_us().equal(result.content.events.t_us()));
  CHECK(read.events.x().equal(result.content.events.x()));
  CHECK(read.events.y().equal(result.content.events.y()));
  CHECK(read.events.polarity().equal(result.content.events.polarity()));
  // Three exposures and the test view between them; the other lies within an exposure.
  REQUIRE(read.frames.size() == 4);
  data::DatasetOptions options;
  options.path = folder / "truth";
  const data::Dataset truth = data::load_dataset(options);
  for (const recording::Frame& frame : read.frames) {
    if (frame.t_end_us - frame.t_start_us == 1) {
      CHECK(frame.image.equal(truth.test[1].image));
      CHECK(frame.name == truth.test[1].name);
      continue;
    }
    const auto same = std::find_if(truth.train.begin(), truth.train.end(),
                                   [&](const auto& e) { return e.name == frame.name; });
    REQUIRE(same != truth.train.end());
    CHECK(frame.image.equal(same->blurry));
    CHECK(frame.t_start_us == same->t_start_us);
    CHECK(frame.t_end_us == same->t_end_us);
  }
  for (const char* poses : {"poses_bounds.npy", "all_poses_bounds.npy", "images_1", "sharp"})
    CHECK_FALSE(std::filesystem::exists(folder / poses));
}

TEST_CASE("simulate: a recording may say nothing of the lengths of its exposures", "[simulate]") {
  SimulateRun run = tiny();
  run.simulate.recording.exposure_times = false;
  test::DriftingPattern footage(24, 16, 300, 1000);
  const SimulateResult result = simulate::simulate(run, footage);
  const test::TempDir folder;
  write_recording(result, run, folder.path());
  CHECK_FALSE(std::filesystem::exists(folder / "exposures.csv"));
  const recording::Recording read = recording::read_recording(folder.path());
  REQUIRE(read.frames.size() == 3);
  CHECK(std::filesystem::exists(folder / "truth" / "simulation.yaml"));
  run.simulate.recording.exposure_times = true;
  const test::TempDir other;
  write_recording(result, run, other.path());
  CHECK(std::filesystem::exists(other / "exposures.csv"));
}

TEST_CASE("simulate: what spoils a recording leaves the truth as it is", "[simulate]") {
  SimulateRun run = tiny();
  test::DriftingPattern footage(24, 16, 300, 1000);
  const SimulateResult plain = simulate::simulate(run, footage);
  const auto same_truth = [&](const SimulateResult& result) {
    for (size_t i = 0; i < 3; ++i) {
      CHECK(result.content.sharp_mid[i].equal(plain.content.sharp_mid[i]));
      CHECK(result.content.train[i].t_mid_us() == plain.content.train[i].t_mid_us());
    }
    CHECK(result.content.test[1].image.equal(plain.content.test[1].image));
    CHECK_FALSE(result.recorded_views[1].image.equal(plain.content.test[1].image));
    CHECK_FALSE(result.content.train[1].blurry.equal(plain.content.train[1].blurry));
  };
  CHECK(plain.recorded_views[1].image.equal(plain.content.test[1].image));
  SimulateOptions& o = run.simulate;
  SECTION("fixed pattern and dead columns") {
    o.image.pattern_pixels = 0.03, o.image.dead_columns = 2;
    same_truth(simulate::simulate(run, footage));
  }
  SECTION("optics and flicker") {
    o.optics.vignetting = 0.5, o.optics.dust = 5;
    o.light.flicker = 0.2;
    const auto result = simulate::simulate(run, footage);
    same_truth(result);
    CHECK(result.content.events.size() > 2 * plain.content.events.size());
  }
  SECTION("a moving object") {
    o.object.radius_px = 12, o.object.travel_px = 20, o.object.period_ms = 100;
    const auto result = simulate::simulate(run, footage);
    same_truth(result);
    CHECK(result.frames > plain.frames);
  }
  SECTION("auto-exposure") {
    o.image.auto_exposure = 0.2;
    const auto result = simulate::simulate(run, footage);
    same_truth(result);
    const auto& exposure = result.content.train[1];
    CHECK(exposure.duration_us() < 30000);
    CHECK(exposure.gain ==
          Approx(static_cast<double>(exposure.duration_us()) / 30000).epsilon(0.01));
    const test::TempDir folder;
    write_recording(result, run, folder.path());
    CHECK(std::filesystem::exists(folder / "truth" / "gains.csv"));
  }
}

TEST_CASE("simulate: each exposure has image noise of its own", "[simulate]") {
  SimulateRun run = tiny();
  run.simulate.exposures = 2, run.simulate.test_views = 0, run.simulate.seen_test_views = 0;
  run.simulate.image.full_well = 0, run.simulate.image.read_noise = 0;
  const auto clean = simulate::simulate(run).content.train;
  run.simulate.image.read_noise = 0.05;
  const auto noisy = simulate::simulate(run).content.train;
  const auto noise = [&](size_t i) { return (noisy[i].blurry - clean[i].blurry).flatten(); };
  const torch::Tensor a = noise(0), b = noise(1);
  CHECK(a.norm().item<double>() > 0);
  // 3600 values: a random correlation is about a sixtieth.
  CHECK(std::abs((a.dot(b) / (a.norm() * b.norm())).item<double>()) < 0.1);
}

TEST_CASE("simulate: the same seed gives the same recording for any number of threads",
          "[simulate]") {
  const int threads = at::get_num_threads();
  SimulateRun run = tiny();
  run.simulate.exposures = 1, run.simulate.test_views = 0, run.simulate.seen_test_views = 0;
  at::set_num_threads(1);
  const auto one = simulate::simulate(run);
  at::set_num_threads(3);
  const auto three = simulate::simulate(run);
  at::set_num_threads(threads);
  CHECK(one.content.events.t_us().equal(three.content.events.t_us()));
  CHECK(one.content.events.x().equal(three.content.events.x()));
  CHECK(one.content.train[0].blurry.equal(three.content.train[0].blurry));
  run.seed = 5;
  CHECK_FALSE(one.content.train[0].blurry.equal(simulate::simulate(run).content.train[0].blurry));
}

TEST_CASE("simulate: colour events are loaded as such, each of the channel that its pixel has",
          "[simulate]") {
  SimulateRun run = tiny();
  run.simulate.exposures = 1, run.simulate.test_views = 1;
  run.simulate.events = {};
  RedChanges footage;
  const auto load = [&](Bayer bayer) {
    run.simulate.events.bayer = bayer;
    const test::TempDir folder;
    write(simulate::simulate(run, footage), run, folder.path());
    data::DatasetOptions options;
    options.path = folder.path();
    return data::load_dataset(options);
  };
  const data::Dataset gray = load(Bayer::kNone), colored = load(Bayer::kRggb);
  CHECK(gray.train[0].blurry.equal(colored.train[0].blurry));
  CHECK_FALSE(gray.event_color.defined());
  REQUIRE(colored.event_color.defined());
  // Only red pixels report red; a gray sensor reports at every pixel.
  const auto red = colored.event_color[0];
  CHECK(red.sum().item<int64_t>() == red.numel() / 4);
  const auto at_red = [&](const events::EventStream& events) {
    const auto place = events.y().to(torch::kInt64) * red.size(1) + events.x().to(torch::kInt64);
    return red.flatten().index_select(0, place).to(torch::kFloat64).mean().item<double>();
  };
  CHECK(at_red(gray.events) == Approx(0.25).margin(0.05));
  CHECK(at_red(colored.events) == 1);
  CHECK(colored.events.size() > 100);
}

TEST_CASE("simulate: an event camera beside that of the frames sees from where it stands",
          "[simulate]") {
  SimulateRun run = tiny();
  run.simulate.exposures = 1, run.simulate.test_views = 0, run.simulate.seen_test_views = 0;
  const SimulateResult one = simulate::simulate(run);
  CHECK_FALSE(one.event_camera);
  auto& beside = run.simulate.event_camera;
  // At the same position it is the same sensor.
  beside.centre = {0, 0, 0};
  const SimulateResult same = simulate::simulate(run);
  CHECK(same.content.events.t_us().equal(one.content.events.t_us()));
  CHECK(same.content.events.x().equal(one.content.events.x()));
  CHECK(same.content.train[0].blurry.equal(one.content.train[0].blurry));
  beside.centre = {0.1, 0, 0}, beside.turn_deg = {0, 0, 90};
  beside.width = 30, beside.height = 44, beside.focal_px = 70;
  const SimulateResult other = simulate::simulate(run);
  REQUIRE(other.event_camera);
  CHECK(other.event_camera->camera.fx == 70);
  CHECK(other.content.events.x().max().item<float>() == 29);
  CHECK(other.content.events.y().max().item<float>() > 39);
  CHECK(other.largest_flow_px <= 50. / 70);
  // A point in front of the event camera is to the right of the frames' camera.
  const auto seen = geometry::transform(other.event_camera->from_frames, {1.1, 0, 1});
  CHECK(seen[0] == Approx(0).margin(1e-12));
  CHECK(seen[1] == Approx(-1));
  CHECK(seen[2] == Approx(1));
  const test::TempDir folder;
  write_recording(other, run, folder.path());
  const recording::Recording read = recording::read_recording(folder.path());
  REQUIRE(!read.calibrations.empty());
  CHECK(read.calibrations.front().name == "camchain.yaml");
  CHECK(read.events.size() == other.content.events.size());
  beside = {};
  beside.focal_px = 70;
  CHECK_THROWS_AS(simulate::simulate(run), ConfigError);
}

TEST_CASE("simulate: a Gaussian file can be filmed", "[simulate]") {
  test::TempDir folder;
  splat::Gaussians g;
  g.means = torch::rand({400, 3}) - 0.5;
  g.rotations = torch::tensor({1.0f, 0.0f, 0.0f, 0.0f}).repeat({400, 1});
  g.log_scales = torch::full({400, 3}, -2.5f);
  g.logit_opacities = torch::full({400}, 3.0f);
  g.sh = torch::rand({400, 1, 3}) * 3 - 1;
  gaussians::write_ply(folder / "cloud.ply", {g, false});
  SimulateRun run = tiny();
  run.simulate.source = Source::kPly, run.simulate.path = folder / "cloud.ply";
  run.simulate.exposures = 1, run.simulate.test_views = 1, run.simulate.motion.blur_px = 3;
  run.simulate.events.threshold_positive = run.simulate.events.threshold_negative = 0.05;
  const auto result = simulate::simulate(run);
  CHECK(result.blur_px == Approx(3).epsilon(0.05));
  CHECK(result.content.events.size() > 50);
  CHECK(result.content.train[0].blurry.max().item<double>() > 0.2);
  run.simulate.path = folder / "missing.ply";
  CHECK_THROWS_AS(simulate::simulate(run), DataError);
}

TEST_CASE("simulate: stops on an interrupt", "[simulate]") {
  const SimulateRun run = tiny();
  set_interrupt_requested(true);
  CHECK_THROWS_AS(simulate::simulate(run), Interrupted);
  set_interrupt_requested(false);
}
