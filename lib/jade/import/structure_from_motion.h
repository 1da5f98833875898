// SPDX-License-Identifier: Apache-2.0
// Estimates the camera pose of each sharp image with COLMAP.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "jade/import/latents.h"
#include "jade/import/options.h"
#include "jade/import/pose_attempt.h"
#include "jade/import/reconstruction.h"

namespace jade::import {

struct SearchResult {
  Reconstruction best;
  std::vector<Attempt> attempts;
  size_t chosen = 0;    ///< index in attempts
  std::string warning;  ///< about an assumed focal length, if not empty
};

/// Finds the poses of the images in LATENTS/images: makes several attempts and prefers one that
/// explains the blur of the frames, then the one with the most images, then the one that explains
/// most of the blur. Frames with hardly any blur are no evidence against poses. All files of COLMAP
/// stay in `work`. Shows progress.
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

/// Writes poses.json and points.npz. @throws DataError.
void keep_reconstruction(const std::filesystem::path& folder, const SearchResult& result);

/// Reads the files that keep_reconstruction wrote. @throws DataError naming the file.
Reconstruction load_reconstruction(const std::filesystem::path& folder);

}  // namespace jade::import
