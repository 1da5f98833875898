// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/range.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::imaging {
namespace {

constexpr double kFull = 65535;
/// Largest value of 12-bit images.
constexpr double kLargestNarrow = 4095;

/// Whether all values are multiples of 1/steps.
bool has_steps(const torch::Tensor& image, double steps) {
  const torch::Tensor scaled = image * steps;
  return (scaled - scaled.round()).abs().max().item<float>() < 1e-2F;
}

bool is_8_bit(const torch::Tensor& image) { return has_steps(image, 255); }

bool is_dark_16_bit(const torch::Tensor& image, double peak) {
  return std::llround(kFull * peak) <= kLargestNarrow && has_steps(image, kFull) &&
         !is_8_bit(image);
}

/// Whether all images except dark ones are 8-bit. A set with brighter 16-bit images fills its
/// range, and its dark images show dark moments.
bool others_are_8_bit(const std::vector<torch::Tensor>& images, const std::vector<size_t>& dark) {
  size_t next = 0;
  for (size_t i = 0; i < images.size(); ++i) {
    if (next < dark.size() && dark[next] == i) {
      ++next;
    } else if (!is_8_bit(images[i])) {
      return false;
    }
  }
  return true;
}

}  // namespace

std::string range_fault(const std::vector<torch::Tensor>& images,
                        const std::vector<std::string>& names) {
  if (images.empty()) return "";
  double largest = 0, largest_dark = 0;
  std::vector<size_t> dark;
  for (size_t i = 0; i < images.size(); ++i) {
    const double peak = images[i].max().item<double>();
    if (std::isnan(peak)) return "";
    largest = std::max(largest, peak);
    if (!is_dark_16_bit(images[i], peak)) continue;
    dark.push_back(i);
    largest_dark = std::max(largest_dark, peak);
  }
  if (largest <= 0) {
    return concat("expected frames with light, found ", images.size(),
                  " that are black (all pixels 0); check their export");
  }
  if (dark.empty() || !others_are_8_bit(images, dark)) return "";
  const int64_t top = std::llround(kFull * largest_dark);
  const int bits = top <= 255 ? 8 : top <= 1023 ? 10 : 12;
  const int factor = bits == 8 ? 257 : bits == 10 ? 64 : 16;
  const bool mixed = largest > largest_dark;
  return concat(
      "expected 16-bit frames that reach up to 65535, found ", top, " as the brightest value of ",
      mixed ? concat(dark.size(), " beside 8-bit ones (the first is ", names.at(dark.front()), ")")
            : concat(images.size(), " frames"),
      ", as in ", bits, "-bit images: ", mixed ? "they" : "the scene", " would be ", factor,
      " times too dark; multiply ", mixed ? "these" : "the", " frames by ", factor);
}

}  // namespace jade::imaging
