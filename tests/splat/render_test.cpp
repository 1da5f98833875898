// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/render.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "support/dense_reference.h"
#include "support/splat_scenes.h"

using namespace jade;
using namespace jade::test;
using splat::RenderOptions;
using splat::RenderOutput;
using torch::Tensor;

namespace {

double largest_difference(const Tensor& a, const Tensor& b) {
  return (a.to(torch::kFloat64) - b.to(torch::kFloat64)).abs().max().item<double>();
}

/// ‖a − b‖ / ‖b‖
double relative_difference(const Tensor& a, const Tensor& b) {
  const Tensor x = a.to(torch::kFloat64), y = b.to(torch::kFloat64);
  return ((x - y).norm() / y.norm().clamp_min(1e-30)).item<double>();
}

/// Gradients of every input for a fixed cotangent on every output.
std::vector<Tensor> gradients(const SplatScene& scene, RenderOptions options, bool dense) {
  SplatScene s = scene;
  require_gradients(s.gaussians);
  s.cameras.camera_from_world = scene.cameras.camera_from_world.clone().set_requires_grad(true);
  if (options.background.defined()) {
    options.background = options.background.clone().set_requires_grad(true);
  }
  const RenderOutput out = dense ? dense_render(s.gaussians, s.cameras, options)
                                 : splat::render(s.gaussians, s.cameras, options);
  Tensor loss = (out.color * random_cotangent(out.color, 1)).sum() +
                (out.alpha * random_cotangent(out.alpha, 2)).sum();
  if (options.depth) loss = loss + 0.1 * (out.depth * random_cotangent(out.depth, 3)).sum();
  loss.backward();
  std::vector<Tensor> grads;
  for (const Tensor& p : parameters(s.gaussians)) grads.push_back(p.grad());
  grads.push_back(s.cameras.camera_from_world.grad().slice(1, 0, 3));
  if (options.background.defined()) grads.push_back(options.background.grad());
  return grads;
}

}  // namespace

TEST_CASE("render: images equal the dense reference", "[splat]") {
  RenderOptions options;
  options.depth = true;
  options.background = torch::tensor({0.2, 0.5, 0.9}, torch::kFloat64);
  for (const bool antialiased : {false, true}) {
    for (const int degree : {0, 1, 2, 3}) {
      options.antialiased = antialiased;
      options.sh_degree = degree;
      const SplatScene scene = make_splat_scene();
      const RenderOutput ours = splat::render(scene.gaussians, scene.cameras, options);
      const RenderOutput dense = dense_render(scene.gaussians, scene.cameras, options);
      INFO("antialiased " << antialiased << ", degree " << degree);
      CHECK(largest_difference(ours.color, dense.color) < 1e-9);
      CHECK(largest_difference(ours.alpha, dense.alpha) < 1e-9);
      CHECK(largest_difference(ours.depth, dense.depth) < 1e-7);
      CHECK(ours.rejected.item<int64_t>() == 0);
    }
  }
}

TEST_CASE("render: stopped pixels equal the dense reference", "[splat]") {
  SplatSceneOptions scene_options;
  scene_options.gaussians = 400;
  scene_options.sigma_px = 6;
  SplatScene scene = make_splat_scene(scene_options);
  scene.gaussians.logit_opacities = scene.gaussians.logit_opacities + 2;
  const RenderOutput ours = splat::render(scene.gaussians, scene.cameras, {});
  const RenderOutput dense = dense_render(scene.gaussians, scene.cameras, {});
  CHECK(ours.alpha.min().item<double>() > 0.3);
  CHECK((ours.alpha > 0.999).to(torch::kFloat64).mean().item<double>() > 0.3);
  CHECK(largest_difference(ours.color, dense.color) < 1e-9);
  CHECK(largest_difference(ours.alpha, dense.alpha) < 1e-9);
}

TEST_CASE("render: gradients equal the dense reference's", "[splat]") {
  const char* const names[] = {"means", "rotations", "log_scales", "logit_opacities",
                               "sh",    "camera",    "background"};
  RenderOptions options;
  options.background = torch::tensor({0.2, 0.5, 0.9}, torch::kFloat64);
  for (const bool antialiased : {false, true}) {
    for (const bool depth : {false, true}) {
      options.antialiased = antialiased;
      options.depth = depth;
      SplatSceneOptions scene_options;
      scene_options.gaussians = 150;
      const SplatScene scene = make_splat_scene(scene_options);
      const auto ours = gradients(scene, options, false);
      const auto dense = gradients(scene, options, true);
      for (size_t i = 0; i < ours.size(); ++i) {
        INFO(names[i] << ", antialiased " << antialiased << ", depth " << depth);
        CHECK(relative_difference(ours[i], dense[i]) < 1e-8);
      }
    }
  }
}

TEST_CASE("render: float agrees with double", "[splat]") {
  SplatSceneOptions scene_options;
  scene_options.gaussians = 300;
  scene_options.width = 70;
  scene_options.height = 50;
  const SplatScene precise = make_splat_scene(scene_options);
  const SplatScene single = move(precise, torch::kCPU, torch::kFloat32);
  // The double scene must contain exactly the numbers of the float one.
  const SplatScene rounded = move(single, torch::kCPU, torch::kFloat64);
  RenderOptions options;
  options.depth = true;
  const RenderOutput a = splat::render(single.gaussians, single.cameras, options);
  const RenderOutput b = splat::render(rounded.gaussians, rounded.cameras, options);
  CHECK(a.color.scalar_type() == torch::kFloat32);
  // A cut-off that differs by rounding changes a pixel by up to 1/255.
  const Tensor difference = (a.color.to(torch::kFloat64) - b.color).abs();
  CHECK(difference.max().item<double>() < 1.5 / 255);
  CHECK((difference > 2e-5).to(torch::kFloat64).mean().item<double>() < 1e-3);
  const auto grads_a = gradients(single, {}, false), grads_b = gradients(rounded, {}, false);
  for (size_t i = 0; i < grads_a.size(); ++i) {
    INFO("gradient " << i);
    CHECK(relative_difference(grads_a[i], grads_b[i]) < 2e-3);
  }
}

TEST_CASE("render: what is nearer than the near plane is not drawn and gets no gradient",
          "[splat]") {
  const SplatScene all = select_views(make_splat_scene(), 0, 1);
  const Tensor pose = all.cameras.camera_from_world[0];
  const Tensor depth =
      torch::matmul(all.gaussians.means, pose[2].slice(0, 0, 3)) + pose[2][3].item<double>();
  RenderOptions options;
  options.near_plane = depth.median().item<double>();
  const Tensor kept = (depth >= options.near_plane).nonzero().squeeze(1);
  REQUIRE(kept.size(0) < depth.size(0));
  SplatScene rest = all;
  for (Tensor* t : {&rest.gaussians.means, &rest.gaussians.rotations, &rest.gaussians.log_scales,
                    &rest.gaussians.logit_opacities, &rest.gaussians.sh}) {
    *t = t->index_select(0, kept);
  }
  const Tensor cut = splat::render(all.gaussians, all.cameras, options).color;
  CHECK(torch::equal(cut, splat::render(rest.gaussians, rest.cameras, {}).color));
  CHECK(largest_difference(cut, splat::render(all.gaussians, all.cameras, {}).color) > 0.01);
  CHECK(largest_difference(cut, dense_render(all.gaussians, all.cameras, options).color) < 1e-9);
  const Tensor of_means = gradients(all, options, false)[0];
  const Tensor hidden = (depth < options.near_plane).unsqueeze(1);
  CHECK((of_means * hidden).abs().max().item<double>() == 0);
  CHECK(of_means.abs().max().item<double>() > 0);
}

TEST_CASE("render: an empty view is the background", "[splat]") {
  SplatSceneOptions scene_options;
  scene_options.gaussians = 0;
  SplatScene scene = make_splat_scene(scene_options);
  RenderOptions options;
  options.depth = true;
  options.background = torch::tensor({0.25, 0.5, 1.0}, torch::kFloat64).set_requires_grad(true);
  require_gradients(scene.gaussians);
  const RenderOutput out = splat::render(scene.gaussians, scene.cameras, options);
  CHECK(
      torch::equal(out.color, options.background.detach().view({1, 3, 1, 1}).expand_as(out.color)));
  CHECK(out.alpha.abs().max().item<double>() == 0);
  CHECK(out.depth.abs().max().item<double>() == 0);
  out.color.sum().backward();
  CHECK(scene.gaussians.means.grad().sizes() == torch::IntArrayRef({0, 3}));
  const double pixels = 3.0 * 45 * 34;
  CHECK(torch::allclose(options.background.grad(), torch::full({3}, pixels, torch::kFloat64)));
}

TEST_CASE("render: a hard edge lies at the pixel centre", "[splat]") {
  // One tiny Gaussian straight ahead projects onto (cx, cy); its peak is at centres +0.5.
  splat::Gaussians g;
  g.means = torch::tensor({{0.0, 0.0, 1.0}}, torch::kFloat64);
  g.rotations = torch::tensor({{1.0, 0.0, 0.0, 0.0}}, torch::kFloat64);
  g.log_scales = torch::full({1, 3}, -20.0, torch::kFloat64);
  g.logit_opacities = torch::full({1}, std::log(0.5 / 0.5), torch::kFloat64);
  g.sh = torch::full({1, 1, 3}, 0.5 / 0.28209479177387814, torch::kFloat64);  // white
  splat::CameraBatch cameras{torch::eye(4, torch::kFloat64).unsqueeze(0),
                             torch::tensor({{10.0, 10.0, 4.5, 2.5}}, torch::kFloat64), 9, 5};
  const RenderOutput out = splat::render(g, cameras, {});
  CHECK(out.color[0][0][2][4].item<double>() == Approx(0.5).epsilon(1e-9));
  // One pixel to the side: variance 0.3 px².
  CHECK(out.color[0][0][2][5].item<double>() == Approx(0.5 * std::exp(-0.5 / 0.3)).epsilon(1e-6));
  CHECK(out.color[0][0][1][4].item<double>() == Approx(0.5 * std::exp(-0.5 / 0.3)).epsilon(1e-6));
}

TEST_CASE("render: colours below zero are clamped and pass no gradient", "[splat]") {
  SplatSceneOptions scene_options;
  scene_options.sh_degree = 0;
  SplatScene scene = make_splat_scene(scene_options);
  scene.gaussians.sh = torch::full_like(scene.gaussians.sh, -10);
  require_gradients(scene.gaussians);
  const RenderOutput out = splat::render(scene.gaussians, scene.cameras, {});
  CHECK(out.color.abs().max().item<double>() == 0);
  (out.color * random_cotangent(out.color)).sum().backward();
  CHECK(scene.gaussians.sh.grad().abs().max().item<double>() == 0);
}

TEST_CASE("render: inputs that do not fit are refused", "[splat]") {
  const SplatScene scene = make_splat_scene();
  SplatScene bad = scene;
  bad.gaussians.rotations = bad.gaussians.rotations.slice(1, 0, 3);
  CHECK_THROWS_AS(splat::render(bad.gaussians, bad.cameras, {}), ContractError);
  bad = scene;
  bad.gaussians.sh = bad.gaussians.sh.slice(1, 0, 5);
  CHECK_THROWS_AS(splat::render(bad.gaussians, bad.cameras, {}), ContractError);
  bad = scene;
  bad.gaussians.log_scales = bad.gaussians.log_scales.to(torch::kFloat32);
  CHECK_THROWS_AS(splat::render(bad.gaussians, bad.cameras, {}), ContractError);
  bad = scene;
  bad.cameras.width = 0;
  CHECK_THROWS_AS(splat::render(bad.gaussians, bad.cameras, {}), ContractError);
  bad = scene;
  bad.cameras.intrinsics = bad.cameras.intrinsics.slice(0, 0, 1);
  CHECK_THROWS_AS(splat::render(bad.gaussians, bad.cameras, {}), ContractError);
  RenderOptions options;
  options.sh_degree = 4;
  CHECK_THROWS_AS(splat::render(scene.gaussians, scene.cameras, options), ContractError);
}
