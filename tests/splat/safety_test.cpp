// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/splat/render.h"
#include "support/splat_scenes.h"

using namespace jade;
using namespace jade::test;
using torch::Tensor;

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

struct Outcome {
  Tensor color;
  int64_t rejected;
  std::vector<Tensor> grads;
};

Outcome run(const SplatScene& scene, bool depth = true) {
  splat::Gaussians g = scene.gaussians;
  require_gradients(g);
  splat::RenderOptions options;
  options.depth = depth;
  const auto out = splat::render(g, scene.cameras, options);
  ((out.color * random_cotangent(out.color)).sum() + out.alpha.sum() +
   (depth ? out.depth.sum() : torch::zeros({})))
      .backward();
  Outcome outcome{out.color.detach(), out.rejected.item<int64_t>(), {}};
  for (const Tensor& p : parameters(g)) outcome.grads.push_back(p.grad());
  return outcome;
}

bool all_finite(const Outcome& outcome) {
  bool finite = torch::isfinite(outcome.color).all().item<bool>();
  for (const Tensor& g : outcome.grads) finite &= torch::isfinite(g).all().item<bool>();
  return finite;
}

SplatScene small_scene(int64_t gaussians = 40) {
  SplatSceneOptions options;
  options.gaussians = gaussians;
  options.dtype = torch::kFloat32;
  return make_splat_scene(options);
}

SplatScene without(const SplatScene& scene, int64_t index) {
  SplatScene rest = scene;
  std::vector<Tensor> p = parameters(scene.gaussians);
  for (Tensor& t : p) t = torch::cat({t.slice(0, 0, index), t.slice(0, index + 1)}, 0);
  rest.gaussians = gaussians_from(p);
  return rest;
}

}  // namespace

TEST_CASE("render: unusable parameters contribute nothing, get no gradient and are counted",
          "[splat]") {
  struct Case {
    const char* name;
    int parameter;
    float value;
  };
  const Case cases[] = {{"NaN mean", 0, kNaN},
                        {"infinite mean", 0, kInf},
                        {"absurd mean", 0, 1e30f},
                        {"NaN rotation", 1, kNaN},
                        {"zero rotation", 1, 0},
                        {"infinite rotation", 1, -kInf},
                        {"NaN scale", 2, kNaN},
                        {"scale of 1e30", 2, std::log(1e30f)},
                        {"scale of 1e-30", 2, std::log(1e-30f)},
                        {"infinite scale", 2, kInf},
                        {"NaN opacity", 3, kNaN},
                        {"opacity 1", 3, kInf},
                        {"opacity 0", 3, -kInf},
                        {"NaN colour", 4, kNaN},
                        {"infinite colour", 4, kInf}};
  const SplatScene scene = small_scene();
  const int64_t victim = 17;
  const Outcome expected = run(without(scene, victim));
  for (const Case& c : cases) {
    INFO(c.name);
    SplatScene bad = scene;
    std::vector<Tensor> p = parameters(scene.gaussians);
    p[c.parameter] = p[c.parameter].clone();
    p[c.parameter][victim].fill_(c.value);
    bad.gaussians = gaussians_from(p);
    const Outcome outcome = run(bad);
    CHECK(outcome.rejected == 1);
    CHECK(torch::equal(outcome.color, expected.color));
    CHECK(all_finite(outcome));
    for (const Tensor& g : outcome.grads) CHECK(g[victim].abs().max().item<float>() == 0);
  }
}

TEST_CASE("render: one bad coordinate is enough to be rejected", "[splat]") {
  SplatScene scene = small_scene();
  scene.gaussians.sh = scene.gaussians.sh.clone();
  scene.gaussians.sh[3][15][2] = kNaN;
  scene.gaussians.means = scene.gaussians.means.clone();
  scene.gaussians.means[8][1] = kInf;
  const Outcome outcome = run(scene);
  CHECK(outcome.rejected == 2);
  CHECK(all_finite(outcome));
}

TEST_CASE("render: finite extremes stay finite", "[splat]") {
  const SplatScene scene = small_scene();
  for (const float logit : {-100.f, 100.f}) {
    SplatScene extreme = scene;
    extreme.gaussians.logit_opacities = torch::full_like(scene.gaussians.logit_opacities, logit);
    const Outcome outcome = run(extreme);
    CHECK(outcome.rejected == 0);
    CHECK(all_finite(outcome));
    CHECK((outcome.color.abs().max().item<float>() == 0) == (logit < 0));
  }
  for (const float log_scale : {-29.f, -12.f, 5.f, 12.f, 29.f}) {
    INFO("log scale " << log_scale);
    SplatScene extreme = scene;
    extreme.gaussians.log_scales = scene.gaussians.log_scales.clone();
    extreme.gaussians.log_scales.slice(0, 0, 20).fill_(log_scale);
    CHECK(all_finite(run(extreme)));
    extreme.gaussians.log_scales.slice(0, 20, 40).select(1, 1).fill_(log_scale);  // needles, discs
    CHECK(all_finite(run(extreme)));
  }
  for (const float length : {1e-11f, 1e11f}) {
    SplatScene extreme = scene;
    extreme.gaussians.rotations =
        scene.gaussians.rotations / scene.gaussians.rotations.norm(2, {1}, true) * length;
    const Outcome outcome = run(extreme);
    CHECK(outcome.rejected == 0);
    CHECK(all_finite(outcome));
    CHECK(torch::allclose(outcome.color, run(scene).color, 1e-3, 1e-3));
  }
}

TEST_CASE("render: Gaussians behind, on or barely before the camera are culled quietly",
          "[splat]") {
  SplatScene scene = small_scene();
  scene.gaussians.means = scene.gaussians.means.clone();
  const Tensor pose = scene.cameras.camera_from_world[0];
  const Tensor center =
      -torch::matmul(pose.slice(0, 0, 3).slice(1, 0, 3).t(), pose.slice(0, 0, 3).select(1, 3));
  scene.gaussians.means[0] = center;                            // on the camera's centre
  scene.gaussians.means.slice(0, 1, 10).select(1, 2).mul_(-1);  // behind
  scene.gaussians.means.slice(0, 10, 20).copy_(center);
  scene.gaussians.means.slice(0, 10, 20).select(1, 2).add_(0.0101);  // just past the near plane
  const Outcome outcome = run(scene);
  CHECK(outcome.rejected == 0);
  CHECK(all_finite(outcome));
  CHECK(outcome.grads[0].slice(0, 1, 10).abs().max().item<float>() == 0);
}

TEST_CASE("render: a camera full of NaN gives the background", "[splat]") {
  SplatScene scene = small_scene();
  scene.cameras.camera_from_world = torch::full_like(scene.cameras.camera_from_world, kNaN);
  const Outcome outcome = run(scene);
  CHECK(outcome.color.abs().max().item<float>() == 0);
  CHECK(all_finite(outcome));
}

TEST_CASE("render: no Gaussians give the background", "[splat]") {
  const SplatScene scene = small_scene();
  splat::Gaussians none = scene.gaussians;
  for (Tensor* t :
       {&none.means, &none.rotations, &none.log_scales, &none.logit_opacities, &none.sh})
    *t = t->narrow(0, 0, 0).clone().set_requires_grad(true);
  splat::RenderOptions options;
  options.depth = true;
  options.background = torch::tensor({0.25f, 0.5f, 1.0f}).set_requires_grad(true);
  const auto out = splat::render(none, scene.cameras, options);
  CHECK(torch::equal(out.color, options.background.view({1, 3, 1, 1}).expand_as(out.color)));
  CHECK(out.alpha.abs().max().item<float>() == 0);
  CHECK(out.depth.abs().max().item<float>() == 0);
  out.color.sum().backward();
  const double pixels = static_cast<double>(out.alpha.numel());
  CHECK(options.background.grad()[1].item<double>() == Approx(pixels));
  CHECK(none.means.grad().numel() == 0);
}

TEST_CASE("render: images of any size work", "[splat]") {
  const int64_t sizes[][2] = {{1, 1},   {1, 40},  {40, 1},  {7, 5},
                              {31, 33}, {32, 32}, {65, 64}, {129, 3}};
  for (const auto& size : sizes) {
    INFO(size[0] << " x " << size[1]);
    SplatSceneOptions options;
    options.width = size[0];
    options.height = size[1];
    options.dtype = torch::kFloat32;
    options.gaussians = 30;
    const Outcome outcome = run(make_splat_scene(options));
    CHECK(outcome.color.sizes() == torch::IntArrayRef({3, 3, size[1], size[0]}));
    CHECK(all_finite(outcome));
  }
}

TEST_CASE("render: a million Gaussians in one tile work", "[splat]") {
  SplatSceneOptions options;
  options.gaussians = 1000000;
  options.views = 1;
  options.width = 16;
  options.height = 16;
  options.sh_degree = 0;
  options.sigma_px = 0.5;
  options.dtype = torch::kFloat32;
  SplatScene scene = make_splat_scene(options);
  scene.gaussians.logit_opacities = scene.gaussians.logit_opacities - 4;
  const Outcome outcome = run(scene, false);
  CHECK(outcome.rejected == 0);
  CHECK(all_finite(outcome));
  CHECK(outcome.color.max().item<float>() > 0.1f);
}
