// SPDX-License-Identifier: Apache-2.0
// Byte layout after the format's public description (github.com/nianticlabs/spz, README): a 16-byte
// header, then positions, alphas, colours, scales, rotations and SH, each as one array.
#include "jade/gaussians/spz_file.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/log.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/summary.h"
#include "jade/io/gzip.h"

namespace jade::gaussians {
namespace {

constexpr uint32_t kMagic = 0x5053474e;  ///< "NGSP"
constexpr uint32_t kVersion = 2;
constexpr double kColorScale = 0.15;
/// Signs of the 15 SH coefficients beyond the first when y and z change sign.
constexpr double kFlip[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};

void put_u32(std::string& out, uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>(value >> shift & 255u);
}

void put_byte(std::string& out, double value) {
  const double bounded = std::clamp(std::round(value), 0.0, 255.0);
  out += static_cast<char>(static_cast<uint8_t>(bounded));
}

void put_positions(std::string& out, const torch::Tensor& means, int bits) {
  const double unit = std::ldexp(1.0, bits);
  const double* value = means.data_ptr<double>();
  for (int64_t i = 0; i < means.numel(); ++i) {
    const double sign = i % 3 == 0 ? 1 : -1;
    const auto fixed =
        static_cast<uint32_t>(static_cast<int32_t>(std::lround(sign * value[i] * unit)));
    for (int shift = 0; shift < 24; shift += 8) out += static_cast<char>(fixed >> shift & 255u);
  }
}

void put_rotations(std::string& out, const torch::Tensor& rotations) {
  const double* q = rotations.data_ptr<double>();
  for (int64_t i = 0; i < rotations.size(0); ++i, q += 4) {
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    // w is not stored and taken as positive; the turn of the axes negates y and z.
    const double scale = (q[0] < 0 ? -127.5 : 127.5) / std::max(norm, 1e-30);
    put_byte(out, q[1] * scale + 127.5);
    put_byte(out, -q[2] * scale + 127.5);
    put_byte(out, -q[3] * scale + 127.5);
  }
}

void put_sh(std::string& out, const torch::Tensor& sh, const SpzOptions& options) {
  const int64_t rest = sh.size(1) - 1;
  const double* row = sh.data_ptr<double>();
  for (int64_t i = 0; i < sh.size(0); ++i, row += sh.size(1) * 3) {
    for (int64_t k = 0; k < rest; ++k) {
      const int bits = k < 3 ? options.first_degree_bits : options.higher_degree_bits;
      const double step = std::ldexp(1.0, 8 - bits);
      for (int c = 0; c < 3; ++c) {
        const double fine = std::round(kFlip[k] * row[3 * (k + 1) + c] * 128) + 128;
        put_byte(out, std::floor((fine + step / 2) / step) * step);
      }
    }
  }
}

/// Steps of a position beyond this share of a typical coordinate are worth a warning.
constexpr double kCoarse = 1e-3;

/// The finest fixed point that still holds the farthest position in 24 bits.
int fitting_bits(const torch::Tensor& means, int wanted) {
  const double far = means.numel() == 0 ? 0 : means.abs().max().item<double>();
  int bits = wanted;
  while (bits > 0 && far * std::ldexp(1.0, bits) >= 8388607) --bits;
  if (far * std::ldexp(1.0, bits) >= 8388607) {
    throw DataError(concat("not written: positions reach ", far,
                           ", beyond the 8388607 units that .spz can hold; write .ply"));
  }
  // A single Gaussian far away decides for all.
  const double typical = means.numel() == 0 ? 0 : means.abs().median().item<double>();
  if (bits < wanted && std::ldexp(1.0, -bits) > kCoarse * typical) {
    log_warn(concat("positions are stored to ", std::ldexp(1.0, -bits),
                    " units, where half of their coordinates are below ", typical,
                    ": the farthest Gaussian, ", far,
                    " away, leaves no more; remove such Gaussians, or write .ply"));
  }
  return bits;
}

}  // namespace

std::string encode_spz(const splat::Gaussians& all, const SpzOptions& options) {
  const splat::Gaussians gaussians = drawable(all);
  const torch::Tensor means = file_tensor(gaussians.means, torch::kFloat64);
  const torch::Tensor sh = file_tensor(gaussians.sh, torch::kFloat64);
  const int64_t count = gaussians.size();
  for (const int bits : {options.first_degree_bits, options.higher_degree_bits}) {
    JADE_CHECK(bits >= 1 && bits <= 8, "encode_spz: expected 1 to 8 bits per coefficient, found ",
               bits);
  }
  JADE_CHECK(count < 60'000'000, "encode_spz: too many Gaussians for one stream: ", count);
  const int bits = fitting_bits(means, options.fractional_bits);
  const int degree = sh.size(1) == 1 ? 0 : sh.size(1) == 4 ? 1 : sh.size(1) == 9 ? 2 : 3;
  std::string content;
  content.reserve(16 + static_cast<size_t>(count) * static_cast<size_t>(19 + 3 * sh.size(1)));
  put_u32(content, kMagic);
  put_u32(content, kVersion);
  put_u32(content, static_cast<uint32_t>(count));
  content += static_cast<char>(degree);
  content += static_cast<char>(bits);
  content += static_cast<char>(options.antialiased ? 1 : 0);
  content += '\0';
  put_positions(content, means, bits);
  const torch::Tensor alphas = file_tensor(gaussians.logit_opacities, torch::kFloat64).sigmoid();
  for (int64_t i = 0; i < count; ++i) put_byte(content, alphas.data_ptr<double>()[i] * 255);
  const torch::Tensor dc = sh.select(1, 0).contiguous();
  for (int64_t i = 0; i < dc.numel(); ++i) {
    put_byte(content, dc.data_ptr<double>()[i] * kColorScale * 255 + 127.5);
  }
  const torch::Tensor scales = file_tensor(gaussians.log_scales, torch::kFloat64);
  for (int64_t i = 0; i < scales.numel(); ++i) {
    put_byte(content, (scales.data_ptr<double>()[i] + 10) * 16);
  }
  put_rotations(content, file_tensor(gaussians.rotations, torch::kFloat64));
  put_sh(content, sh, options);
  return io::gzip(content);
}

void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options) {
  std::string bytes;
  try {
    bytes = encode_spz(gaussians, options);
  } catch (const DataError& problem) {
    throw DataError(concat(path.string(), ": ", problem.what()));
  }
  write_file(path, bytes);
}

}  // namespace jade::gaussians
