// SPDX-License-Identifier: Apache-2.0
#include "jade/run/page_scene.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>
#include <string_view>
#include <torch/types.h>

#include "jade/core/digest.h"
#include "jade/io/gzip.h"

namespace jade::run {

using Json = nlohmann::ordered_json;

namespace {

Json page_camera(const std::string& name, const geometry::Intrinsics& camera,
                 const std::vector<geometry::Pose>& poses) {
  return {{"name", name},    {"width", camera.width},     {"height", camera.height},
          {"fx", camera.fx}, {"fy", camera.fy},           {"cx", camera.cx},
          {"cy", camera.cy}, {"poses", page_poses(poses)}};
}

}  // namespace

std::optional<CameraOfPage> camera_of_page(const data::Dataset& dataset, const std::string& name) {
  for (const bool exposure : {true, false}) {
    const std::string_view kind = exposure ? "train." : "test.";
    if (name.compare(0, kind.size(), kind) != 0) continue;
    size_t index = 0;
    const char* const end = name.data() + name.size();
    const auto [next, error] = std::from_chars(name.data() + kind.size(), end, index);
    const size_t count = exposure ? dataset.train.size() : dataset.test.size();
    if (error == std::errc() && next == end && index < count) return CameraOfPage{exposure, index};
  }
  return std::nullopt;
}

Json page_poses(const std::vector<geometry::Pose>& camera_from_world) {
  Json rows = Json::array();
  for (const geometry::Pose& pose : camera_from_world) {
    Json numbers = Json::array();
    for (size_t r = 0; r < 3; ++r) {
      for (size_t c = 0; c < 3; ++c) numbers.push_back(pose.rotation[3 * r + c]);
      numbers.push_back(pose.translation[r]);
    }
    rows.push_back(std::move(numbers));
  }
  return rows;
}

double display_brightness(const data::Dataset& dataset) {
  constexpr double kDark = 0.3, kWanted = 0.4, kMost = 5;
  double sum = 0;
  for (const data::Exposure& exposure : dataset.train) {
    // A mask has set excluded pixels to 0.
    const double counted =
        exposure.mask.defined() ? exposure.mask.to(torch::kFloat32).mean().item<double>() : 1;
    sum += exposure.blurry.mean().item<double>() / std::max(counted, 1e-3);
  }
  const double mean = dataset.train.empty() ? 1 : sum / static_cast<double>(dataset.train.size());
  if (mean >= kDark) return 1;
  return std::round(10 * std::min(kMost, kWanted / std::max(mean, 1e-3))) / 10;
}

Json page_scene(const data::Dataset& dataset, const splat::RenderOptions& draw) {
  Json train = Json::array(), test = Json::array();
  for (const data::Exposure& exposure : dataset.train) {
    train.push_back(page_camera(exposure.name, exposure.camera,
                                {exposure.poses.begin(), exposure.poses.end()}));
  }
  for (const data::SharpView& view : dataset.test) {
    test.push_back(page_camera(view.name, view.camera, {view.pose}));
    test.back()["seen"] = view.seen ? Json(*view.seen) : Json(nullptr);
  }
  Json background{0, 0, 0};
  if (draw.background.defined()) {
    for (int64_t c = 0; c < 3; ++c) {
      background[static_cast<size_t>(c)] = draw.background[c].item<double>();
    }
  }
  return {{"near_plane", draw.near_plane},
          {"background", background},
          {"brightness", display_brightness(dataset)},
          {"cameras", {{"train", train}, {"test", test}}}};
}

Json page_film(const data::Exposure& exposure, size_t limit) {
  const EventFilm film = event_film(exposure, limit);
  if (film.marks == 0) return nullptr;
  return {{"bins", film.bins}, {"columns", film.columns}, {"rows", film.rows},
          {"cell", film.cell}, {"events", film.events},   {"packed", base64(io::gzip(film.bytes))}};
}

}  // namespace jade::run
