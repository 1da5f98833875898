// SPDX-License-Identifier: Apache-2.0
#include "jade/run/page_scene.h"

#include <array>
#include <string>
#include <torch/types.h>

#include "jade/io/gzip.h"
#include "jade/page/base64.h"

namespace jade::run {

using Json = nlohmann::ordered_json;

namespace {

template <class Poses>
Json page_camera(const std::string& name, const geometry::Intrinsics& camera, const Poses& poses) {
  Json rows = Json::array();
  for (const geometry::Pose& pose : poses) {
    Json numbers = Json::array();
    for (size_t r = 0; r < 3; ++r) {
      for (size_t c = 0; c < 3; ++c) numbers.push_back(pose.rotation[3 * r + c]);
      numbers.push_back(pose.translation[r]);
    }
    rows.push_back(std::move(numbers));
  }
  return {{"name", name},    {"width", camera.width}, {"height", camera.height}, {"fx", camera.fx},
          {"fy", camera.fy}, {"cx", camera.cx},       {"cy", camera.cy},         {"poses", rows}};
}

}  // namespace

Json page_scene(const data::Dataset& dataset, const splat::RenderOptions& draw) {
  Json train = Json::array(), test = Json::array();
  for (const data::Exposure& exposure : dataset.train) {
    train.push_back(page_camera(exposure.name, exposure.camera, exposure.poses));
  }
  for (const data::SharpView& view : dataset.test) {
    test.push_back(page_camera(view.name, view.camera, std::array{view.pose}));
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
          {"cameras", {{"train", train}, {"test", test}}}};
}

Json page_film(const data::Exposure& exposure, size_t limit) {
  const EventFilm film = event_film(exposure, limit);
  if (film.marks == 0) return nullptr;
  return {{"bins", film.bins},     {"columns", film.columns},
          {"rows", film.rows},     {"cell", film.cell},
          {"events", film.events}, {"packed", page::base64(io::gzip(film.bytes))}};
}

}  // namespace jade::run
