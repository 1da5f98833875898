// SPDX-License-Identifier: Apache-2.0
// The splatting workloads: N Gaussians seen by the nine poses of one exposure.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/splat/render.h"

namespace jade::bench {

struct Workload {
  std::string name;
  splat::Gaussians gaussians;
  splat::CameraBatch cameras;
  torch::Tensor cotangent;  ///< [C,3,H,W], dL/dcolour at which the backward pass starts
};

struct WorkloadSize {
  std::string name;
  int64_t gaussians, width, height;
};

/// W1 to W4, and W5 (a million Gaussians).
const std::vector<WorkloadSize>& standard_sizes();

/// Samples a workload on the CPU: Gaussians of about two pixels in a slab of depth 3 to 7 that
/// fills the frame, and a hand-shake path of 4 mm and 0.3 degrees per step. Depends on the seed
/// alone.
Workload make_workload(const WorkloadSize& size, uint64_t seed = 0);

/// Reads a workload from a folder of .npy files and size.json, a format shared with other programs.
/// @throws DataError.
Workload read_workload(const std::filesystem::path& folder);
void write_workload(const Workload& workload, const std::filesystem::path& folder);

/// Names of the parameters in such a folder, in the order of `parameters()`.
extern const char* const kParameterNames[5];
std::vector<torch::Tensor> parameters(const splat::Gaussians& gaussians);

Workload to(const Workload& workload, torch::Device device);

}  // namespace jade::bench
