// SPDX-License-Identifier: Apache-2.0
#include "jade/router/allocation.h"

#include <vector>

#include "jade/core/check.h"
#include "jade/router/router.h"

namespace jade::router {
namespace {

class RoutedAllocation : public Allocation {
 public:
  RoutedAllocation(at::Generator generator, bool sigmoid)
      : router_(register_module("router", Router(std::move(generator)))), sigmoid_(sigmoid) {}

  torch::Tensor forward(const torch::Tensor& measured, int64_t) override {
    const torch::Tensor logits = router_->logits(measured.unsqueeze(0)).squeeze(0);
    return sigmoid_ ? logits.sigmoid() : logits;
  }

 private:
  Router router_;
  bool sigmoid_;
};

class GlobalScalarAllocation : public Allocation {
 public:
  GlobalScalarAllocation() : logit_(register_parameter("logit", torch::zeros({1}))) {}

  torch::Tensor forward(const torch::Tensor& measured, int64_t) override {
    return logit_.sigmoid().view({1, 1, 1}).expand({1, measured.size(1), measured.size(2)});
  }

 private:
  torch::Tensor logit_;
};

/// One parameter per view, so that an optimiser can skip those of absent views.
class PerViewAllocation : public Allocation {
 public:
  PerViewAllocation(int64_t views, int64_t height, int64_t width) {
    for (int64_t view = 0; view < views; ++view) {
      logits_.push_back(
          register_parameter(concat("logits_", view), torch::zeros({1, height, width})));
    }
  }

  torch::Tensor forward(const torch::Tensor&, int64_t view) override {
    JADE_CHECK(view >= 0 && view < static_cast<int64_t>(logits_.size()), "per_view_map: view ",
               view, " of ", logits_.size());
    return logits_[static_cast<size_t>(view)].sigmoid();
  }

 private:
  std::vector<torch::Tensor> logits_;
};

}  // namespace

std::shared_ptr<Allocation> make_allocation(const AllocationOptions& options, int64_t views,
                                            int64_t height, int64_t width,
                                            at::Generator generator) {
  switch (options.kind) {
    case AllocationKind::kRouter:
      return std::make_shared<RoutedAllocation>(std::move(generator), /*sigmoid=*/true);
    case AllocationKind::kRouterNoSigmoid:
      return std::make_shared<RoutedAllocation>(std::move(generator), /*sigmoid=*/false);
    case AllocationKind::kGlobalScalar:
      return std::make_shared<GlobalScalarAllocation>();
    case AllocationKind::kPerViewMap:
      break;
  }
  return std::make_shared<PerViewAllocation>(views, height, width);
}

}  // namespace jade::router
