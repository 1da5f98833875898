// SPDX-License-Identifier: Apache-2.0
#include <torch/types.h>

#include "jade/geometry/exposure_path.h"
#include "jade/geometry/exposure_path_math.h"

namespace jade::geometry::cpu {
namespace {

PathPointers pointers_of(const ExposurePath& path) {
  return {path.twists.const_data_ptr<double>(), path.u.const_data_ptr<double>(),
          path.base.const_data_ptr<double>(), static_cast<int>(path.twists.size(0)), path.corrects};
}

}  // namespace

torch::Tensor exposure_path(const ExposurePath& path) {
  const PathPointers pointers = pointers_of(path);
  torch::Tensor poses = torch::empty({path.u.size(0), 4, 4}, path.u.options());
  double* const out = poses.mutable_data_ptr<double>();
  for (int64_t m = 0; m < path.u.size(0); ++m) {
    store_motion(path_pose<double>(pointers, m, -1), out + 16 * m);
  }
  return poses;
}

torch::Tensor exposure_path_backward(const ExposurePath& path, const torch::Tensor& gradient) {
  const PathPointers pointers = pointers_of(path);
  torch::Tensor of_twists = torch::zeros_like(path.twists);
  double* const out = of_twists.mutable_data_ptr<double>();
  const double* const of_poses = gradient.const_data_ptr<double>();
  for (int direction = 0; direction < 6 * pointers.control; ++direction) {
    for (int64_t m = 0; m < path.u.size(0); ++m) {
      out[direction] += gradient_along(pointers, of_poses, m, direction);
    }
  }
  return of_twists;
}

}  // namespace jade::geometry::cpu
