// SPDX-License-Identifier: Apache-2.0
#include "jade/response/identity_response.h"

#include <utility>

#include "jade/core/asset.h"
#include "jade/core/error.h"
#include "jade/io/npy.h"

namespace jade::response {
namespace {

/// Outputs and inputs of each layer.
constexpr std::pair<int64_t, int64_t> kLayers[] = {{16, 1}, {16, 16}, {16, 16}, {1, 16}};

Weights read() {
  const auto path = asset("assets/identity_response.npy");
  const torch::Tensor all = io::read_npy(path);
  int64_t count = 0;
  for (const auto& [outputs, inputs] : kLayers) count += outputs * inputs + outputs;
  if (all.scalar_type() != torch::kFloat32 || all.dim() != 1 || all.numel() != count) {
    throw DataError(concat(path.string(), ": expected ", count, " float32 numbers, found ",
                           all.numel(), " of ", c10::toString(all.scalar_type()),
                           "; install the program's files again"));
  }
  Weights result;
  int64_t begin = 0;
  const auto next = [&](int64_t length) {
    begin += length;
    return all.slice(0, begin - length, begin).clone();
  };
  for (size_t i = 0; i < result.weight.size(); ++i) {
    const auto& [outputs, inputs] = kLayers[i];
    result.weight[i] = next(outputs * inputs).view({outputs, inputs});
    result.bias[i] = next(outputs);
  }
  return result;
}

}  // namespace

const Weights& identity_response() {
  static const Weights weights = read();
  return weights;
}

}  // namespace jade::response
