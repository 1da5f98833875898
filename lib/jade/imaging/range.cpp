// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/range.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::imaging {
namespace {

/// Whether all values are multiples of 1/steps.
bool has_steps(const torch::Tensor& image, double steps) {
  const torch::Tensor scaled = image * steps;
  return (scaled - scaled.round()).abs().max().item<float>() < 1e-2F;
}

}  // namespace

std::string range_fault(const std::vector<torch::Tensor>& images) {
  constexpr double kFull = 65535;
  double largest = 0;
  for (const torch::Tensor& image : images) largest = std::max(largest, image.max().item<double>());
  if (images.empty() || std::isnan(largest)) return "";
  if (largest <= 0) {
    return concat("expected frames with light, found ", images.size(),
                  " that are black (all pixels 0); check their export");
  }
  const int64_t top = std::llround(kFull * largest);
  if (top > 4095) return "";
  const auto all_have = [&](double steps) {
    return std::all_of(images.begin(), images.end(),
                       [&](const torch::Tensor& image) { return has_steps(image, steps); });
  };
  if (!all_have(kFull) || all_have(255)) return "";
  const int bits = top <= 255 ? 8 : top <= 1023 ? 10 : 12;
  const int factor = bits == 8 ? 257 : bits == 10 ? 64 : 16;
  return concat("expected 16-bit frames that reach up to 65535, found ", top,
                " as the brightest value of ", images.size(), " frames, as in ", bits,
                "-bit images: the scene would be ", factor,
                " times too dark; multiply the frames by ", factor);
}

}  // namespace jade::imaging
