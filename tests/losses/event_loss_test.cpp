// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/event_loss.h"

#include <cmath>
#include <utility>

#include "jade/losses/event_loss_math.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

torch::Tensor uniform(double value) { return torch::full({3, 4, 4}, value, torch::kFloat64); }

TEST_CASE("lin_log: a line up to 20, the logarithm above, one function", "[losses]") {
  CHECK(lin_log(0) == 0);
  CHECK(lin_log(10) == Approx(std::log(20.0) / 2));
  CHECK(lin_log(20) == Approx(std::log(20.0)));
  CHECK(lin_log(20 + 1e-9) == Approx(lin_log(20)));
  CHECK(lin_log(255) == Approx(std::log(255.0)));
  CHECK(lin_log_slope(0) == Approx(std::log(20.0) / 20));
  CHECK(lin_log_slope(100) == Approx(0.01));
}

/// Brightness doubles everywhere; two pixels brighter, one darker, the rest quiet.
EventPair doubling() {
  EventPair pair;
  pair.renders = torch::stack({uniform(0.3), uniform(0.6)});
  pair.counts = torch::zeros({4, 4}, torch::kFloat64);
  pair.counts[0][0] = 3;
  pair.counts[1][2] = 5;
  pair.counts[3][3] = -2;
  pair.pixels = torch::arange(16, torch::kInt64);
  return pair;
}

TEST_CASE("event_loss: gray, by hand, with a threshold for each sign", "[losses]") {
  EventPair pair = doubling();
  pair.threshold_negative = 0.4;
  const double up = std::log(2.0) / 0.2, down = std::log(2.0) / 0.4;
  const double expected = (std::pow(up - 3, 2) + std::pow(up - 5, 2) + std::pow(down + 2, 2)) / 16;
  CHECK(event_loss(pair).item<double>() == Approx(expected));
}

TEST_CASE("event_loss: only drawn pixels count, and without events it is zero", "[losses]") {
  EventPair pair = doubling();
  pair.pixels = torch::tensor({0, 1}, torch::kInt64);
  CHECK(event_loss(pair).item<double>() == Approx(std::pow(std::log(2.0) / 0.2 - 3, 2) / 2));
  pair.counts.zero_();
  CHECK(event_loss(pair).item<double>() == 0);
}

TEST_CASE("event_loss: in colour a pixel's own channel counts, weighted after the warm-up",
          "[losses]") {
  EventPair pair = doubling();
  pair.renders[0][1].fill_(0.6);  // green does not change
  pair.threshold_positive = pair.threshold_negative = 0.25;
  pair.color_filter = torch::zeros({4, 4, 3}, torch::kBool);
  pair.color_filter[0][0][0] = true;  // red, n = 3
  pair.color_filter[1][2][1] = true;  // green, n = 5
  const double red = std::pow(std::log(2.0) / 0.25 - 3, 2), green = 25;
  CHECK(event_loss(pair).item<double>() == Approx((red + green) / 2));
  pair.weighted_colors = true;
  CHECK(event_loss(pair).item<double>() == Approx((0.4 * red + 0.2 * green) / 0.6));
}

TEST_CASE("event_loss: gradients equal central differences", "[losses]") {
  for (const bool color : {false, true}) {
    EventPair pair;
    pair.counts = (image(5, {7, 9}) * 10 - 5).round();
    pair.pixels = torch::arange(0, 63, 2, torch::kInt64);
    if (color) pair.color_filter = image(6, {7, 9, 3}) > 0.5;
    pair.weighted_colors = color;
    check_gradients(
        [&](const std::vector<torch::Tensor>& in) {
          EventPair filled = pair;
          filled.renders = torch::stack({in[0], in[1]});
          return event_loss(filled);
        },
        {image(1), image(2)}, {"before", "after"});
  }
}

TEST_CASE("event_loss: a pixel that is drawn twice counts twice", "[losses]") {
  EventPair pair = doubling();
  pair.pixels = torch::tensor({0, 5, 0}, torch::kInt64);
  pair.renders.set_requires_grad(true);
  const double off = std::log(2.0) / 0.2 - 3;
  const torch::Tensor loss = event_loss(pair);
  CHECK(loss.item<double>() == Approx(2 * off * off / 3));
  loss.backward();
  const torch::Tensor gradient = pair.renders.grad();
  // dL/dgreen of the later render: 2 off/Θ over three pixels, twice, times 255 · 0.587 / (255 ·
  // 0.6).
  CHECK(gradient[1][1][0][0].item<double>() == Approx(4 * off / 0.2 / 3 * 0.587 / 0.6));
  CHECK(gradient[0][1][0][0].item<double>() == Approx(-4 * off / 0.2 / 3 * 0.587 / 0.3));
  CHECK(gradient.count_nonzero().item<int64_t>() == 6);
}

TEST_CASE("event_loss: without drawn pixels it is zero, and so is its gradient", "[losses]") {
  EventPair pair = doubling();
  pair.pixels = torch::empty({0}, torch::kInt64);
  pair.renders.set_requires_grad(true);
  const torch::Tensor loss = event_loss(pair);
  CHECK(loss.item<double>() == 0);
  loss.backward();
  CHECK(pair.renders.grad().count_nonzero().item<int64_t>() == 0);
}

TEST_CASE("event_loss: a GPU agrees with the CPU", "[losses][cuda]") {
  for (const bool color : {false, true}) {
    EventPair pair;
    pair.renders = image(1, {2, 3, 40, 61}).to(torch::kFloat32);
    pair.counts = (image(5, {40, 61}) * 10 - 5).round().to(torch::kFloat32);
    pair.pixels = torch::arange(0, 40 * 61, 3, torch::kInt64);
    if (color) pair.color_filter = image(6, {40, 61, 3}) > 0.5;
    pair.weighted_colors = color;
    const auto on = [&](const torch::Device& device) {
      EventPair there = pair;
      for (torch::Tensor* tensor :
           {&there.renders, &there.counts, &there.pixels, &there.color_filter}) {
        if (tensor->defined()) *tensor = tensor->to(device);
      }
      there.renders = there.renders.detach().clone().set_requires_grad(true);
      const torch::Tensor loss = event_loss(there);
      loss.backward();
      return std::pair(loss.detach().cpu(), there.renders.grad().cpu());
    };
    const auto [loss, gradient] = on(torch::kCPU);
    const auto [found, found_gradient] = on({torch::kCUDA, 0});
    CHECK(torch::allclose(found, loss, 1e-5, 0));
    CHECK(torch::allclose(found_gradient, gradient, 1e-4, 1e-6));
  }
}

}  // namespace
}  // namespace jade::losses
