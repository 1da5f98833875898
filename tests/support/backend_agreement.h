// SPDX-License-Identifier: Apache-2.0
// Criteria for the agreement of two backends of the splatting op.
#pragma once

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>
#include <vector>

namespace jade::test {

/// Cosine of the angle between two tensors; 1 if one of them is zero.
inline double cosine(const torch::Tensor& a, const torch::Tensor& b) {
  const torch::Tensor x = a.to(torch::kFloat64).flatten(), y = b.to(torch::kFloat64).flatten();
  const double norms = (x.norm() * y.norm()).item<double>();
  return norms == 0 ? 1 : x.dot(y).item<double>() / norms;
}

/// A cut-off that differs by rounding changes a pixel by up to 1/255 of a colour; other differences
/// must be small. For images of about 1.
inline void check_images(const torch::Tensor& found, const torch::Tensor& expected) {
  const torch::Tensor difference = (found - expected).abs();
  const torch::Tensor flipped = difference > 1e-4;
  CHECK(flipped.to(torch::kFloat64).mean().item<double>() <= 1e-3);
  CHECK(difference.masked_select(flipped.logical_not()).mean().item<double>() < 2e-6);
  const torch::Tensor signs = (found - expected).masked_select(flipped).sign();
  if (signs.numel() >= 50) CHECK(std::abs(signs.mean().item<double>()) < 0.5);
}

/// Checks that each pair has the same direction and length.
inline void check_gradients(const std::vector<torch::Tensor>& found,
                            const std::vector<torch::Tensor>& expected) {
  REQUIRE(found.size() == expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    INFO("gradient " << i);
    CHECK(torch::isfinite(found[i]).all().item<bool>());
    CHECK(cosine(found[i], expected[i]) >= 0.9999);
    const double norm = found[i].norm().item<double>();
    CHECK(norm == Approx(expected[i].norm().item<double>()).epsilon(5e-3).margin(1e-6));
  }
}

/// Checks that each pair is bit-equal.
inline void check_equal(const std::vector<torch::Tensor>& a, const std::vector<torch::Tensor>& b) {
  REQUIRE(a.size() == b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    INFO("tensor " << i);
    CHECK(torch::equal(a[i], b[i]));
  }
}

}  // namespace jade::test
