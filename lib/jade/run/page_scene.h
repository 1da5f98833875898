// SPDX-License-Identifier: Apache-2.0
// What a page says of a scene beside its Gaussians, as page/page.h lists it.
#pragma once

#include <nlohmann/json.hpp>

#include "jade/data/exposure.h"
#include "jade/run/event_film.h"
#include "jade/splat/render.h"

namespace jade::run {

/// {"near_plane", "background", "cameras": {"train", "test"}}: how a viewer draws, and where the
/// data set's cameras stand.
nlohmann::ordered_json page_scene(const data::Dataset& dataset, const splat::RenderOptions& draw);

/// The film of an exposure's events, packed for the page's events.js; null where there are none.
/// @param limit  as event_film() has it
nlohmann::ordered_json page_film(const data::Exposure& exposure, size_t limit = kFilmBytes);

}  // namespace jade::run
