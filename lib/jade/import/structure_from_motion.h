// SPDX-License-Identifier: Apache-2.0
// Estimates the camera pose of each sharp image with COLMAP.
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
  int64_t observations = 0;  ///< number of scene points observed in its image
};

/// A reconstruction. Lengths are in units of the median depth of its points.
struct Reconstruction {
  geometry::Intrinsics camera;   ///< of the shots
  std::vector<TimedPose> poses;  ///< sorted by time
  torch::Tensor points;          ///< [P,3] float64
  torch::Tensor colors;          ///< [P,3] uint8
  torch::Tensor point_errors;    ///< [P] float64, px of the shots
  /// Indices of the poses that observe each point.
  std::vector<std::vector<int64_t>> seen_by;
};

/// Result of one attempt.
struct Attempt {
  std::string name;
  int64_t images = 0, registered = 0;
  int64_t points = 0, observations = 0;
  double error_px = 0;        ///< mean reprojection error, px of the shots
  double parallax_deg = 0;    ///< median angle between the outermost rays to a point
  double explained_blur = 0;  ///< share of the blur of the frames that its poses explain
  double blur_px = 0;   ///< length of that blur: the larger one of its poses and of the events
  std::string problem;  ///< why it failed; empty if it produced a model

  /// Whether the frames have enough blur to check the poses by it. Of less, noise hides the share.
  bool has_blur() const { return blur_px >= 2; }
};

/// "80 % of the blur explained", or that there is too little blur.
std::string said_of_blur(const Attempt& attempt);

struct SearchResult {
  Reconstruction best;
  std::vector<Attempt> attempts;
  size_t chosen = 0;    ///< index in attempts
  std::string warning;  ///< about an assumed focal length, if not empty
};

/// Finds the poses of the images in LATENTS/images: makes several attempts and prefers one that
/// explains the blur of the frames, then the one with the most images, then the one that explains
/// most of the blur. Frames with hardly any blur
/// are no evidence against poses. All files of COLMAP stay in `work`. Shows progress.
/// @param capture  its camera is held constant; without one, the focal length is estimated Frames
///   that seem static only cause a warning: patterns fixed to a sensor can hide motion.
/// @throws DataError if no attempt registers two thirds of the images, has parallax and explains
///   the blur if there is any, with the result of each, whether the frames moved, and how to record
///   better; Interrupted.
SearchResult find_poses(const std::filesystem::path& latents,
                        const std::vector<LatentImage>& images, const Capture& capture,
                        const ImportOptions& options, const std::filesystem::path& work);

/// Pairs of images to match if matching all would be slow: each image with the next nine, and the
/// middle images of up to 40 shots, spread over the recording, with one another, which closes
/// loops.
/// @param images  sorted by time
/// @return indices, the earlier image first, without duplicates
std::vector<std::pair<size_t, size_t>> sequential_pairs(const std::vector<LatentImage>& images);

/// Converts a COLMAP model to a reconstruction.
/// @param scale  size of COLMAP's images relative to the shots
Reconstruction read_reconstruction(const std::filesystem::path& model,
                                   const std::vector<LatentImage>& images, double scale);

/// The camera path through the poses of a capture; poses closer in time than an eighth of its
/// shortest exposure are merged.
PosePath path_of(const std::vector<TimedPose>& poses, const Capture& capture);

/// Writes poses.json and points.npz. @throws DataError.
void keep_reconstruction(const std::filesystem::path& folder, const SearchResult& result);

/// Reads the files that keep_reconstruction wrote. @throws DataError naming the file.
Reconstruction load_reconstruction(const std::filesystem::path& folder);

}  // namespace jade::import
