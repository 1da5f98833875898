// SPDX-License-Identifier: Apache-2.0
// The CUDA backend's own sources, run thread by thread on the CPU, against the CPU backend.
#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <torch/types.h>

#include "emulated/block.h"
#include "jade/splat/backend.h"
#include "support/backend_agreement.h"
#include "support/splat_scenes.h"

namespace jade::splat::emulated_cuda {
ForwardResult forward(const ForwardArgs& args);
BackwardResult backward(const BackwardArgs& args);
void set_instance_capacity_for_test(int64_t capacity);
void set_chunk_gaussians_for_test(int gaussians);
}  // namespace jade::splat::emulated_cuda

using namespace jade;
using namespace jade::test;
using emulated::ForcedOrder;
using emulated::Order;
using torch::Tensor;

namespace {

struct Settings {
  int sh_degree = 3;
  bool antialiased = false;
  bool depth = false;
  bool depth_gradient = true;  ///< where there is depth
  bool deterministic = false;
  int64_t statistics_views = -1;
  bool cameras = true;  ///< compare their gradients too
  bool activated = false;
  double opacity = 1;  ///< factor of activated opacities
  double far_plane = splat::kFarthest;
  bool means2d = false;      ///< compare screen gradients too
  bool interleaved = false;  ///< colours by pixel, and intrinsics as matrices
};

struct Backend {
  splat::ForwardResult (*forward)(const splat::ForwardArgs&);
  splat::BackwardResult (*backward)(const splat::BackwardArgs&);
};
const Backend kCpu{splat::cpu::forward, splat::cpu::backward};
const Backend kCuda{splat::emulated_cuda::forward, splat::emulated_cuda::backward};

struct Outcome {
  std::vector<Tensor> images;     ///< colour, alpha, depth sums
  std::vector<Tensor> gradients;  ///< five parameters, background, cameras
  splat::ScreenStatistics statistics;
  int64_t rejected = 0;
  int64_t room = 0;  ///< capacity in list entries; CUDA only
};

/// A backward call without a background.
splat::BackwardArgs call_of(const SplatScene& scene) {
  splat::BackwardArgs args;
  splat::ForwardArgs& f = args.forward;
  f.gaussians = scene.gaussians;
  f.camera_from_world = scene.cameras.camera_from_world;
  f.intrinsics = scene.cameras.intrinsics;
  f.width = scene.cameras.width;
  f.height = scene.cameras.height;
  f.sh_degree = 3;
  f.needs_backward = true;
  return args;
}

/// [C,3,3] of fx, fy, cx, cy [C,4].
Tensor matrices_of(const Tensor& intrinsics) {
  Tensor matrices = torch::zeros({intrinsics.size(0), 9}, intrinsics.options());
  matrices.select(1, 8).fill_(1);
  const int64_t places[] = {0, 4, 2, 5};
  for (int64_t k = 0; k < 4; ++k) matrices.select(1, places[k]).copy_(intrinsics.select(1, k));
  return matrices.view({-1, 3, 3});
}

Outcome run(const Backend& backend, const SplatScene& scene, const Settings& settings) {
  splat::BackwardArgs args = call_of(scene);
  splat::ForwardArgs& f = args.forward;
  f.background = torch::tensor({0.2f, 0.5f, 0.9f}).to(scene.gaussians.means.dtype());
  f.sh_degree = settings.sh_degree;
  f.antialiased = settings.antialiased;
  f.depth = settings.depth;
  f.far_plane = settings.far_plane;
  f.activated = settings.activated;
  if (settings.activated) {
    f.gaussians.log_scales = scene.gaussians.log_scales.exp();
    f.gaussians.logit_opacities = settings.opacity * scene.gaussians.logit_opacities.sigmoid();
  }
  f.deterministic = settings.deterministic;
  if (settings.interleaved) {
    f.interleaved = true;
    f.intrinsics = matrices_of(f.intrinsics);
  }
  splat::ForwardResult images = backend.forward(f);
  if (backend.forward == kCuda.forward) {
    // The first call of a size counts and lists instances one by one, later ones by chunks.
    const splat::ForwardResult first = images;
    images = backend.forward(f);
    check_equal({images.color, images.alpha}, {first.color, first.alpha});
    if (settings.depth) CHECK(images.depth_sum.equal(first.depth_sum));
    CHECK(images.rejected.equal(first.rejected));
  }
  args.state = images.state;
  args.color = images.color;
  args.alpha = images.alpha;
  args.depth_sum = images.depth_sum;
  // Both layouts get the same values.
  const auto cotangent_of = [&](const Tensor& image, uint64_t seed) {
    if (!settings.interleaved) return random_cotangent(image, seed);
    const Tensor planes = image.movedim(-1, 1).contiguous();
    return random_cotangent(planes, seed).movedim(1, -1).contiguous();
  };
  args.grad_color = cotangent_of(images.color, 1);
  args.grad_alpha = cotangent_of(images.alpha, 2);
  if (settings.depth && settings.depth_gradient) {
    args.grad_depth_sum = 0.1 * cotangent_of(images.depth_sum, 3);
  }
  args.statistics = splat::ScreenStatistics::zeros(scene.gaussians.size(), torch::kCPU);
  args.statistics_views = settings.statistics_views;
  args.needs_camera = settings.cameras;
  args.needs_background = true;
  args.needs_means2d = settings.means2d;
  const splat::BackwardResult back = backend.backward(args);
  Outcome out;
  out.images = {images.color, images.alpha};
  if (settings.depth) out.images.push_back(images.depth_sum);
  const splat::Gaussians& g = back.gaussians;
  out.gradients = {g.means, g.rotations, g.log_scales, g.logit_opacities, g.sh, back.background};
  if (settings.cameras) out.gradients.push_back(back.camera_from_world);
  if (settings.means2d) out.gradients.push_back(back.means2d);
  out.statistics = args.statistics;
  out.rejected = images.rejected.item<int64_t>();
  if (backend.forward == kCuda.forward) out.room = images.state.tensors.at(1).size(0);
  return out;
}

void check_outcomes(const Outcome& cuda, const Outcome& cpu) {
  REQUIRE(cuda.images.size() == cpu.images.size());
  for (size_t i = 0; i < cpu.images.size(); ++i) {
    INFO("image " << i);
    const double scale = std::max(1.0, cpu.images[i].abs().max().item<double>());
    check_images(cuda.images[i] / scale, cpu.images[i] / scale);
  }
  CHECK(cuda.rejected == cpu.rejected);
  check_gradients(cuda.gradients, cpu.gradients);
  const splat::ScreenStatistics &found = cuda.statistics, &expected = cpu.statistics;
  const Tensor seen = found.visible_count == expected.visible_count;
  CHECK(seen.to(torch::kFloat64).mean().item<double>() > 0.99);
  CHECK(torch::allclose(found.max_radius_px, expected.max_radius_px, 1e-3, 1e-2));
  check_gradients({found.gradient_norm}, {expected.gradient_norm});
}

/// For any order of threads.
void check_against_cpu(const SplatScene& scene, const Settings& settings = {}) {
  const Outcome cpu = run(kCpu, scene, settings);
  for (const Order order : {Order::kAscending, Order::kDescending}) {
    INFO("order " << static_cast<int>(order));
    const ForcedOrder forced(order);
    check_outcomes(run(kCuda, scene, settings), cpu);
  }
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

}  // namespace

TEST_CASE("emulated cuda: images and gradients agree with the CPU backend", "[emulated]") {
  const SplatScene scene = scene_of(200, 45, 37);
  for (const int degree : {0, 1, 2, 3}) {
    Settings settings;
    settings.sh_degree = degree;
    settings.antialiased = degree % 2 == 1;
    settings.depth = degree >= 2;
    settings.statistics_views = degree == 1 ? 1 : -1;
    INFO("degree " << degree);
    check_against_cpu(scene, settings);
  }
}

TEST_CASE(
    "emulated cuda: activated parameters, plain colours, a far plane, gradients on the screen",
    "[emulated]") {
  SplatScene scene = scene_of(200, 45, 37);
  Settings settings;
  settings.activated = true;
  settings.far_plane = 5;
  settings.means2d = true;
  check_against_cpu(scene, settings);
  settings.opacity = 2.5;
  check_against_cpu(scene, settings);
  settings.interleaved = true;
  settings.sh_degree = splat::kPlainColor;
  scene.gaussians.sh = scene.gaussians.sh.narrow(1, 0, 1).contiguous();
  check_against_cpu(scene, settings);
  // One screen gradient per view and Gaussian, zero where a Gaussian is not visible.
  const Outcome cuda = run(kCuda, scene, settings);
  const Tensor on_screen = cuda.gradients.back();
  REQUIRE(on_screen.sizes() == torch::IntArrayRef({3, 200, 2}));
  const Tensor used = (on_screen != 0).any(-1).sum(0);
  CHECK((used <= cuda.statistics.visible_count).all().item<bool>());
  CHECK(used.sum().item<int64_t>() > 100);
}

TEST_CASE("emulated cuda: the layout of colours and intrinsics changes no bit", "[emulated]") {
  const SplatScene scene = scene_of(200, 45, 37);
  for (const Backend& backend : {kCpu, kCuda}) {
    Settings settings;
    settings.depth = true;
    settings.deterministic = true;
    const Outcome planes = run(backend, scene, settings);
    settings.interleaved = true;
    const Outcome pixels = run(backend, scene, settings);
    REQUIRE(pixels.images[0].sizes() == torch::IntArrayRef({3, 37, 45, 3}));
    REQUIRE(pixels.images[1].sizes() == torch::IntArrayRef({3, 37, 45, 1}));
    CHECK(pixels.images[0].movedim(-1, 1).equal(planes.images[0]));
    CHECK(pixels.images[1].movedim(-1, 1).equal(planes.images[1]));
    check_equal(pixels.gradients, planes.gradients);
  }
}

TEST_CASE("emulated cuda: a splat that stops a pixel and colours none still counts in the adjoint",
          "[emulated]") {
  // A row of eight pixels. Two splats leave the first pixel 1.2e-4 of its light; a third beside it
  // would leave it less than 1e-4, which stops it, and reaches no other pixel. One behind covers
  // all: the first pixel would continue with it alone. The last reaches only the first pixel. 32
  // faint splats at the last pixel precede them, because the forward pass checks which splats
  // change a pixel only after these.
  const int64_t before = 32, count = before + 5;
  SplatScene scene = select_views(scene_of(count, 8, 1), 0, 1);
  scene.cameras.camera_from_world = torch::eye(4).unsqueeze(0);
  scene.cameras.intrinsics = torch::tensor({{5.f, 5.f, 0.5f, 0.5f}});
  splat::Gaussians& g = scene.gaussians;
  g.means = torch::cat(
      {torch::tensor({1.4f, 0.f, 1.f}).expand({before, 3}), torch::tensor({{0.f, 0.f, 2.f},
                                                                           {0.f, 0.f, 3.f},
                                                                           {-0.56f, 0.f, 4.f},
                                                                           {0.f, 0.f, 5.f},
                                                                           {-0.84f, 0.f, 6.f}})});
  g.log_scales = torch::full({count, 3}, -9.f);
  g.log_scales[before + 3].fill_(3);
  g.logit_opacities = torch::logit(torch::cat(
      {torch::full({before}, 0.01f), torch::tensor({0.989f, 0.989f, 0.41f, 0.1f, 0.41f})}));
  splat::BackwardArgs args = call_of(scene);
  const splat::ForwardResult images = kCuda.forward(args.forward);
  const Tensor entries = images.state.tensors.at(1).view(torch::kInt32);
  const auto first_quarter = [&](int64_t place) {
    const auto entry = entries[place].item<int32_t>();
    REQUIRE(entry >> 4 == place);  // by depth, as by index
    return entry & 1;
  };
  CHECK(first_quarter(before + 1) == 1);
  CHECK(first_quarter(before + 2) == 1);
  CHECK(first_quarter(before + 3) == 1);
  CHECK(first_quarter(before + 4) == 0);
  args.state = images.state;
  args.color = images.color;
  args.alpha = images.alpha;
  args.grad_color = torch::zeros_like(images.color);
  args.grad_color.select(3, 0).fill_(1);
  const Tensor first_alone = kCuda.backward(args).gaussians.logit_opacities.narrow(0, before, 5);
  CHECK(first_alone[1].item<float>() != 0);
  for (int64_t i = 2; i < 5; ++i) CHECK(first_alone[i].item<float>() == 0);
  args.state.cleared = Tensor();
  args.grad_color.fill_(1);
  CHECK(kCuda.backward(args).gaussians.logit_opacities[before + 3].item<float>() != 0);
}

TEST_CASE("emulated cuda: depth without a gradient", "[emulated]") {
  for (const bool deterministic : {false, true}) {
    Settings settings;
    settings.depth = true;
    settings.depth_gradient = false;
    settings.deterministic = deterministic;
    check_against_cpu(scene_of(100, 33, 20), settings);
  }
}

TEST_CASE("emulated cuda: a second backward call clears its own memory", "[emulated]") {
  for (const bool deterministic : {false, true}) {
    splat::BackwardArgs args = call_of(scene_of(50, 20, 17));
    splat::ForwardArgs& f = args.forward;
    f.deterministic = deterministic;
    f.background = torch::rand({3});
    const splat::ForwardResult images = kCuda.forward(f);
    CHECK(images.state.cleared.defined());
    args.state = images.state;
    args.color = images.color;
    args.alpha = images.alpha;
    args.grad_color = random_cotangent(images.color, 1);
    args.needs_camera = args.needs_background = true;
    const splat::BackwardResult first = kCuda.backward(args);
    args.state.cleared = Tensor();
    const splat::BackwardResult second = kCuda.backward(args);
    check_equal(
        {second.gaussians.sh, second.gaussians.means, second.background, second.camera_from_world},
        {first.gaussians.sh, first.gaussians.means, first.background, first.camera_from_world});
    CHECK(first.background.abs().min().item<float>() > 0);
    args.needs_camera = args.needs_background = false;
    const splat::BackwardResult less = kCuda.backward(args);
    check_equal({less.gaussians.sh, less.gaussians.means},
                {first.gaussians.sh, first.gaussians.means});
    CHECK_FALSE(less.background.defined());
    CHECK_FALSE(less.camera_from_world.defined());
    f.needs_backward = false;
    CHECK_FALSE(kCuda.forward(f).state.cleared.defined());
  }
}

TEST_CASE("emulated cuda: the order of threads changes no image and no deterministic gradient",
          "[emulated]") {
  const SplatScene scene = scene_of(150, 37, 29);
  Settings settings;
  settings.depth = true;
  const Outcome usual = run(kCuda, scene, settings);
  settings.deterministic = true;
  const Outcome first = run(kCuda, scene, settings);
  check_equal(first.images, usual.images);
  for (size_t i = 0; i < first.gradients.size(); ++i) {
    CHECK(cosine(first.gradients[i], usual.gradients[i]) > 0.999999);
  }
  for (const Order order : {Order::kDescending, Order::kShuffled}) {
    const ForcedOrder forced(order);
    const Outcome again = run(kCuda, scene, settings);
    check_equal(again.images, first.images);
    check_equal(again.gradients, first.gradients);
    settings.deterministic = false;
    const Outcome sums = run(kCuda, scene, settings);
    settings.deterministic = true;
    check_equal(sums.images, first.images);
    for (size_t i = 0; i < sums.gradients.size(); ++i) {
      CHECK(cosine(sums.gradients[i], first.gradients[i]) > 0.999999);
    }
  }
}

TEST_CASE("emulated cuda: gradients are as exact as sums in TF32 are, and not shorter",
          "[emulated]") {
  const SplatScene scene = make_splat_workload(600, 48, 40);
  const Outcome found = run(kCuda, scene, {}), expected = run(kCpu, scene, {});
  for (size_t i = 0; i < expected.gradients.size(); ++i) {
    INFO("gradient " << i);
    const Tensor exact = expected.gradients[i].to(torch::kFloat64).flatten();
    const Tensor difference = found.gradients[i].to(torch::kFloat64).flatten() - exact;
    const double norm = exact.norm().item<double>();
    CHECK(difference.norm().item<double>() < 5e-4 * norm);
    // The cut to TF32 alone would make this −3.5e-4.
    CHECK(std::abs(difference.dot(exact).item<double>()) < 1e-4 * norm * norm);
  }
}

TEST_CASE("emulated cuda: chunks of any size change no image", "[emulated][slow]") {
  struct Case {
    SplatScene scene;
    std::vector<int> sizes;
  };
  SplatScene crowd = select_views(scene_of(1100, 48, 48, 30), 0, 1);
  crowd.gaussians.logit_opacities.fill_(-4.0);
  const std::vector<Case> cases = {
      {scene_of(300, 77, 60, 6), {32, 64, 320}},
      // the most tiles for which chunks are used
      {select_views(scene_of(30, 512, 1024), 0, 1), {1024}},
      {crowd, {1024}},  // more instances than fit in shared memory
  };
  for (const Case& c : cases) {
    splat::emulated_cuda::set_chunk_gaussians_for_test(0);
    const Outcome straight = run(kCuda, c.scene, {});
    for (const int size : c.sizes) {
      INFO(c.scene.cameras.width << "x" << c.scene.cameras.height << ", chunks of " << size);
      const ForcedOrder forced(size == 64 ? Order::kShuffled : Order::kDescending);
      splat::emulated_cuda::set_chunk_gaussians_for_test(size);
      const Outcome chunked = run(kCuda, c.scene, {});
      splat::emulated_cuda::set_chunk_gaussians_for_test(-1);
      check_equal(chunked.images, straight.images);
      for (size_t i = 0; i < straight.gradients.size(); ++i) {
        CHECK(cosine(chunked.gradients[i], straight.gradients[i]) > 0.999999);
      }
    }
  }
  Settings settings;
  settings.deterministic = true;
  CHECK(run(kCuda, crowd, settings).room > 6144 * 1100 / 1024);
}

TEST_CASE("emulated cuda: a view of too many tiles for chunks agrees with the CPU backend",
          "[emulated]") {
  SplatScene scene = select_views(scene_of(40, 529, 1024), 0, 1);
  check_outcomes(run(kCuda, scene, {}), run(kCpu, scene, {}));
}

TEST_CASE("emulated cuda: lists that do not fit change no image", "[emulated]") {
  // More splats than one round selects, all of them visible.
  SplatScene scene = scene_of(700, 20, 17);
  scene.gaussians.logit_opacities.fill_(-4.5);
  const Outcome usual = run(kCuda, scene, {});
  for (const int64_t capacity : {0, 2000}) {
    INFO("capacity " << capacity);
    splat::emulated_cuda::set_instance_capacity_for_test(capacity);
    const Outcome tight = run(kCuda, scene, {});
    splat::emulated_cuda::set_instance_capacity_for_test(-1);
    check_equal(tight.images, usual.images);
    for (size_t i = 0; i < usual.gradients.size(); ++i) {
      CHECK(cosine(tight.gradients[i], usual.gradients[i]) > 0.999999);
    }
  }
}

TEST_CASE("emulated cuda: deterministic calls make room for what is there, whatever came before",
          "[emulated]") {
  const SplatScene small = scene_of(60, 41, 23, 1), large = scene_of(60, 41, 23, 30);
  Settings settings;
  settings.deterministic = true;
  const int64_t before = run(kCuda, small, settings).room;
  const int64_t most = run(kCuda, large, settings).room;
  CHECK(before >= 60);
  CHECK(most > 2 * before);
  CHECK(run(kCuda, small, settings).room == before);
  settings.deterministic = false;
  CHECK(run(kCuda, small, settings).room > most);
}

TEST_CASE("emulated cuda: long lists, equal depths and large splats agree with the CPU backend",
          "[emulated]") {
  SplatSceneOptions options;
  options.views = 1;
  options.dtype = torch::kFloat32;
  options.width = 20;
  options.height = 18;
  options.gaussians = 2300;
  SplatScene crowd = make_splat_scene(options);
  crowd.gaussians.logit_opacities.fill_(-4.5);
  check_against_cpu(crowd);
  options.gaussians = 120;
  SplatScene flat = make_splat_scene(options);
  flat.cameras.camera_from_world = torch::eye(4).unsqueeze(0);
  flat.gaussians.means.select(1, 2).fill_(4);
  check_against_cpu(flat);
  options.width = 150;
  options.height = 140;
  options.gaussians = 12;
  options.sigma_px = 40;
  const SplatScene large = make_splat_scene(options);
  check_against_cpu(large);
}

TEST_CASE("emulated cuda: more views than a block holds cameras agree with the CPU backend",
          "[emulated]") {
  SplatSceneOptions options;
  options.views = 18;
  options.gaussians = 40;
  options.width = options.height = 17;
  options.dtype = torch::kFloat32;
  const SplatScene scene = make_splat_scene(options);
  check_against_cpu(scene);
  Settings settings;
  settings.cameras = false;
  check_against_cpu(scene, settings);
}

TEST_CASE("emulated cuda: unusable parameters contribute nothing and are counted", "[emulated]") {
  SplatScene scene = scene_of(80, 33, 21);
  scene.gaussians.means[0][0] = std::nanf("");
  scene.gaussians.rotations[1].zero_();
  scene.gaussians.log_scales[2][1] = 70;
  scene.gaussians.sh[3][2][1] = INFINITY;
  const Outcome cuda = run(kCuda, scene, {});
  CHECK(cuda.rejected == 4);
  check_outcomes(cuda, run(kCpu, scene, {}));
  for (int64_t i = 0; i < 4; ++i) CHECK(cuda.gradients[0][i].abs().sum().item<double>() == 0);
}

TEST_CASE("emulated cuda: no Gaussians give the background", "[emulated]") {
  SplatScene scene = scene_of(1, 20, 19);
  splat::Gaussians& g = scene.gaussians;
  for (Tensor* t : {&g.means, &g.rotations, &g.log_scales, &g.logit_opacities, &g.sh}) {
    *t = t->narrow(0, 0, 0);
  }
  Settings settings;
  settings.depth = true;
  for (const bool deterministic : {false, true}) {
    settings.deterministic = deterministic;
    const Outcome cuda = run(kCuda, scene, settings), cpu = run(kCpu, scene, settings);
    for (size_t i = 0; i < cpu.images.size(); ++i) CHECK(cuda.images[i].equal(cpu.images[i]));
    CHECK(torch::allclose(cuda.gradients[5], cpu.gradients[5]));
  }
}

TEST_CASE("emulated cuda: random scenes, sizes and settings agree with the CPU backend",
          "[emulated]") {
  for (uint32_t seed = 0; seed < 16; ++seed) {
    std::mt19937 random(seed);
    const auto pick = [&](int low, int high) {
      return low + static_cast<int>(random() % static_cast<uint32_t>(high - low + 1));
    };
    const auto rarely = [&] { return pick(0, 3) == 0; };
    SplatSceneOptions options;
    options.seed = seed;
    options.dtype = torch::kFloat32;
    options.gaussians = pick(1, rarely() ? 300 : 80);
    options.views = pick(1, rarely() ? 12 : 3);
    options.width = pick(1, rarely() ? 90 : 40);
    options.height = pick(1, rarely() ? 90 : 40);
    options.sh_degree = pick(0, 3);
    options.sigma_px = rarely() ? pick(1, 60) : 3;
    SplatScene scene = make_splat_scene(options);
    if (rarely()) scene.gaussians.logit_opacities.fill_(-4.8f);
    if (rarely()) scene.gaussians.log_scales.select(1, 0).add_(3);
    Settings settings;
    settings.sh_degree = pick(0, options.sh_degree);
    settings.antialiased = pick(0, 1) == 1;
    settings.depth = pick(0, 1) == 1;
    settings.deterministic = rarely();
    settings.statistics_views = pick(-1, static_cast<int>(options.views));
    settings.cameras = !rarely();
    INFO("seed " << seed << ", " << options.gaussians << " Gaussians, " << options.views
                 << " views of " << options.width << "x" << options.height << ", sigma "
                 << options.sigma_px << " px, degree " << settings.sh_degree);
    const ForcedOrder forced(Order::kShuffled);
    check_outcomes(run(kCuda, scene, settings), run(kCpu, scene, settings));
  }
}
