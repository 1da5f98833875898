// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/written_poses.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

#include "jade/core/progress.h"
#include "jade/data/dataset.h"
#include "jade/simulate/simulator.h"
#include "support/drifting_pattern.h"
#include "support/se3_log.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::simulate;

namespace {

constexpr double kDegree = M_PI / 180;

SimulateRun pattern_run(int64_t exposures) {
  set_progress_enabled(false);
  SimulateRun run;
  run.seed = 4;
  run.simulate.exposures = exposures, run.simulate.exposure_ms = 100, run.simulate.gap_ms = 20;
  run.simulate.test_views = run.simulate.seen_test_views = 0;
  return run;
}

/// A world in front of a handheld camera with noise.
SimulateRun shaken() {
  SimulateRun run = pattern_run(4);
  run.simulate = preset_options(Preset::kCdavis);
  run.simulate.world = "clutter";
  run.simulate.exposures = 4;
  run.simulate.width = 40, run.simulate.height = 30, run.simulate.focal_px = 50;
  run.simulate.exposure_ms = 30, run.simulate.gap_ms = 6;
  run.simulate.test_views = 2, run.simulate.seen_test_views = 1;
  run.simulate.motion.blur_px = 4;
  return run;
}

double distance(const geometry::Pose& a, const geometry::Pose& b) {
  const auto c = geometry::centre(a), d = geometry::centre(b);
  return geometry::rotation_angle(a, b) + std::hypot(c[0] - d[0], c[1] - d[1], c[2] - d[2]);
}

/// Rotation vectors and translations of written relative to true poses, in units of the requested
/// errors.
class Errors {
 public:
  explicit Errors(const PoseNoiseOptions& options) : options_(options) {}
  void add(const geometry::Pose& truth, const geometry::Pose& written) {
    turns_.push_back(geometry::to_tensor(geometry::compose(written, geometry::inverse(truth))));
    const auto a = geometry::centre(truth), b = geometry::centre(written);
    for (size_t i = 0; i < 3; ++i) shifts_.push_back(b[i] - a[i]);
  }
  torch::Tensor all() const {
    const auto rotation = test::se3_log(torch::stack(turns_)).slice(1, 3) / kDegree;
    const auto position = torch::tensor(shifts_, torch::kFloat64).view({-1, 3});
    return torch::cat({rotation / options_.rotation_deg, position / options_.position}, 1);
  }

 private:
  PoseNoiseOptions options_;
  std::vector<torch::Tensor> turns_;
  std::vector<double> shifts_;
};

/// Six independent standard normals, within four standard errors: 1/√n of a mean or a correlation,
/// 1/√(2n) of a deviation.
void check_deviations(const torch::Tensor& errors) {
  const double bound = 4 / std::sqrt(double(errors.size(0)));
  CHECK(errors.mean(0).abs().max().item<double>() < bound);
  CHECK((errors.std(0) - 1).abs().max().item<double>() < bound / std::sqrt(2.0));
  const auto correlation = torch::corrcoef(errors.t()) - torch::eye(6, torch::kFloat64);
  CHECK(correlation.abs().max().item<double>() < bound);
}

}  // namespace

TEST_CASE("written poses: have the deviations asked for, in degrees and in world units",
          "[simulate]") {
  SimulateRun run = pattern_run(60);
  run.simulate.test_views = 40;
  run.simulate.poses.rotation_deg = 0.5, run.simulate.poses.position = 0.01;
  test::DriftingPattern pattern(8, 8, 10, 100000);
  SECTION("of the nine poses, which no longer lie on a grid from time 0") {
    Errors errors(run.simulate.poses), tests(run.simulate.poses), between(run.simulate.poses);
    const auto result = simulate::simulate(run, pattern);
    for (const auto& exposure : result.content.train) {
      const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
      for (size_t k = 0; k < times.size(); ++k)
        errors.add(pattern.pose(times[k]), exposure.poses[k]);
    }
    REQUIRE(errors.all().size(0) == 540);
    check_deviations(errors.all());
    for (const auto& view : result.content.test)
      tests.add(pattern.pose(double(view.t_us)), view.pose);
    check_deviations(tests.all());
    // Every 37 ms, at arbitrary positions between two of the nine.
    for (size_t i = 0; i < result.content.path.size(); i += 37)
      between.add(pattern.pose(double(result.content.path_t_us[i])), result.content.path[i]);
    CHECK(between.all().std().item<double>() == Approx(1).margin(0.15));
  }
  SECTION("of the middle ones, alone or among three") {
    run.simulate.exposures = 300;
    run.simulate.poses.at = GENERATE(PoseTimes::kMidExposure, PoseTimes::kThirds);
    const Timeline timeline = make_timeline(run.simulate);
    const WrittenPoses poses(run, pattern, timeline);
    Errors errors(run.simulate.poses);
    for (const auto& window : timeline.exposures) {
      const auto truth = pattern.pose(double(window.mid_us()));
      errors.add(truth, poses.frame(window.mid_us()));
      CHECK(distance(poses.frame(window.mid_us()), poses.path(window.mid_us())) < 1e-7);
    }
    check_deviations(errors.all());
  }
}

TEST_CASE("written poses: at mid-exposure, the path is what these alone tell", "[simulate]") {
  SimulateRun run = shaken();
  run.simulate.poses.at = PoseTimes::kMidExposure;
  const auto exact = simulate::simulate(shaken()), written = simulate::simulate(run);
  const auto &a = exact.content, &b = written.content;
  std::vector<double> times;
  std::vector<geometry::Pose> mids;
  for (size_t i = 0; i < 4; ++i) {
    CHECK(distance(a.train[i].poses[4], b.train[i].poses[4]) < 1e-7);
    CHECK(distance(a.train[i].poses[0], b.train[i].poses[0]) > 1e-3);
    times.push_back(double(b.train[i].t_mid_us()));
    mids.push_back(b.train[i].poses[4]);
  }
  const auto through = geometry::Trajectory(times, mids).spanning(0, double(b.path_t_us.back()));
  double furthest = 0;
  for (size_t i = 0; i < b.path.size(); ++i)
    furthest = std::max(furthest, distance(b.path[i], through.at(double(b.path_t_us[i]))));
  CHECK(furthest < 1e-7);
  // Sharp frames have separate estimates.
  for (size_t i = 0; i < 2; ++i) CHECK(distance(a.test[i].pose, b.test[i].pose) < 1e-7);
  CHECK(distance(b.test[1].pose, through.at(double(b.test[1].t_us))) > 1e-4);
  CHECK(exact.pose_errors.nine.max < 1e-3);
  CHECK(written.pose_errors.mid.max < 1e-3);
  CHECK(written.pose_errors.nine.rms > 0.1);
}

TEST_CASE("written poses: more of them per exposure follow the hand more closely", "[simulate]") {
  SimulateRun run = shaken();
  const auto error = [&](PoseTimes at) {
    run.simulate.poses.at = at;
    return simulate::simulate(run).pose_errors;
  };
  const auto middle = error(PoseTimes::kMidExposure), thirds = error(PoseTimes::kThirds);
  CHECK(thirds.mid.max < 1e-3);
  CHECK(thirds.nine.rms > 1e-3);
  CHECK(thirds.nine.rms < 0.5 * middle.nine.rms);
}

TEST_CASE("written poses: middle poses determine a camera at constant velocity", "[simulate]") {
  SimulateRun run = pattern_run(3);
  run.simulate.poses.at = GENERATE(PoseTimes::kMidExposure, PoseTimes::kThirds);
  const test::DriftingPattern pattern(8, 8, 10, 100000);
  const Timeline timeline = make_timeline(run.simulate);
  const WrittenPoses poses(run, pattern, timeline);
  for (int64_t t = 0; t <= timeline.end_us; t += 5000)
    CHECK(distance(poses.path(t), pattern.pose(double(t))) < 1e-7);
}

TEST_CASE("written poses: whatever their error, frames and events are the same to the bit",
          "[simulate]") {
  SimulateRun run = shaken();
  const auto exact = simulate::simulate(run);
  run.simulate.poses = {PoseTimes::kMidExposure, 0.5, 0.01, 40};
  const auto estimated = simulate::simulate(run);
  const auto &a = exact.content, &b = estimated.content;
  CHECK(a.events.x().equal(b.events.x()));
  CHECK(a.events.y().equal(b.events.y()));
  CHECK(a.events.t_us().equal(b.events.t_us()));
  CHECK(a.events.polarity().equal(b.events.polarity()));
  CHECK((a.near == b.near && a.far == b.far));
  for (size_t i = 0; i < 4; ++i) {
    CHECK(a.train[i].blurry.equal(b.train[i].blurry));
    CHECK(a.sharp_mid[i].equal(b.sharp_mid[i]));
    CHECK(distance(a.train[i].poses[4], b.train[i].poses[4]) > 1e-4);
  }
  for (size_t i = 0; i < 2; ++i) {
    CHECK(a.test[i].image.equal(b.test[i].image));
    CHECK(distance(a.test[i].pose, b.test[i].pose) > 1e-4);
  }
  // After loading, exposures have the written poses, and all of the events.
  const test::TempDir folder;
  write(estimated, run, folder.path());
  data::DatasetOptions options;
  options.path = folder.path();
  const data::Dataset loaded = data::load_dataset(options);
  CHECK(loaded.events.size() == a.events.size());
  for (size_t i = 0; i < 4; ++i) {
    for (size_t k = 0; k < 9; ++k)
      CHECK(distance(loaded.train[i].poses[k], b.train[i].poses[k]) < 1e-3);
  }
}

TEST_CASE("pose errors: are the pixels by which the picture moves", "[simulate]") {
  const test::DriftingPattern pattern(8, 8, 10, 100000);
  std::vector<data::Exposure> exposures(2);
  for (size_t i = 0; i < 2; ++i) {
    exposures[i].t_start_us = 5000 + 120000 * int64_t(i);
    exposures[i].t_end_us = exposures[i].t_start_us + 100000;
    const auto times = geometry::exposure_times(exposures[i].t_start_us, exposures[i].t_end_us);
    for (size_t k = 0; k < 9; ++k) exposures[i].poses[k] = pattern.pose(times[k]);
  }
  CHECK(pose_errors(exposures, pattern).nine.max < 1e-6);
  // Focal length 100 px, depth 2: 1 px is 0.57° or 0.02 units.
  auto& turned = exposures[0].poses[4];
  turned = geometry::compose({geometry::rotation_from_vector({0, std::atan(0.01), 0}), {0, 0, 0}},
                             turned);
  auto& shifted = exposures[1].poses[8];
  shifted.translation[0] += 0.04;
  const auto found = pose_errors(exposures, pattern);
  CHECK(found.mid.max == Approx(1).epsilon(0.01));
  CHECK(found.mid.rms == Approx(1 / std::sqrt(2.0)).epsilon(0.01));
  CHECK(found.nine.max == Approx(2).epsilon(0.02));
  CHECK(found.nine.rms == Approx(std::sqrt(5.0 / 18)).epsilon(0.02));
}
