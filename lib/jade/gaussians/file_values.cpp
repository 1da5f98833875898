// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/file_values.h"

#include <limits>
#include <tuple>

#include "jade/geometry/origin.h"
#include "jade/splat/math/projection.h"

namespace jade::gaussians {
namespace {

/// Logit of an opacity that is 1 in float32. Converters write infinity if a byte format has 255.
constexpr double kFullLogit = 30;

/// Log thickness of a flat Gaussian relative to its thinnest other axis: a thousandth.
constexpr double kLogFlatness = -6.9;
/// Log scale of Gaussians that are flat along all axes: points of 1e-7.
constexpr double kLogPoint = -16;

}  // namespace

int64_t make_finite(splat::Gaussians& g) {
  const torch::Tensor logits = g.logit_opacities;
  g.logit_opacities = torch::where(logits.abs() > splat::math::kMaxAbsLogit,
                                   logits.clamp(-kFullLogit, kFullLogit), logits)
                          .contiguous();
  const torch::Tensor thin = g.log_scales < -splat::math::kMaxAbsLogScale;
  const torch::Tensor flat = thin.any(1);
  const auto count = flat.sum().item<int64_t>();
  if (count == 0) return 0;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const torch::Tensor thinnest = std::get<0>(g.log_scales.masked_fill(thin, kNone).min(1));
  const torch::Tensor depth =
      torch::where(thinnest.isinf(), torch::full_like(thinnest, kLogPoint),
                   (thinnest + kLogFlatness).clamp_min(1 - splat::math::kMaxAbsLogScale));
  g.log_scales = torch::where(thin, depth.unsqueeze(1), g.log_scales).contiguous();
  return count;
}

geometry::Vector3 found_origin(const torch::Tensor& places) {
  const torch::Tensor finite = places.index({places.isfinite().all(1)}).to(torch::kFloat64);
  if (finite.size(0) == 0) return {0, 0, 0};
  const torch::Tensor middle = std::get<0>(finite.median(0));
  const double size = (finite - middle).norm(2, 1).median().item<double>();
  return geometry::scene_origin(
      {middle[0].item<double>(), middle[1].item<double>(), middle[2].item<double>()}, size);
}

int sh_degree_of(int64_t coefficients) {
  return coefficients == 1 ? 0 : coefficients == 4 ? 1 : coefficients == 9 ? 2 : 3;
}

torch::Tensor to_bytes(const torch::Tensor& values) {
  return values.round().clamp(0, 255).to(torch::kUInt8).contiguous();
}

std::string content_of(const torch::Tensor& tensor) {
  const torch::Tensor whole = tensor.contiguous();
  return {static_cast<const char*>(whole.data_ptr()), whole.nbytes()};
}

torch::Tensor numbers_of(std::string_view bytes, const std::vector<int64_t>& shape) {
  auto* const data = const_cast<char*>(bytes.data());
  return torch::from_blob(data, shape, torch::kUInt8).to(torch::kFloat32);
}

uint64_t unsigned_at(std::string_view bytes, size_t at, size_t size) {
  uint64_t value = 0;
  for (size_t i = 0; i < size; ++i) {
    value |= static_cast<uint64_t>(static_cast<unsigned char>(bytes[at + i])) << (8 * i);
  }
  return value;
}

void put_unsigned(std::string& out, uint64_t value, size_t size) {
  for (size_t i = 0; i < size; ++i) out += static_cast<char>(value >> (8 * i) & 255u);
}

}  // namespace jade::gaussians
