// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply_packed.h"

#include <cmath>
#include <string>
#include <tuple>

#include "jade/core/error.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/smallest_three.h"
#include "jade/gaussians/spatial_order.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kChunkSize = 256;
const std::vector<std::string> kPacked = {"packed_position", "packed_rotation", "packed_scale",
                                          "packed_color"};

const std::vector<std::string> kRanges = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};

/// The bits of `packed` from `shift` on, as a number in [0,1].
torch::Tensor unit_of(const torch::Tensor& packed, int64_t shift, int64_t bits) {
  const int64_t most = (int64_t(1) << bits) - 1;
  return packed.bitwise_right_shift(shift).bitwise_and(most).to(torch::kFloat32) / double(most);
}

/// Unpacks [N,3] of 11, 10 and 11 bits.
torch::Tensor unpack_triple(const torch::Tensor& packed) {
  return torch::stack({unit_of(packed, 21, 11), unit_of(packed, 11, 10), unit_of(packed, 0, 11)},
                      1);
}

/// [N,4] wxyz: two bits select the largest component, ten bits each store the other three.
torch::Tensor unpack_rotations(const torch::Tensor& packed) {
  const torch::Tensor unit = fields_of(packed).to(torch::kFloat32) / 1023;
  return joined({packed.bitwise_right_shift(30), (unit - 0.5) * std::sqrt(2.0)});
}

/// Maps values in [0,1] to the range of each vertex's chunk.
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

/// Values of a chunk's vertices relative to their range.
struct Ranged {
  torch::Tensor unit;       ///< [N,3], in [0,1]
  torch::Tensor low, high;  ///< [chunks,3]
};

/// @param values  [N,3], whose rows share chunks of 256
Ranged ranged(const torch::Tensor& values) {
  const int64_t count = values.size(0), chunks = (count + kChunkSize - 1) / kChunkSize;
  // Pads with the last row, so that the last chunk is full.
  const torch::Tensor last = values.slice(0, count - 1).expand({chunks * kChunkSize - count, 3});
  const torch::Tensor whole = torch::cat({values, last}).reshape({chunks, kChunkSize, 3});
  Ranged out;
  out.low = std::get<0>(whole.min(1));
  out.high = std::get<0>(whole.max(1));
  const torch::Tensor reach = (out.high - out.low).unsqueeze(1);
  const torch::Tensor unit = (whole - out.low.unsqueeze(1)) / reach;
  out.unit =
      torch::where(reach > 0, unit, torch::zeros_like(unit)).reshape({-1, 3}).slice(0, 0, count);
  return out;
}

/// [N] int64 of columns with values in [0,1], the first in the highest bits.
torch::Tensor pack(const torch::Tensor& unit, const std::vector<int64_t>& bits) {
  torch::Tensor packed = torch::zeros({unit.size(0)}, torch::kInt64);
  for (size_t i = 0; i < bits.size(); ++i) {
    const int64_t steps = int64_t(1) << bits[i];
    const torch::Tensor column = unit.select(1, static_cast<int64_t>(i));
    packed = packed * steps + (column * double(steps - 1)).round().to(torch::kInt64);
  }
  return packed;
}

/// Number of SH coefficients without the highest degrees that are 0 everywhere, as those that
/// training has not reached: a byte has no value for 0.
int64_t used_coefficients(const torch::Tensor& sh) {
  for (const int64_t degree : {3, 2, 1}) {
    const int64_t begin = degree * degree, end = (degree + 1) * (degree + 1);
    if (sh.size(1) >= end && sh.slice(1, begin, end).ne(0).any().item<bool>()) return end;
  }
  return 1;
}

/// Bytes of SH coefficients [N,K] from -4 to 4. A byte has no value for 0, near which most are: the
/// nearest value would tint the scene. Of the two values beside a coefficient each is taken in
/// proportion to its nearness, in a fixed pattern, so that Gaussians that overlap average out.
torch::Tensor dithered(const torch::Tensor& coefficients) {
  constexpr double kGolden = 0.6180339887498949, kPlastic = 0.7548776662466927;
  const auto pattern = [](int64_t count, double step) {
    return (torch::arange(count, torch::kFloat64) * step).frac();
  };
  const torch::Tensor shift = (pattern(coefficients.size(0), kGolden).unsqueeze(1) +
                               pattern(coefficients.size(1), kPlastic).unsqueeze(0))
                                  .frac()
                                  .to(torch::kFloat32);
  return ((coefficients / 8 + 0.5) * 256 - 0.5 + shift).floor().clamp(0, 255).to(torch::kUInt8);
}

std::string header_text(int64_t count, int64_t rest, bool antialiased) {
  std::string text = concat("ply\nformat binary_little_endian 1.0\n", render_mode_line(antialiased),
                            "element chunk ", (count + kChunkSize - 1) / kChunkSize, "\n");
  for (const std::string& name : kRanges) text += concat("property float ", name, "\n");
  text += concat("element vertex ", count, "\n");
  for (const std::string& name : kPacked) text += concat("property uint ", name, "\n");
  if (rest > 0) text += concat("element sh ", count, "\n");
  for (int64_t i = 0; i < rest; ++i) text += concat("property uchar f_rest_", i, "\n");
  return text + "end_header\n";
}

}  // namespace

std::string encode_packed_ply(const splat::Gaussians& all, bool antialiased) {
  const torch::Tensor order = spatial_order(all.means);
  const splat::Gaussians gaussians = map_parameters(
      all, [&](const auto& value) { return file_tensor(value).index_select(0, order); });
  const int64_t used = used_coefficients(gaussians.sh);
  const int64_t count = gaussians.size(), rest = 3 * (used - 1);
  std::string out = header_text(count, rest, antialiased);
  if (count == 0) return out;
  const Ranged places = ranged(gaussians.means), scales = ranged(gaussians.log_scales);
  const Ranged colors = ranged(gaussians.sh.select(1, 0) * splat::math::kSh0 + 0.5);
  out += content_of(
      torch::cat({places.low, places.high, scales.low, scales.high, colors.low, colors.high}, 1));
  const SmallestThree parts = smallest_three(gaussians.rotations);
  const torch::Tensor fields =
      ((parts.others / std::sqrt(2.0) + 0.5) * 1023).round().clamp(0, 1023);
  const torch::Tensor opacity = gaussians.logit_opacities.sigmoid().unsqueeze(1);
  const torch::Tensor packed = torch::stack(
      {pack(places.unit, {11, 10, 11}), packed_32(parts.largest, fields.to(torch::kInt64)),
       pack(scales.unit, {11, 10, 11}), pack(torch::cat({colors.unit, opacity}, 1), {8, 8, 8, 8})},
      1);
  // The lower half of each int64 contains the bits, because the machine is little-endian.
  out += content_of(packed.view(torch::kInt32).reshape({count, 4, 2}).select(2, 0));
  return out + content_of(
                   dithered(gaussians.sh.slice(1, 1, used).transpose(1, 2).reshape({count, rest})));
}

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
  out.sh = torch::cat({((rgb - 0.5) / splat::math::kSh0).unsqueeze(1), unpack_rest(file)}, 1);
  return out;
}

}  // namespace jade::gaussians
