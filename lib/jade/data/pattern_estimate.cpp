// SPDX-License-Identifier: Apache-2.0
#include "jade/data/pattern_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/imaging/color.h"

namespace jade::data {
namespace {

constexpr size_t kMostFrames = 64;
constexpr double kApartPx = 8;

/// Detail of strong edges is clipped to this, so that few pixels do not dominate.
constexpr double kMostDetail = 0.1;

using Place = std::array<double, 2>;

std::vector<const Exposure*> chosen_frames(const Dataset& dataset) {
  std::vector<const Exposure*> same_size;
  for (const Exposure& exposure : dataset.train) {
    if (exposure.blurry.sizes() == dataset.train.front().blurry.sizes()) {
      same_size.push_back(&exposure);
    }
  }
  const size_t count = std::min(same_size.size(), kMostFrames);
  std::vector<const Exposure*> chosen;
  for (size_t i = 0; i < count; ++i) chosen.push_back(same_size[i * same_size.size() / count]);
  return chosen;
}

/// Pixel coordinates in frame `of` of the points at depth `depth` at five places of frame `from`;
/// far outside the image if they are behind it.
std::array<Place, 5> places_of(const Exposure& from, const Exposure& of, double depth) {
  constexpr size_t kMiddle = geometry::kExposurePoses / 2;
  const auto w = double(from.camera.width), h = double(from.camera.height);
  const std::array<Place, 5> shares{Place{0.5, 0.5}, Place{0.25, 0.25}, Place{0.75, 0.25},
                                    Place{0.25, 0.75}, Place{0.75, 0.75}};
  const geometry::Pose step =
      geometry::compose(of.poses[kMiddle], geometry::inverse(from.poses[kMiddle]));
  std::array<Place, 5> places;
  for (size_t i = 0; i < shares.size(); ++i) {
    geometry::Vector3 point = geometry::unproject(from.camera, shares[i][0] * w, shares[i][1] * h);
    for (double& each : point) each *= depth;
    point = geometry::transform(step, point);
    places[i] = point[2] > 0 ? geometry::project(of.camera, point) : Place{1e6, 1e6};
  }
  return places;
}

/// Whether all five places moved by more than kApartPx, at the depth that moves less.
bool apart(const Exposure& a, const Exposure& b, const Dataset& dataset) {
  for (const double depth : {dataset.near, dataset.far}) {
    const auto before = places_of(a, a, depth), after = places_of(a, b, depth);
    for (size_t i = 0; i < before.size(); ++i) {
      if (std::hypot(after[i][0] - before[i][0], after[i][1] - before[i][1]) <= kApartPx)
        return false;
    }
  }
  return true;
}

/// Standard deviation of the image centre's place along its direction of least motion. Places are
/// clamped to an image of three times the size.
double sideways(const std::vector<const Exposure*>& frames, double depth) {
  const Exposure& first = *frames[frames.size() / 2];
  const auto w = double(first.camera.width), h = double(first.camera.height);
  double sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  for (const Exposure* frame : frames) {
    const Place place = places_of(first, *frame, depth)[0];
    const double x = std::clamp(place[0], -w, 2 * w), y = std::clamp(place[1], -h, 2 * h);
    sx += x, sy += y, sxx += x * x, sxy += x * y, syy += y * y;
  }
  const auto n = double(frames.size());
  const double xx = sxx / n - sx / n * sx / n, yy = syy / n - sy / n * sy / n;
  const double xy = sxy / n - sx / n * sy / n;
  const double least = 0.5 * (xx + yy) - std::hypot(0.5 * (xx - yy), xy);
  return std::sqrt(std::max(0.0, least));
}

/// [1,H,W]: the mean of 3x3 pixels.
torch::Tensor mean_around(const torch::Tensor& image) {
  return at::avg_pool2d(at::replication_pad2d(image, {1, 1, 1, 1}), 3, 1);
}

/// [P] of a frame: 1 where the mask excludes none of the 3x3 pixels, else 0.
torch::Tensor counted_in(const Exposure& frame) {
  if (!frame.mask.defined()) return torch::ones({frame.blurry[0].numel()});
  return (mean_around(frame.mask.to(torch::kFloat32)) == 1).to(torch::kFloat32).flatten();
}

/// [P] of a frame: the difference from the mean of 3x3 pixels; 0 where not counted.
torch::Tensor detail_of(const Exposure& frame) {
  const torch::Tensor gray = imaging::gray(frame.blurry).unsqueeze(0);
  const torch::Tensor detail = (gray - mean_around(gray)).clamp(-kMostDetail, kMostDetail);
  return frame.mask.defined() ? detail.flatten() * counted_in(frame) : detail.flatten();
}

/// [F,F]: the products of the [P] of each pair of frames.
torch::Tensor products_of(const std::vector<const Exposure*>& frames,
                          torch::Tensor (*values_of)(const Exposure&)) {
  std::vector<torch::Tensor> values;
  for (const Exposure* frame : frames) values.push_back(values_of(*frame));
  const torch::Tensor all = torch::stack(values);
  return all.matmul(all.t()).to(torch::kFloat64);
}

}  // namespace

PatternEstimate estimate_pattern(const Dataset& dataset) {
  const std::vector<const Exposure*> frames = chosen_frames(dataset);
  PatternEstimate found;
  if (frames.size() < 3) return found;
  found.sideways_px = std::min(sideways(frames, dataset.near), sideways(frames, dataset.far));
  const torch::Tensor common = products_of(frames, detail_of);
  const torch::Tensor shared = products_of(frames, counted_in);
  const auto products = common.accessor<double, 2>(), pixels = shared.accessor<double, 2>();
  double sum = 0, count = 0;
  for (size_t i = 0; i < frames.size(); ++i) {
    for (size_t j = i + 1; j < frames.size(); ++j) {
      if (!apart(*frames[i], *frames[j], dataset)) continue;
      sum += products[int64_t(i)][int64_t(j)];
      count += pixels[int64_t(i)][int64_t(j)];
      ++found.pairs;
    }
  }
  if (count > 0) found.strength = std::sqrt(std::max(0.0, sum / count));
  return found;
}

}  // namespace jade::data
