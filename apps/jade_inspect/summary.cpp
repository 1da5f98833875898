// SPDX-License-Identifier: Apache-2.0
#include "summary.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <torch/types.h>

#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/data/masks.h"

namespace jade::apps {
namespace {

using data::Dataset;
using data::Exposure;

double positive_share(const events::EventStream& events) {
  return events.empty() ? 0 : (events.polarity() > 0).sum().item<double>() / double(events.size());
}

double events_per_second(const Exposure& exposure) {
  if (exposure.duration_us() == 0) return 0;
  return 1e6 * double(exposure.events.size()) / double(exposure.duration_us());
}

/// The sharp test views taken in the middle of an exposure, by name.
std::string seen_by(const Dataset& dataset, size_t index) {
  std::string names;
  for (const data::SharpView& view : dataset.test) {
    if (data::exposure_of(dataset, view) != int64_t(index)) continue;
    names += (names.empty() ? "" : ", ") + view.name;
  }
  return names;
}

double path_length(const Exposure& exposure) {
  double length = 0;
  for (size_t k = 1; k < exposure.poses.size(); ++k) {
    const auto a = geometry::centre(exposure.poses[k - 1]);
    const auto b = geometry::centre(exposure.poses[k]);
    length += std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  }
  return length;
}

/// Appends whether training sees the scene from there, if known.
std::string marked_name(const data::SharpView& view) {
  return view.name + (!view.seen ? "" : *view.seen ? " (seen)" : " (unseen)");
}

/// Sizes of images that differ from `size`, each once.
std::vector<std::string> other_sizes(const Dataset& d, const std::string& size) {
  std::vector<std::string> sizes;
  const auto add = [&](const geometry::Intrinsics& camera) {
    const std::string other = concat(camera.width, "x", camera.height);
    if (other == size || std::find(sizes.begin(), sizes.end(), other) != sizes.end()) return;
    sizes.push_back(other);
  };
  for (const auto* exposures : {&d.train, &d.held_out}) {
    for (const Exposure& exposure : *exposures) add(exposure.camera);
  }
  for (const data::SharpView& view : d.test) add(view.camera);
  return sizes;
}

void print_frames(const Dataset& d) {
  const geometry::Intrinsics& camera = d.train.front().camera;
  std::printf("data set    %s, layout %s, in %s\n", d.name.c_str(), word_of(d.kind),
              d.root.c_str());
  std::printf("frames      %zu for training, %zu sharp test views (%s)\n", d.train.size(),
              d.test.size(), d.split.c_str());
  if (!d.held_out.empty()) {
    std::string held;
    for (const auto& exposure : d.held_out) held += (held.empty() ? "" : ", ") + exposure.name;
    std::printf("held out    %s (%s)\n", held.c_str(), data::kHeldOutFile);
  }
  std::string names;
  for (const auto& view : d.test) names += (names.empty() ? "" : ", ") + marked_name(view);
  if (!names.empty()) std::printf("test views  %s\n", names.c_str());
  std::printf("image       %ldx%ld px, focal %.2f px, field of view %.1f x %.1f degrees\n",
              long(camera.width), long(camera.height), camera.fx,
              2 * std::atan(0.5 * double(camera.width) / camera.fx) * 180 / M_PI,
              2 * std::atan(0.5 * double(camera.height) / camera.fy) * 180 / M_PI);
  const auto others = other_sizes(d, concat(camera.width, "x", camera.height));
  if (!others.empty()) std::printf("            others %s px\n", listing(others).c_str());
  std::printf("color       %s\n", d.monochrome ? "monochrome: R = G = B in every frame, so the "
                                                 "restorations and the scene are gray"
                                               : "frames in colour");
  for (const std::string& note : d.notes) std::printf("note        %s\n", note.c_str());
  if (const data::MaskSummary masks = data::summarize_masks(d); masks.frames > 0) {
    std::printf("masks       %ld frames, %.1f %% of all pixels excluded, %.1f %% of one at most\n",
                long(masks.frames), 100 * masks.excluded, 100 * masks.largest);
  }
  std::printf("depth       %.4g to %.4g units\n", d.near, d.far);
  if (d.points.defined()) std::printf("points      %ld sparse points\n", long(d.points.size(0)));
  if (d.trajectory.empty()) {
    std::printf("poses       nine an exposure, no dense trajectory\n");
  } else {
    std::printf("poses       nine an exposure, from a trajectory of %ld poses, %.4f to %.4f s\n",
                long(d.trajectory.size()), 1e-6 * d.trajectory.begin_us(),
                1e-6 * d.trajectory.end_us());
  }
}

void print_events(const Inspection& inspection) {
  const Dataset& d = inspection.dataset;
  if (d.events.empty()) {
    std::printf("events      none\n");
    return;
  }
  const double seconds = 1e-6 * double(d.events.last_us() - d.events.first_us());
  const double rate_hz = double(d.events.size()) / std::max(seconds, 1e-6);
  std::printf("events      %s from %.4f to %.4f s, %s events/s, %.0f %% positive, %s\n",
              grouped(d.events.size()).c_str(), 1e-6 * double(d.events.first_us()),
              1e-6 * double(d.events.last_us()), grouped(std::llround(rate_hz)).c_str(),
              100 * positive_share(d.events),
              d.event_color.defined() ? "with a colour filter" : "without colours");
  const data::ThresholdEstimate& t = inspection.thresholds;
  if (!t.found) {
    std::printf(
        "thresholds  cannot be estimated from these frames and events; jade_train uses 0.25 "
        "where none are set\n");
    return;
  }
  std::printf(
      "thresholds  about %.2f (positive) and %.2f (negative) in log(I + %.4g), spread %.2f and "
      "%.2f "
      "from\n            pixel to pixel; fitted to the change between blurry frames, %.0f %% of "
      "which "
      "stays unexplained\n",
      t.thresholds.positive, t.thresholds.negative, inspection.log_offset, t.spread.positive,
      t.spread.negative, 100 * t.unexplained);
  if (inspection.log_offset == 0) {
    std::printf("            jade_train and jade_deblur take these where none are set\n");
  }
}

void print_pattern(const data::PatternEstimate& pattern) {
  if (pattern.pairs == 0) return;
  const char* action = pattern.is_worth_learning()
                           ? "jade_train learns it and keeps it out of the scene"
                       : pattern.sideways_px < data::PatternEstimate::kLeastSidewaysPx
                           ? "not learned: a camera on one line cannot separate it from the scene"
                           : "too little to learn";
  std::printf("pattern     %.2f %% of white is the same in all frames; %s\n",
              100 * pattern.strength, action);
}

void print_exposures(const Dataset& d) {
  if (d.train.front().duration_us() == 0) return;
  std::printf("\n%-10s %11s %9s %11s %11s %9s %10s  %s\n", "exposure", "start s", "ms", "events",
              "events/s", "per pixel", "path", "sharp view at its middle");
  for (size_t i = 0; i < d.train.size(); ++i) {
    const Exposure& e = d.train[i];
    const double pixels = double(e.camera.width * e.camera.height);
    std::printf("%-10s %11.4f %9.2f %11s %11s %9.2f %10.4g  %s\n", e.name.c_str(),
                1e-6 * double(e.t_start_us), 1e-3 * double(e.duration_us()),
                grouped(e.events.size()).c_str(),
                grouped(std::llround(events_per_second(e))).c_str(),
                double(e.events.size()) / pixels, path_length(e), seen_by(d, i).c_str());
  }
}

}  // namespace

void print_text(const Inspection& inspection) {
  print_frames(inspection.dataset);
  print_events(inspection);
  print_pattern(inspection.pattern);
  print_exposures(inspection.dataset);
  if (inspection.problems.empty()) {
    std::printf("\nNo problems found.\n\nnext        %s\n", inspection.next.c_str());
    return;
  }
  std::printf("\n%zu problem%s:\n", inspection.problems.size(),
              inspection.problems.size() == 1 ? "" : "s");
  for (const std::string& problem : inspection.problems) std::printf("  %s\n", problem.c_str());
}

nlohmann::json to_json(const Inspection& inspection) {
  const Dataset& d = inspection.dataset;
  const geometry::Intrinsics& camera = d.train.front().camera;
  nlohmann::json exposures = nlohmann::json::array();
  for (size_t i = 0; i < d.train.size(); ++i) {
    const Exposure& e = d.train[i];
    exposures.push_back({{"name", e.name},
                         {"t_start_us", e.t_start_us},
                         {"t_end_us", e.t_end_us},
                         {"events", e.events.size()},
                         {"events_per_second", events_per_second(e)},
                         {"path_length", path_length(e)},
                         {"sharp_view", seen_by(d, i)}});
  }
  nlohmann::json tests = nlohmann::json::array(), seen = nlohmann::json::array();
  for (const auto& view : d.test) {
    tests.push_back(view.name);
    seen.push_back(view.seen ? nlohmann::json(*view.seen) : nlohmann::json(nullptr));
  }
  nlohmann::json result = {{"name", d.name},
                           {"kind", word_of(d.kind)},
                           {"split", d.split},
                           {"width", camera.width},
                           {"height", camera.height},
                           {"focal_px", camera.fx},
                           {"color", d.monochrome ? "gray" : "color"},
                           {"near", d.near},
                           {"far", d.far},
                           {"points", d.points.defined() ? d.points.size(0) : 0},
                           {"trajectory_poses", d.trajectory.size()},
                           {"train", exposures},
                           {"test", tests},
                           {"test_seen", seen},
                           {"events",
                            {{"count", d.events.size()},
                             {"positive_share", positive_share(d.events)},
                             {"colour", d.event_color.defined()}}},
                           {"thresholds", nullptr},
                           {"pattern",
                            {{"strength", inspection.pattern.strength},
                             {"sideways_px", inspection.pattern.sideways_px},
                             {"pairs", inspection.pattern.pairs}}},
                           {"notes", d.notes},
                           {"problems", inspection.problems},
                           {"next", inspection.next}};
  if (const data::MaskSummary masks = data::summarize_masks(d); masks.frames > 0) {
    result["masks"] = {{"frames", masks.frames},
                       {"excluded_share", masks.excluded},
                       {"largest_excluded_share", masks.largest}};
  }
  if (inspection.thresholds.found) {
    result["thresholds"] = {{"positive", inspection.thresholds.thresholds.positive},
                            {"negative", inspection.thresholds.thresholds.negative},
                            {"spread_positive", inspection.thresholds.spread.positive},
                            {"spread_negative", inspection.thresholds.spread.negative},
                            {"log_offset", inspection.log_offset},
                            {"unexplained", inspection.thresholds.unexplained}};
  }
  return result;
}

}  // namespace jade::apps
