// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/splat_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/summary.h"

namespace jade::gaussians {
namespace {

constexpr size_t kRecordBytes = 32;
constexpr double kShDc = 0.28209479177387814;  ///< Y_0^0

}  // namespace

void write_splat(const std::filesystem::path& path, const splat::Gaussians& all) {
  const splat::Gaussians gaussians = drawable(all);
  const torch::Tensor means = file_tensor(gaussians.means);
  const torch::Tensor scales = file_tensor(gaussians.log_scales).exp();
  const torch::Tensor opacities = file_tensor(gaussians.logit_opacities).sigmoid();
  const torch::Tensor rgb = file_tensor(gaussians.sh.select(1, 0)) * kShDc + 0.5;
  const torch::Tensor rgba = (torch::cat({rgb, opacities.unsqueeze(1)}, 1) * 255)
                                 .round()
                                 .clamp(0, 255)
                                 .to(torch::kUInt8)
                                 .contiguous();
  const torch::Tensor rotations = file_tensor(gaussians.rotations);
  const torch::Tensor unit = rotations / rotations.norm(2, 1, true).clamp_min(1e-12);
  const torch::Tensor packed_rotations =
      (unit * 128 + 128).round().clamp(0, 255).to(torch::kUInt8).contiguous();
  const torch::Tensor importance = scales.prod(1) * opacities;
  const torch::Tensor order = importance.argsort(/*stable=*/true, 0, true);
  const auto* from = order.data_ptr<int64_t>();
  std::string content(static_cast<size_t>(gaussians.size()) * kRecordBytes, '\0');
  for (int64_t i = 0; i < gaussians.size(); ++i) {
    char* record = content.data() + static_cast<size_t>(i) * kRecordBytes;
    std::memcpy(record, means.data_ptr<float>() + 3 * from[i], 12);
    std::memcpy(record + 12, scales.data_ptr<float>() + 3 * from[i], 12);
    std::memcpy(record + 24, rgba.data_ptr<uint8_t>() + 4 * from[i], 4);
    std::memcpy(record + 28, packed_rotations.data_ptr<uint8_t>() + 4 * from[i], 4);
  }
  write_file(path, content);
}

}  // namespace jade::gaussians
