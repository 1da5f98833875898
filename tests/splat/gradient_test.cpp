// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <torch/csrc/autograd/autograd.h>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/splat/render.h"
#include "support/gradcheck.h"
#include "support/splat_scenes.h"

using namespace jade;
using namespace jade::test;
using splat::RenderOptions;
using torch::Tensor;

namespace {

SplatScene small_scene(int degree, uint64_t seed = 3) {
  SplatSceneOptions options;
  options.gaussians = 14;
  options.views = 2;
  options.width = 19;
  options.height = 13;
  options.sh_degree = degree;
  options.sigma_px = 2;
  options.seed = seed;
  SplatScene scene = make_splat_scene(options);
  // Keep clear of the kink of max(0, colour).
  scene.gaussians.sh = scene.gaussians.sh * 0.4;
  return scene;
}

/// All outputs as one vector, so that one cotangent weights all of their elements.
Tensor flatten(const splat::RenderOutput& out) {
  std::vector<Tensor> parts = {out.color.flatten(), out.alpha.flatten()};
  if (out.depth.defined()) parts.push_back(out.depth.flatten());
  return torch::cat(parts);
}

GradcheckReport check_scene(const SplatScene& scene, RenderOptions options,
                            const std::function<Tensor(const Tensor&)>& spoil = nullptr) {
  options.smooth_cutoff = true;
  std::vector<Tensor> inputs = parameters(scene.gaussians);
  inputs.push_back(scene.cameras.camera_from_world);
  inputs.push_back(torch::tensor({0.3, 0.6, 0.1}, torch::kFloat64));
  for (Tensor& t : inputs) t = t.clone().set_requires_grad(true);
  std::vector<std::string> names(kParameterNames, kParameterNames + 5);
  names.insert(names.end(), {"camera_from_world", "background"});
  const auto fn = [&](const std::vector<Tensor>& in) {
    splat::CameraBatch cameras = scene.cameras;
    cameras.camera_from_world = in[5];
    RenderOptions with_background = options;
    with_background.background = in[6];
    std::vector<Tensor> raw(in.begin(), in.begin() + 5);
    if (spoil) raw[0] = spoil(raw[0]);
    return flatten(splat::render(gaussians_from(raw), cameras, with_background));
  };
  return gradcheck(fn, inputs, names);
}

/// The identity, whose derivative zeroes `component`.
struct DropComponent : torch::autograd::Function<DropComponent> {
  static Tensor forward(torch::autograd::AutogradContext* ctx, const Tensor& x, int64_t component) {
    ctx->saved_data["component"] = component;
    return x.clone();
  }
  static torch::autograd::tensor_list backward(torch::autograd::AutogradContext* ctx,
                                               const torch::autograd::tensor_list& g) {
    Tensor grad = g[0].clone();
    grad.select(1, ctx->saved_data["component"].toInt()).zero_();
    return {grad, Tensor()};
  }
};

}  // namespace

TEST_CASE("render: gradients of every input match central differences", "[splat][gradcheck]") {
  for (const int degree : {0, 1, 2, 3}) {
    RenderOptions options;
    options.depth = degree == 3;
    const auto report = check_scene(small_scene(degree), options);
    INFO("degree " << degree << ": " << report.message);
    CHECK(report.passed);
    CHECK(report.checked > 14 * 11);
  }
}

TEST_CASE("render: antialiased gradients match central differences", "[splat][gradcheck]") {
  RenderOptions options;
  options.antialiased = true;
  const auto report = check_scene(small_scene(1), options);
  INFO(report.message);
  CHECK(report.passed);
}

TEST_CASE("render: gradients through the clamped Jacobian match central differences",
          "[splat][gradcheck]") {
  // Large Gaussians far outside the frustum, where x/z and y/z are clamped, still reach the image.
  SplatScene scene = small_scene(1);
  scene.gaussians.means.select(1, 0).mul_(2.2);
  scene.gaussians.means.select(1, 1).mul_(2.4);
  scene.gaussians.log_scales.add_(1.6);
  const auto report = check_scene(scene, {});
  INFO(report.message);
  CHECK(report.passed);
  const Tensor ratio =
      (scene.gaussians.means.select(1, 0) / scene.gaussians.means.select(1, 2)).abs();
  CHECK((ratio > 0.75).sum().item<int64_t>() >= 3);
}

TEST_CASE("render: an active degree below the stored one leaves the rest without gradient",
          "[splat][gradcheck]") {
  RenderOptions options;
  options.sh_degree = 1;
  const SplatScene scene = small_scene(3);
  const auto report = check_scene(scene, options);
  INFO(report.message);
  CHECK(report.passed);
  splat::Gaussians g = scene.gaussians;
  require_gradients(g);
  splat::render(g, scene.cameras, options).color.sum().backward();
  CHECK(g.sh.grad().slice(1, 4, 16).abs().max().item<double>() == 0);
  CHECK(g.sh.grad().slice(1, 0, 4).abs().max().item<double>() > 0);
}

TEST_CASE("render: a dropped gradient component is caught", "[splat][gradcheck]") {
  for (const int64_t component : {0, 1, 2}) {
    const auto report = check_scene(small_scene(1), {}, [&](const Tensor& means) {
      return DropComponent::apply(means, component);
    });
    INFO("component " << component);
    CHECK_FALSE(report.passed);
    CHECK(report.message.find("means[") == 0);
  }
}

TEST_CASE("render: the op refuses to be differentiated twice quietly", "[splat]") {
  SplatScene scene = small_scene(0);
  require_gradients(scene.gaussians);
  const auto out = splat::render(scene.gaussians, scene.cameras, {});
  const auto grads =
      torch::autograd::grad({out.color.square().sum()}, {scene.gaussians.means}, {}, true, true);
  // The first derivative depends on the parameters through the op, which has no second derivative:
  // requesting it must throw rather than return a part.
  CHECK_THROWS(torch::autograd::grad({grads[0].square().sum()}, {scene.gaussians.means}));
}

TEST_CASE("render: backward can run twice on a retained graph", "[splat]") {
  SplatScene scene = small_scene(2);
  require_gradients(scene.gaussians);
  const auto out = splat::render(scene.gaussians, scene.cameras, {});
  const Tensor loss = out.color.square().sum();
  const auto once = torch::autograd::grad({loss}, {scene.gaussians.means}, {}, true);
  const auto twice = torch::autograd::grad({loss}, {scene.gaussians.means}, {}, true);
  CHECK(torch::equal(once[0], twice[0]));
}
