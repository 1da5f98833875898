// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/splat_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/summary.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

constexpr size_t kRecordBytes = 32;

}  // namespace

void write_splat(const std::filesystem::path& path, const splat::Gaussians& all) {
  const splat::Gaussians gaussians = drawable(all);
  const torch::Tensor means = file_tensor(gaussians.means);
  const torch::Tensor scales = file_tensor(gaussians.log_scales).exp();
  const torch::Tensor opacities = file_tensor(gaussians.logit_opacities).sigmoid();
  const torch::Tensor rgb = file_tensor(gaussians.sh.select(1, 0)) * splat::math::kSh0 + 0.5;
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

GaussianFile read_splat(const std::filesystem::path& path) {
  const std::string content = read_file(path);
  if (content.empty() || content.size() % kRecordBytes != 0) {
    throw DataError(concat(path.string(), ": expected a .splat, records of ", kRecordBytes,
                           " bytes, found ", content.size(), " bytes; copy the file again"));
  }
  const auto count = static_cast<int64_t>(content.size() / kRecordBytes);
  auto* const data = const_cast<char*>(content.data());
  const torch::Tensor floats = torch::from_blob(data, {count, 8}, torch::kFloat32).clone();
  const torch::Tensor bytes = numbers_of(content, {count, 32});
  GaussianFile file;
  file.gaussians.means = floats.slice(1, 0, 3).contiguous();
  file.gaussians.log_scales = floats.slice(1, 3, 6).log();
  file.gaussians.logit_opacities = torch::logit(bytes.select(1, 27) / 255);
  file.gaussians.rotations = (bytes.slice(1, 28) - 128) / 128;
  file.gaussians.sh =
      ((bytes.slice(1, 24, 27) / 255 - 0.5) / splat::math::kSh0).unsqueeze(1).contiguous();
  make_finite(file.gaussians);
  return file;
}

}  // namespace jade::gaussians
