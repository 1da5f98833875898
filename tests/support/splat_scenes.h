// SPDX-License-Identifier: Apache-2.0
// Scenes for the splatting tests. All on the CPU; move() brings them to another device.
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/splat/render.h"

namespace jade::test {

struct SplatScene {
  splat::Gaussians gaussians;
  splat::CameraBatch cameras;
};

struct SplatSceneOptions {
  int64_t gaussians = 60;
  int64_t views = 3;
  int64_t width = 45;
  int64_t height = 34;
  int sh_degree = 3;
  double sigma_px = 3;  ///< typical size on the screen
  uint64_t seed = 0;
  torch::ScalarType dtype = torch::kFloat64;
};

/// Gaussians of mixed sizes and opacities in front of cameras with slightly different poses and
/// principal points off the centre; some extend beyond the image and the clamped frustum.
SplatScene make_splat_scene(const SplatSceneOptions& options = {});

/// The benchmark scene of N Gaussians (about 2 px on the screen) seen by nine poses of one
/// exposure. W1 = 30000, 346, 260; W2 = 100000, 346, 260; W3 = 100000, 600, 400; W4 = 300000, 600,
/// 400.
SplatScene make_splat_workload(int64_t gaussians, int64_t width, int64_t height);

SplatScene move(const SplatScene& scene, torch::Device device, torch::ScalarType dtype);
SplatScene select_views(const SplatScene& scene, int64_t begin, int64_t end);

/// Makes the Gaussian parameters leaves that require gradients.
void require_gradients(splat::Gaussians& gaussians);
std::vector<torch::Tensor> parameters(const splat::Gaussians& gaussians);
splat::Gaussians gaussians_from(const std::vector<torch::Tensor>& parameters);
extern const char* const kParameterNames[5];

/// A fixed random tensor shaped as `like`: the dL/dimage of a test.
torch::Tensor random_cotangent(const torch::Tensor& like, uint64_t seed = 1);

}  // namespace jade::test
