// SPDX-License-Identifier: Apache-2.0
#include "support/splat_scenes.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/random.h"

namespace jade::test {

using torch::Tensor;

const char* const kParameterNames[5] = {"means", "rotations", "log_scales", "logit_opacities",
                                        "sh"};

namespace {

/// A rotation by `angle` about the y axis and a shift.
Tensor pose(double angle, double x, double y, double z) {
  Tensor m = torch::eye(4, torch::kFloat64);
  m[0][0] = std::cos(angle);
  m[2][2] = std::cos(angle);
  m[0][2] = std::sin(angle);
  m[2][0] = -std::sin(angle);
  m[0][3] = x;
  m[1][3] = y;
  m[2][3] = z;
  return m;
}

}  // namespace

SplatScene make_splat_scene(const SplatSceneOptions& o) {
  auto generator = make_generator(o.seed, "splat scene");
  const auto f64 = torch::TensorOptions().dtype(torch::kFloat64);
  const auto uniform = [&](std::vector<int64_t> shape) {
    return torch::rand(shape, generator, f64);
  };
  const auto normal = [&](std::vector<int64_t> shape) {
    return torch::randn(shape, generator, f64);
  };
  const double focal = 0.9 * o.width;
  const Tensor z = 2 + 4 * uniform({o.gaussians});
  const Tensor x = (uniform({o.gaussians}) - 0.5) * 1.4 * o.width / focal * z;
  const Tensor y = (uniform({o.gaussians}) - 0.5) * 1.4 * o.height / focal * z;
  SplatScene scene;
  scene.gaussians.means = torch::stack({x, y, z}, 1);
  scene.gaussians.rotations = normal({o.gaussians, 4});
  scene.gaussians.log_scales =
      torch::log(o.sigma_px * z / focal).unsqueeze(1) + 0.6 * normal({o.gaussians, 3});
  scene.gaussians.logit_opacities = 1.5 * normal({o.gaussians});
  const int64_t coefficients = (o.sh_degree + 1) * (o.sh_degree + 1);
  scene.gaussians.sh = torch::cat(
      {0.8 * normal({o.gaussians, 1, 3}), 0.2 * normal({o.gaussians, coefficients - 1, 3})}, 1);
  std::vector<Tensor> poses, intrinsics;
  for (int64_t view = 0; view < o.views; ++view) {
    const double t = o.views > 1 ? 2.0 * view / (o.views - 1) - 1 : 0.5;
    poses.push_back(pose(0.05 * t, 0.1 * t, -0.04 * t * t, 0.08 * t));
    intrinsics.push_back(
        torch::tensor({focal, 1.05 * focal, 0.5 * o.width + 1.7 + t, 0.5 * o.height - 2.3}, f64));
  }
  scene.cameras = {torch::stack(poses), torch::stack(intrinsics), o.width, o.height};
  return move(scene, torch::kCPU, o.dtype);
}

SplatScene make_splat_workload(int64_t n, int64_t width, int64_t height) {
  auto generator = at::make_generator<at::CPUGeneratorImpl>(0);
  const auto uniform = [&](std::vector<int64_t> shape) { return torch::rand(shape, generator); };
  const auto normal = [&](std::vector<int64_t> shape) { return torch::randn(shape, generator); };
  const double focal = 0.9 * width;
  const Tensor z = 3.0 + 4.0 * uniform({n});
  const Tensor x = (uniform({n}) - 0.5) * 1.1 * width / focal * z;
  const Tensor y = (uniform({n}) - 0.5) * 1.1 * height / focal * z;
  const Tensor scales = (2.0 * z / focal).unsqueeze(1) * torch::exp(0.5 * normal({n, 3}));
  SplatScene scene;
  scene.gaussians.rotations = normal({n, 4});
  scene.gaussians.logit_opacities = 1.5 * normal({n});
  const Tensor dc = 0.8 * normal({n, 1, 3});
  scene.gaussians.sh = torch::cat({dc, 0.1 * normal({n, 15, 3})}, 1);
  scene.gaussians.means = torch::stack({x, y, z}, -1);
  scene.gaussians.log_scales = torch::log(scales);
  std::vector<Tensor> poses;
  for (int k = 0; k < 9; ++k) {
    const double t = (k - 4) / 4.0;
    poses.push_back(pose(1.2 * t * M_PI / 180, 0.016 * t, 0.008 * t * t, 0.004 * t));
  }
  const Tensor intrinsics =
      torch::tensor({focal, focal, width / 2.0, height / 2.0}, torch::kFloat64).repeat({9, 1});
  scene.cameras = {torch::stack(poses), intrinsics, width, height};
  return move(scene, torch::kCPU, torch::kFloat32);
}

SplatScene move(const SplatScene& scene, torch::Device device, torch::ScalarType dtype) {
  const auto to = [&](const Tensor& t) { return t.detach().to(device, dtype).contiguous(); };
  SplatScene moved = scene;
  moved.gaussians = {to(scene.gaussians.means), to(scene.gaussians.rotations),
                     to(scene.gaussians.log_scales), to(scene.gaussians.logit_opacities),
                     to(scene.gaussians.sh)};
  moved.cameras.camera_from_world = to(scene.cameras.camera_from_world);
  moved.cameras.intrinsics = to(scene.cameras.intrinsics);
  return moved;
}

SplatScene select_views(const SplatScene& scene, int64_t begin, int64_t end) {
  SplatScene selected = scene;
  selected.cameras.camera_from_world = scene.cameras.camera_from_world.slice(0, begin, end);
  selected.cameras.intrinsics = scene.cameras.intrinsics.slice(0, begin, end);
  return selected;
}

void require_gradients(splat::Gaussians& g) {
  for (Tensor* t : {&g.means, &g.rotations, &g.log_scales, &g.logit_opacities, &g.sh}) {
    *t = t->detach().clone().set_requires_grad(true);
  }
}

std::vector<Tensor> parameters(const splat::Gaussians& g) {
  return {g.means, g.rotations, g.log_scales, g.logit_opacities, g.sh};
}

splat::Gaussians gaussians_from(const std::vector<Tensor>& p) {
  return {p[0], p[1], p[2], p[3], p[4]};
}

Tensor random_cotangent(const Tensor& like, uint64_t seed) {
  auto generator = make_generator(seed, "cotangent");
  return torch::randn(like.sizes(), generator, torch::TensorOptions().dtype(torch::kFloat64))
      .to(like.options().requires_grad(false));
}

}  // namespace jade::test
