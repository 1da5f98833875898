// SPDX-License-Identifier: Apache-2.0
#include "jade/import/bad_frames.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>

#include "jade/imaging/color.h"

namespace jade::import {
namespace {

constexpr double kFlatRow = 4.0 / 255;  // largest range within a row of one level
constexpr double kFlatFrame = 1.5 / 255;
constexpr double kPicture = 0.1;  // least range in a row beside the cut
constexpr size_t kBeside = 2;     // frames on either side
constexpr int64_t kRowShare = 20, kFewestRows = 3;

struct Rows {
  torch::Tensor low, high;  ///< [H] float32
  int64_t count() const { return low.size(0); }
  bool is_flat(int64_t row, float level) const {
    const float least = low[row].item<float>(), most = high[row].item<float>();
    return most - least <= kFlatRow && std::abs(least - level) <= kFlatRow;
  }
};

Rows rows_of(const torch::Tensor& image) {
  const torch::Tensor gray = imaging::gray(image)[0];
  return {std::get<0>(gray.min(1)), std::get<0>(gray.max(1))};
}

/// Rows of one level from the first on (step 1) or from the last back (−1).
int64_t flat_rows(const Rows& rows, int64_t first, int64_t step) {
  const float level = rows.low[first].item<float>();
  int64_t count = 0;
  while (count < rows.count() && rows.is_flat(first + step * count, level)) ++count;
  return count;
}

/// Rows [begin, end) of a frame.
struct Part {
  int64_t begin = 0, end = 0;
  int64_t size() const { return end - begin; }
};

/// The flat part with a sharp edge to the picture; the whole frame if it has one level.
Part missing_part(const Rows& rows) {
  if ((rows.high.max() - rows.low.min()).item<double>() <= kFlatFrame) return {0, rows.count()};
  Part most;
  for (const int64_t step : {1, -1}) {
    const int64_t first = step > 0 ? 0 : rows.count() - 1;
    const int64_t flat = flat_rows(rows, first, step);
    if (flat == 0 || flat == rows.count()) continue;
    // The first row behind the cut may be half written.
    double range = 0;
    for (int64_t k = flat; k < std::min(flat + 2, rows.count()); ++k) {
      const int64_t row = first + step * k;
      range = std::max(range, (rows.high[row] - rows.low[row]).item<double>());
    }
    if (range < kPicture || flat <= most.size()) continue;
    most = step > 0 ? Part{0, flat} : Part{rows.count() - flat, rows.count()};
  }
  return most;
}

}  // namespace

std::vector<size_t> bad_frames(const std::vector<torch::Tensor>& images,
                               const SawChange& saw_change) {
  if (images.empty()) return {};
  const int64_t height = images.front().size(1);
  std::vector<Part> missing;
  for (const torch::Tensor& image : images) missing.push_back(missing_part(rows_of(image)));
  // Lower median of the sizes from one frame to another.
  const auto usual = [&](size_t begin, size_t end) {
    std::vector<int64_t> sizes;
    for (size_t i = begin; i < end; ++i) sizes.push_back(missing[i].size());
    std::sort(sizes.begin(), sizes.end());
    return sizes[(sizes.size() - 1) / 2];
  };
  const int64_t least = std::max(kFewestRows, height / kRowShare);
  std::vector<size_t> bad;
  for (size_t i = 0; i < missing.size(); ++i) {
    const Part& part = missing[i];
    // A horizon that moves is like the frames beside it.
    const size_t before = i - std::min(i, kBeside),
                 behind = std::min(i + kBeside + 1, images.size());
    if (part.size() < std::max(usual(0, images.size()), usual(before, behind)) + least) continue;
    if (part.size() == height || saw_change(i, part.begin, part.end)) bad.push_back(i);
  }
  return bad;
}

}  // namespace jade::import
