// SPDX-License-Identifier: Apache-2.0
#include "jade/models/allocation.h"

#include "jade/core/check.h"
#include "jade/models/router.h"

namespace jade::models {
namespace {

class RoutedAllocation : public Allocation {
 public:
  RoutedAllocation(at::Generator generator, bool sigmoid)
      : router_(register_module("router", Router(std::move(generator)))), sigmoid_(sigmoid) {}

  torch::Tensor forward(const AllocationInput& input) override {
    const torch::Tensor logits =
        router_->logits(input.blurry.unsqueeze(0), input.psi.unsqueeze(0)).squeeze(0);
    return sigmoid_ ? logits.sigmoid() : logits;
  }

 private:
  Router router_;
  bool sigmoid_;
};

class ConstantAllocation : public Allocation {
 public:
  explicit ConstantAllocation(double value) : value_(value) {}

  torch::Tensor forward(const AllocationInput& input) override {
    return torch::full({1, input.blurry.size(1), input.blurry.size(2)}, value_,
                       input.blurry.options());
  }

 private:
  double value_;
};

class GlobalScalarAllocation : public Allocation {
 public:
  GlobalScalarAllocation() : logit_(register_parameter("logit", torch::zeros({1}))) {}

  torch::Tensor forward(const AllocationInput& input) override {
    return logit_.sigmoid().view({1, 1, 1}).expand({1, input.blurry.size(1), input.blurry.size(2)});
  }

 private:
  torch::Tensor logit_;
};

class PerViewAllocation : public Allocation {
 public:
  PerViewAllocation(int64_t views, int64_t height, int64_t width)
      : logits_(register_parameter("logits", torch::zeros({views, 1, height, width}))) {}

  torch::Tensor forward(const AllocationInput& input) override {
    JADE_CHECK(input.view >= 0 && input.view < logits_.size(0), "per_view_map: view ", input.view,
               " of ", logits_.size(0));
    return logits_.select(0, input.view).sigmoid();
  }

 private:
  torch::Tensor logits_;
};

}  // namespace

std::shared_ptr<Allocation> make_allocation(const AllocationOptions& options, int64_t views,
                                            int64_t height, int64_t width,
                                            at::Generator generator) {
  if (options.kind == "none") return nullptr;
  if (options.kind == "constant") return std::make_shared<ConstantAllocation>(options.constant);
  if (options.kind == "global_scalar") return std::make_shared<GlobalScalarAllocation>();
  if (options.kind == "per_view_map") {
    return std::make_shared<PerViewAllocation>(views, height, width);
  }
  if (options.kind == "router" || options.kind == "router_no_sigmoid") {
    return std::make_shared<RoutedAllocation>(std::move(generator), options.kind == "router");
  }
  throw ConfigError(concat("allocation.kind: unknown kind '", options.kind, "'"));
}

}  // namespace jade::models
