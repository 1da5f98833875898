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
  std::string name;     ///< as frame_names() says
  torch::Tensor image;  ///< [3,H,W], 0 where the mask excludes a pixel
  torch::Tensor mask;   ///< [1,H,W] bool, true: the pixel counts; undefined: all count
};

/// Whether the images of a folder may all lie in folders inside it, such as one a camera.
enum class ImageDepth { kFlat, kNested };

/// The folder of the frames: `wanted` if given, else the first of images_1, images and images_N
/// that holds images. For kNested, if none does, the first that holds some in folders inside it.
/// @throws DataError if there is none.
std::filesystem::path find_image_folder(const std::filesystem::path& root,
                                        const std::string& wanted,
                                        ImageDepth depth = ImageDepth::kFlat);

/// The images of a folder and of the folders inside it, except those in hidden folders and in
/// folders of masks or maps, in order of their path.
std::vector<std::filesystem::path> list_images_within(const std::filesystem::path& folder);

/// The N of a folder named images_N, else 1: how much smaller its images are than the poses say.
double folder_scale(const std::filesystem::path& image_folder);

/// Names of frames: file names without extension; duplicates get the folder in front ("cam0_001"),
/// and remaining duplicates the extension behind.
/// @throws DataError for names that are no UTF-8, that are alike all the same, or of which one is
///   NAME_k of another, as an exposure's poses are called.
std::vector<std::string> frame_names(const std::vector<std::filesystem::path>& paths);

/// Whether the frames of a data set may differ in size.
enum class FrameSizes { kOne, kAny };

/// Reads the given images, on several threads, into the given order, and their masks.
/// @throws DataError if one cannot be read or, for kOne, they differ in size; if they would not fit
///   into memory, which is found from their first bytes; and as frame_names() and read_masks().
std::vector<Frame> read_frames(const std::vector<std::filesystem::path>& paths,
                               const MaskSources& masks, const Warnings& warnings,
                               FrameSizes sizes = FrameSizes::kOne);

/// Depth bounds around a point cloud as seen from the cameras: the 0.5 % and 99.5 % quantiles of
/// depth with a tenth of room. (0.01, 100) times the spread of the cameras if there are no points
/// in front of them.
struct DepthBounds {
  double near = 0, far = 0;
};
DepthBounds depth_bounds(const torch::Tensor& points, const std::vector<geometry::Pose>& poses);

}  // namespace jade::data
