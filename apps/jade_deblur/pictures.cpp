// SPDX-License-Identifier: Apache-2.0
#include "pictures.h"

#include <algorithm>
#include <filesystem>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/imaging/color.h"
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

void write_side_pictures(const std::filesystem::path& output, const std::string& name,
                         const Restored& restored) {
  const auto write = [&](const char* what, const torch::Tensor& picture) {
    imaging::write_image(output / what / (name + ".png"), picture);
  };
  const Candidates& c = restored.candidates;
  write("events", event_picture(restored.events));
  if (!c.efnet.defined()) return;
  write("edi", c.edi);
  write("efnet", c.efnet);
  write("difference", 4 * (c.edi.clamp(0, 1) - c.efnet).abs().mean(0, true));
  if (c.alpha.defined()) write("alpha", c.alpha);
  if (!c.truth.defined()) return;
  const torch::Tensor better = edi_is_better(c);
  write("oracle", torch::where(better, c.edi, c.efnet));
  write("better", better.to(torch::kFloat32));
}

std::vector<Truth> truths_of(const data::Dataset& dataset, size_t index) {
  std::vector<Truth> truths;
  const data::Exposure& exposure = dataset.train[index];
  for (const char* extension : {".png", ".tiff", ".npy"}) {
    const auto path = dataset.root / "sharp" / (exposure.name + extension);
    if (std::filesystem::exists(path)) {
      const torch::Tensor image = imaging::read_image(path);
      truths.push_back(
          {"sharp/" + exposure.name, dataset.monochrome ? imaging::as_gray(image) : image});
      if (truths.back().image.sizes() != exposure.blurry.sizes()) {
        throw DataError(concat(path.string(), ": expected ", shape_string(exposure.blurry),
                               " as the blurry frame, found ", shape_string(truths.back().image)));
      }
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
