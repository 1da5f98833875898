// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/codebook.h"

#include <algorithm>
#include <vector>

namespace jade::gaussians {
namespace {

constexpr int64_t kCodes = 256;
constexpr int kCodeIterations = 20;
constexpr int64_t kGroups = 256;
constexpr int kIterations = 6;
/// Number of rows sampled to find a group's centre; more change little.
constexpr int64_t kSample = 65536;
/// Distances computed at once, 64 MB.
constexpr int64_t kDistances = int64_t(1) << 24;

/// [N] int64: the nearest centre of each row.
torch::Tensor nearest(const torch::Tensor& rows, const torch::Tensor& centres) {
  const torch::Tensor offsets = centres.square().sum(1);
  const int64_t step = std::max<int64_t>(1, kDistances / centres.size(0));
  std::vector<torch::Tensor> labels;
  for (int64_t begin = 0; begin < rows.size(0); begin += step) {
    const torch::Tensor part = rows.slice(0, begin, begin + step);
    labels.push_back(torch::addmm(offsets, part, centres.t(), 1, -2).argmin(1));
  }
  return torch::cat(labels);
}

/// Every (N/count)-th row, from the middle of its interval.
torch::Tensor evenly(const torch::Tensor& rows, int64_t count) {
  const torch::Tensor at =
      ((torch::arange(count, torch::kFloat64) + 0.5) * (double(rows.size(0)) / double(count)))
          .floor()
          .to(torch::kInt64);
  return rows.index_select(0, at);
}

/// Centres [count,D] of groups of rows.
torch::Tensor k_means(const torch::Tensor& rows, int64_t count) {
  const torch::Tensor sample = rows.size(0) > kSample ? evenly(rows, kSample) : rows;
  torch::Tensor centres = evenly(sample, count).clone();
  for (int i = 0; i < kIterations; ++i) {
    const torch::Tensor labels = nearest(sample, centres);
    const torch::Tensor sums = torch::zeros_like(centres).index_add_(0, labels, sample);
    const torch::Tensor members =
        torch::bincount(labels, {}, count).to(sample.scalar_type()).unsqueeze(1);
    centres = torch::where(members > 0, sums / members, centres);
  }
  return centres;
}

}  // namespace

Codebook codebook_of(const torch::Tensor& numbers) {
  const torch::Tensor flat = numbers.detach().to(torch::kFloat64).flatten().contiguous();
  const torch::Tensor sorted = std::get<0>(flat.sort());
  const int64_t count = sorted.size(0);
  const torch::Tensor sums = torch::cat({torch::zeros({1}, torch::kFloat64), sorted.cumsum(0)});
  const torch::Tensor share = (torch::arange(kCodes, torch::kFloat64) + 0.5) / double(kCodes);
  const torch::Tensor quantiles =
      sorted.index_select(0, (share * double(count)).floor().to(torch::kInt64));
  torch::Tensor values = 0.5 * (quantiles + sorted[0] + (sorted[-1] - sorted[0]) * share);
  const auto edges = [&] { return 0.5 * (values.slice(0, 1) + values.slice(0, 0, -1)); };
  for (int i = 0; i < kCodeIterations; ++i) {
    const torch::Tensor inner = torch::searchsorted(sorted, edges());
    const torch::Tensor begin = torch::cat({torch::zeros({1}, torch::kInt64), inner});
    const torch::Tensor end = torch::cat({inner, torch::full({1}, count, torch::kInt64)});
    const torch::Tensor members = (end - begin).to(torch::kFloat64);
    const torch::Tensor total = sums.index_select(0, end) - sums.index_select(0, begin);
    values = torch::where(members > 0, total / members, values);
  }
  const torch::Tensor labels = torch::searchsorted(edges(), flat);
  return {values, labels.to(torch::kUInt8).reshape(numbers.sizes())};
}

Palette palette_of(const torch::Tensor& rows, int64_t at_most) {
  const int64_t count = rows.size(0);
  if (count <= at_most) return {rows, torch::arange(count, torch::kInt64)};
  if (at_most <= kGroups) {
    const torch::Tensor centres = k_means(rows, at_most);
    return {centres, nearest(rows, centres)};
  }
  const torch::Tensor groups = nearest(rows, k_means(rows, kGroups));
  const torch::Tensor order = groups.argsort(/*stable=*/true, 0, false);
  const torch::Tensor sizes = torch::bincount(groups, {}, kGroups);
  torch::Tensor labels = torch::empty({count}, torch::kInt64);
  std::vector<torch::Tensor> parts;
  int64_t begin = 0, used = 0;
  for (int64_t group = 0; group < kGroups; ++group) {
    const auto size = sizes[group].item<int64_t>();
    if (size == 0) continue;
    const torch::Tensor members = order.slice(0, begin, begin + size);
    // One palette row is reserved for each group; the rest is distributed by their sizes.
    const int64_t share = 1 + (at_most - kGroups) * size / count;
    const torch::Tensor own = rows.index_select(0, members);
    const torch::Tensor centres = k_means(own, std::min(share, size));
    labels.index_copy_(0, members, nearest(own, centres) + used);
    parts.push_back(centres);
    used += centres.size(0);
    begin += size;
  }
  return {torch::cat(parts), labels};
}

}  // namespace jade::gaussians
