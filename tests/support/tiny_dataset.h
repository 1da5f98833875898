// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/data/exposure.h"

namespace jade::test {

struct TinyDatasetOptions {
  int64_t width = 36, height = 28;
  int64_t exposures = 3;
  bool last_exposure_without_events = false;
  bool gray = false;  ///< R = G = B in every frame
};

/// Writes a small scene in the EvDeblur layout: a plane with a smooth pattern at depth 2, seen by a
/// camera that moves 6 px per exposure; blurry frames are exact means and events come from the
/// exact log intensity with Θ = 0.2 for both polarities. Two sharp test views follow.
void write_tiny_dataset(const std::filesystem::path& folder,
                        const TinyDatasetOptions& options = {});

}  // namespace jade::test
