// SPDX-License-Identifier: Apache-2.0
// Camera pose of each sharp image, by COLMAP.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <utility>
#include <vector>

#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"
#include "jade/import/latents.h"
#include "jade/import/options.h"
#include "jade/import/pose_path.h"

namespace jade::import {

/// A pose that was found.
struct TimedPose {
  int64_t t_us = 0;
  int64_t shot = 0;          ///< index in Capture::shots
  geometry::Pose pose;       ///< camera_from_world
  int64_t observations = 0;  ///< points of the scene found in its image
};

/// A reconstruction. Lengths are in units of the median depth of its points.
struct Reconstruction {
  geometry::Intrinsics camera;   ///< of the shots
  std::vector<TimedPose> poses;  ///< by time
  torch::Tensor points;          ///< [P,3] float64
  torch::Tensor colors;          ///< [P,3] uint8
  torch::Tensor point_errors;    ///< [P] float64, px of the shots
  /// Indices of the poses that see each point.
  std::vector<std::vector<int64_t>> seen_by;
};

/// How one attempt ended.
struct Attempt {
  std::string name;
  int64_t images = 0, registered = 0;
  int64_t points = 0, observations = 0;
  double error_px = 0;        ///< mean reprojection error, px of the shots
  double parallax_deg = 0;    ///< median angle between the outermost rays to a point
  double explained_blur = 0;  ///< share of the blur of the frames that its poses explain
  std::string problem;        ///< why it gave nothing; empty where it gave a model
};

struct SearchResult {
  Reconstruction best;
  std::vector<Attempt> attempts;
  size_t chosen = 0;  ///< index in attempts
};

/// Finds the poses of the images in LATENTS/images: several attempts, of which one that explains
/// the blur of the frames comes first, then the one with the most images, then the one that
/// explains most of the blur. Everything that COLMAP wrote stays in `work`. Shows progress.
/// @param capture  its camera is held; absent: the focal length is searched
/// Frames that seem to stand still are warned of, no more: what is fixed to a sensor can hide
/// motion.
/// @throws DataError where no attempt registers two thirds of the images, has parallax and explains
///   the blur, with what each one found, whether the frames moved, and what to record differently;
///   Interrupted.
SearchResult find_poses(const std::filesystem::path& latents,
                        const std::vector<LatentImage>& images, const Capture& capture,
                        const ImportOptions& options, const std::filesystem::path& work);

/// Pairs of images to compare where comparing all would take long: each image with the nine after
/// it, and the middle images of up to 40 shots, spread over the recording, with one another, which
/// closes loops.
/// @param images  by time
/// @return indices, the earlier image first, without repetition
std::vector<std::pair<size_t, size_t>> sequential_pairs(const std::vector<LatentImage>& images);

/// A model of COLMAP as a reconstruction.
/// @param scale  how much larger COLMAP saw the images than the shots are
Reconstruction read_reconstruction(const std::filesystem::path& model,
                                   const std::vector<LatentImage>& images, double scale);

/// The path of the camera through poses of a capture; those closer than an eighth of its shortest
/// exposure count as one.
PosePath path_of(const std::vector<TimedPose>& poses, const Capture& capture);

/// Writes poses.json and points.npz. @throws DataError.
void keep_reconstruction(const std::filesystem::path& folder, const SearchResult& result);

/// Reads what keep_reconstruction wrote. @throws DataError naming the file.
Reconstruction load_reconstruction(const std::filesystem::path& folder);

}  // namespace jade::import
