// SPDX-License-Identifier: Apache-2.0
#include "jade/run/allocation_choice.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

using namespace jade;

namespace {

/// One row of pixels, the same in all channels.
torch::Tensor pixels(const std::vector<float>& values) {
  return torch::tensor(values).view({1, 1, -1}).expand({3, 1, -1}).contiguous();
}

torch::Tensor weights(const std::vector<float>& values) {
  return torch::tensor(values).view({1, 1, -1});
}

}  // namespace

TEST_CASE("allocation choice: the share of pixels where the nearer restoration is preferred",
          "[run]") {
  // EDI is nearer in pixels 0 and 1, EFNet in 2 to 4; in 5 they are equally near.
  const auto truth = pixels({0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f});
  const restore::Restorations both{pixels({0.5f, 0.6f, 0.9f, 0.8f, 0.1f, 0.25f}),
                                   pixels({0.7f, 0.2f, 0.5f, 0.4f, 0.4f, 0.25f})};
  const auto right = [&](const std::vector<float>& alpha) {
    return *run::allocation_choice(weights(alpha), both, truth).right;
  };
  CHECK(right({1, 0.6f, 0, 0.4f, 0.1f, 1}) == 1);
  CHECK(right({0, 0.4f, 1, 0.6f, 0.9f, 0}) == 0);
  CHECK(right({1, 1, 1, 1, 1, 1}) == Approx(2.0 / 5));
  // α = ½ is no preference for EDI, and one number is broadcast to all pixels.
  CHECK(right({0.5f}) == Approx(3.0 / 5));
  CHECK_FALSE(run::allocation_choice(weights({1}), {truth, truth}, truth).right);
}

TEST_CASE("allocation choice: nearness is the mean over the channels", "[run]") {
  const auto truth = torch::zeros({3, 1, 1});
  const restore::Restorations both{torch::tensor({0.6f, 0.0f, 0.0f}).view({3, 1, 1}),
                                   torch::tensor({0.3f, 0.3f, 0.3f}).view({3, 1, 1})};
  CHECK(run::allocation_choice(weights({0.9f}), both, truth).right == 1.0);
}

TEST_CASE("allocation choice: the gain is that over the better of the two", "[run]") {
  const auto truth = pixels({0.5f, 0.5f, 0.5f, 0.5f});
  const restore::Restorations both{pixels({0.5f, 0.6f, 0.6f, 0.6f}),
                                   pixels({0.7f, 0.5f, 0.7f, 0.7f})};
  const auto gain = [&](const std::vector<float>& alpha) {
    return run::allocation_choice(weights(alpha), both, truth).gain_db;
  };
  CHECK(gain({1, 1, 1, 1}) == Approx(0).margin(1e-5));
  // Squared errors 0, 1, 1, 1 against 4, 0, 4, 4 of EFNet and 0, 0, 1, 1 of the best mix.
  CHECK(gain({0, 0, 0, 0}) == Approx(10 * std::log10(3.0 / 12)).epsilon(1e-4));
  CHECK(gain({1, 0, 1, 1}) == Approx(10 * std::log10(3.0 / 2)).epsilon(1e-4));
}
