// SPDX-License-Identifier: Apache-2.0
// The layout of DiET-GS scenes:
//   images/NN.png            N blurry frames, then the sharp test frames
//   sparse/0                 COLMAP model of 9N + 5 images named <frame>_<pose> and GT<i>
//   events/events.h5         x, y, t, p          } made from the published pickles
//   events/timestamps.npz    one window per frame  } by scripts/convert_diet_gs.py
//   events/color_map.npy     optional, [3,H,W]   }
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// True if the COLMAP model in `folder` names its images as DiET-GS does.
bool is_diet_gs(const std::filesystem::path& folder);

/// Test views are the GT<i>, whatever dataset.split is, unless it is `none`.
Dataset load_diet_gs(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
