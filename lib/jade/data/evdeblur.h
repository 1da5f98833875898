// SPDX-License-Identifier: Apache-2.0
// The layout of the EvDeblur-CDAVIS and -Blender scenes:
//   images_1/NN.png          blurry and sharp frames together, in order of name
//   images_1/timestamps.npz  timestamps_start, timestamps_end, one each per frame
//   poses_bounds.npy         LLFF rows, one per frame
//   all_poses_bounds.npy     optional: LLFF rows of a dense trajectory, with all_timestamps.npy
//   events.h5                optional: x, y, t, p
//   points.npz               optional: points [P,3] in world axes, colors [P,3] uint8
//   ev_map.npz               optional: where raw pixels of a colour sensor land
//   gains.csv                optional: lines name,gain; a frame's brightness is the scene's times
//   it
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

constexpr char kGainFile[] = "gains.csv";

/// True if `folder` looks like this layout: poses_bounds.npy, or time stamps beside its images.
bool is_evdeblur(const std::filesystem::path& folder);

/// Poses of an exposure come from the dense trajectory. Without one they are interpolated between
/// the frames' own poses, continued at both ends. See load_dataset for errors.
Dataset load_evdeblur(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
