// SPDX-License-Identifier: Apache-2.0
// Writes the EvDeblur layout, which data/evdeblur.h reads back.
#pragma once

#include <cstdint>
#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"

namespace jade::data {

/// Contents of a folder in the EvDeblur layout. Frames are numbered in the given order: all
/// exposures first, then all sharp test views, as in the CDAVIS scenes.
struct EvDeblurContent {
  std::vector<Exposure> train;  ///< blurry, times, poses[4], camera and gain are used
  std::vector<SharpView> test;  ///< t_us must be set
  events::EventStream events;   ///< the whole recording
  bool color_events = false;    ///< each pixel has the channel of data/bayer.h
  /// For colour events: [2,h,w], column and row of raw pixel (i,j), with (0,0) a red pixel;
  /// undefined: the identity.
  torch::Tensor event_map;
  std::vector<int64_t> path_t_us;    ///< dense trajectory: strictly increasing times that span all
  std::vector<geometry::Pose> path;  ///< exposures, and camera_from_world at each
  double near = 0, far = 0;          ///< depth bounds in world units, 0 < near < far
  torch::Tensor points;              ///< [P,3] world axes, or undefined: initial points of the
                                     ///< scene
  torch::Tensor point_colors;        ///< [P,3] uint8 RGB, one per point
  std::vector<bool> held_out;        ///< one per exposure, or empty: listed in held_out.txt
  /// The true sharp frame at the middle of each exposure, or empty. Written to sharp/ for checks;
  /// training never reads them.
  std::vector<torch::Tensor> sharp_mid;  ///< [3,H,W] RGB in [0,1], one per exposure
};

/// Writes images_1/NN.png and timestamps.npz, poses_bounds.npy, all_poses_bounds.npy,
/// all_timestamps.npy, events.h5 (x, y float32, t int64 µs, p int8 ±1) and, if they have content,
/// points.npz, held_out.txt, gains.csv, ev_map.npz and sharp/NN.png. The layout can store only one
/// focal length and a centred principal point.
/// @param image_bits  8 or 16
/// @throws DataError if a file cannot be written.
/// @throws ContractError for content that the layout cannot store: no exposure, cameras that differ
///   or are not centred, fx ≠ fy, test views without time, a trajectory that does not span the
///   exposures.
void write_evdeblur(const std::filesystem::path& folder, const EvDeblurContent& content,
                    int image_bits = 8);

/// Writes the events.h5 of that layout. @throws DataError.
void write_event_file(const std::filesystem::path& path, const events::EventStream& events,
                      int gzip_level = 4);

}  // namespace jade::data
