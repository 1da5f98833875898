// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/gaussian_source.h"

#include <algorithm>
#include <cstring>

#include "jade/gaussians/scene_file.h"
#include "jade/splat/render.h"

namespace jade::simulate {

GaussianSource::GaussianSource(const std::filesystem::path& path)
    : file_(gaussians::read_gaussians(path)) {
  gaussians::check_some(file_.gaussians, path);
}

void GaussianSource::render(const geometry::Pose& camera_from_world,
                            const geometry::Intrinsics& camera, int /*samples*/,
                            world::SharpFrame& frame) const {
  const torch::NoGradGuard no_grad;
  splat::CameraBatch batch{geometry::to_tensor(camera_from_world).to(torch::kFloat32).unsqueeze(0),
                           geometry::to_tensor(camera).to(torch::kFloat32).unsqueeze(0),
                           camera.width, camera.height};
  splat::RenderOptions options;
  options.depth = true;
  options.antialiased = file_.antialiased;
  const auto out = splat::render(file_.gaussians, batch, options);
  const auto color = out.color.clamp(0, 1).contiguous();
  const auto depth =
      torch::where(out.alpha > 0.5, out.depth, torch::full_like(out.depth, world::kNoDepth))
          .contiguous();
  frame.resize(camera.width, camera.height);
  std::memcpy(frame.rgb.data(), color.data_ptr<float>(), frame.rgb.size() * sizeof(float));
  std::memcpy(frame.depth.data(), depth.data_ptr<float>(), frame.depth.size() * sizeof(float));
}

world::CameraRig GaussianSource::rig() const {
  const auto sorted = std::get<0>(file_.gaussians.means.sort(0));  // each axis separately
  const int64_t n = sorted.size(0);
  const auto at = [&](int64_t i, int64_t axis) { return sorted.index({i, axis}).item<float>(); };
  const world::Vec3 middle{at(n / 2, 0), at(n / 2, 1), at(n / 2, 2)};
  const float width =
      std::max({at(n * 5 / 6, 0) - at(n / 6, 0), at(n * 5 / 6, 1) - at(n / 6, 1), 1e-3f});
  const float reach = 0.2f * width;
  return {middle + world::Vec3{0, 0, 1.3f * width},
          middle,
          {reach, 0.6f * reach, 0.6f * reach},
          {0.6f * reach, 0.4f * reach, 0.2f * reach},
          {0, 1, 0}};
}

}  // namespace jade::simulate
