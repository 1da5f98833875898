// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>

#include "jade/losses/poses_kernels.h"

namespace jade::losses::cpu {
namespace {

constexpr int64_t kGrain = 16384;

/// Number of values whose sums stay in the L1 cache while the renders are added.
constexpr int64_t kBlock = 2048;

}  // namespace

void weighted_sum(const at::Tensor& renders, const at::Tensor& weights, at::Tensor& sum) {
  const int64_t count = renders.size(0), values = renders.numel() / count;
  AT_DISPATCH_FLOATING_TYPES(renders.scalar_type(), "weighted_sum", [&] {
    const scalar_t* const from = renders.const_data_ptr<scalar_t>();
    const scalar_t* const weight = weights.const_data_ptr<scalar_t>();
    scalar_t* const out = sum.mutable_data_ptr<scalar_t>();
    at::parallel_for(0, values, kGrain, [&](int64_t first, int64_t last) {
      for (int64_t begin = first; begin < last; begin += kBlock) {
        const int64_t end = std::min(last, begin + kBlock);
        for (int64_t i = begin; i < end; ++i) out[i] = weight[0] * from[i];
        for (int64_t k = 1; k < count; ++k) {
          const scalar_t* const render = from + k * values;
          for (int64_t i = begin; i < end; ++i) out[i] += weight[k] * render[i];
        }
      }
    });
  });
}

void pose_gradient(const PosePicks& picks, const PoseGradients& of, at::Tensor& of_renders) {
  const int64_t count = of_renders.size(0), values = of_renders.numel() / count;
  std::vector<int64_t> poses;
  if (picks.first >= 0) poses.push_back(picks.first);
  const int64_t* const indices = picks.indices.const_data_ptr<int64_t>();
  poses.insert(poses.end(), indices, indices + picks.indices.numel());
  AT_DISPATCH_FLOATING_TYPES(of_renders.scalar_type(), "pose_gradient", [&] {
    const scalar_t* const mean = of.mean.defined() ? of.mean.const_data_ptr<scalar_t>() : nullptr;
    const scalar_t* const weights =
        picks.weights.defined() ? picks.weights.const_data_ptr<scalar_t>() : nullptr;
    const scalar_t* const all = of.all.defined() ? of.all.const_data_ptr<scalar_t>() : nullptr;
    at::parallel_for(0, values, kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t k = 0; k < count; ++k) {
        scalar_t* const out = of_renders.mutable_data_ptr<scalar_t>() + k * values;
        const auto poses_count = static_cast<scalar_t>(count);
        if (mean == nullptr) {
          std::fill(out + begin, out + end, scalar_t(0));
        } else if (weights != nullptr) {
          for (int64_t i = begin; i < end; ++i) out[i] = mean[i] * weights[k];
        } else {
          for (int64_t i = begin; i < end; ++i) out[i] = mean[i] / poses_count;
        }
        for (size_t m = 0; m < poses.size(); ++m) {
          if (poses[m] != k || !of.picks[m].defined()) continue;
          const scalar_t* const from = of.picks[m].const_data_ptr<scalar_t>();
          for (int64_t i = begin; i < end; ++i) out[i] += from[i];
        }
        if (all == nullptr) continue;
        for (int64_t i = begin; i < end; ++i) out[i] += all[k * values + i];
      }
    });
  });
}

}  // namespace jade::losses::cpu
