// SPDX-License-Identifier: Apache-2.0
#include "workload.h"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/npy.h"

namespace jade::bench {

namespace {

constexpr int kViews = 9;
constexpr double kSigmaPx = 2.0;
constexpr double kPi = 3.14159265358979323846;

torch::Tensor intrinsics_of(const torch::Tensor& k, int64_t views) {
  return torch::stack({k[0][0], k[1][1], k[0][2], k[1][2]}).unsqueeze(0).repeat({views, 1});
}

torch::Tensor hand_shake_path() {
  const torch::Tensor poses = torch::zeros({kViews, 4, 4});
  auto pose = poses.accessor<float, 3>();
  for (int k = 0; k < kViews; ++k) {
    const double t = (k - 4) / 4.0, angle = 1.2 * t * kPi / 180.0;
    pose[k][0][0] = pose[k][2][2] = static_cast<float>(std::cos(angle));
    pose[k][0][2] = static_cast<float>(std::sin(angle));
    pose[k][2][0] = static_cast<float>(-std::sin(angle));
    pose[k][0][3] = static_cast<float>(0.016 * t);
    pose[k][1][3] = static_cast<float>(0.008 * t * t);
    pose[k][2][3] = static_cast<float>(0.004 * t);
    pose[k][1][1] = pose[k][3][3] = 1;
  }
  return poses;
}

}  // namespace

const char* const kParameterNames[5] = {"means", "quats", "log_scales", "logit_opacities", "sh"};

const std::vector<WorkloadSize>& standard_sizes() {
  static const std::vector<WorkloadSize> sizes = {{"W1", 30000, 346, 260},
                                                  {"W2", 100000, 346, 260},
                                                  {"W3", 100000, 600, 400},
                                                  {"W4", 300000, 600, 400},
                                                  {"W5", 1000000, 1600, 1060}};
  return sizes;
}

std::vector<torch::Tensor> parameters(const splat::Gaussians& g) {
  return {g.means, g.rotations, g.log_scales, g.logit_opacities, g.sh};
}

Workload make_workload(const WorkloadSize& size, uint64_t seed) {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  const auto uniform = [&](torch::IntArrayRef shape) { return torch::rand(shape, generator); };
  const auto normal = [&](torch::IntArrayRef shape) { return torch::randn(shape, generator); };
  const int64_t n = size.gaussians;
  const double w = static_cast<double>(size.width), h = static_cast<double>(size.height);
  const double focal_px = 0.9 * w;
  // The order of the samples and of the roundings is part of the format.
  const torch::Tensor z = 3.0 + 4.0 * uniform({n});
  const torch::Tensor x = (uniform({n}) - 0.5) * 1.1 * w / focal_px * z;
  const torch::Tensor y = (uniform({n}) - 0.5) * 1.1 * h / focal_px * z;
  const torch::Tensor spread = torch::exp(0.5 * normal({n, 3}));
  const torch::Tensor scales = (kSigmaPx * z / focal_px).unsqueeze(1) * spread;
  Workload workload;
  workload.name = size.name;
  splat::Gaussians& g = workload.gaussians;
  g.rotations = normal({n, 4});
  g.logit_opacities = 1.5 * normal({n});
  const torch::Tensor dc = 0.8 * normal({n, 1, 3});
  g.sh = torch::cat({dc, 0.1 * normal({n, 15, 3})}, 1);
  g.means = torch::stack({x, y, z}, -1);
  g.log_scales = torch::log(scales);
  const torch::Tensor k =
      torch::tensor({focal_px, 0.0, w / 2, 0.0, focal_px, h / 2, 0.0, 0.0, 1.0}, torch::kFloat32);
  workload.cameras = {hand_shake_path(), intrinsics_of(k.view({3, 3}), kViews), size.width,
                      size.height};
  workload.cotangent =
      torch::randn({kViews, 3, size.height, size.width}, at::detail::createCPUGenerator(seed + 1));
  return workload;
}

Workload read_workload(const std::filesystem::path& folder) {
  const auto read = [&](const std::string& name) { return io::read_npy(folder / (name + ".npy")); };
  std::ifstream file(folder / "size.json");
  if (!file) throw DataError(concat(folder.string(), "/size.json: cannot be read"));
  const auto size = nlohmann::json::parse(file, nullptr, false);
  if (size.is_discarded() || !size.contains("width") || !size.contains("height")) {
    throw DataError(concat(folder.string(), "/size.json: expected an object with width, height"));
  }
  Workload workload;
  workload.name = folder.filename().empty() ? folder.parent_path().filename().string()
                                            : folder.filename().string();
  workload.gaussians = {read("means"), read("quats"), read("log_scales"), read("logit_opacities"),
                        read("sh")};
  const torch::Tensor poses = read("camera_from_world");
  workload.cameras = {poses, intrinsics_of(read("intrinsics"), poses.size(0)),
                      size["width"].get<int64_t>(), size["height"].get<int64_t>()};
  workload.cotangent = read("cotangent");
  return workload;
}

void write_workload(const Workload& workload, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  const auto write = [&](const std::string& name, const torch::Tensor& tensor) {
    io::write_npy(folder / (name + ".npy"), tensor);
  };
  const auto tensors = parameters(workload.gaussians);
  for (size_t i = 0; i < tensors.size(); ++i) write(kParameterNames[i], tensors[i]);
  const torch::Tensor values = workload.cameras.intrinsics[0];
  const torch::Tensor k = torch::eye(3);
  k[0][0] = values[0];
  k[1][1] = values[1];
  k[0][2] = values[2];
  k[1][2] = values[3];
  write("intrinsics", k);
  write("camera_from_world", workload.cameras.camera_from_world);
  write("cotangent", workload.cotangent);
  const nlohmann::json size = {{"gaussians", workload.gaussians.size()},
                               {"width", workload.cameras.width},
                               {"height", workload.cameras.height},
                               {"views", workload.cameras.camera_from_world.size(0)}};
  std::ofstream file(folder / "size.json");
  if (!(file << size.dump() << '\n')) {
    throw DataError(concat(folder.string(), "/size.json: cannot be written"));
  }
}

Workload to(const Workload& workload, torch::Device device) {
  Workload moved = workload;
  splat::Gaussians& g = moved.gaussians;
  for (torch::Tensor* t :
       {&g.means, &g.rotations, &g.log_scales, &g.logit_opacities, &g.sh,
        &moved.cameras.camera_from_world, &moved.cameras.intrinsics, &moved.cotangent}) {
    *t = t->to(device, torch::kFloat32).contiguous();
  }
  return moved;
}

}  // namespace jade::bench
