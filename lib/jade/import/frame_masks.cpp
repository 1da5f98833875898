// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_masks.h"

#include "jade/core/error.h"
#include "jade/data/masks.h"

namespace jade::import {
namespace {

/// The text with the archive's path in place of the temporary folder.
std::string naming_archive(std::string text, const recording::Recording& recording) {
  const std::string folder = recording.mask_root.string();
  if (recording.keep && text.rfind(folder, 0) == 0)
    text.replace(0, folder.size(), recording.source.string());
  return text;
}

}  // namespace

std::vector<torch::Tensor> masks_of(const recording::Recording& recording,
                                    std::vector<std::string>& warnings) {
  if (recording.mask_root.empty() || recording.frames.empty()) return {};
  std::vector<std::filesystem::path> paths;
  std::vector<torch::Tensor> images;
  for (const recording::Frame& frame : recording.frames) {
    paths.push_back(frame.path);
    images.push_back(frame.image);
  }
  data::MaskSources sources;
  sources.root = recording.mask_root;
  std::vector<std::string> found;
  try {
    std::vector<torch::Tensor> masks =
        data::read_masks(paths, images, sources, data::Warnings(&found));
    for (std::string& warning : found)
      warnings.push_back(naming_archive(std::move(warning), recording));
    return masks;
  } catch (const DataError& error) {
    throw DataError(naming_archive(error.what(), recording));
  }
}

}  // namespace jade::import
