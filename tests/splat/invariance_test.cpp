// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/splat/render.h"
#include "support/gradient_norms.h"
#include "support/splat_scenes.h"

using namespace jade;
using namespace jade::test;
using torch::Tensor;

namespace {

SplatScene float_scene(int64_t views = 3) {
  SplatSceneOptions options;
  options.gaussians = 500;
  options.views = views;
  options.width = 83;
  options.height = 61;
  options.dtype = torch::kFloat32;
  return make_splat_scene(options);
}

/// Colour, and the gradients of the five parameters for a fixed cotangent.
std::vector<Tensor> image_and_gradients(const SplatScene& scene,
                                        const splat::RenderOptions& options = {}) {
  splat::Gaussians g = scene.gaussians;
  require_gradients(g);
  const auto out = splat::render(g, scene.cameras, options);
  (out.color * random_cotangent(out.color)).sum().backward();
  std::vector<Tensor> result = {out.color.detach()};
  for (const Tensor& p : parameters(g)) result.push_back(p.grad());
  return result;
}

}  // namespace

TEST_CASE("render: the order in which Gaussians are stored does not matter", "[splat]") {
  const SplatScene scene = float_scene();
  auto generator = make_generator(5, "permutation");
  const Tensor order = torch::randperm(scene.gaussians.size(), generator);
  SplatScene shuffled = scene;
  std::vector<Tensor> p = parameters(scene.gaussians);
  for (Tensor& t : p) t = t.index_select(0, order);
  shuffled.gaussians = gaussians_from(p);
  const auto a = image_and_gradients(scene), b = image_and_gradients(shuffled);
  CHECK(torch::equal(a[0], b[0]));
  for (int i = 1; i < 6; ++i) {
    INFO(kParameterNames[i - 1]);
    CHECK(torch::equal(a[i].index_select(0, order), b[i]));
  }
}

TEST_CASE("render: equal depths are drawn in the order of the index", "[splat]") {
  SplatSceneOptions options;
  options.gaussians = 2;
  options.views = 1;
  options.sh_degree = 0;
  SplatScene scene = make_splat_scene(options);
  scene.cameras.camera_from_world = torch::eye(4, torch::kFloat64).unsqueeze(0);
  scene.gaussians.means = torch::tensor({{0.0, 0.0, 3.0}, {0.0, 0.0, 3.0}}, torch::kFloat64);
  scene.gaussians.log_scales = torch::full({2, 3}, -1.0, torch::kFloat64);
  scene.gaussians.logit_opacities = torch::full({2}, 3.0, torch::kFloat64);
  scene.gaussians.sh = torch::zeros({2, 1, 3}, torch::kFloat64);
  scene.gaussians.sh[0][0][0] = 1.7;  // red in front
  scene.gaussians.sh[1][0][1] = 1.7;
  const Tensor color = splat::render(scene.gaussians, scene.cameras, {}).color[0];
  CHECK(color[0].max().item<double>() > color[1].max().item<double>() + 0.3);
}

TEST_CASE("render: a batch equals its views rendered one by one", "[splat]") {
  const SplatScene scene = float_scene(4);
  const auto batch = image_and_gradients(scene);
  Tensor sum = torch::zeros_like(batch[1]);
  for (int64_t view = 0; view < 4; ++view) {
    const SplatScene one = select_views(scene, view, view + 1);
    splat::Gaussians g = one.gaussians;
    require_gradients(g);
    const auto out = splat::render(g, one.cameras, {});
    CHECK(torch::equal(out.color[0], batch[0][view]));
    (out.color * random_cotangent(batch[0]).slice(0, view, view + 1)).sum().backward();
    sum = sum + g.means.grad();
  }
  CHECK(torch::allclose(sum, batch[1], 1e-4, 1e-3));
}

TEST_CASE("render: moving world and cameras together changes nothing", "[splat]") {
  SplatSceneOptions options;
  options.sh_degree = 0;  // directions turn with the world
  const SplatScene scene = make_splat_scene(options);
  // A rotation by the unit quaternion (0.5, 0.5, 0.5, 0.5): x → y → z → x; and a shift.
  const Tensor turn =
      torch::tensor({{0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}}, torch::kFloat64);
  const Tensor shift = torch::tensor({1.5, -0.7, 2.2}, torch::kFloat64);
  SplatScene moved = scene;
  moved.gaussians.means = torch::matmul(scene.gaussians.means, turn.t()) + shift;
  const auto q = scene.gaussians.rotations.unbind(1);
  moved.gaussians.rotations = torch::stack({q[0] - q[1] - q[2] - q[3], q[0] + q[1] - q[2] + q[3],
                                            q[0] + q[1] + q[2] - q[3], q[0] - q[1] + q[2] + q[3]},
                                           1);
  Tensor world_from_moved = torch::eye(4, torch::kFloat64);
  world_from_moved.slice(0, 0, 3).slice(1, 0, 3).copy_(turn.t());
  world_from_moved.slice(0, 0, 3).select(1, 3).copy_(-torch::matmul(turn.t(), shift));
  moved.cameras.camera_from_world =
      torch::matmul(scene.cameras.camera_from_world, world_from_moved);
  const Tensor a = splat::render(scene.gaussians, scene.cameras, {}).color;
  const Tensor b = splat::render(moved.gaussians, moved.cameras, {}).color;
  CHECK((a - b).abs().max().item<double>() < 1e-9);
  CHECK(a.max().item<double>() > 0.5);
}

TEST_CASE("render: higher harmonics of zero change nothing", "[splat]") {
  SplatSceneOptions options;
  options.sh_degree = 1;
  const SplatScene low = make_splat_scene(options);
  SplatScene high = low;
  high.gaussians.sh = torch::cat(
      {low.gaussians.sh, torch::zeros({low.gaussians.size(), 12, 3}, torch::kFloat64)}, 1);
  const Tensor a = splat::render(low.gaussians, low.cameras, {}).color;
  const Tensor b = splat::render(high.gaussians, high.cameras, {}).color;
  CHECK((a - b).abs().max().item<double>() < 1e-12);
  splat::RenderOptions degree_one;
  degree_one.sh_degree = 1;
  CHECK(torch::equal(a, splat::render(high.gaussians, high.cameras, degree_one).color));
}

TEST_CASE("render: the principal point shifts the image", "[splat]") {
  SplatSceneOptions options;
  options.views = 1;
  SplatScene scene = make_splat_scene(options);
  // Inside the frustum, so that the Jacobian's clamp has no effect.
  scene.gaussians.means = scene.gaussians.means * torch::tensor({0.6, 0.6, 1.0}, torch::kFloat64);
  SplatScene shifted = scene;
  shifted.cameras.intrinsics = scene.cameras.intrinsics.clone();
  shifted.cameras.intrinsics[0][2] += 5;
  shifted.cameras.intrinsics[0][3] += 3;
  shifted.cameras.width += 5;
  shifted.cameras.height += 3;
  const Tensor a = splat::render(scene.gaussians, scene.cameras, {}).color;
  const Tensor b = splat::render(shifted.gaussians, shifted.cameras, {}).color;
  const Tensor difference = (a - b.slice(2, 3, 3 + 34).slice(3, 5, 5 + 45)).abs();
  CHECK(difference.max().item<double>() < 1e-9);
}

TEST_CASE("render: statistics sum over views and steps what autograd gives", "[splat]") {
  const SplatScene scene = float_scene(3);
  const int64_t n = scene.gaussians.size();
  splat::RenderOptions options;
  options.statistics = splat::ScreenStatistics::zeros(n, torch::kCPU);
  image_and_gradients(scene, options);
  const auto once = splat::ScreenStatistics{options.statistics.gradient_norm.clone(),
                                            options.statistics.visible_count.clone(),
                                            options.statistics.max_radius_px.clone()};
  CHECK(once.visible_count.max().item<float>() == 3);
  CHECK(once.gradient_norm.max().item<float>() > 0);
  CHECK(once.max_radius_px.max().item<float>() > 3 * std::sqrt(0.3f));
  CHECK((once.gradient_norm.masked_select(once.visible_count == 0) == 0).all().item<bool>());
  image_and_gradients(scene, options);
  CHECK(torch::equal(options.statistics.gradient_norm, 2 * once.gradient_norm));
  CHECK(torch::equal(options.statistics.max_radius_px, once.max_radius_px));
}

TEST_CASE("render: the views that do not count leave the statistics alone", "[splat]") {
  const SplatScene scene = float_scene(3);
  const int64_t n = scene.gaussians.size();
  const auto statistics_of = [n](const SplatScene& seen, int64_t counted) {
    splat::Gaussians g = seen.gaussians;
    require_gradients(g);
    splat::RenderOptions options;
    options.statistics = splat::ScreenStatistics::zeros(n, torch::kCPU);
    options.statistics_views = counted;
    splat::render(g, seen.cameras, options).color.square().sum().backward();
    return options.statistics;
  };
  Tensor fewer = torch::zeros({n});
  for (int64_t views = 0; views <= 3; ++views) {
    INFO(views << " views count");
    const splat::ScreenStatistics found = statistics_of(scene, views);
    CHECK(found.visible_count.max().item<float>() == static_cast<float>(views));
    if (views == 0) continue;
    SplatScene alone = scene;
    alone.cameras.camera_from_world = scene.cameras.camera_from_world.narrow(0, 0, views);
    alone.cameras.intrinsics = scene.cameras.intrinsics.narrow(0, 0, views);
    const splat::ScreenStatistics expected = statistics_of(alone, -1);
    CHECK(torch::equal(found.gradient_norm, expected.gradient_norm));
    CHECK(torch::equal(found.visible_count, expected.visible_count));
    CHECK(torch::equal(found.max_radius_px, expected.max_radius_px));
    CHECK((found.gradient_norm >= fewer).all().item<bool>());
    CHECK_FALSE(torch::equal(found.gradient_norm, fewer));
    fewer = found.gradient_norm;
  }
}

TEST_CASE("render: the statistics' norms in float32 are those of float64 but for rounding",
          "[splat]") {
  for (const int64_t views : {-1, 1}) {
    SplatSceneOptions scene_options;
    scene_options.gaussians = 2000;
    scene_options.width = 101;
    scene_options.height = 67;
    scene_options.dtype = torch::kFloat32;
    const SplatScene single = make_splat_scene(scene_options);
    std::vector<Tensor> norms;
    for (const auto dtype : {torch::kFloat32, torch::kFloat64}) {
      splat::RenderOptions options;
      options.statistics = splat::ScreenStatistics::zeros(single.gaussians.size(), torch::kCPU);
      options.statistics_views = views;
      image_and_gradients(move(single, torch::kCPU, dtype), options);
      norms.push_back(options.statistics.gradient_norm);
    }
    const NormDifference rounding = compare_gradient_norms(norms[0], norms[1]);
    CHECK(rounding.beyond_rounding <= kBeyondRounding);
    CHECK(rounding.largest < kLargestFlip);
    // A difference of a hundredth is detected, although the vector's direction is unchanged.
    CHECK(compare_gradient_norms(norms[0] * 1.01, norms[1]).beyond_rounding > 0.1);
  }
}

TEST_CASE("render: the statistics' gradient is that of the screen position", "[splat]") {
  // Moving the principal point moves every mean2d equally, so for a single centred Gaussian
  // dL/dmean2d is the derivative by (cx, cy).
  SplatSceneOptions scene_options;
  scene_options.gaussians = 1;
  scene_options.views = 1;
  SplatScene scene = make_splat_scene(scene_options);
  scene.cameras.camera_from_world = torch::eye(4, torch::kFloat64).unsqueeze(0);
  scene.gaussians.means = torch::tensor({{0.05, -0.1, 3.0}}, torch::kFloat64);
  scene.gaussians.logit_opacities = torch::full({1}, 1.0, torch::kFloat64);
  splat::RenderOptions options;
  options.smooth_cutoff = true;
  options.statistics = splat::ScreenStatistics::zeros(1, torch::kCPU);
  image_and_gradients(scene, options);
  const auto loss = [&](double dx, double dy) {
    splat::CameraBatch cameras = scene.cameras;
    cameras.intrinsics = cameras.intrinsics.clone();
    cameras.intrinsics[0][2] += dx;
    cameras.intrinsics[0][3] += dy;
    splat::RenderOptions smooth;
    smooth.smooth_cutoff = true;
    const Tensor color = splat::render(scene.gaussians, cameras, smooth).color;
    return (color * random_cotangent(color)).sum().item<double>();
  };
  const double step = 1e-5;
  const double gx = (loss(step, 0) - loss(-step, 0)) / (2 * step) * scene.cameras.width / 2;
  const double gy = (loss(0, step) - loss(0, -step)) / (2 * step) * scene.cameras.height / 2;
  CHECK(options.statistics.gradient_norm.item<float>() ==
        Approx(std::sqrt(gx * gx + gy * gy)).epsilon(1e-4));
}
