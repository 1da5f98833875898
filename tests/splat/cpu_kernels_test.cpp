// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <ATen/Parallel.h>
#include <initializer_list>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/splat/cpu/dispatch.h"
#include "jade/splat/render.h"
#include "support/splat_scenes.h"

using namespace jade;
using namespace jade::test;
using torch::Tensor;

namespace {

/// Restores the number of threads.
struct RestoreThreads {
  int threads = at::get_num_threads();
  ~RestoreThreads() { at::set_num_threads(threads); }
};

SplatScene scene_of(torch::ScalarType dtype) {
  SplatSceneOptions options;
  options.gaussians = 3000;
  options.width = 150;
  options.height = 110;
  options.dtype = dtype;
  return make_splat_scene(options);
}

/// Colour, alpha, depth and all gradients.
std::vector<Tensor> everything(const SplatScene& scene) {
  splat::Gaussians g = scene.gaussians;
  require_gradients(g);
  splat::CameraBatch cameras = scene.cameras;
  cameras.camera_from_world = cameras.camera_from_world.clone().set_requires_grad(true);
  splat::RenderOptions options;
  options.depth = true;
  options.background = torch::full({3}, 0.4, g.means.options().requires_grad(false));
  options.background.set_requires_grad(true);
  const auto out = splat::render(g, cameras, options);
  ((out.color * random_cotangent(out.color, 1)).sum() +
   (out.alpha * random_cotangent(out.alpha, 2)).sum() +
   (out.depth * random_cotangent(out.depth, 3)).sum())
      .backward();
  std::vector<Tensor> all = {out.color.detach(), out.alpha.detach(), out.depth.detach()};
  for (const Tensor& p : parameters(g)) all.push_back(p.grad());
  all.push_back(cameras.camera_from_world.grad());
  all.push_back(options.background.grad());
  return all;
}

double relative_difference(const Tensor& a, const Tensor& b) {
  return ((a - b).norm() / b.norm()).item<double>();
}

void expect_same_bits(const SplatScene& scene, std::initializer_list<int> thread_counts) {
  at::set_num_threads(1);
  const auto one = everything(scene);
  for (const int threads : thread_counts) {
    at::set_num_threads(threads);
    const auto many = everything(scene);
    for (size_t i = 0; i < one.size(); ++i) {
      INFO(threads << " threads, result " << i);
      CHECK(torch::equal(one[i], many[i]));
    }
  }
}

}  // namespace

TEST_CASE("cpu kernels: any number of threads gives the same bits", "[splat]") {
  const RestoreThreads restore;
  for (const auto dtype : {torch::kFloat32, torch::kFloat64}) {
    expect_same_bits(scene_of(dtype), {1, 2, 3, 7});
  }
}

TEST_CASE("cpu kernels: one view on any number of threads gives the same bits", "[splat]") {
  const RestoreThreads restore;
  for (const auto dtype : {torch::kFloat32, torch::kFloat64}) {
    SplatScene scene = select_views(scene_of(dtype), 0, 1);
    expect_same_bits(scene, {2, 4, 16});
    // Equal depths in every tile: with another order than the index's the image differs.
    const Tensor pose = scene.cameras.camera_from_world[0];
    Tensor& means = scene.gaussians.means;
    const Tensor forward = pose[2].slice(0, 0, 3);
    const Tensor depth = torch::mv(means, forward) + pose[2][3];
    means = means - (depth - torch::round(depth)).unsqueeze(1) * forward;
    expect_same_bits(scene, {2, 4, 16});
  }
}

TEST_CASE("cpu kernels: equal depths are drawn in the order of the index", "[splat]") {
  // A stack at one depth, more than a chunk of Gaussians, whose first ones are bright. One more
  // behind it, because equal depths would need no sorting.
  constexpr int64_t kCount = 1500;
  splat::Gaussians g;
  g.means = torch::tensor({0.0f, 0.0f, 2.0f}).repeat({kCount, 1});
  g.rotations = torch::tensor({1.0f, 0.0f, 0.0f, 0.0f}).repeat({kCount, 1});
  g.log_scales = torch::full({kCount, 3}, 2.0f);
  g.logit_opacities = torch::full({kCount}, 8.0f);
  g.sh = torch::full({kCount, 1, 3}, -1.0f);
  g.means[0][2] = 3.0f;
  g.sh.slice(0, 1, 3).fill_(1.0f);
  const splat::CameraBatch cameras = {torch::eye(4).unsqueeze(0),
                                      torch::tensor({{40.0f, 40.0f, 18.5f, 17.0f}}), 37, 34};
  const Tensor front = splat::render(g, cameras, {}).color;
  CHECK(front.min().item<double>() > 0.75);
  g.means.slice(0, kCount - 2).select(1, 2).fill_(1.9f);
  CHECK(splat::render(g, cameras, {}).color.max().item<double>() < 0.25);
}

TEST_CASE("cpu kernels: the image has the same bits for any tile size", "[splat]") {
  for (const auto dtype : {torch::kFloat32, torch::kFloat64}) {
    const SplatScene scene = scene_of(dtype);
    const auto usual = everything(scene);
    for (const int shift : {5, 0, 2, 3, 4}) {
      const splat::cpu::ForcedTileShift forced(shift);
      CHECK(splat::cpu::tile_shift() == shift);
      const auto other = everything(scene);
      INFO("tiles of " << (1 << shift) << " px");
      for (int i = 0; i < 3; ++i) CHECK(torch::equal(usual[i], other[i]));
      // Sums over pixels are in another order.
      for (size_t i = 3; i < usual.size(); ++i) {
        CHECK(relative_difference(other[i], usual[i]) < (dtype == torch::kFloat32 ? 2e-4 : 1e-11));
      }
    }
  }
  CHECK_THROWS_AS(splat::cpu::ForcedTileShift(6), ContractError);
  CHECK(splat::cpu::tile_shift() == splat::cpu::kDefaultTileShift);
}

TEST_CASE("cpu kernels: every instruction set gives the portable image and gradients", "[splat]") {
  for (const auto dtype : {torch::kFloat32, torch::kFloat64}) {
    const SplatScene scene = scene_of(dtype);
    const auto portable = [&] {
      const kernel::ForcedIsa forced(kernel::Isa::kPortable);
      CHECK(&splat::cpu::kernels() == &splat::cpu::portable::kKernels);
      return everything(scene);
    }();
    for (const kernel::Isa isa : kernel::kIsas) {
      if (!kernel::can_run(isa)) continue;
      const kernel::ForcedIsa forced(isa);
      INFO(kernel::name(isa));
      CHECK((&splat::cpu::kernels() == &splat::cpu::portable::kKernels) ==
            (isa == kernel::Isa::kPortable));
      const auto native = everything(scene);
      const Tensor difference = (native[0] - portable[0]).abs();
      const bool single = dtype == torch::kFloat32;
      CHECK(difference.max().item<double>() < (single ? 1.5 / 255 : 1e-9));
      CHECK((difference > 1e-5).to(torch::kFloat64).mean().item<double>() < 1e-3);
      for (size_t i = 3; i < native.size(); ++i) {
        CHECK(relative_difference(native[i], portable[i]) < (single ? 2e-3 : 1e-8));
      }
    }
  }
}

TEST_CASE("cpu kernels: what stands behind stopped pixels changes nothing", "[splat]") {
  // Splats over the whole image, one behind the other: pixels stop within the first few, while the
  // list has many batches.
  const auto stack_of = [](int64_t count) {
    splat::Gaussians g;
    g.means = torch::zeros({count, 3});
    g.means.select(1, 2).copy_(2 + 0.01 * torch::arange(count));
    g.rotations = torch::tensor({1.0f, 0.0f, 0.0f, 0.0f}).repeat({count, 1});
    g.log_scales = torch::full({count, 3}, 1.0f);
    g.logit_opacities = torch::full({count}, 3.0f);
    g.sh = 0.3 * torch::sin(torch::arange(3 * count)).view({count, 1, 3});
    return g;
  };
  const splat::CameraBatch cameras = {torch::eye(4).unsqueeze(0),
                                      torch::tensor({{40.0f, 40.0f, 18.5f, 17.0f}}), 37, 34};
  constexpr int64_t kFront = 16, kAll = 200;
  for (const kernel::Isa isa : kernel::kIsas) {
    if (!kernel::can_run(isa)) continue;
    const kernel::ForcedIsa forced(isa);
    INFO(kernel::name(isa));
    splat::Gaussians g = stack_of(kAll);
    require_gradients(g);
    const Tensor all = splat::render(g, cameras, {}).color;
    CHECK(torch::equal(all.detach(), splat::render(stack_of(kFront), cameras, {}).color));
    all.sum().backward();
    for (const Tensor& p : parameters(g)) {
      CHECK(torch::isfinite(p.grad()).all().item<bool>());
      CHECK(p.grad().narrow(0, kFront, kAll - kFront).count_nonzero().item<int64_t>() == 0);
    }
    CHECK(g.sh.grad().narrow(0, 0, 1).count_nonzero().item<int64_t>() > 0);
  }
}

TEST_CASE("cpu kernels: the benchmark workload is whole", "[splat]") {
  SplatScene scene = make_splat_workload(30000, 346, 260);
  const auto out = splat::render(scene.gaussians, scene.cameras, {});
  CHECK(out.color.size(0) == 9);
  CHECK(torch::isfinite(out.color).all().item<bool>());
  CHECK(out.alpha.mean().item<double>() > 0.9);
  CHECK(out.rejected.item<int64_t>() == 0);
}
