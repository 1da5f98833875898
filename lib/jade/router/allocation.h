// SPDX-License-Identifier: Apache-2.0
// Ways to compute the weight α between the two restorations: the rows of the ablation tables.
#pragma once

#include <ATen/core/Generator.h>
#include <memory>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "jade/core/fields.h"

namespace jade::router {

enum class AllocationKind { kRouter, kRouterNoSigmoid, kGlobalScalar, kPerViewMap };

constexpr auto words_of(AllocationKind) {
  using Kind = AllocationKind;
  return std::array{
      Word{"router", Kind::kRouter},
      Word{"router_no_sigmoid", Kind::kRouterNoSigmoid, "the same without its sigmoid"},
      Word{"global_scalar", Kind::kGlobalScalar, "one learned number"},
      Word{"per_view_map", Kind::kPerViewMap, "one learned map per view"}};
}

struct AllocationOptions {
  AllocationKind kind = AllocationKind::kRouter;
};

template <class V>
void describe(V& v, AllocationOptions& o) {
  v.field("kind", o.kind,
          "source of the weight α between EDI (1) and EFNet (0) for objective.target routed");
  v.fixed("constant", 0.5);  // listed by runs of earlier versions
}

/// Interface of θ.
class Allocation : public torch::nn::Module {
 public:
  /// α [1,H,W], differentiable in the parameters; in [0,1] for every kind but router_no_sigmoid.
  /// @param measured  [5,H,W], X_in of Eq. (2): B, then Ψ(V). Never a restoration.
  /// @param view      index among the training views
  virtual torch::Tensor forward(const torch::Tensor& measured, int64_t view) = 0;
};

/// The kind that the options name, on the CPU. The learned number and maps start at 0.5.
/// @param views, height, width  sizes of per_view_map.
std::shared_ptr<Allocation> make_allocation(const AllocationOptions& options, int64_t views,
                                            int64_t height, int64_t width, at::Generator generator);

}  // namespace jade::router
