// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/event_cover.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <tuple>
#include <vector>

#include "jade/core/error.h"
#include "jade/events/pixels.h"

namespace jade::imaging {
namespace {

/// Number of bands of equal width into which a side is divided; fewer if it has fewer pixels.
constexpr int64_t kBands = 20;

/// One side of the image in bands.
struct Side {
  int64_t pixels = 0;
  std::vector<int64_t> counts;  ///< pixels with events per band

  explicit Side(int64_t size) : pixels(size), counts(size_t(std::min(size, kBands))) {}
  int64_t bands() const { return int64_t(counts.size()); }
  /// First pixel of a band.
  int64_t begin(int64_t band) const { return band * pixels / bands(); }
  void add(int64_t place) { ++counts[size_t(place * bands() / pixels)]; }
  bool is_touched(int64_t band, int64_t all) const {
    constexpr double kFew = 0.02;  // of the mean per band
    return double(counts[size_t(band)]) > kFew * double(all) / double(bands());
  }
};

/// Whether gray levels vary in the bands of a side without events.
/// @param axis  of the side in `gray`, [H,W]
/// @param all  number of pixels with events
bool has_detail(const torch::Tensor& gray, int64_t axis, const Side& side, int64_t all) {
  constexpr float kFlat = 0.02F;
  for (int64_t band = 0; band < side.bands(); ++band) {
    if (side.is_touched(band, all)) continue;
    const int64_t begin = side.begin(band), end = side.begin(band + 1);
    const torch::Tensor part = gray.narrow(axis, begin, end - begin);
    if (part.std(/*unbiased=*/false).item<float>() >= kFlat) return true;
  }
  return false;
}

}  // namespace

std::string cover_fault(const events::EventStream& events, const torch::Tensor& image) {
  constexpr int64_t kTelling = 1000;
  constexpr double kLeast = 0.6;
  const int64_t height = image.size(1), width = image.size(2);
  if (events.size() < kTelling) return "";
  const torch::Tensor counts = events::pixel_counts(events, {height, width});
  const int64_t* const count = counts.const_data_ptr<int64_t>();
  const int64_t inside = counts.sum().item<int64_t>();
  if (inside < kTelling) return "";
  // Pixels count once, so that hot ones do not cover a band.
  Side columns(width), rows(height);
  int64_t all = 0;
  for (int64_t i = 0; i < width * height; ++i) {
    if (count[i] == 0) continue;
    columns.add(i % width);
    rows.add(i / width);
    ++all;
  }
  const torch::Tensor gray = image.mean(0);
  for (const auto& [side, axis, name] :
       {std::tuple{&columns, 1, "width"}, std::tuple{&rows, 0, "height"}}) {
    int64_t covered = 0;
    for (int64_t band = 0; band < side->bands(); ++band) covered += side->is_touched(band, all);
    const double share = double(covered) / double(side->bands());
    if (share >= kLeast || !has_detail(gray, axis, *side, all)) continue;
    return concat("expected events all over the ", width, "x", height, " frames, found ", inside,
                  " within ", std::lround(100 * share), " % of their ", name,
                  "; does the event sensor have fewer pixels, or a region of interest? Scale the "
                  "frames to the events, or crop them");
  }
  return "";
}

}  // namespace jade::imaging
