// SPDX-License-Identifier: Apache-2.0
#include "pictures.h"

#include <algorithm>
#include <filesystem>
#include <torch/types.h>

#include "jade/imaging/image_io.h"

namespace jade::apps {

torch::Tensor event_picture(const torch::Tensor& counts) {
  const torch::Tensor total = counts.sum(0).flatten();
  const int64_t rank = std::max<int64_t>(1, total.numel() * 99 / 100);
  const double full = std::max(1.0, std::get<0>(total.kthvalue(rank)).item<double>());
  const torch::Tensor positive = (counts[0] / full).clamp(0, 1);
  const torch::Tensor negative = (counts[1] / full).clamp(0, 1);
  return torch::stack({1 - negative, (1 - positive - negative).clamp_min(0), 1 - positive});
}

std::vector<Truth> truths_of(const data::Dataset& dataset, size_t index) {
  std::vector<Truth> truths;
  const data::Exposure& exposure = dataset.train[index];
  for (const char* extension : {".png", ".tiff", ".npy"}) {
    const auto path = dataset.root / "sharp" / (exposure.name + extension);
    if (std::filesystem::exists(path)) {
      truths.push_back({"sharp/" + exposure.name, imaging::read_image(path)});
      break;
    }
  }
  for (const data::SharpView& view : dataset.test) {
    if (data::exposure_of(dataset, view) == static_cast<int64_t>(index)) {
      truths.push_back({view.name, view.image});
    }
  }
  return truths;
}

}  // namespace jade::apps
