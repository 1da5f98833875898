// SPDX-License-Identifier: Apache-2.0
// Sharp images of every exposure, for structure from motion.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/import/capture.h"
#include "jade/import/options.h"
#include "jade/restore/view_restorer.h"

namespace jade::import {

/// The moments of an exposure that structure from motion uses. One pose per exposure does not
/// determine its motion; nine are slow and no more accurate than three.
inline constexpr double kLatentMoments[] = {0, 0.5, 1};

/// The sharp images of an exposure at its start, middle and end, [3,3,H,W] on the CPU, of the kind
/// in the options. Not clamped.
/// @param restorer  with its network unless the kind is EDI
torch::Tensor latents_of(const Shot& shot, const Capture& capture, const ImportOptions& options,
                         restore::ViewRestorer& restorer);

/// One image for structure from motion.
struct LatentImage {
  std::string file;  ///< in images/ of the stage's folder
  int64_t shot = 0;  ///< index in Capture::shots
  int64_t t_us = 0;
};

/// Writes images/SHOT_K.png, enlarged by latents.upscale: three per blurry shot, one per sharp
/// one or one without events; and images.json. Shows progress.
std::vector<LatentImage> write_latents(const std::filesystem::path& folder, const Capture& capture,
                                       const ImportOptions& options);

/// Reads the list that write_latents returned, sorted by time. @throws DataError naming the file.
std::vector<LatentImage> load_latents(const std::filesystem::path& folder);

/// Whether a shot needs no deblurring: its exposure has no length, or the scene moves less than
/// this during it.
bool is_sharp(const Shot& shot, double sharp_px);

}  // namespace jade::import
