// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/image_header.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <string>

#include "jade/core/error.h"

namespace jade::imaging {
namespace {

/// Reads numbers at any offset of a file; 0 beyond its end.
class HeaderFile {
 public:
  explicit HeaderFile(const std::filesystem::path& path) : in_(path, std::ios::binary) {}

  std::string bytes(uint64_t at, size_t count) {
    std::string found(count, '\0');
    in_.clear();
    in_.seekg(static_cast<std::streamoff>(at));
    in_.read(found.data(), static_cast<std::streamsize>(count));
    whole_ = whole_ && static_cast<size_t>(in_.gcount()) == count;
    return found;
  }
  uint32_t big(uint64_t at, size_t count) { return number(at, count, true); }
  uint32_t little(uint64_t at, size_t count) { return number(at, count, false); }
  uint32_t number(uint64_t at, size_t count, bool big_endian) {
    const std::string found = bytes(at, count);
    uint32_t value = 0;
    for (size_t i = 0; i < count; ++i) {
      value = value << 8 | uint8_t(found[big_endian ? i : count - 1 - i]);
    }
    return value;
  }
  /// Whether all requested bytes existed.
  bool whole() const { return whole_; }

 private:
  std::ifstream in_;
  bool whole_ = true;
};

/// Colour type 4 or 6, or a tRNS chunk before the pixels.
ImageHeader png_header(HeaderFile& file) {
  constexpr uint8_t kAlphaBit = 4;
  ImageHeader header{file.big(16, 4), file.big(20, 4), (file.big(25, 1) & kAlphaBit) != 0};
  for (uint64_t at = 8; file.whole() && !header.has_alpha;) {
    const std::string kind = file.bytes(at + 4, 4);
    if (kind == "IDAT" || kind == "IEND") break;
    header.has_alpha = kind == "tRNS";
    at += 12 + uint64_t(file.big(at, 4));
  }
  return header;
}

/// The orientation in an APP1 segment, or 1. EXIF data are a TIFF without an image.
int exif_orientation(HeaderFile& file, uint64_t begin, uint64_t end) {
  constexpr uint32_t kOrientation = 274;
  const uint64_t tiff = begin + 6;
  if (end < tiff + 8 || file.bytes(begin, 6) != std::string("Exif\0\0", 6)) return 1;
  const bool big_endian = file.bytes(tiff, 2) == "MM";
  const uint64_t directory = tiff + file.number(tiff + 4, 4, big_endian);
  const uint64_t count = directory + 2 > end ? 0 : file.number(directory, 2, big_endian);
  for (uint64_t entry = directory + 2; entry < directory + 2 + 12 * count && entry + 12 <= end;
       entry += 12) {
    if (file.number(entry, 2, big_endian) != kOrientation) continue;
    const uint32_t value = file.number(entry + 8, 2, big_endian);
    return value >= 1 && value <= 8 ? int(value) : 1;
  }
  return 1;
}

/// The first start-of-frame segment, and EXIF data before it.
ImageHeader jpeg_header(HeaderFile& file) {
  constexpr uint32_t kApp1 = 0xE1;
  int orientation = 1;
  for (uint64_t at = 2; file.whole();) {
    if (file.big(at, 1) != 0xFF) break;
    const uint32_t marker = file.big(at + 1, 1);
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    const bool frame =
        marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) return {file.big(at + 7, 2), file.big(at + 5, 2), false, orientation};
    const uint64_t end = at + 2 + uint64_t(file.big(at + 2, 2));
    if (marker == kApp1 && orientation == 1) orientation = exif_orientation(file, at + 4, end);
    at = end;
  }
  return {};
}

/// The tags of the first directory.
ImageHeader tiff_header(HeaderFile& file, bool big_endian) {
  constexpr uint32_t kWidth = 256, kHeight = 257, kPhotometric = 262, kSamples = 277, kExtra = 338;
  constexpr uint32_t kBits = 258, kSampleFormat = 339;
  constexpr uint32_t kShort = 3, kSeparated = 5;
  const uint64_t directory = file.number(4, 4, big_endian);
  const uint32_t count = std::min<uint32_t>(file.number(directory, 2, big_endian), 1000);
  ImageHeader header;
  uint32_t samples = 1, photometric = 0, bits = 1, format = 1;
  for (uint32_t i = 0; i < count; ++i) {
    const uint64_t entry = directory + 2 + 12 * uint64_t(i);
    const uint32_t tag = file.number(entry, 2, big_endian);
    const bool is_short = file.number(entry + 2, 2, big_endian) == kShort;
    const uint32_t value = file.number(entry + 8, is_short ? 2 : 4, big_endian);
    // One number per channel; more than two are elsewhere in the file.
    const bool elsewhere = is_short && file.number(entry + 4, 4, big_endian) > 2;
    const auto of_first_channel = [&] {
      if (!elsewhere) return value;
      return file.number(file.number(entry + 8, 4, big_endian), 2, big_endian);
    };
    if (tag == kBits) bits = of_first_channel();
    if (tag == kSampleFormat) format = of_first_channel();
    if (tag == kWidth) header.width = value;
    if (tag == kHeight) header.height = value;
    if (tag == kPhotometric) photometric = value;
    if (tag == kSamples) samples = value;
    if (tag == kExtra) header.has_alpha = true;
  }
  if (samples == 2 || (samples == 4 && photometric != kSeparated)) header.has_alpha = true;
  constexpr uint32_t kSigned = 2, kFloat = 3;
  header.values = concat(format == kFloat ? "float" : format == kSigned ? "int" : "uint", bits);
  return header;
}

ImageHeader bmp_header(HeaderFile& file) {
  // Top-down bitmaps have a negative height.
  return {file.little(18, 4), std::abs(int64_t(int32_t(file.little(22, 4)))), false};
}

ImageHeader webp_header(HeaderFile& file) {
  const std::string kind = file.bytes(12, 4);
  if (kind == "VP8 ") return {file.little(26, 2) & 0x3FFF, file.little(28, 2) & 0x3FFF, false};
  if (kind == "VP8L") {
    const uint32_t bits = file.little(21, 4);
    return {(bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1, (bits >> 28 & 1) != 0};
  }
  if (kind == "VP8X") {
    constexpr uint32_t kAlphaFlag = 0x10;
    return {file.little(24, 3) + 1, file.little(27, 3) + 1, (file.little(20, 1) & kAlphaFlag) != 0};
  }
  return {};
}

/// "P6 WIDTH HEIGHT ..." with comments from '#' to the end of a line.
ImageHeader pnm_header(const std::string& start) {
  std::array<int64_t, 2> sides{};
  size_t at = 2;
  for (int64_t& side : sides) {
    while (at < start.size() && (start[at] < '0' || start[at] > '9')) {
      if (start[at] == '#') at = std::min(start.find('\n', at), start.size());
      ++at;
    }
    while (at < start.size() && start[at] >= '0' && start[at] <= '9' && side < 1000000) {
      side = 10 * side + (start[at++] - '0');
    }
  }
  return {sides[0], sides[1], false};
}

ImageHeader header_of(HeaderFile& file, const std::string& start, const std::string& more) {
  if (start.rfind("\x89PNG", 0) == 0) return png_header(file);
  if (start.rfind("\xFF\xD8", 0) == 0) return jpeg_header(file);
  if (start == std::string("II*\0", 4)) return tiff_header(file, false);
  if (start == std::string("MM\0*", 4)) return tiff_header(file, true);
  if (start.rfind("BM", 0) == 0) return bmp_header(file);
  if (start == "RIFF" && file.bytes(8, 4) == "WEBP") return webp_header(file);
  if (start[0] == 'P' && start[1] >= '1' && start[1] <= '6') return pnm_header(more);
  return {};
}

}  // namespace

std::optional<ImageHeader> read_image_header(const std::filesystem::path& path) {
  std::string more(512, '\0');  // a PNM may be shorter
  std::ifstream(path, std::ios::binary)
      .read(more.data(), static_cast<std::streamsize>(more.size()));
  HeaderFile file(path);
  const std::string start = file.bytes(0, 4);
  if (!file.whole()) return std::nullopt;
  const ImageHeader header = header_of(file, start, more);
  if (!file.whole() || header.width <= 0 || header.height <= 0) return std::nullopt;
  return header;
}

}  // namespace jade::imaging
