// SPDX-License-Identifier: Apache-2.0
// Masks: which pixels of a data set count.
#pragma once

#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// A mask for every frame, in the folder of a data set of any layout; jade_import writes it.
constexpr char kMaskFile[] = "mask.png";

/// Sources of frame masks other than alpha.
struct MaskSources {
  std::filesystem::path root;                ///< folder of the data set, which may contain masks/
                                             ///< and kMaskFile
  std::filesystem::path of_all;              ///< dataset.mask, or empty
  std::vector<std::filesystem::path> named;  ///< one per frame, from the data set's own files, or
                                             ///< empty

  MaskSources() = default;
  /// Takes the sources from the options; `named` as above, or empty if no frame names a mask.
  explicit MaskSources(const DatasetOptions& options,
                       std::vector<std::filesystem::path> named_masks = {});
};

/// Masks of frames, [1,H,W] bool, true: the pixel counts. Undefined if all pixels count.
/// A pixel counts if all sources agree: alpha (opaque_part), the mask that the data set names, the
/// one in a folder masks/ beside that of the frames, `of_all`, and kMaskFile in the root. For
/// images/a.jpg, masks/ may have a.png, a.jpg, a.jpg.png (COLMAP) or a.png.png; for images_4 a
/// folder masks_4 precedes masks; images/cam0/a.jpg may have masks/cam0/a.png. The case of masks/
/// and of kMaskFile does not matter. Logs one line that says how many pixels each source excludes.
/// @param paths   of the frames
/// @param images  read from these, [3,H,W]
/// @throws DataError naming the file for a mask that is missing, unreadable, of another size than
///   its frame, and for frames whose pixels are all excluded.
std::vector<torch::Tensor> read_masks(const std::vector<std::filesystem::path>& paths,
                                      const std::vector<torch::Tensor>& images,
                                      const MaskSources& sources, const Warnings& warnings);

/// Mask of pixels whose alpha is at least half of full, [1,H,W] bool; undefined without alpha.
/// @throws DataError naming the file if no pixel qualifies.
torch::Tensor opaque_part(const std::filesystem::path& path);

/// The image with excluded pixels set to 0; the same tensor if all pixels count.
torch::Tensor masked(const torch::Tensor& image, const torch::Tensor& mask);

/// Intersection of two masks; either may be undefined.
torch::Tensor both_masks(const torch::Tensor& a, const torch::Tensor& b);

/// Applies the masks: sets excluded pixels of every frame to 0, and drops events whose nearest
/// pixel is excluded in the exposure, training or held out, that is nearest in time. Does nothing
/// to data sets without masks.
/// @throws DataError naming a frame whose pixels are all excluded.
void apply_masks(Dataset& data);

/// How much of a data set's frames is excluded.
struct MaskSummary {
  int64_t frames = 0;   ///< frames with a mask
  double excluded = 0;  ///< excluded share of the pixels of all frames
  double largest = 0;   ///< excluded share of the most affected frame
};

MaskSummary summarize_masks(const Dataset& data);

}  // namespace jade::data
