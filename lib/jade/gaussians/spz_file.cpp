// SPDX-License-Identifier: Apache-2.0
// Implements the format's public description and its reference reader (github.com/nianticlabs/spz):
// a header, then positions, alphas, colours, scales, rotations and SH, each as one array. Versions
// 2 and 3 are one gzip stream with a header of 16 bytes. Version 4 has a plain header of 32 bytes,
// a table of sizes and one Zstandard stream per array.
#include "jade/gaussians/spz_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/gaussians/axes.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/smallest_three.h"
#include "jade/gaussians/summary.h"
#include "jade/io/gzip.h"
#include "jade/io/zstd.h"

namespace jade::gaussians {
namespace {

constexpr uint32_t kMagic = 0x5053474e;  ///< "NGSP"
constexpr size_t kHeader = 16, kHeader4 = 32, kTableRow = 16;
constexpr unsigned kAntialiased = 1;  ///< bit of the header's flags
constexpr int kMostDegree = 4;
constexpr int kReadDegree = 3;
constexpr int kMostBits = 24;  ///< after the binary point
constexpr double kLeastLogScale = -10, kLogScaleSteps = 16;
constexpr double kColorScale = 0.15;
constexpr double kRotationSteps = 511;  ///< of a component from 0 to 1/√2, in versions 3 and 4

enum Stream : size_t { kPositions, kAlphas, kColors, kScales, kRotations, kSh, kStreams };
using Streams = std::array<std::string, kStreams>;

struct Header {
  int version = 2;
  uint64_t count = 0;
  int degree = 0;  ///< of SH
  int bits = 12;   ///< after the binary point of positions
  bool antialiased = false;
  bool extended = false;  ///< may have more data behind the arrays
};

/// Bytes of each array.
std::array<uint64_t, kStreams> sizes_of(const Header& header) {
  const auto rest = static_cast<uint64_t>((header.degree + 1) * (header.degree + 1) - 1);
  const uint64_t rotation = header.version == 2 ? 3 : 4;
  std::array<uint64_t, kStreams> sizes = {9, 1, 3, 3, rotation, 3 * rest};
  for (uint64_t& size : sizes) size *= header.count;
  return sizes;
}

/// Little-endian integers of `size` bytes each.
std::string packed_integers(const torch::Tensor& values, int64_t size) {
  std::vector<torch::Tensor> bytes;
  for (int64_t i = 0; i < size; ++i) {
    bytes.push_back(values.bitwise_right_shift(8 * i).bitwise_and(255).to(torch::kUInt8));
  }
  return content_of(torch::stack(bytes, -1));
}

std::string positions_of(const torch::Tensor& means, int bits) {
  return packed_integers((means * std::ldexp(1.0, bits)).round().to(torch::kInt64), 3);
}

/// The imaginary part, signed so that the real part, which is not stored, is positive.
std::string rotations_2(const torch::Tensor& rotations) {
  const torch::Tensor norm = rotations.norm(2, 1, true).clamp_min(1e-30);
  const torch::Tensor sign = torch::where(rotations.slice(1, 0, 1) < 0, -1.0, 1.0);
  return content_of(to_bytes(rotations.slice(1, 1) / norm * sign * 127.5 + 127.5));
}

/// The three smallest components of xyzw as a sign and nine bits each.
std::string rotations_3(const torch::Tensor& rotations) {
  const SmallestThree parts = smallest_three(rotations.roll(-1, 1));
  const torch::Tensor steps =
      (parts.others.abs() * (std::sqrt(2.0) * kRotationSteps)).round().clamp_max(kRotationSteps);
  const torch::Tensor fields = steps.to(torch::kInt64) + 512 * parts.others.lt(0).to(torch::kInt64);
  return packed_integers(packed_32(parts.largest, fields), 4);
}

std::string sh_of(const torch::Tensor& sh, const SpzOptions& options) {
  const torch::Tensor fine = (sh.slice(1, 1) * 128).round() + 128;
  torch::Tensor steps = torch::full(
      {fine.size(1), 1}, std::ldexp(1.0, 8 - options.higher_degree_bits), torch::kFloat64);
  steps.slice(0, 0, 3).fill_(std::ldexp(1.0, 8 - options.first_degree_bits));
  return content_of(to_bytes(((fine + steps / 2) / steps).floor() * steps));
}

torch::Tensor rotations_from(const std::string& bytes, const Header& header) {
  const auto count = static_cast<int64_t>(header.count);
  if (header.version == 2) {
    const torch::Tensor xyz = numbers_of(bytes, {count, 3}) / 127.5 - 1;
    const torch::Tensor w = (1 - xyz.square().sum(1, true)).clamp_min(0).sqrt();
    return torch::cat({w, xyz}, 1);
  }
  const torch::Tensor weights = torch::tensor({1, 256, 65536, 16777216}, torch::kInt64);
  const torch::Tensor packed = (numbers_of(bytes, {count, 4}).to(torch::kInt64) * weights).sum(1);
  const torch::Tensor fields = fields_of(packed);
  const torch::Tensor size =
      fields.bitwise_and(511).to(torch::kFloat32) / (std::sqrt(2.0) * kRotationSteps);
  const torch::Tensor others = torch::where(fields.ge(512), -size, size);
  return joined({packed.bitwise_right_shift(30), others}).roll(1, 1);
}

splat::Gaussians decoded(const Streams& streams, const Header& header) {
  const auto count = static_cast<int64_t>(header.count);
  splat::Gaussians out;
  const torch::Tensor bytes = numbers_of(streams[kPositions], {count, 3, 3}).to(torch::kFloat64);
  torch::Tensor fixed = bytes.select(2, 0) + 256 * bytes.select(2, 1) + 65536 * bytes.select(2, 2);
  fixed = torch::where(fixed >= 8388608, fixed - 16777216, fixed);
  out.means = (fixed * std::ldexp(1.0, -header.bits)).to(torch::kFloat32);
  out.logit_opacities = torch::logit(numbers_of(streams[kAlphas], {count}) / 255);
  out.log_scales = numbers_of(streams[kScales], {count, 3}) / kLogScaleSteps + kLeastLogScale;
  out.rotations = rotations_from(streams[kRotations], header);
  const torch::Tensor dc = (numbers_of(streams[kColors], {count, 1, 3}) / 255 - 0.5) / kColorScale;
  const int64_t all = (header.degree + 1) * (header.degree + 1) - 1;
  const torch::Tensor rest = (numbers_of(streams[kSh], {count, all, 3}) - 128) / 128;
  out.sh = torch::cat({dc, rest.slice(1, 0, 15)}, 1);
  return half_turn(out);
}

/// @param bytes  from the magic number on
Header header_of(std::string_view bytes, const std::string& name) {
  if (bytes.size() < kHeader || unsigned_at(bytes, 0, 4) != kMagic) {
    throw DataError(
        concat(name, ": expected the mark NGSP of an .spz, found none; copy the file ", "again"));
  }
  Header header;
  const uint64_t version = unsigned_at(bytes, 4, 4);
  if (version < 2 || version > 4) {
    throw DataError(concat(name, ": expected .spz of version 2, 3 or 4, found version ", version,
                           "; write the scene again with another program"));
  }
  header.version = static_cast<int>(version);
  header.count = unsigned_at(bytes, 8, 4);
  header.degree = static_cast<int>(unsigned_at(bytes, 12, 1));
  header.bits = static_cast<int>(unsigned_at(bytes, 13, 1));
  const uint64_t flags = unsigned_at(bytes, 14, 1);
  header.antialiased = (flags & kAntialiased) != 0;
  header.extended = flags > kAntialiased;
  if (header.degree > kMostDegree || header.bits > kMostBits) {
    throw DataError(concat(name, ": expected SH degree 0 to 4 and positions with up to 24 bits ",
                           "after the binary point, found ", header.degree, " and ", header.bits,
                           "; copy the file again"));
  }
  return header;
}

DataError cut_short(const std::string& name, uint64_t expected, uint64_t found) {
  return DataError(concat(name, ": expected at least ", expected, " bytes, as its header says, ",
                          "found ", found, "; copy the file again"));
}

/// Arrays, and the number of bytes behind them.
struct Content {
  Streams streams;
  uint64_t rest = 0;
};

/// Splits the content of versions 2 and 3 into arrays.
Content cut(std::string_view content, const Header& header, const std::string& name) {
  Streams streams;
  size_t at = kHeader;
  const auto sizes = sizes_of(header);
  uint64_t all = kHeader;
  for (const uint64_t size : sizes) all += size;
  if (content.size() < all) throw cut_short(name, all, content.size());
  for (size_t i = 0; i < kStreams; ++i) {
    streams[i] = content.substr(at, sizes[i]);
    at += sizes[i];
  }
  return {std::move(streams), content.size() - all};
}

/// Unpacks the arrays of version 4; an empty array has no stream.
Content unpack_streams(std::string_view bytes, const Header& header, const std::string& name) {
  if (bytes.size() < kHeader4) throw cut_short(name, kHeader4, bytes.size());
  const uint64_t count = unsigned_at(bytes, 15, 1), table = unsigned_at(bytes, 16, 4);
  const auto sizes = sizes_of(header);
  const auto expected = static_cast<uint64_t>(
      std::count_if(sizes.begin(), sizes.end(), [](auto s) { return s > 0; }));
  if (count != expected || table < kHeader4) {
    throw DataError(concat(name, ": expected ", expected, " streams behind a header of 32 bytes, ",
                           "found ", count, " and a table at ", table, "; copy the file again"));
  }
  uint64_t at = table + count * kTableRow;
  if (bytes.size() < at) throw cut_short(name, at, bytes.size());
  Streams streams;
  uint64_t row = table;
  for (size_t i = 0; i < kStreams; ++i) {
    if (sizes[i] == 0) continue;
    const uint64_t packed = unsigned_at(bytes, row, 8), whole = unsigned_at(bytes, row + 8, 8);
    row += kTableRow;
    if (whole != sizes[i]) {
      throw DataError(concat(name, ": expected ", sizes[i], " bytes in stream ", i, ", found ",
                             whole, "; copy the file again"));
    }
    if (packed > bytes.size() - at) throw cut_short(name, at + packed, bytes.size());
    streams[i] = io::unzstd(bytes.substr(at, packed), whole, name);
    at += packed;
  }
  return {std::move(streams), bytes.size() - at};
}

/// Warn if the step of positions exceeds these shares of the median distance from the middle and
/// of the median longest axis.
constexpr double kCoarse = 1e-3, kCoarseOfSize = 0.1;

/// The most fractional bits with which the farthest position fits 24 bits.
int fitting_bits(const splat::Gaussians& g, int most, const std::string& name) {
  if (g.size() == 0) return most;
  const double far = g.means.abs().max().item<double>();
  int bits = most;
  while (bits > 0 && far * std::ldexp(1.0, bits) >= 8388607) --bits;
  if (far * std::ldexp(1.0, bits) >= 8388607) {
    throw DataError(concat(name, ": expected positions within the 8388607 units that .spz can ",
                           "hold, found ", far, "; write .ply"));
  }
  // The farthest Gaussian determines the step for all.
  const torch::Tensor middle = std::get<0>(g.means.median(0));
  const double distance = (g.means - middle).norm(2, 1).median().item<double>();
  const double size = g.log_scales.amax(1).median().exp().item<double>();
  const double step = std::ldexp(1.0, -bits);
  if ((distance > 0 && step > kCoarse * distance) || step > kCoarseOfSize * size) {
    log_warn(concat(name, ": positions are stored in steps of ", step,
                    " units, where half of the Gaussians lie within ", distance,
                    " of the middle and are shorter than ", size,
                    bits < kMostBits
                        ? concat("; the farthest one, ", far, " from the origin, leaves no finer ",
                                 "steps: delete such Gaussians, or write .ply")
                        : "; .spz has no finer steps: enlarge the scene, or write .ply"));
  }
  return bits;
}

/// Warn if more than this share of the Gaussians is too small. Trained scenes have a few specks.
constexpr double kFewSpecks = 0.05;
/// Log of the elongation from which the thinnest axis does not show.
constexpr double kThin = 2.3;

/// Warns of Gaussians whose size changes visibly because the format cannot hold it.
void check_sizes(const torch::Tensor& log_scales, const std::string& name) {
  if (log_scales.size(0) == 0) return;
  constexpr double kLeast = kLeastLogScale, kMost = kLeast + 255 / kLogScaleSteps;
  constexpr double kRounding = 0.5 / kLogScaleSteps;
  const auto count = [](const torch::Tensor& mask) { return mask.sum().item<int64_t>(); };
  const torch::Tensor thinner = log_scales.amin(1) < kLeast - kRounding;
  // A speck that is small beside the other Gaussians does not show either.
  const bool specks_show =
      std::exp(kLeast) > kCoarseOfSize * log_scales.amax(1).median().exp().item<double>();
  const int64_t small = count(thinner.logical_and(log_scales.amax(1) < kLeast + kThin));
  const int64_t large = count(log_scales.amax(1) > kMost + kRounding);
  if (large == 0 && (!specks_show || double(small) <= kFewSpecks * double(log_scales.size(0))))
    return;
  log_warn(concat(name, ": expected axes of ", readable(std::exp(kLeast), 2), " to ",
                  readable(std::exp(kMost), 3), " units, which .spz can hold, found ",
                  grouped(small), " smaller and ", grouped(large), " larger of ",
                  grouped(log_scales.size(0)),
                  " Gaussians, which are stored at these limits; scale the scene, or write .ply"));
}

}  // namespace

std::string encode_spz(const splat::Gaussians& all, const SpzOptions& options,
                       const std::string& name) {
  const splat::Gaussians gaussians = half_turn(map_parameters(
      drawable(all), [](const auto& value) { return file_tensor(value, torch::kFloat64); }));
  for (const int bits : {options.first_degree_bits, options.higher_degree_bits}) {
    JADE_CHECK(bits >= 1 && bits <= 8, "encode_spz: expected 1 to 8 bits per coefficient, found ",
               bits);
  }
  JADE_CHECK(options.version >= 2 && options.version <= 4,
             "encode_spz: expected version 2, 3 or 4, found ", options.version);
  JADE_CHECK(gaussians.size() < 60'000'000,
             "encode_spz: too many Gaussians for one stream: ", gaussians.size());
  const int bits = fitting_bits(gaussians, options.fractional_bits, name);
  check_sizes(gaussians.log_scales, name);
  const torch::Tensor dc = gaussians.sh.select(1, 0);
  const Streams streams = {
      positions_of(gaussians.means, bits),
      content_of(to_bytes(gaussians.logit_opacities.sigmoid() * 255)),
      content_of(to_bytes(dc * (kColorScale * 255) + 127.5)),
      content_of(to_bytes((gaussians.log_scales - kLeastLogScale) * kLogScaleSteps)),
      options.version == 2 ? rotations_2(gaussians.rotations) : rotations_3(gaussians.rotations),
      sh_of(gaussians.sh, options)};
  std::string header;
  put_unsigned(header, kMagic, 4);
  put_unsigned(header, static_cast<uint64_t>(options.version), 4);
  put_unsigned(header, static_cast<uint64_t>(gaussians.size()), 4);
  put_unsigned(header, static_cast<uint64_t>(sh_degree_of(gaussians.sh.size(1))), 1);
  put_unsigned(header, static_cast<uint64_t>(bits), 1);
  put_unsigned(header, options.antialiased ? kAntialiased : 0, 1);
  if (options.version < 4) {
    put_unsigned(header, 0, 1);
    for (const std::string& stream : streams) header += stream;
    return io::gzip(header);
  }
  std::string table, content;
  uint64_t count = 0;
  for (const std::string& stream : streams) {
    if (stream.empty()) continue;
    const std::string packed = io::zstd(stream);
    put_unsigned(table, packed.size(), 8);
    put_unsigned(table, stream.size(), 8);
    content += packed;
    ++count;
  }
  put_unsigned(header, count, 1);
  put_unsigned(header, kHeader4, 4);
  header.resize(kHeader4, '\0');
  return header + table + content;
}

void write_spz(const std::filesystem::path& path, const splat::Gaussians& gaussians,
               const SpzOptions& options) {
  write_file(path, encode_spz(gaussians, options, path.string()));
}

bool is_spz(const std::string& bytes) {
  try {
    const std::string start = io::is_gzip(bytes) ? io::gunzip(bytes, "", 4) : bytes.substr(0, 4);
    return start.size() == 4 && unsigned_at(start, 0, 4) == kMagic;
  } catch (const DataError&) {
    return false;
  }
}

GaussianFile parse_spz(const std::string& bytes, const std::string& name,
                       std::vector<std::string>& notes) {
  const bool packed = io::is_gzip(bytes);
  const std::string content = packed ? io::gunzip(bytes, name) : bytes;
  const Header header = header_of(content, name);
  const Content found =
      header.version == 4 ? unpack_streams(content, header, name) : cut(content, header, name);
  GaussianFile file;
  file.gaussians = decoded(found.streams, header);
  file.antialiased = header.antialiased;
  make_finite(file.gaussians);
  if (header.degree > kReadDegree) {
    notes.push_back(concat(name, ": expected SH degree 0 to ", kReadDegree, ", found ",
                           header.degree, "; coefficients of higher degrees are left out"));
  }
  if (found.rest > 0 && !header.extended) {
    notes.push_back(concat(name, ": expected ", header.count,
                           " Gaussians as its header says, found ", found.rest,
                           " bytes behind them, which are not read; export the file ", "again"));
  }
  return file;
}

}  // namespace jade::gaussians
