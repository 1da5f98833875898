// SPDX-License-Identifier: Apache-2.0
#include "jade/data/truths.h"

#include <filesystem>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/data/masks.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"

namespace jade::data {

std::optional<Truth> truth_of(const Dataset& dataset, const Exposure& exposure) {
  for (const char* extension : {".png", ".tiff", ".npy"}) {
    const auto path = dataset.root / "sharp" / (exposure.name + extension);
    if (!std::filesystem::exists(path)) continue;
    torch::Tensor image = imaging::read_image(path);
    if (dataset.monochrome) image = imaging::as_gray(image);
    if (image.sizes() != exposure.blurry.sizes()) {
      throw DataError(concat(path.string(), ": expected ", shape_string(exposure.blurry),
                             " as the blurry frame, found ", shape_string(image)));
    }
    const torch::Tensor mask = both_masks(exposure.mask, opaque_part(path));
    return Truth{"sharp/" + exposure.name, masked(image, mask), mask};
  }
  for (const SharpView& view : dataset.test) {
    if (!is_mid_exposure(exposure, view)) continue;
    return Truth{view.name, view.image, both_masks(exposure.mask, view.mask)};
  }
  return std::nullopt;
}

}  // namespace jade::data
