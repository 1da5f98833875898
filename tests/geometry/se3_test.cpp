// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/se3.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "support/gradcheck.h"
#include "support/se3_log.h"

using namespace jade;

namespace {

torch::Tensor twists(double size) {
  torch::manual_seed(3);
  return torch::randn({5, 6}, torch::kFloat64) * size;
}

double largest(const torch::Tensor& t) { return t.abs().max().item<double>(); }

}  // namespace

TEST_CASE("se3_exp: equals the matrix exponential of the twist", "[geometry]") {
  for (const double size : {0.0, 1e-9, 1e-3, 0.05, 0.3, 1.0}) {
    const torch::Tensor twist = twists(size);
    torch::Tensor algebra = torch::zeros({5, 4, 4}, torch::kFloat64);
    for (int64_t i = 0; i < 5; ++i) {
      const auto w = twist[i].narrow(0, 3, 3);
      algebra[i][0][1] = -w[2], algebra[i][0][2] = w[1], algebra[i][1][2] = -w[0];
      algebra[i][1][0] = w[2], algebra[i][2][0] = -w[1], algebra[i][2][1] = w[0];
      algebra[i].narrow(0, 0, 3).select(1, 3).copy_(twist[i].narrow(0, 0, 3));
    }
    INFO(size);
    CHECK(largest(geometry::se3_exp(twist) - torch::matrix_exp(algebra)) < 1e-13);
  }
}

TEST_CASE("se3_log: undoes se3_exp for rotations below 90 degrees", "[geometry]") {
  for (const double size : {0.0, 1e-9, 1e-3, 0.05, 0.099, 0.101, 0.4}) {
    const torch::Tensor twist = twists(size);
    INFO(size);
    CHECK(largest(test::se3_log(geometry::se3_exp(twist)) - twist) < 1e-12);
  }
}

TEST_CASE("se3_inverse: a motion and its inverse cancel", "[geometry]") {
  const torch::Tensor motion = geometry::se3_exp(twists(0.7));
  CHECK(largest(motion.matmul(geometry::se3_inverse(motion)) - torch::eye(4, torch::kFloat64)) <
        1e-14);
}

TEST_CASE("se3: rotation about z by 0.2 rad and a step along x, by hand", "[geometry]") {
  const torch::Tensor motion =
      geometry::se3_exp(torch::tensor({0., 0., 0., 0., 0., 0.2}, torch::kFloat64));
  CHECK(motion[0][0].item<double>() == Approx(std::cos(0.2)).margin(1e-15));
  CHECK(motion[1][0].item<double>() == Approx(std::sin(0.2)).margin(1e-15));
  const torch::Tensor step =
      geometry::se3_exp(torch::tensor({3., 0., 0., 0., 0., 0.}, torch::kFloat64));
  CHECK(step[0][3].item<double>() == 3.0);
}

TEST_CASE("se3: gradients match central differences, at zero motion too", "[geometry]") {
  for (const double size : {0.0, 1e-5, 0.3}) {
    const auto exp = [](const std::vector<torch::Tensor>& in) { return geometry::se3_exp(in[0]); };
    const auto twist = twists(size).requires_grad_();
    const auto report = test::gradcheck(exp, {twist}, {"twist"});
    INFO(report.message);
    CHECK(report.passed);
    const auto round = [](const std::vector<torch::Tensor>& in) {
      return test::se3_log(geometry::se3_exp(in[0]).matmul(geometry::se3_exp(in[0].flip(0) * 0.5)));
    };
    const auto both = test::gradcheck(round, {twist}, {"twist"});
    INFO(both.message);
    CHECK(both.passed);
  }
}

TEST_CASE("se3: a lost derivative is caught", "[geometry]") {
  const auto broken = [](const std::vector<torch::Tensor>& in) {
    return geometry::se3_exp(
        torch::cat({in[0].narrow(-1, 0, 3), in[0].narrow(-1, 3, 3).detach()}, -1));
  };
  CHECK_FALSE(test::gradcheck(broken, {twists(0.3).requires_grad_()}, {"twist"}).passed);
}
