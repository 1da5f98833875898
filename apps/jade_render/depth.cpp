// SPDX-License-Identifier: Apache-2.0
#include "jade_render/depth.h"

#include <algorithm>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/imaging/image_io.h"

namespace jade::apps {
namespace {

constexpr double kMostSteps = 65535;
/// Share of light from behind the Gaussians above which a pixel has no depth.
constexpr double kThrough = 0.5;

}  // namespace

DepthFiles::DepthFiles(std::filesystem::path folder, double step)
    : folder_(std::move(folder)), step_(step) {}

void DepthFiles::write(const std::string& name, const splat::RenderOutput& out) {
  const torch::Tensor covered = out.alpha[0] > 1 - kThrough;
  const torch::Tensor depth =
      torch::where(covered, out.depth[0], torch::zeros_like(out.depth[0])).to(torch::kCPU);
  beyond_ += (depth > kMostSteps * step_).sum().item<int64_t>();
  farthest_ = std::max(farthest_, depth.max().item<double>());
  imaging::write_image(folder_ / (name + "_depth.npy"), depth);
  imaging::write_image(folder_ / (name + "_depth.png"), depth / (kMostSteps * step_), {16});
}

void DepthFiles::finish() const {
  if (beyond_ == 0) return;
  log_warn(concat(beyond_, " pixels are farther than ", kMostSteps * step_,
                  ", the most that a 16-bit .png holds in steps of ", step_, ", up to ", farthest_,
                  "; their .png says the most. Use --depth-step ", farthest_ / kMostSteps,
                  " or more, or read the .npy"));
}

}  // namespace jade::apps
