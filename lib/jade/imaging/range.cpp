// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/range.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/imaging/color.h"

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

/// Smallest and largest value of an image.
struct Range {
  double low = 0, high = 0;
};

std::vector<Range> ranges_of(const std::vector<torch::Tensor>& images) {
  std::vector<Range> out;
  for (const torch::Tensor& image : images) {
    const auto [low, high] = image.aminmax();
    out.push_back({low.item<double>(), high.item<double>()});
  }
  return out;
}

/// Images of a wrong range: all black, or 16-bit ones that use 10 or 12 bits. Empty if none.
std::string range_fault(const std::vector<torch::Tensor>& images, const std::vector<Range>& ranges,
                        const std::vector<std::string>& names) {
  double largest = 0, largest_dark = 0;
  std::vector<size_t> dark;
  for (size_t i = 0; i < images.size(); ++i) {
    const double peak = ranges[i].high;
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

bool any_nan(const std::vector<Range>& ranges) {
  return std::any_of(ranges.begin(), ranges.end(),
                     [](const Range& range) { return std::isnan(range.high); });
}

/// "2 of 12 all black (the first is 02)"; empty for none.
std::string counted(const std::vector<size_t>& found, const char* what,
                    const std::vector<std::string>& names) {
  if (found.empty()) return "";
  return concat(found.size(), " of ", names.size(), " ", what, " (the first is ",
                names.at(found.front()), ")");
}

/// Images without a picture. Empty if none; if all are black, range_fault() says so.
std::string blank_fault(const std::vector<Range>& ranges, const std::vector<std::string>& names) {
  constexpr double kBlack = 1.5 / 255, kWhite = 253.5 / 255;
  std::vector<size_t> black, white;
  for (size_t i = 0; i < ranges.size(); ++i) {
    if (ranges[i].high < kBlack) black.push_back(i);
    if (ranges[i].low > kWhite) white.push_back(i);
  }
  const size_t blank = black.size() + white.size();
  if (blank == 0 || black.size() == ranges.size()) return "";
  const std::string all_black = counted(black, "all black", names);
  const std::string all_white = counted(white, "all white", names);
  return concat("expected frames with a picture, found ", all_black,
                black.empty() || white.empty() ? "" : " and ", all_white, "; export them again");
}

/// Images that are equal to the one before. Empty if none.
std::string repeat_fault(const std::vector<torch::Tensor>& images, const std::vector<Range>& ranges,
                         const std::vector<std::string>& names) {
  std::vector<size_t> repeated;
  for (size_t i = 1; i < images.size(); ++i) {
    const Range &a = ranges[i - 1], &b = ranges[i];
    const bool blank = b.low == b.high;
    if (blank || a.low != b.low || a.high != b.high) continue;
    if (torch::equal(images[i - 1], images[i])) repeated.push_back(i);
  }
  if (repeated.empty()) return "";
  return concat("expected frames that differ, found ",
                counted(repeated, "identical to the frame before", names),
                "; a frame was written twice: leave the copies out");
}

}  // namespace

std::vector<std::string> frame_faults(const std::vector<torch::Tensor>& images,
                                      const std::vector<std::string>& names) {
  const std::vector<Range> ranges = ranges_of(images);
  if (images.empty() || any_nan(ranges)) return {};
  std::vector<std::string> faults;
  for (const std::string& fault : {range_fault(images, ranges, names), blank_fault(ranges, names),
                                   repeat_fault(images, ranges, names)}) {
    if (!fault.empty()) faults.push_back(fault);
  }
  return faults;
}

std::string range_fault(const std::vector<torch::Tensor>& images,
                        const std::vector<std::string>& names) {
  const std::vector<Range> ranges = ranges_of(images);
  return images.empty() || any_nan(ranges) ? "" : range_fault(images, ranges, names);
}

bool is_mosaic(const torch::Tensor& frame) {
  constexpr double kLeastDifference = 0.02;  // relative to the brightness of a cell
  check_shape(frame, "frame", {3, -1, -1});
  if (!is_gray(frame)) return false;
  const int64_t rows = frame.size(1) / 2, columns = frame.size(2) / 2;
  if (rows == 0 || columns == 0) return false;
  const torch::Tensor cells = frame[0]
                                  .slice(0, 0, 2 * rows)
                                  .slice(1, 0, 2 * columns)
                                  .reshape({rows, 2, columns, 2})
                                  .to(torch::kFloat64);
  const torch::Tensor mean = cells.mean(0).mean(1).flatten().contiguous();
  const double level = mean.mean().item<double>();
  if (level <= 0) return false;
  const auto m = mean.accessor<double, 1>();
  // Even for a gray scene the colours of a filter differ in sensitivity.
  const double range = (mean.max() - mean.min()).item<double>();
  const double diagonal = std::min(std::abs(m[0] - m[3]), std::abs(m[1] - m[2]));
  return range > kLeastDifference * level && diagonal < 0.25 * range;
}

}  // namespace jade::imaging
