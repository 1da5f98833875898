// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/render.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/splat/autograd.h"

namespace jade::splat {

namespace {

constexpr int64_t kMaxImageSide = 32767;

int degree_of(int64_t coefficients) {
  for (int degree = 0; degree <= 3; ++degree) {
    if (coefficients == (degree + 1) * (degree + 1)) return degree;
  }
  throw ContractError(
      concat("spherical harmonics: expected 1, 4, 9 or 16 coefficients, found ", coefficients));
}

void check(const ScreenStatistics& statistics, const Gaussians& gaussians) {
  const std::pair<const char*, torch::Tensor> fields[] = {
      {"statistics.gradient_norm", statistics.gradient_norm},
      {"statistics.visible_count", statistics.visible_count},
      {"statistics.max_radius_px", statistics.max_radius_px}};
  for (const auto& [name, tensor] : fields) {
    check_shape(tensor, name, {gaussians.size()});
    check_dtype(tensor, name, torch::kFloat32);
    check_same_device(tensor, name, gaussians.means, "means");
    JADE_CHECK(tensor.is_contiguous(), name, " must be contiguous");
  }
}

void check(const CameraBatch& cameras) {
  check_shape(cameras.camera_from_world, "camera_from_world", {-1, 4, 4});
  const int64_t views = cameras.camera_from_world.size(0);
  JADE_CHECK(views >= 1, "expected at least one camera, found none");
  check_shape(cameras.intrinsics, "intrinsics", {views, 4});
  JADE_CHECK(cameras.width >= 1 && cameras.width <= kMaxImageSide && cameras.height >= 1 &&
                 cameras.height <= kMaxImageSide,
             "expected an image of 1 to ", kMaxImageSide, " pixels a side, found ", cameras.width,
             " x ", cameras.height);
}

ForwardArgs make_args(const Gaussians& gaussians, const CameraBatch& cameras,
                      const RenderOptions& options) {
  const auto like = gaussians.means.options().requires_grad(false);
  ForwardArgs args;
  args.gaussians = {gaussians.means.contiguous(), gaussians.rotations.contiguous(),
                    gaussians.log_scales.contiguous(), gaussians.logit_opacities.contiguous(),
                    gaussians.sh.contiguous()};
  args.camera_from_world = cameras.camera_from_world.to(like, true).contiguous();
  args.intrinsics = cameras.intrinsics.detach().to(like, true).contiguous();
  if (options.background.defined()) {
    args.background = options.background.to(like, true).contiguous();
  }
  args.width = cameras.width;
  args.height = cameras.height;
  args.sh_degree = std::min(options.sh_degree, degree_of(gaussians.sh.size(1)));
  args.near_plane = options.near_plane;
  args.antialiased = options.antialiased;
  args.depth = options.depth;
  args.smooth_cutoff = options.smooth_cutoff;
  args.deterministic = options.deterministic;
  return args;
}

}  // namespace

void check(const Gaussians& g) {
  check_shape(g.means, "means", {-1, 3});
  const int64_t count = g.size();
  check_shape(g.rotations, "rotations", {count, 4});
  check_shape(g.log_scales, "log_scales", {count, 3});
  check_shape(g.logit_opacities, "logit_opacities", {count});
  check_shape(g.sh, "sh", {count, -1, 3});
  degree_of(g.sh.size(1));
  const auto dtype = g.means.scalar_type();
  JADE_CHECK(dtype == torch::kFloat32 || dtype == torch::kFloat64,
             "means: expected float32 or float64, found ", g.means.dtype().name());
  const std::pair<const char*, torch::Tensor> others[] = {{"rotations", g.rotations},
                                                          {"log_scales", g.log_scales},
                                                          {"logit_opacities", g.logit_opacities},
                                                          {"sh", g.sh}};
  for (const auto& [name, tensor] : others) {
    check_dtype(tensor, name, dtype);
    check_same_device(tensor, name, g.means, "means");
  }
  JADE_CHECK(!g.means.is_cuda() || dtype == torch::kFloat32,
             "means: expected float32 on a GPU, found float64; render doubles on the CPU");
}

ScreenStatistics ScreenStatistics::zeros(int64_t size, torch::Device device) {
  const auto options = torch::TensorOptions().dtype(torch::kFloat32).device(device);
  return {torch::zeros({size}, options), torch::zeros({size}, options),
          torch::zeros({size}, options)};
}

RenderOutput render(const Gaussians& gaussians, const CameraBatch& cameras,
                    const RenderOptions& options) {
  check(gaussians);
  check(cameras);
  JADE_CHECK(options.sh_degree >= 0 && options.sh_degree <= 3, "sh_degree: expected 0 to 3, found ",
             options.sh_degree);
  JADE_CHECK(options.near_plane > 0, "near_plane: expected a positive distance, found ",
             options.near_plane);
  if (options.background.defined()) check_shape(options.background, "background", {3});
  if (options.statistics.defined()) check(options.statistics, gaussians);

  const BlendedImages images = blend_images(make_args(gaussians, cameras, options),
                                            options.statistics, options.statistics_views);
  RenderOutput output;
  output.color = images.color;
  output.alpha = images.alpha;
  output.rejected = images.rejected;
  output.statistics = options.statistics;
  // The sum is 0 where there is no Gaussian; the clamp avoids 0/0.
  if (options.depth) output.depth = images.depth_sum / images.alpha.clamp_min(1e-10);
  return output;
}

}  // namespace jade::splat
