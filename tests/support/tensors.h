// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/gaussians/gaussian_model.h"

namespace jade::test {

inline std::vector<torch::Tensor> copies(const std::vector<torch::Tensor>& tensors) {
  std::vector<torch::Tensor> all;
  for (const torch::Tensor& tensor : tensors) all.push_back(tensor.detach().clone());
  return all;
}

inline std::vector<torch::Tensor> copies(const splat::Gaussians& gaussians) {
  std::vector<torch::Tensor> all;
  for (int i = 0; i < gaussians::kParameterCount; ++i)
    all.push_back(gaussians::parameter(gaussians, i).detach().clone());
  return all;
}

inline bool equal(const std::vector<torch::Tensor>& a, const std::vector<torch::Tensor>& b) {
  bool same = a.size() == b.size();
  for (size_t i = 0; same && i < a.size(); ++i) same = a[i].equal(b[i]);
  return same;
}

}  // namespace jade::test
