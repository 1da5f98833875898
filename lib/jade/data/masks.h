// SPDX-License-Identifier: Apache-2.0
// Which pixels of a data set count.
#pragma once

#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// A mask of every frame, in the folder of a data set of any layout; jade_import writes it.
constexpr char kMaskFile[] = "mask.png";

/// Sources of frame masks besides alpha.
struct MaskSources {
  std::filesystem::path root;                ///< of the data set, for its masks/ and kMaskFile
  std::filesystem::path of_all;              ///< dataset.mask, or empty
  std::vector<std::filesystem::path> named;  ///< one per frame that the data set names, or empty

  MaskSources() = default;
  /// Takes the sources from the options; `named` as above, or empty if no frame names a mask.
  explicit MaskSources(const DatasetOptions& options,
                       std::vector<std::filesystem::path> named_masks = {});
};

/// Masks of frames, [1,H,W] bool, true: the pixel counts. Undefined where all count.
/// All of these must agree that a pixel counts: alpha (opaque_part), the mask that the data
/// set names, the one in a folder masks/ beside that of the frames, `of_all`, and kMaskFile in the
/// root. For images/a.jpg, masks/ may have a.png, a.jpg, a.jpg.png (COLMAP) or a.png.png; for
/// images_4 a folder masks_4 goes before masks; images/cam0/a.jpg may have masks/cam0/a.png.
/// Logs one line that says how many pixels are excluded, and by what.
/// @param paths   of the frames
/// @param images  read from these, [3,H,W]
/// @throws DataError naming the file for a mask that is missing, unreadable, of another size than
///         its frame, and for frames whose pixels are all excluded.
std::vector<torch::Tensor> read_masks(const std::vector<std::filesystem::path>& paths,
                                      const std::vector<torch::Tensor>& images,
                                      const MaskSources& sources, const Warnings& warnings);

/// Mask of pixels whose alpha is at least half of full, [1,H,W] bool; undefined without alpha.
/// @throws DataError naming the file where that is nowhere.
torch::Tensor opaque_part(const std::filesystem::path& path);

/// The image with excluded pixels set to 0; the same tensor where all count.
torch::Tensor masked(const torch::Tensor& image, const torch::Tensor& mask);

/// Intersection of two masks; either may be undefined.
torch::Tensor both_masks(const torch::Tensor& a, const torch::Tensor& b);

/// Makes what lies under the masks count for nothing: sets excluded pixels of every frame to 0, and
/// drops events whose nearest pixel is excluded in the exposure, training or held out, that is
/// nearest in time. Data sets without masks stay as they are.
/// @throws DataError naming a frame whose pixels are all excluded.
void apply_masks(Dataset& data);

/// How much of a data set's frames is excluded.
struct MaskSummary {
  int64_t frames = 0;   ///< that have a mask
  double excluded = 0;  ///< share of the pixels of all frames
  double largest = 0;   ///< share of the frame that lost most
};

MaskSummary summarize_masks(const Dataset& data);

}  // namespace jade::data
