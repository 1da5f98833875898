// SPDX-License-Identifier: Apache-2.0
// The layout of the EvDeblur-CDAVIS and -Blender scenes:
//   images_1/NN.png          blurry and sharp frames together, in order of name
//   images_1/timestamps.npz  timestamps_start, timestamps_end, one each per frame
//   poses_bounds.npy         LLFF rows, one per frame
//   all_poses_bounds.npy     optional: LLFF rows of a dense trajectory, with all_timestamps.npy
//   events.h5                optional: x, y, t, p
//   points.npz               optional: points [P,3] in world axes, colors [P,3] uint8
//   ev_map.npz               optional: rectified places of the raw pixels of a colour sensor
//   gains.csv                optional: lines name,gain; frame brightness = scene brightness · gain
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

constexpr char kGainFile[] = "gains.csv";

/// True if `folder` has this layout: poses_bounds.npy, or time stamps beside its images.
bool is_evdeblur(const std::filesystem::path& folder);

/// Takes the poses of an exposure from the dense trajectory. Without one, interpolates between the
/// frames' own poses and extrapolates at both ends. See load_dataset for errors.
Dataset load_evdeblur(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
