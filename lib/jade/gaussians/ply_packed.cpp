// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply_packed.h"

#include <cmath>
#include <string>

#include "jade/core/error.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kChunkSize = 256;
constexpr double kShConstant = 0.28209479177387814;  ///< Y_0^0
const std::vector<std::string> kPacked = {"packed_position", "packed_rotation", "packed_scale",
                                          "packed_color"};

/// The bits of `packed` from `shift` on, as a number from 0 to 1.
torch::Tensor unit_of(const torch::Tensor& packed, int64_t shift, int64_t bits) {
  const int64_t most = (int64_t(1) << bits) - 1;
  return packed.bitwise_right_shift(shift).bitwise_and(most).to(torch::kFloat32) / double(most);
}

/// [N,3] of 11, 10 and 11 bits.
torch::Tensor unpack_triple(const torch::Tensor& packed) {
  return torch::stack({unit_of(packed, 21, 11), unit_of(packed, 11, 10), unit_of(packed, 0, 11)},
                      1);
}

/// [N,4] wxyz: two bits tell the largest component, ten bits each the other three.
torch::Tensor unpack_rotations(const torch::Tensor& packed) {
  const double reach = std::sqrt(2.0);  // the other three lie within ±1/√2
  torch::Tensor rest[3];
  for (int64_t i = 0; i < 3; ++i) rest[i] = (unit_of(packed, 20 - 10 * i, 10) - 0.5) * reach;
  const torch::Tensor largest =
      (1 - rest[0].square() - rest[1].square() - rest[2].square()).clamp_min(0).sqrt();
  const torch::Tensor which = packed.bitwise_right_shift(30);
  std::vector<torch::Tensor> components;
  for (int64_t i = 0; i < 4; ++i) {
    const torch::Tensor& after = rest[i > 0 ? i - 1 : 0];
    const torch::Tensor& before = rest[i < 3 ? i : 2];
    components.push_back(
        torch::where(which.eq(i), largest, torch::where(which.lt(i), after, before)));
  }
  return torch::stack(components, 1);
}

/// Values from 0 to 1 in the range that each vertex's chunk has for them.
class Chunks {
 public:
  explicit Chunks(const PlyFile& file) : file_(file), element_(file.element("chunk")) {
    const int64_t count = file.vertices().count;
    if (element_ == nullptr || element_->count * kChunkSize < count) {
      throw DataError(concat(file.path().string(), ": expected a chunk for every ", kChunkSize,
                             " of ", count, " packed vertices, found ",
                             element_ == nullptr ? 0 : element_->count,
                             "; export the scene again"));
    }
    row_of_ = torch::arange(count, torch::kInt64).div(kChunkSize, "floor");
  }
  bool has(const std::string& name) const { return element_->find(name) >= 0; }
  torch::Tensor place(const torch::Tensor& values, const std::vector<std::string>& low,
                      const std::vector<std::string>& high) const {
    const auto rows = [&](const std::vector<std::string>& names) {
      return file_.read(*element_, names, torch::kFloat32).index_select(0, row_of_);
    };
    return rows(low) * (1 - values) + rows(high) * values;
  }

 private:
  const PlyFile& file_;
  const PlyElement* element_;
  torch::Tensor row_of_;
};

/// [N,K,3]: coefficients above the constant from the bytes of the element 'sh', channel-major.
torch::Tensor unpack_rest(const PlyFile& file) {
  const PlyElement* const element = file.element("sh");
  const int64_t count = file.vertices().count;
  if (element == nullptr) return torch::empty({count, 0, 3}, torch::kFloat32);
  std::vector<std::string> names;
  while (element->find(concat("f_rest_", names.size())) >= 0)
    names.push_back(concat("f_rest_", names.size()));
  const auto properties = int64_t(names.size());
  if (element->count != count || (properties != 9 && properties != 24 && properties != 45)) {
    throw DataError(concat(file.path().string(), ": expected 9, 24 or 45 f_rest properties of ",
                           count, " rows in its element 'sh', found ", properties, " of ",
                           element->count, "; export the scene again"));
  }
  const torch::Tensor bytes = file.read(*element, names, torch::kFloat32);
  torch::Tensor unit = (bytes + 0.5) / 256;
  unit = torch::where(bytes.eq(0), torch::zeros_like(unit), unit);
  unit = torch::where(bytes.eq(255), torch::ones_like(unit), unit);
  return ((unit - 0.5) * 8).reshape({count, 3, properties / 3}).transpose(1, 2);
}

}  // namespace

bool is_packed(const PlyFile& file) {
  for (const std::string& name : kPacked) {
    if (file.vertices().find(name) < 0) return false;
  }
  return true;
}

splat::Gaussians unpack(const PlyFile& file) {
  const Chunks chunks(file);
  const torch::Tensor packed =
      file.read(file.vertices(), kPacked, torch::kFloat64).to(torch::kInt64);
  const torch::Tensor color = packed.select(1, 3);
  splat::Gaussians out;
  out.means = chunks.place(unpack_triple(packed.select(1, 0)), {"min_x", "min_y", "min_z"},
                           {"max_x", "max_y", "max_z"});
  out.rotations = unpack_rotations(packed.select(1, 1));
  out.log_scales = chunks.place(unpack_triple(packed.select(1, 2)),
                                {"min_scale_x", "min_scale_y", "min_scale_z"},
                                {"max_scale_x", "max_scale_y", "max_scale_z"});
  torch::Tensor rgb =
      torch::stack({unit_of(color, 24, 8), unit_of(color, 16, 8), unit_of(color, 8, 8)}, 1);
  if (chunks.has("min_r")) {
    rgb = chunks.place(rgb, {"min_r", "min_g", "min_b"}, {"max_r", "max_g", "max_b"});
  }
  out.logit_opacities = torch::logit(unit_of(color, 0, 8));
  out.sh = torch::cat({((rgb - 0.5) / kShConstant).unsqueeze(1), unpack_rest(file)}, 1);
  return out;
}

}  // namespace jade::gaussians
