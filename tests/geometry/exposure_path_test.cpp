// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/exposure_path.h"

#include "support/catch.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/geometry/se3.h"
#include "support/gradcheck.h"
#include "support/se3_log.h"

using namespace jade;

namespace {

/// A path's inputs: K twists, irregular times, poses of a rotating camera in float32.
struct PathCase {
  torch::Tensor twists, u, poses, control;

  PathCase(int64_t count, double size, double pose_size = 0.2) {
    torch::manual_seed(11);
    twists = size * torch::randn({count, 6}, torch::kFloat64);
    u = torch::tensor({0.0, 0.21, 0.5, 0.77, 1.0}, torch::kFloat64);
    poses = geometry::se3_exp(torch::randn({5, 6}, torch::kFloat64)).to(torch::kFloat32);
    control = geometry::se3_exp(pose_size * torch::randn({count, 6}, torch::kFloat64));
  }
};

/// b_j of exposure_path.h, [M,K].
torch::Tensor weights(const torch::Tensor& u, int64_t count) {
  if (count == 2) return torch::stack({1 - u, u}, 1);
  if (count > 4) {  // segment by segment
    const torch::Tensor all = torch::zeros({u.size(0), count}, torch::kFloat64);
    for (int64_t m = 0; m < u.size(0); ++m) {
      const torch::Tensor place = u.narrow(0, m, 1) * static_cast<double>(count - 3);
      const auto first = std::min(count - 4, static_cast<int64_t>(place.item<double>()));
      all[m].narrow(0, first, 4).copy_(weights(place - static_cast<double>(first), 4)[0]);
    }
    return all;
  }
  const torch::Tensor u2 = u * u, u3 = u2 * u;
  return torch::stack({(1 - u).pow(3), 3 * u3 - 6 * u2 + 4, -3 * u3 + 3 * u2 + 3 * u + 1, u3}, 1) /
         6;
}

/// Reference path from se3.h's operations, as BAD-Gaussians writes it.
torch::Tensor slow_spline(const torch::Tensor& twists, const torch::Tensor& u,
                          const torch::Tensor& control) {
  const torch::Tensor poses = control.matmul(geometry::se3_exp(twists));
  const torch::Tensor motions =
      test::se3_log(geometry::se3_inverse(poses.slice(0, 0, -1)).matmul(poses.slice(0, 1)));
  const torch::Tensor shares = weights(u, twists.size(0)).flip(1).cumsum(1).flip(1);
  torch::Tensor path = poses[0].unsqueeze(0);
  for (int64_t j = 1; j < twists.size(0); ++j) {
    path = path.matmul(geometry::se3_exp(shares.narrow(1, j, 1) * motions[j - 1]));
  }
  return geometry::se3_inverse(path);
}

torch::Tensor slow_correction(const torch::Tensor& twists, const torch::Tensor& u,
                              const torch::Tensor& poses) {
  const torch::Tensor twist = weights(u, twists.size(0)).matmul(twists);
  return geometry::se3_inverse(geometry::se3_exp(twist)).matmul(poses.to(torch::kFloat64));
}

double farthest(const torch::Tensor& a, const torch::Tensor& b) {
  return (a - b).abs().max().item<double>();
}

}  // namespace

TEST_CASE("exposure path: without a twist the data's poses are restored bit for bit",
          "[geometry]") {
  for (const int64_t count : {2, 4}) {
    const PathCase c(count, 0);
    const torch::Tensor path = geometry::corrected_path(c.twists, c.u, c.poses);
    CHECK(path.scalar_type() == torch::kFloat64);
    CHECK(path.to(torch::kFloat32).equal(c.poses));
  }
}

TEST_CASE(
    "exposure path: corrections of more segments are B-splines too, smooth across their joints",
    "[geometry]") {
  const PathCase c(8, 0.1);
  CHECK(farthest(geometry::corrected_path(c.twists, c.u, c.poses),
                 slow_correction(c.twists, c.u, c.poses)) < 1e-13);
  const double joint = 2.0 / 5;
  const torch::Tensor u =
      torch::tensor({joint - 2e-6, joint - 1e-6, joint + 1e-6, joint + 2e-6}, torch::kFloat64);
  const torch::Tensor still = torch::eye(4, torch::kFloat64).expand({4, 4, 4});
  const torch::Tensor path = geometry::corrected_path(c.twists, u, still);
  CHECK(farthest(path[1] - path[0], path[3] - path[2]) < 1e-10);
  torch::Tensor twists = c.twists.clone().set_requires_grad(true);
  const auto report = test::gradcheck(
      [&](const std::vector<torch::Tensor>& in) {
        return geometry::corrected_path(in[0], c.u, c.poses).square();
      },
      {twists}, {"twists"});
  INFO(report.message);
  CHECK(report.passed);
  CHECK_THROWS_AS(geometry::spline_path(c.twists, c.u, c.control), ContractError);
}

TEST_CASE("exposure path: both kinds are what se3.h's operations make of the equations",
          "[geometry]") {
  for (const int64_t count : {2, 4}) {
    for (const double size : {0.0, 1e-6, 0.05, 0.2}) {
      INFO(count << " twists of " << size);
      const PathCase c(count, size, size);
      CHECK(farthest(geometry::corrected_path(c.twists, c.u, c.poses),
                     slow_correction(c.twists, c.u, c.poses)) < 1e-13);
      CHECK(farthest(geometry::spline_path(c.twists, c.u, c.control),
                     slow_spline(c.twists, c.u, c.control)) < 1e-13);
    }
  }
}

TEST_CASE("exposure path: equal twists are one motion along the whole exposure", "[geometry]") {
  for (const int64_t count : {2, 4}) {
    const PathCase c(count, 0.1);
    const torch::Tensor one = c.twists.narrow(0, 0, 1);
    CHECK(farthest(
              geometry::corrected_path(one.repeat({count, 1}), c.u, c.poses),
              geometry::se3_inverse(geometry::se3_exp(one)).matmul(c.poses.to(torch::kFloat64))) <
          1e-14);
  }
}

TEST_CASE("exposure path: gradients match central differences, at rest too", "[geometry]") {
  for (const int64_t count : {2, 4}) {
    for (const double size : {0.0, 1e-5, 0.2}) {
      INFO(count << " twists of " << size);
      const PathCase c(count, size);
      const torch::Tensor twists = c.twists.clone().requires_grad_();
      const auto corrected = [&](const std::vector<torch::Tensor>& in) {
        return geometry::corrected_path(in[0], c.u, c.poses);
      };
      const auto of_correction = test::gradcheck(corrected, {twists}, {"twists"});
      INFO(of_correction.message);
      CHECK(of_correction.passed);
      const auto spline = [&](const std::vector<torch::Tensor>& in) {
        return geometry::spline_path(in[0], c.u, c.control);
      };
      const auto of_spline = test::gradcheck(spline, {twists}, {"twists"});
      INFO(of_spline.message);
      CHECK(of_spline.passed);
    }
  }
}

TEST_CASE("exposure path: a lost derivative is caught", "[geometry]") {
  const PathCase c(4, 0.2);
  const auto broken = [&](const std::vector<torch::Tensor>& in) {
    const torch::Tensor last = in[0].narrow(0, 3, 1).detach();
    return geometry::corrected_path(torch::cat({in[0].narrow(0, 0, 3), last}), c.u, c.poses);
  };
  CHECK_FALSE(test::gradcheck(broken, {c.twists.clone().requires_grad_()}, {"twists"}).passed);
}

TEST_CASE("exposure path: shapes that do not fit are refused, and no pose is no error",
          "[geometry]") {
  const PathCase c(2, 0.1);
  CHECK_THROWS_AS(geometry::corrected_path(c.twists[0].repeat({3, 1}), c.u, c.poses),
                  ContractError);
  CHECK_THROWS_AS(geometry::corrected_path(c.twists, c.u.narrow(0, 0, 4), c.poses), ContractError);
  CHECK_THROWS_AS(geometry::corrected_path(c.twists.to(torch::kFloat32), c.u, c.poses),
                  ContractError);
  CHECK_THROWS_AS(geometry::spline_path(c.twists, c.u, c.poses), ContractError);
  CHECK(geometry::corrected_path(c.twists, c.u.narrow(0, 0, 0), c.poses.narrow(0, 0, 0)).size(0) ==
        0);
}

TEST_CASE("exposure path: CUDA does as the CPU, forward and backward, and repeats its bits",
          "[geometry][cuda]") {
  for (const int64_t count : {2, 4, 8}) {
    for (const bool corrects : {true, false}) {
      if (count > 4 && !corrects) continue;
      INFO(count << (corrects ? " corrections" : " control poses"));
      const PathCase c(count, 0.2);
      const auto run = [&](torch::Device device) {
        // More poses than a warp has threads.
        const torch::Tensor u = c.u.repeat({9}).to(device);
        const torch::Tensor twists = c.twists.to(device).clone().requires_grad_();
        const torch::Tensor path =
            corrects ? geometry::corrected_path(twists, u, c.poses.repeat({9, 1, 1}).to(device))
                     : geometry::spline_path(twists, u, c.control.to(device));
        const torch::Tensor weight = torch::linspace(-1, 2, path.numel(), torch::kFloat64);
        (path * weight.view_as(path).to(device)).sum().backward();
        return std::pair(path.detach().cpu(), twists.grad().cpu());
      };
      const auto [path, gradient] = run(torch::kCUDA);
      const auto [expected, expected_gradient] = run(torch::kCPU);
      CHECK(farthest(path, expected) < 1e-12);
      CHECK(farthest(gradient, expected_gradient) < 1e-10);
      CHECK(run(torch::kCUDA).second.equal(gradient));
    }
  }
}
