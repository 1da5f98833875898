// SPDX-License-Identifier: Apache-2.0
#include "jade/import/scene_files.h"

#include <algorithm>
#include <set>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/evdeblur_writer.h"
#include "jade/data/frames.h"
#include "jade/data/masks.h"
#include "jade/geometry/trajectory.h"
#include "jade/imaging/image_io.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Margin of events before the first and after the last exposure, for ramps that begin or end
/// there.
constexpr int64_t kMarginUs = 20000;

/// Holds out every n-th training exposure, starting in the middle of the first n.
void hold_out(int64_t every, std::vector<Part>& parts) {
  if (every < 2) return;
  int64_t count = 0;
  for (Part& part : parts) {
    if (part == Part::kTrain && count++ % every == every / 2) part = Part::kHeldOut;
  }
}

/// A quarter of the frames suffices for evaluation: train on further sharp ones that have a length,
/// so that a camera that often rests loses no views.
void train_on_spare_tests(const std::vector<Shot>& shots, std::vector<Part>& parts) {
  std::vector<size_t> tests;
  int64_t posed = 0, fixed = 0;
  for (size_t i = 0; i < parts.size(); ++i) {
    if (parts[i] == Part::kLeftOut) continue;
    ++posed;
    if (parts[i] != Part::kTest) continue;
    shots[i].duration_us() > 0 ? tests.push_back(i) : void(++fixed);
  }
  const auto all = static_cast<int64_t>(tests.size());
  const int64_t kept = std::clamp<int64_t>(posed / 4 - fixed, fixed > 0 ? 0 : 1, all);
  for (int64_t n = 0; n < all; ++n) {
    const bool keep = (n + 1) * kept / all > n * kept / all;
    if (!keep) parts[tests[static_cast<size_t>(n)]] = Part::kTrain;
  }
}

/// Nine times per exposure, with the same density in between.
std::vector<int64_t> path_times(const std::vector<Shot>& shots, const std::vector<Part>& parts) {
  std::set<int64_t> times;
  int64_t first = INT64_MAX, last = INT64_MIN, step = INT64_MAX;
  for (size_t i = 0; i < shots.size(); ++i) {
    if (parts[i] == Part::kLeftOut) continue;
    first = std::min(first, shots[i].t_start_us);
    last = std::max(last, shots[i].t_end_us);
    if (shots[i].duration_us() == 0) continue;
    step = std::min(step, std::max<int64_t>(shots[i].duration_us() / 8, 100));
    for (const double t : geometry::exposure_times(shots[i].t_start_us, shots[i].t_end_us)) {
      times.insert(std::llround(t));
    }
  }
  for (int64_t t = first - kMarginUs; t < last + kMarginUs; t += step) {
    const auto next = times.lower_bound(t - step / 2);
    if (next == times.end() || *next > t + step / 2) times.insert(t);
  }
  times.insert(last + kMarginUs);
  return {times.begin(), times.end()};
}

/// Positions of event pixels, starting at the first red one.
torch::Tensor map_from_red(const Capture& capture) {
  torch::Tensor map = capture.event_map;
  if (!map.defined()) {
    const auto axes = torch::meshgrid({torch::arange(capture.sensor.height, torch::kFloat32),
                                       torch::arange(capture.sensor.width, torch::kFloat32)},
                                      "ij");
    map = torch::stack({axes[1], axes[0]});
  }
  const auto [row, column] = first_red(capture.filter);
  return map.slice(1, row).slice(2, column).contiguous();
}

data::EvDeblurContent content_of(const Capture& capture, const Reconstruction& found,
                                 const std::vector<Part>& parts) {
  data::EvDeblurContent content;
  const PosePath path = path_of(found.poses, capture);
  content.path_t_us = path_times(capture.shots, parts);
  for (const int64_t t : content.path_t_us) content.path.push_back(path.at(double(t)));
  std::vector<geometry::Pose> middles;
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    const Shot& shot = capture.shots[i];
    const geometry::Pose middle = path.at(double(shot.t_mid_us()));
    if (parts[i] == Part::kLeftOut) continue;
    middles.push_back(middle);
    if (parts[i] == Part::kTest) {
      content.test.push_back({shot.name, shot.image, middle, found.camera, shot.t_mid_us()});
      content.test.back().gain = shot.gain;
      continue;
    }
    data::Exposure exposure;
    exposure.name = shot.name;
    exposure.blurry = shot.image;
    exposure.gain = shot.gain;
    exposure.t_start_us = shot.t_start_us;
    exposure.t_end_us = shot.t_end_us;
    exposure.poses[geometry::kMidPose] = middle;
    exposure.camera = found.camera;
    content.train.push_back(std::move(exposure));
    content.held_out.push_back(parts[i] == Part::kHeldOut);
  }
  content.events = capture.events.slice(content.path_t_us.front(), content.path_t_us.back() + 1);
  content.color_events = capture.filter != ColorFilter::kNone;
  if (content.color_events) content.event_map = map_from_red(capture);
  content.points = found.points;
  content.point_colors = found.colors;
  const data::DepthBounds bounds = data::depth_bounds(found.points, middles);
  content.near = bounds.near;
  content.far = bounds.far;
  return content;
}

/// Whether all values are 8-bit steps: frames that no stage has changed.
bool is_eight_bit(const Capture& capture) {
  return std::all_of(capture.shots.begin(), capture.shots.end(), [](const Shot& shot) {
    const torch::Tensor steps = shot.image * 255;
    return (steps - steps.round()).abs().max().item<float>() < 1e-3f;
  });
}

std::string scene_yaml(const Capture& capture, const ImportOptions& options) {
  const events::Thresholds thresholds = options.events.thresholds();
  return concat("# Written by jade_import from ", fs::path(capture.source).filename().string(),
                ":\n#   jade_train --config scene.yaml --output DIR\n"
                "# Steps and moments that are not set here are chosen when the run begins.\n"
                "dataset: {path: .}\n"
                "events: {threshold_positive: ",
                thresholds.positive, ", threshold_negative: ", thresholds.negative,
                "}\n"
                "init: {kind: sfm}\n");
}

/// Lists frames in the order of the data set's numbers, then those not included.
std::string frame_list(const Capture& capture, const std::vector<Part>& parts) {
  std::string lines = "frame,part,name,start_us,end_us,blur_px\n";
  int64_t number = 0;
  const auto rest = [&](const Shot& shot) {
    return concat(shot.name, ",", shot.t_start_us, ",", shot.t_end_us, ",", shot.blur_px, "\n");
  };
  for (const bool tests : {false, true}) {
    for (size_t i = 0; i < capture.shots.size(); ++i) {
      if (parts[i] == Part::kLeftOut || (parts[i] == Part::kTest) != tests) continue;
      const Shot& shot = capture.shots[i];
      const char* part = tests ? "test" : parts[i] == Part::kHeldOut ? "held out" : "train";
      lines += concat(number++, ",", part, ",", rest(shot));
    }
  }
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    if (parts[i] == Part::kLeftOut) lines += concat(",left out,", rest(capture.shots[i]));
  }
  return lines;
}

/// "2 frames left out without a pose (a, b)", with the first few names.
std::string left_out(const Capture& capture, const std::vector<Part>& parts) {
  constexpr int64_t kNamed = 8;
  std::string names;
  int64_t count = 0;
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    if (parts[i] != Part::kLeftOut) continue;
    if (count < kNamed) names += concat(count > 0 ? ", " : "", capture.shots[i].name);
    ++count;
  }
  if (count == 0) return "no frame left out";
  return concat(count, " left out without a pose (", names, count > kNamed ? ", ..." : "", ")");
}

/// Writes masks/ under the names of the data set's frames, for frames with a mask of their own.
void write_frame_masks(const fs::path& folder, const Capture& capture,
                       const std::vector<Part>& parts) {
  fs::remove_all(folder / "masks");  // of an earlier import
  const auto& shots = capture.shots;
  if (std::none_of(shots.begin(), shots.end(), [](const Shot& s) { return s.mask.defined(); }))
    return;
  const torch::Tensor whole = torch::ones({1, capture.height(), capture.width()});
  const std::vector<fs::path> frames = imaging::list_images(folder / "images_1");
  size_t number = 0;
  for (const bool tests : {false, true}) {
    for (size_t i = 0; i < parts.size(); ++i) {
      if (parts[i] == Part::kLeftOut || (parts[i] == Part::kTest) != tests) continue;
      const torch::Tensor& mask = shots[i].mask;
      imaging::write_image(folder / "masks" / (frames[number++].stem().string() + ".png"),
                           mask.defined() ? mask.to(torch::kFloat32) : whole);
    }
  }
}

}  // namespace

void check_test_names(const Capture& capture, const TestOptions& options) {
  std::set<std::string> known;
  for (const Shot& shot : capture.shots) known.insert(shot.name);
  for (const std::string& name : options.names) {
    if (known.count(name) != 0) continue;
    throw ConfigError(concat("--test: expected names of frames such as '",
                             capture.shots.front().name, "', found '", name, "'"));
  }
}

std::vector<Part> parts_of(const Capture& capture, const std::vector<TimedPose>& found,
                           const TestOptions& options) {
  check_test_names(capture, options);
  const std::set<std::string> named(options.names.begin(), options.names.end());
  std::set<int64_t> posed;
  for (const TimedPose& timed : found) posed.insert(timed.shot);
  std::vector<Part> parts;
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    const Shot& shot = capture.shots[i];
    const bool sharp = is_sharp(shot, options.sharp_px);
    if (posed.count(static_cast<int64_t>(i)) == 0) {
      parts.push_back(Part::kLeftOut);
    } else if (named.count(shot.name) != 0) {
      parts.push_back(sharp ? Part::kTest : Part::kHeldOut);
    } else if (sharp && (named.empty() || shot.duration_us() == 0)) {
      parts.push_back(Part::kTest);
    } else {
      parts.push_back(Part::kTrain);
    }
  }
  if (named.empty()) {
    const bool judged = std::count(parts.begin(), parts.end(), Part::kTest) > 0;
    judged ? train_on_spare_tests(capture.shots, parts) : hold_out(options.every, parts);
  }
  if (std::count(parts.begin(), parts.end(), Part::kTrain) == 0) {
    throw DataError(
        "write: expected frames with a length and poses for training, found none; name fewer test "
        "frames (--test)");
  }
  return parts;
}

std::string write_scene(const fs::path& folder, const Capture& capture, const Reconstruction& found,
                        const ImportOptions& options) {
  const std::vector<Part> parts = parts_of(capture, found.poses, options.test);
  data::write_evdeblur(folder, content_of(capture, found, parts), is_eight_bit(capture) ? 8 : 16);
  fs::remove(folder / data::kMaskFile);  // of an earlier import
  if (capture.mask.defined()) {
    imaging::write_image(folder / data::kMaskFile, capture.mask.to(torch::kFloat32));
  }
  write_frame_masks(folder, capture, parts);
  write_file(folder / "frames.csv", frame_list(capture, parts));
  write_file(folder / "scene.yaml", scene_yaml(capture, options));
  const auto count = [&](Part part) { return std::count(parts.begin(), parts.end(), part); };
  const int64_t exposures = count(Part::kTrain), tests = count(Part::kTest);
  return concat(exposures, exposures == 1 ? " exposure, " : " exposures, ", count(Part::kHeldOut),
                " held out, ", tests, tests == 1 ? " sharp test view, " : " sharp test views, ",
                left_out(capture, parts), ", ", found.points.size(0), " points");
}

}  // namespace jade::import
