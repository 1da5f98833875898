// SPDX-License-Identifier: Apache-2.0
// Data of a page about a scene besides its Gaussians; page/page.h lists them.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/run/event_film.h"
#include "jade/splat/render.h"

namespace jade::run {

/// A camera of a data set as pages name it: "train.3", the exposure of index 3, or "test.0".
struct CameraOfPage {
  bool exposure = false;
  size_t index = 0;
};

/// Returns no value for an unknown camera name.
std::optional<CameraOfPage> camera_of_page(const data::Dataset& dataset, const std::string& name);

/// Brightness factor of pages and films: 1 for frames of usual brightness, up to 5 for dark ones.
/// Files store the original values.
double display_brightness(const data::Dataset& dataset);

/// {"near_plane", "background", "brightness", "cameras": {"train", "test"}}: settings of the
/// viewer, and the data set's cameras.
nlohmann::ordered_json page_scene(const data::Dataset& dataset, const splat::RenderOptions& draw);

/// Cameras in the page's format: 12 numbers each, the rows of camera_from_world.
nlohmann::ordered_json page_poses(const std::vector<geometry::Pose>& camera_from_world);

/// The film of an exposure's events, packed for the page's events.js; null if there are none.
/// @param limit  as in event_film()
nlohmann::ordered_json page_film(const data::Exposure& exposure, size_t limit = kFilmBytes);

}  // namespace jade::run
