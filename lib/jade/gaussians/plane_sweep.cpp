// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/plane_sweep.h"

#include <ATen/Parallel.h>
#include <ATen/ops/avg_pool2d.h>
#include <ATen/ops/rand.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/random.h"

namespace jade::gaussians {
namespace {

using geometry::Vector3;

/// Views that are compared, spread over the data set.
constexpr size_t kMostViews = 64;
constexpr int kFewestViews = 3;
/// Images are reduced to about this width, then averaged over kPatch x kPatch pixels.
constexpr int64_t kWidth = 240, kPatch = 5;
/// Averages of a smaller share of pixels that count are no part of the comparison.
constexpr float kLeastShare = 0.5F;
/// Depths up to this factor of the least variance, and this much above it, agree as well.
constexpr double kFactor = 1.5, kNoise = 1e-4;

struct Compared {
  const InitView* view;
  torch::Tensor image;  ///< [3,h,w], reduced and averaged, without the gain
  torch::Tensor share;  ///< [h,w], of the averaged pixels that count; undefined: all
  double scale;         ///< pixels of the view per pixel of `image`
};

Compared reduced(const InitView& view) {
  const int64_t factor = std::max<int64_t>(1, view.image.size(2) / kWidth);
  const auto averaged = [&](const torch::Tensor& whole) {
    const torch::Tensor small =
        at::avg_pool2d(whole.unsqueeze(0), factor, factor, 0, /*ceil_mode=*/true, false);
    return at::avg_pool2d(small, kPatch, 1, kPatch / 2, false, /*count_include_pad=*/false)[0];
  };
  torch::Tensor image = view.image.detach().to(torch::kCPU, torch::kFloat32), share;
  if (view.gain != 1) image = image / view.gain;
  if (view.mask.defined()) {
    const torch::Tensor mask = view.mask.to(torch::kCPU, torch::kFloat32);
    share = averaged(mask);
    image = averaged(image * mask) / share.clamp_min(kLeastShare);
    share = share[0].contiguous();
  } else {
    image = averaged(image);
  }
  return {&view, image.contiguous(), share, double(factor)};
}

std::vector<Compared> compared(const std::vector<InitView>& views) {
  const size_t count = std::min(views.size(), kMostViews);
  std::vector<Compared> result;
  for (size_t i = 0; i < count; ++i) result.push_back(reduced(views[i * views.size() / count]));
  return result;
}

struct Agreement {
  std::array<float, 3> color{};  ///< mean of the views
  /// Sample variance, mean of the channels; infinite for fewer than kFewestViews views.
  double variance = std::numeric_limits<double>::infinity();
};

Agreement agreement_at(const Vector3& point, const std::vector<Compared>& views) {
  std::array<double, 3> sum{}, squares{};
  int seen = 0;
  for (const Compared& c : views) {
    const Vector3 x = geometry::transform(c.view->camera_from_world, point);
    if (!(x[2] > 0)) continue;
    const auto uv = geometry::project(c.view->camera, x);
    if (!(uv[0] >= 0 && uv[1] >= 0 && uv[0] < double(c.view->camera.width) &&
          uv[1] < double(c.view->camera.height))) {
      continue;
    }
    const int64_t height = c.image.size(1), width = c.image.size(2);
    const int64_t row = std::min(int64_t(uv[1] / c.scale), height - 1);
    const int64_t at = row * width + std::min(int64_t(uv[0] / c.scale), width - 1);
    if (c.share.defined() && c.share.const_data_ptr<float>()[at] < kLeastShare) continue;
    const float* pixel = c.image.const_data_ptr<float>() + at;
    for (size_t k = 0; k < 3; ++k, pixel += height * width) {
      sum[k] += *pixel;
      squares[k] += double(*pixel) * *pixel;
    }
    ++seen;
  }
  Agreement result;
  for (size_t k = 0; k < 3; ++k) result.color[k] = float(sum[k] / std::max(seen, 1));
  if (seen < kFewestViews) return result;
  result.variance = 0;
  for (size_t k = 0; k < 3; ++k) {
    result.variance += std::max(squares[k] - sum[k] * sum[k] / seen, 0.0) / (seen - 1) / 3;
  }
  return result;
}

/// The least variance of a point over the median one; no value without texture, or with few depths.
std::optional<double> disagreement_of(const std::array<Agreement, kSweptDepths>& agreements) {
  constexpr size_t kFewestDepths = 8;
  constexpr double kTexture = 10 * kNoise;  // variance at wrong depths
  std::vector<double> variances;
  for (const Agreement& each : agreements) {
    if (std::isfinite(each.variance)) variances.push_back(each.variance);
  }
  if (variances.size() < kFewestDepths) return std::nullopt;
  const double median = median_of(variances);
  if (median < kTexture) return std::nullopt;
  return *std::min_element(variances.begin(), variances.end()) / median;
}

double median_of_most(std::vector<std::optional<double>> values) {
  constexpr size_t kFewest = 100;
  std::vector<double> known;
  for (const auto& value : values) {
    if (value) known.push_back(*value);
  }
  return known.size() < kFewest ? 0 : median_of(std::move(known));
}

}  // namespace

PointCloud plane_sweep(const InitSources& sources, int64_t count, at::Generator& generator,
                       double* disagreement) {
  check_frusta(sources);
  const std::vector<Compared> views = compared(sources.views);
  // [count,5] per point: view, column, row, offset of the depths, choice among those that agree.
  const torch::Tensor draws = at::rand({count, 5}, generator, torch::kFloat64);
  PointCloud cloud{torch::empty({count, 3}), torch::empty({count, 3})};
  const double* all_draws = draws.const_data_ptr<double>();
  auto* points = cloud.points.mutable_data_ptr<float>();
  auto* colors = cloud.colors.mutable_data_ptr<float>();
  std::vector<std::optional<double>> disagreements(size_t(disagreement ? count : 0));
  at::parallel_for(0, count, 64, [&](int64_t begin, int64_t end) {
    std::array<Vector3, kSweptDepths> swept;
    std::array<Agreement, kSweptDepths> agreements;
    for (int64_t i = begin; i < end; ++i) {
      const double* draw = all_draws + 5 * i;
      double least = std::numeric_limits<double>::infinity();
      for (size_t k = 0; k < kSweptDepths; ++k) {
        const double share = (double(k) + draw[3]) / double(kSweptDepths);
        swept[k] = point_in_frustum(sources, {draw[0], draw[1], draw[2]}, share);
        agreements[k] = agreement_at(swept[k], views);
        least = std::min(least, agreements[k].variance);
      }
      if (disagreement) disagreements[size_t(i)] = disagreement_of(agreements);
      std::array<size_t, kSweptDepths> good{};
      size_t found = 0;
      for (size_t k = 0; k < kSweptDepths; ++k) {
        if (agreements[k].variance <= kFactor * least + kNoise) good[found++] = k;
      }
      const size_t chosen = good[std::min(size_t(draw[4] * double(found)), found - 1)];
      for (size_t a = 0; a < 3; ++a) {
        points[3 * i + int64_t(a)] = float(swept[chosen][a]);
        colors[3 * i + int64_t(a)] = agreements[chosen].color[a];
      }
    }
  });
  if (disagreement) *disagreement = median_of_most(std::move(disagreements));
  return cloud;
}

std::string pose_fault(double disagreement) {
  constexpr double kWrong = 0.3;
  if (disagreement <= kWrong) return "";
  return concat(
      "poses: expected frames that agree at some depth, found that at the best one they "
      "differ ",
      std::round(100 * disagreement),
      " % as much as at others; look at the poses' convention (axes, camera to world), "
      "at their order and at the focal length");
}

std::string pose_fault(const InitSources& sources) {
  constexpr int64_t kPoints = 2000;
  if (sources.views.empty() || !(sources.near > 0 && sources.far > sources.near)) return "";
  at::Generator generator = make_generator(0, "points of a check of the poses");
  double disagreement = 0;
  plane_sweep(sources, kPoints, generator, &disagreement);
  return pose_fault(disagreement);
}

}  // namespace jade::gaussians
