// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/alignment.h"

#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

/// [N,3,3] rotations and [N,3] centres.
struct Cameras {
  torch::Tensor rotations, centres;
};

Cameras stacked(const std::vector<Pose>& poses) {
  std::vector<torch::Tensor> rotations, centres;
  for (const Pose& pose : poses) {
    const torch::Tensor world_from_camera = to_tensor(inverse(pose));
    rotations.push_back(world_from_camera.narrow(0, 0, 3).narrow(1, 0, 3));
    centres.push_back(world_from_camera.narrow(0, 0, 3).select(1, 3));
  }
  return {torch::stack(rotations), torch::stack(centres)};
}

/// The rotation nearest to the sum of R_b R_aᵀ: the factor U Vᵀ with determinant 1.
torch::Tensor mean_rotation(const Cameras& a, const Cameras& b) {
  const torch::Tensor sum = b.rotations.matmul(a.rotations.transpose(1, 2)).sum(0);
  const auto [u, s, vt] = torch::linalg_svd(sum);
  torch::Tensor signs = torch::ones({3}, torch::kFloat64);
  signs[2] = torch::linalg_det(u.matmul(vt));
  return u.matmul(torch::diag(signs)).matmul(vt);
}

}  // namespace

Similarity align_cameras(const std::vector<Pose>& a, const std::vector<Pose>& b) {
  JADE_CHECK(!a.empty() && a.size() == b.size(), "cameras: ", a.size(), " and ", b.size());
  const Cameras from = stacked(a), to = stacked(b);
  const torch::Tensor rotation = mean_rotation(from, to);
  const torch::Tensor turned = from.centres.matmul(rotation.t());
  const torch::Tensor spread = turned - turned.mean(0), target = to.centres - to.centres.mean(0);
  const double power = spread.square().sum().item<double>();
  const double fitted = power > 1e-18 ? (spread * target).sum().item<double>() / power : 1;
  const double scale = fitted > 0 ? fitted : 1;
  const torch::Tensor translation = to.centres.mean(0) - scale * turned.mean(0);
  Similarity result;
  result.scale = scale;
  for (int i = 0; i < 9; ++i) result.rotation[i] = rotation[i / 3][i % 3].item<double>();
  for (int i = 0; i < 3; ++i) result.translation[i] = translation[i].item<double>();
  return result;
}

Pose moved(const Pose& camera_from_world, const Similarity& b_from_a) {
  const Pose turn = inverse({b_from_a.rotation, {0, 0, 0}});
  Vector3 centre_b = transform({b_from_a.rotation, {0, 0, 0}}, centre(camera_from_world));
  for (int i = 0; i < 3; ++i) {
    centre_b[i] = b_from_a.scale * centre_b[i] + b_from_a.translation[i];
  }
  return pose_at_centre(compose({camera_from_world.rotation, {0, 0, 0}}, turn).rotation, centre_b);
}

}  // namespace jade::geometry
