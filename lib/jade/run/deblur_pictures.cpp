// SPDX-License-Identifier: Apache-2.0
#include "jade/run/deblur_pictures.h"

#include <algorithm>
#include <filesystem>
#include <torch/types.h>

#include "jade/imaging/image_io.h"

namespace jade::run {

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
  const restore::Candidates& c = restored.candidates;
  write("events", event_picture(restored.events));
  if (!c.efnet.defined()) return;
  write("edi", c.edi);
  write("efnet", c.efnet);
  write("difference", 4 * (c.edi.clamp(0, 1) - c.efnet).abs().mean(0, true));
  if (c.alpha.defined()) write("alpha", c.alpha);
  if (!c.truth.defined()) return;
  const torch::Tensor better = restore::edi_is_better(c);
  write("oracle", torch::where(better, c.edi, c.efnet));
  write("better", better.to(torch::kFloat32));
}

}  // namespace jade::run
