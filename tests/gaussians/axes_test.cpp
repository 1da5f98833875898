// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/axes.h"

#include "support/catch.h"

#include <cmath>

#include "jade/geometry/pose.h"
#include "jade/splat/render.h"
#include "random_gaussians.h"

namespace jade::gaussians {
namespace {

/// The view of a camera along z, transformed together with the scene by x → scale · R x + shift.
torch::Tensor seen(const splat::Gaussians& gaussians, const torch::Tensor& rotation, double scale,
                   const torch::Tensor& shift) {
  // camera_from_world of the transformed world: C x / scale, whose picture is the same as that of C
  // x.
  torch::Tensor camera = torch::eye(4, torch::kFloat64);
  camera[2][3] = 6;
  torch::Tensor world = torch::eye(4, torch::kFloat64);
  world.slice(0, 0, 3).slice(1, 0, 3).copy_(rotation.t());
  world.slice(0, 0, 3).select(1, 3).copy_(-rotation.t().mv(shift));
  camera.slice(0, 0, 3).select(1, 3).mul_(scale);
  const torch::Tensor pose = camera.mm(world).to(torch::kFloat32).unsqueeze(0);
  splat::CameraBatch cameras{pose, torch::tensor({{40.f, 40.f, 24.f, 16.f}}), 48, 32};
  splat::RenderOptions options;
  options.near_plane = 0.01 * scale;
  return splat::render(gaussians, cameras, options).color;
}

TEST_CASE("axes: a moved camera sees of moved Gaussians what it saw before", "[gaussians]") {
  const torch::Tensor none = torch::eye(3, torch::kFloat64);
  const torch::Tensor zero = torch::zeros({3}, torch::kFloat64);
  const geometry::Matrix3 r = geometry::rotation_from_quaternion({0.6, -0.3, 0.7, 0.2});
  const torch::Tensor rotation =
      torch::from_blob(const_cast<double*>(r.data()), {3, 3}, torch::kFloat64).clone();
  const torch::Tensor shift = torch::tensor({0.5, -1.0, 2.0}, torch::kFloat64);
  for (const int64_t coefficients : {1, 4, 9, 16}) {
    const splat::Gaussians g = test::random_gaussians(40, coefficients);
    const torch::Tensor before = seen(g, none, 1, zero);
    CHECK(before.max().item<double>() > 0.2);
    const torch::Tensor after = seen(moved(g, rotation, 3, shift), rotation, 3, shift);
    CHECK((before - after).abs().max().item<double>() < 2e-4);
    splat::Gaussians wrong = moved(g, rotation, 3, shift);
    wrong.sh = g.sh;
    const double error = (before - seen(wrong, rotation, 3, shift)).abs().max().item<double>();
    CHECK((error > 0.01) == (coefficients > 1));
  }
}

TEST_CASE("axes: half a turn about x is that motion, and undoes itself", "[gaussians]") {
  const splat::Gaussians g = test::random_gaussians(40, 16);
  const torch::Tensor turn = torch::diag(torch::tensor({1.0, -1.0, -1.0}, torch::kFloat64));
  const torch::Tensor zero = torch::zeros({3}, torch::kFloat64);
  const splat::Gaussians turned = half_turn(g);
  CHECK(torch::allclose(turned.sh, moved(g, turn, 1, zero).sh, 1e-5, 1e-6));
  CHECK((seen(g, torch::eye(3, torch::kFloat64), 1, zero) - seen(turned, turn, 1, zero))
            .abs()
            .max()
            .item<double>() < 2e-4);
  const splat::Gaussians back = half_turn(turned);
  for (int i = 0; i < kParameterCount; ++i) CHECK(parameter(back, i).equal(parameter(g, i)));
}

}  // namespace
}  // namespace jade::gaussians
