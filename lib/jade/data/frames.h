// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/masks.h"
#include "jade/data/warnings.h"
#include "jade/geometry/pose.h"

namespace jade::data {

/// One image of a folder.
struct Frame {
  std::string name;     ///< from frame_names()
  torch::Tensor image;  ///< [3,H,W], 0 at pixels that the mask excludes
  torch::Tensor mask;   ///< [1,H,W] bool, true: the pixel counts; undefined: all pixels count
};

/// Whether the images may lie in subfolders, such as one per camera.
enum class ImageDepth { kFlat, kNested };

/// The folder of the frames: `wanted` if given, else the first of images_1, images and images_N
/// that contains images. For kNested, if none does, the first whose subfolders contain images.
/// @throws DataError if there is none.
std::filesystem::path find_image_folder(const std::filesystem::path& root,
                                        const std::string& wanted,
                                        ImageDepth depth = ImageDepth::kFlat);

/// The images of a folder and its subfolders, except hidden folders and folders of masks or maps,
/// sorted by path.
std::vector<std::filesystem::path> list_images_within(const std::filesystem::path& folder);

/// The N of a folder named images_N, else 1: the factor by which its images are smaller than the
/// poses' cameras.
double folder_scale(const std::filesystem::path& image_folder);

/// Names of frames: file names without extension; duplicates get the folder as a prefix
/// ("cam0_001"), and remaining duplicates keep their extension.
/// @throws DataError for names that are not UTF-8, that remain duplicate, or of which one is NAME_k
///   of another, the name of an exposure's pose.
std::vector<std::string> frame_names(const std::vector<std::filesystem::path>& paths);

/// Whether the frames of a data set may differ in size.
enum class FrameSizes { kOne, kAny };

/// Reads the given images and their masks on several threads, in the given order.
/// @throws DataError if one cannot be read; for kOne, if they differ in size; if they would not fit
///   into memory, as estimated from their headers; and as frame_names() and read_masks().
std::vector<Frame> read_frames(const std::vector<std::filesystem::path>& paths,
                               const MaskSources& masks, const Warnings& warnings,
                               FrameSizes sizes = FrameSizes::kOne);

/// Depth bounds of a point cloud seen from the cameras: the 0.5 % and 99.5 % quantiles of depth,
/// widened by a tenth. Without points in front of the cameras: (0.01, 100) times the spread of the
/// cameras. Cameras far from all others do not count.
struct DepthBounds {
  double near = 0, far = 0;
};
DepthBounds depth_bounds(const torch::Tensor& points,
                         const std::vector<geometry::Pose>& cameras_from_world);

}  // namespace jade::data
