// SPDX-License-Identifier: Apache-2.0
// The CUDA backend against the CPU one.
#include "support/catch.h"

#include <cmath>
#include <torch/cuda.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/splat/render.h"
#include "support/backend_agreement.h"
#include "support/gradient_norms.h"
#include "support/splat_scenes.h"
#ifdef JADE_WITH_CUDA
#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDAGuard.h>

#include "jade/splat/cuda/capacity.h"
#include "jade/splat/cuda/chunk_size.h"
#endif

using namespace jade;
using namespace jade::test;
using splat::RenderOptions;
using splat::RenderOutput;
using torch::Tensor;

#ifdef JADE_WITH_CUDA
namespace {

const torch::Device kGpu(torch::kCUDA, 0);

struct Rendered {
  RenderOutput output;
  std::vector<Tensor> gradients;  ///< five parameters, cameras, background
};

/// Renders and differentiates on one device; all results are on the CPU.
Rendered run(const SplatScene& scene, RenderOptions options, torch::Device device) {
  SplatScene s = move(scene, device, torch::kFloat32);
  require_gradients(s.gaussians);
  s.cameras.camera_from_world = s.cameras.camera_from_world.clone().set_requires_grad(true);
  const bool background = options.background.defined();
  if (background)
    options.background = options.background.to(device).clone().set_requires_grad(true);
  if (options.statistics.defined()) {
    options.statistics = splat::ScreenStatistics::zeros(s.gaussians.size(), device);
  }
  Rendered outcome;
  RenderOutput& out = outcome.output;
  out = splat::render(s.gaussians, s.cameras, options);
  const auto cotangent = [&](const Tensor& like, uint64_t seed) {
    return random_cotangent(like.detach().cpu(), seed).to(device);
  };
  Tensor loss =
      (out.color * cotangent(out.color, 1)).sum() + (out.alpha * cotangent(out.alpha, 2)).sum();
  if (options.depth) loss = loss + 0.1 * (out.depth * cotangent(out.depth, 3)).sum();
  loss.backward();
  for (const Tensor& p : parameters(s.gaussians)) outcome.gradients.push_back(p.grad().cpu());
  outcome.gradients.push_back(s.cameras.camera_from_world.grad().slice(1, 0, 3).cpu());
  if (background) outcome.gradients.push_back(options.background.grad().cpu());
  for (Tensor* t :
       {&out.color, &out.alpha, &out.depth, &out.rejected, &out.statistics.gradient_norm,
        &out.statistics.visible_count, &out.statistics.max_radius_px}) {
    if (t->defined()) *t = t->detach().cpu();
  }
  return outcome;
}

void check_outcomes(const Rendered& gpu, const Rendered& cpu) {
  check_images(gpu.output.color, cpu.output.color);
  check_images(gpu.output.alpha, cpu.output.alpha);
  if (cpu.output.depth.defined()) check_images(gpu.output.depth / 10, cpu.output.depth / 10);
  CHECK(torch::equal(gpu.output.rejected, cpu.output.rejected));
  check_gradients(gpu.gradients, cpu.gradients);
}

void check_same(const Rendered& a, const Rendered& b) {
  check_equal({a.output.color, a.output.alpha}, {b.output.color, b.output.alpha});
  check_equal(a.gradients, b.gradients);
}

SplatScene scene_of(int64_t gaussians, int64_t width, int64_t height, double sigma_px = 3) {
  SplatSceneOptions options;
  options.gaussians = gaussians;
  options.width = width;
  options.height = height;
  options.sigma_px = sigma_px;
  options.dtype = torch::kFloat32;
  return make_splat_scene(options);
}

/// Everything within the middle of a 16x16 image.
SplatScene crowd(int64_t gaussians, double logit) {
  SplatScene scene = scene_of(1, 16, 16);
  const auto uniform = torch::rand({gaussians, 3}, at::detail::createCPUGenerator(5));
  scene.cameras.camera_from_world = torch::eye(4).unsqueeze(0);
  scene.cameras.intrinsics = torch::tensor({16.0f, 16.0f, 8.0f, 8.0f}).unsqueeze(0);
  splat::Gaussians& g = scene.gaussians;
  g.means = (uniform - 0.5) * torch::tensor({0.4f, 0.4f, 2.0f}) + torch::tensor({0.f, 0.f, 4.f});
  g.rotations = torch::randn({gaussians, 4}, at::detail::createCPUGenerator(7));
  g.log_scales = torch::tensor({-1.5f, -1.8f, -1.3f}).repeat({gaussians, 1});
  g.logit_opacities = torch::full({gaussians}, logit);
  g.sh = torch::rand({gaussians, 1, 3}, at::detail::createCPUGenerator(6));
  return scene;
}

struct ForcedCapacity {
  explicit ForcedCapacity(int64_t capacity) {
    splat::cuda::set_instance_capacity_for_test(capacity);
  }
  ~ForcedCapacity() { splat::cuda::set_instance_capacity_for_test(-1); }
};

struct ForcedChunks {
  explicit ForcedChunks(int gaussians) { splat::cuda::set_chunk_gaussians_for_test(gaussians); }
  ~ForcedChunks() { splat::cuda::set_chunk_gaussians_for_test(-1); }
};

}  // namespace

TEST_CASE("cuda: images and gradients agree with the CPU", "[splat][cuda]") {
  RenderOptions options;
  options.background = torch::tensor({0.2f, 0.5f, 0.9f});
  for (const bool antialiased : {false, true}) {
    for (const bool depth : {false, true}) {
      for (const int degree : {0, 1, 2, 3}) {
        options.antialiased = antialiased;
        options.depth = depth;
        options.sh_degree = degree;
        INFO("antialiased " << antialiased << ", depth " << depth << ", degree " << degree);
        const SplatScene scene = scene_of(2000, 101, 67);
        check_outcomes(run(scene, options, kGpu), run(scene, options, torch::kCPU));
      }
    }
  }
}

TEST_CASE("cuda: chunks of any size change no image", "[splat][cuda]") {
  const SplatScene scene = scene_of(5000, 301, 203, 6);
  const auto rendered = [&](int size) {
    const ForcedChunks forced(size);
    return run(scene, {}, kGpu);
  };
  const Rendered straight = rendered(0);
  for (const int size : {32, 480, 1024}) {
    INFO("chunks of " << size);
    const Rendered chunked = rendered(size);
    check_equal({chunked.output.color, chunked.output.alpha},
                {straight.output.color, straight.output.alpha});
  }
}

TEST_CASE("cuda: every near plane agrees with the CPU", "[splat][cuda]") {
  const SplatScene scene = select_views(scene_of(2000, 101, 67), 0, 1);
  const Tensor pose = scene.cameras.camera_from_world[0];
  const Tensor depth =
      torch::matmul(scene.gaussians.means, pose[2].slice(0, 0, 3)) + pose[2][3].item<double>();
  const Tensor whole = run(scene, {}, kGpu).output.color;
  for (const double share : {0.1, 0.5, 0.9}) {
    // Between two Gaussians, so that float and double cull the same ones.
    const Tensor sorted = std::get<0>(depth.sort());
    const auto at = static_cast<int64_t>(share * 2000);
    RenderOptions options;
    options.near_plane = 0.5 * (sorted[at] + sorted[at + 1]).item<double>();
    const Rendered gpu = run(scene, options, kGpu);
    check_outcomes(gpu, run(scene, options, torch::kCPU));
    CHECK((gpu.output.color - whole).abs().max().item<double>() > 0.01);
    const Tensor hidden = (depth < options.near_plane).unsqueeze(1);
    CHECK((gpu.gradients[0] * hidden).abs().max().item<double>() == 0);
  }
}

TEST_CASE("cuda: coefficients above the active degree get no gradient", "[splat][cuda]") {
  RenderOptions options;
  options.sh_degree = 1;
  const Rendered outcome = run(scene_of(100, 40, 40), options, kGpu);
  CHECK(outcome.gradients[4].slice(1, 4).abs().max().item<double>() == 0);
  CHECK(outcome.gradients[4].slice(1, 0, 4).abs().max().item<double>() > 0);
}

TEST_CASE("cuda: a benchmark workload agrees with the CPU", "[splat][cuda]") {
  const SplatScene scene = make_splat_workload(30000, 346, 260);
  check_outcomes(run(scene, {}, kGpu), run(scene, {}, torch::kCPU));
}

TEST_CASE("cuda: images repeat bit by bit", "[splat][cuda]") {
  const SplatScene scene = move(scene_of(5000, 150, 90), kGpu, torch::kFloat32);
  const torch::NoGradGuard no_grad;
  const Tensor first = splat::render(scene.gaussians, scene.cameras, {}).color;
  for (int i = 0; i < 5; ++i) {
    CHECK(torch::equal(first, splat::render(scene.gaussians, scene.cameras, {}).color));
  }
}

TEST_CASE("cuda: deterministic gradients repeat bit by bit and agree with the others",
          "[splat][cuda]") {
  RenderOptions options;
  options.depth = true;
  options.background = torch::tensor({0.2f, 0.5f, 0.9f});
  const SplatScene scene = scene_of(5000, 150, 90);
  const Rendered usual = run(scene, options, kGpu);
  options.deterministic = true;
  const Rendered first = run(scene, options, kGpu);
  for (int i = 0; i < 4; ++i) check_same(run(scene, options, kGpu), first);
  CHECK(torch::equal(first.output.color, usual.output.color));
  for (size_t i = 0; i < first.gradients.size(); ++i) {
    CHECK(cosine(first.gradients[i], usual.gradients[i]) > 0.999999);
  }
}

TEST_CASE("cuda: lists that do not fit change no image", "[splat][cuda]") {
  const SplatScene scene = scene_of(3000, 101, 67);
  const Rendered usual = run(scene, {}, kGpu);
  for (const int64_t capacity : {0, 100, 4000}) {
    INFO("capacity " << capacity);
    const ForcedCapacity forced(capacity);
    const Rendered tight = run(scene, {}, kGpu);
    CHECK(torch::equal(tight.output.color, usual.output.color));
    CHECK(torch::equal(tight.output.alpha, usual.output.alpha));
    for (size_t i = 0; i < usual.gradients.size(); ++i) {
      CHECK(cosine(tight.gradients[i], usual.gradients[i]) > 0.999999);
    }
  }
}

TEST_CASE("cuda: a scene that grows suddenly is right at once", "[splat][cuda]") {
  const SplatScene small = scene_of(200, 77, 55, 1), large = scene_of(200, 77, 55, 60);
  run(small, {}, kGpu);
  check_images(run(large, {}, kGpu).output.color, run(large, {}, torch::kCPU).output.color);
}

TEST_CASE("cuda: statistics equal the CPU's", "[splat][cuda]") {
  for (const int64_t views : {-1, 1}) {
    RenderOptions options;
    options.statistics = splat::ScreenStatistics::zeros(1, torch::kCPU);
    options.statistics_views = views;
    const SplatScene scene = scene_of(2000, 101, 67);
    const auto gpu = run(scene, options, kGpu).output.statistics;
    const auto cpu = run(scene, options, torch::kCPU).output.statistics;
    const Tensor same = (gpu.visible_count == cpu.visible_count).to(torch::kFloat64);
    CHECK(same.mean().item<double>() > 0.999);
    CHECK(torch::allclose(gpu.max_radius_px, cpu.max_radius_px, 1e-3, 1e-2));
    const NormDifference norms = compare_gradient_norms(gpu.gradient_norm, cpu.gradient_norm);
    CHECK(norms.beyond_rounding <= kBeyondRounding);
    CHECK(norms.largest < kLargestFlip);
    const Tensor unseen = gpu.gradient_norm.masked_select(gpu.visible_count == 0);
    CHECK((unseen.numel() > 0 && unseen.eq(0).all().item<bool>()));
  }
}

TEST_CASE("cuda: unusable parameters contribute nothing and are counted", "[splat][cuda]") {
  const float nan = std::nanf(""), infinity = INFINITY;
  SplatScene scene = scene_of(300, 45, 34);
  splat::Gaussians& g = scene.gaussians;
  g.means[0][0] = nan;
  g.means[1][2] = infinity;
  g.rotations[2].zero_();
  g.rotations[3][1] = nan;
  g.log_scales[4][0] = 70;
  g.log_scales[5][1] = -70;
  g.logit_opacities[6] = nan;
  g.sh[7][3][1] = infinity;
  g.logit_opacities[8] = 1000;   // opacity 1
  g.logit_opacities[9] = -1000;  // opacity 0
  g.means[10] = torch::tensor({0.f, 0.f, -5.f});
  g.log_scales[11] = 20;
  const Rendered gpu = run(scene, {}, kGpu);
  CHECK(gpu.output.rejected.item<int64_t>() == 8);
  CHECK(torch::isfinite(gpu.output.color).all().item<bool>());
  for (const Tensor& gradient : gpu.gradients) CHECK(torch::isfinite(gradient).all().item<bool>());
  for (int64_t i = 0; i < 8; ++i) CHECK(gpu.gradients[0][i].abs().sum().item<double>() == 0);
  check_images(gpu.output.color, run(scene, {}, torch::kCPU).output.color);
}

TEST_CASE("cuda: finite extremes, and Gaussians behind or on the camera, agree with the CPU",
          "[splat][cuda]") {
  const auto check = [](const SplatScene& scene) {
    const Rendered gpu = run(scene, {}, kGpu), cpu = run(scene, {}, torch::kCPU);
    CHECK(gpu.output.rejected.item<int64_t>() == cpu.output.rejected.item<int64_t>());
    CHECK(torch::isfinite(gpu.output.color).all().item<bool>());
    for (const Tensor& gradient : gpu.gradients) {
      CHECK(torch::isfinite(gradient).all().item<bool>());
    }
    check_images(gpu.output.color, cpu.output.color);
  };
  SplatScene behind = scene_of(300, 45, 34);
  const Tensor pose = behind.cameras.camera_from_world[0];
  const Tensor center =
      -torch::matmul(pose.slice(0, 0, 3).slice(1, 0, 3).t(), pose.slice(0, 0, 3).select(1, 3));
  behind.gaussians.means[0] = center;
  behind.gaussians.means.slice(0, 1, 100).select(1, 2).mul_(-1);
  check(behind);
  for (const float log_scale : {-29.f, -12.f, 5.f, 12.f, 29.f}) {
    INFO("log scale " << log_scale);
    SplatScene extreme = scene_of(300, 45, 34);
    extreme.gaussians.log_scales.slice(0, 0, 20).fill_(log_scale);
    extreme.gaussians.log_scales.slice(0, 20, 40).select(1, 1).fill_(log_scale);
    check(extreme);
  }
  SplatScene lost = scene_of(300, 45, 34);
  lost.cameras.camera_from_world.fill_(std::nanf(""));
  const Rendered nothing = run(lost, {}, kGpu);
  CHECK(nothing.output.color.abs().max().item<double>() == 0);
}

TEST_CASE("cuda: the gradient tests' smooth cut-off is refused", "[splat][cuda]") {
  const SplatScene scene = move(scene_of(10, 20, 20), kGpu, torch::kFloat32);
  RenderOptions options;
  options.smooth_cutoff = true;
  CHECK_THROWS_AS(splat::render(scene.gaussians, scene.cameras, options), ContractError);
}

TEST_CASE("cuda: no Gaussians give the background", "[splat][cuda]") {
  RenderOptions options;
  options.background = torch::tensor({0.25f, 0.5f, 1.0f});
  options.depth = true;
  SplatScene scene = scene_of(1, 45, 34);
  for (Tensor* t : {&scene.gaussians.means, &scene.gaussians.rotations, &scene.gaussians.log_scales,
                    &scene.gaussians.logit_opacities, &scene.gaussians.sh}) {
    *t = t->narrow(0, 0, 0);
  }
  for (const bool deterministic : {false, true}) {
    options.deterministic = deterministic;
    const Rendered outcome = run(scene, options, kGpu);
    const Tensor expected = options.background.view({1, 3, 1, 1}).expand_as(outcome.output.color);
    CHECK(torch::equal(outcome.output.color, expected));
    CHECK(outcome.output.alpha.abs().max().item<double>() == 0);
    check_outcomes(outcome, run(scene, options, torch::kCPU));
  }
}

TEST_CASE("cuda: any image size agrees with the CPU", "[splat][cuda]") {
  const std::pair<int64_t, int64_t> sizes[] = {{1, 1}, {1, 40}, {17, 1}, {16, 16}, {33, 15}};
  for (const auto& [width, height] : sizes) {
    INFO(width << " x " << height);
    const SplatScene scene = scene_of(60, width, height);
    const Tensor gpu = run(scene, {}, kGpu).output.color,
                 cpu = run(scene, {}, torch::kCPU).output.color;
    CHECK((gpu - cpu).abs().max().item<double>() < 5e-3);
    CHECK((gpu - cpu).abs().mean().item<double>() < 1e-4);
  }
}

TEST_CASE("cuda: long lists are sorted", "[splat][cuda]") {
  for (const int64_t count : {1500, 2048, 2049, 5000, 70000}) {
    INFO(count << " Gaussians in one tile");
    const SplatScene scene = crowd(count, -5.2);
    check_outcomes(run(scene, {}, kGpu), run(scene, {}, torch::kCPU));
  }
}

TEST_CASE("cuda: equal depths keep the order of the index", "[splat][cuda]") {
  SplatScene scene = crowd(3000, 0);
  scene.gaussians.means.select(1, 2).fill_(4);
  check_images(run(scene, {}, kGpu).output.color, run(scene, {}, torch::kCPU).output.color);
}

TEST_CASE("cuda: a million Gaussians in one tile", "[splat][cuda]") {
  const SplatScene scene = crowd(1000000, -5.2);
  const Rendered gpu = run(scene, {}, kGpu);
  CHECK(torch::isfinite(gpu.gradients[0]).all().item<bool>());
  check_images(gpu.output.color, run(scene, {}, torch::kCPU).output.color);
}

TEST_CASE("cuda: splitting a batch changes no image", "[splat][cuda]") {
  const SplatScene scene = move(scene_of(2000, 101, 67), kGpu, torch::kFloat32);
  const torch::NoGradGuard no_grad;
  const Tensor all = splat::render(scene.gaussians, scene.cameras, {}).color;
  for (int64_t view = 0; view < all.size(0); ++view) {
    const SplatScene one = select_views(scene, view, view + 1);
    CHECK(torch::equal(splat::render(one.gaussians, one.cameras, {}).color[0], all[view]));
  }
}

TEST_CASE("cuda: many views in one call", "[splat][cuda]") {
  SplatSceneOptions options;
  options.gaussians = 300;
  options.views = 40;
  options.dtype = torch::kFloat32;
  const SplatScene scene = make_splat_scene(options);
  check_outcomes(run(scene, {}, kGpu), run(scene, {}, torch::kCPU));
}

TEST_CASE("cuda: a graph that is kept gives its gradients twice", "[splat][cuda]") {
  SplatScene scene = move(scene_of(2000, 101, 67), kGpu, torch::kFloat32);
  require_gradients(scene.gaussians);
  scene.cameras.camera_from_world.requires_grad_();
  const Tensor color = splat::render(scene.gaussians, scene.cameras, {}).color;
  const Tensor cotangent = torch::randn_like(color);
  const std::vector<Tensor> of{scene.gaussians.means, scene.cameras.camera_from_world};
  std::vector<Tensor> once;
  color.backward(cotangent, /*retain_graph=*/true);
  for (const Tensor& each : of) {
    once.push_back(each.grad().clone());
    each.mutable_grad().reset();
  }
  color.backward(cotangent);
  for (size_t i = 0; i < of.size(); ++i) {
    CHECK(cosine(of[i].grad().cpu(), once[i].cpu()) > 0.999999);
    CHECK(torch::allclose(of[i].grad().norm(), once[i].norm(), 1e-4));
  }
}

TEST_CASE("cuda: a captured graph of both passes replays with new parameters", "[splat][cuda]") {
  SplatScene scene = move(scene_of(2000, 101, 67), kGpu, torch::kFloat32);
  require_gradients(scene.gaussians);
  Tensor& means = scene.gaussians.means;
  const Tensor cotangent =
      torch::randn({scene.cameras.camera_from_world.size(0), 3, 67, 101}).to(kGpu);
  Tensor color;
  const auto step = [&] {
    for (Tensor& p : parameters(scene.gaussians)) p.mutable_grad().reset();
    color = splat::render(scene.gaussians, scene.cameras, {}).color;
    color.backward(cotangent);
  };
  const c10::cuda::CUDAStream stream = c10::cuda::getStreamFromPool();
  const c10::cuda::CUDAStreamGuard guard(stream);
  step();
  step();
  torch::cuda::synchronize();
  at::cuda::CUDAGraph graph;
  graph.capture_begin();
  step();
  graph.capture_end();
  const Tensor captured_color = color, captured_grad = means.grad();
  {
    const torch::NoGradGuard no_grad;
    means.add_(torch::randn_like(means) * 0.02);
  }
  graph.replay();
  torch::cuda::synchronize();
  const Tensor replayed_color = captured_color.clone(), replayed_grad = captured_grad.clone();
  step();
  CHECK(torch::equal(replayed_color, color));
  CHECK(cosine(replayed_grad.cpu(), means.grad().cpu()) > 0.999999);
}
#endif
