// SPDX-License-Identifier: Apache-2.0
#include "jade/data/truths.h"

#include <filesystem>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/data/masks.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"

namespace jade::data {

std::vector<Truth> truths_of(const Dataset& dataset, size_t index) {
  std::vector<Truth> truths;
  const Exposure& exposure = dataset.train[index];
  for (const char* extension : {".png", ".tiff", ".npy"}) {
    const auto path = dataset.root / "sharp" / (exposure.name + extension);
    if (std::filesystem::exists(path)) {
      const torch::Tensor image = imaging::read_image(path);
      truths.push_back(
          {"sharp/" + exposure.name, dataset.monochrome ? imaging::as_gray(image) : image, {}});
      if (truths.back().image.sizes() != exposure.blurry.sizes()) {
        throw DataError(concat(path.string(), ": expected ", shape_string(exposure.blurry),
                               " as the blurry frame, found ", shape_string(truths.back().image)));
      }
      truths.back().mask = both_masks(exposure.mask, opaque_part(path));
      truths.back().image = masked(truths.back().image, truths.back().mask);
      break;
    }
  }
  for (const SharpView& view : dataset.test) {
    if (exposure_of(dataset, view) == static_cast<int64_t>(index)) {
      truths.push_back({view.name, view.image, both_masks(exposure.mask, view.mask)});
    }
  }
  return truths;
}

}  // namespace jade::data
