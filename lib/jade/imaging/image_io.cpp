// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/image_io.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>
#include <string>
#include <system_error>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/text.h"
#include "jade/imaging/decoder_output.h"
#include "jade/imaging/image_header.h"
#include "jade/imaging/pnm.h"
#include "jade/io/npy.h"
#include "jade/io/stand_in.h"

namespace jade::imaging {
namespace {

namespace fs = std::filesystem;

std::string extension(const fs::path& path) { return in_small_letters(path.extension().string()); }

bool is_image_extension(const std::string& name) {
  static const std::set<std::string> known{".png", ".jpg",  ".jpeg", ".tif", ".tiff",
                                           ".bmp", ".webp", ".ppm",  ".pgm", ".pnm"};
  return known.count(name) > 0;
}

void require_file(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error))
    throw DataError(concat(path.string(), ": no such image file"));
  if (fs::file_size(path, error) == 0)
    throw DataError(concat(path.string(), ": expected an image, found ", io::stand_in("", path)));
}

/// BGR or gray rows of 8 or 16 bits (or float) → RGB planes in [0,1].
template <class T>
torch::Tensor planes_from_rows(const cv::Mat& mat, float scale) {
  const int64_t height = mat.rows, width = mat.cols, channels = mat.channels();
  auto out = torch::empty({3, height, width}, torch::kFloat32);
  float* data = out.mutable_data_ptr<float>();
  for (int64_t row = 0; row < height; ++row) {
    const T* source = mat.ptr<T>(int(row));
    for (int64_t c = 0; c < 3; ++c) {
      float* target = data + (c * height + row) * width;
      const int64_t from = channels >= 3 ? 2 - c : 0;
      for (int64_t column = 0; column < width; ++column) {
        target[column] = float(source[column * channels + from]) * scale;
      }
    }
  }
  return out;
}

torch::Tensor read_array(const fs::path& path) {
  auto array = io::read_npy(path);
  if (array.dim() == 2) array = array.unsqueeze(0);
  if (!array.is_floating_point() || array.dim() != 3 ||
      (array.size(0) != 1 && array.size(0) != 3)) {
    throw DataError(concat(path.string(),
                           ": expected a float image [3,H,W], [1,H,W] or [H,W], found ",
                           array.scalar_type(), " ", shape_string(array)));
  }
  return array.to(torch::kFloat32).expand({3, -1, -1}).contiguous();
}

/// Float files have white at 1. Highlights may exceed it, but not most of an image.
void check_float_range(const fs::path& path, const torch::Tensor& image) {
  if (!image.isfinite().all().item<bool>()) {
    throw DataError(
        concat(path.string(),
               ": expected finite pixel values, found NaN or infinity; replace them, or "
               "exclude the pixels by a mask and set them to 0"));
  }
  const int64_t lit = image.gt(0).sum().item<int64_t>(), above = image.gt(1).sum().item<int64_t>();
  if (2 * above <= lit) return;
  throw DataError(concat(path.string(), ": expected float values from 0 to 1, found up to ",
                         image.max().item<float>(), " and ",
                         std::llround(100.0 * double(above) / double(lit)),
                         " % of them above 1; divide the image by its white level (255 or 65535)"));
}

torch::Tensor checked_planes(const torch::Tensor& image) {
  JADE_CHECK(image.defined() && image.dim() == 3 && (image.size(0) == 3 || image.size(0) == 1) &&
                 image.numel() > 0 && image.is_floating_point(),
             "expected a float image [3,H,W] or [1,H,W] to write, found ", shape_string(image));
  return image.detach().to(torch::kCPU, torch::kFloat32).contiguous();
}

/// RGB planes in [0,1] → BGR or gray rows of 8 or 16 bits.
template <class T>
cv::Mat rows_from_planes(const torch::Tensor& image, int type, float top) {
  const int64_t channels = image.size(0), height = image.size(1), width = image.size(2);
  cv::Mat mat(int(height), int(width), CV_MAKETYPE(type, int(channels)));
  const float* data = image.const_data_ptr<float>();
  for (int64_t row = 0; row < height; ++row) {
    T* target = mat.ptr<T>(int(row));
    for (int64_t c = 0; c < channels; ++c) {
      const float* source = data + (c * height + row) * width;
      for (int64_t column = 0; column < width; ++column) {
        const float value = source[column];  // NaN fails both comparisons and becomes 0
        const float clamped = value > 0 ? (value < 1 ? value : 1.0f) : 0.0f;
        target[column * channels + (channels - 1 - c)] = T(clamped * top + 0.5f);
      }
    }
  }
  return mat;
}

std::vector<uint8_t> encode(const torch::Tensor& image, const std::string& format,
                            const ImageWriteOptions& options, const std::string& name) {
  JADE_CHECK(options.bits == 8 || options.bits == 16, "expected 8 or 16 bits, found ",
             options.bits);
  const auto planes = checked_planes(image);
  const cv::Mat mat = options.bits == 8 ? rows_from_planes<uint8_t>(planes, CV_8U, 255.0f)
                                        : rows_from_planes<uint16_t>(planes, CV_16U, 65535.0f);
  if (options.bits == 16 && format != ".png" && format != ".tif" && format != ".tiff") {
    throw DataError(concat(name, ": 16-bit images are written as .png or .tiff, not as ", format));
  }
  std::vector<int> flags;
  if (format == ".jpg" || format == ".jpeg")
    flags = {cv::IMWRITE_JPEG_QUALITY, options.jpeg_quality};
  std::vector<uint8_t> bytes;
  try {
    if (cv::imencode(format, mat, bytes, flags)) return bytes;
  } catch (const cv::Exception&) {
    // reported below
  }
  throw DataError(concat(name, ": the image cannot be encoded as ", format));
}

/// Place of a JPEG's end marker, npos without one; the decoder fills missing data with gray.
/// Thumbnails in the header have such a marker too, so search only the image's own data.
size_t end_of_jpeg(const std::string& bytes) {
  const auto at = [&](size_t i) { return i < bytes.size() ? uint8_t(bytes[i]) : uint8_t(0); };
  constexpr uint8_t kFill = 0xFF, kStartOfScan = 0xDA;
  size_t i = 2;
  while (i + 4 <= bytes.size()) {
    const uint8_t marker = at(i + 1);
    if (at(i) != kFill || marker == kFill) {
      ++i;
      continue;
    }
    i += 2 + (size_t(at(i + 2)) << 8 | at(i + 3));
    if (marker == kStartOfScan) return bytes.find("\xFF\xD9", i);
  }
  return std::string::npos;
}

/// Whether libjpeg's line is about zeros before the end marker, with which some cameras fill up the
/// data.
bool is_of_padding(const std::string& line, const std::string& bytes) {
  size_t count = 0;
  if (line.find("extraneous bytes before marker 0xd9") == std::string::npos ||
      std::sscanf(line.c_str(), "Corrupt JPEG data: %zu", &count) != 1)
    return false;
  const size_t end = end_of_jpeg(bytes);
  return end != std::string::npos && count <= end &&
         bytes.find_first_not_of('\0', end - count) >= end;
}

/// A line about damaged data of a JPEG; empty if libjpeg said nothing of damage. It goes on after
/// damage, so that a part of the picture is wrong.
std::string jpeg_fault(const fs::path& path, const std::string& said) {
  std::istringstream lines(said);
  for (std::string line; std::getline(lines, line);) {
    const bool is_damage = line.rfind("Corrupt JPEG data", 0) == 0 ||
                           line.rfind("Premature end of JPEG", 0) == 0 ||
                           line.rfind("Inconsistent progression", 0) == 0;
    if (!is_damage || is_of_padding(line, read_file(path))) continue;
    return concat(path.string(), ": expected an undamaged JPEG, found damage inside (", line,
                  "); a part of the picture is wrong: copy the file again, or leave it out");
  }
  return "";
}

/// Whether a PNG reaches its end chunk. Its decoder prints a line of its own if it does not.
bool is_whole_png(const std::string& bytes) {
  constexpr size_t kAround = 12;  // length, kind and checksum of a chunk
  for (size_t at = 8; at + kAround <= bytes.size();) {
    if (bytes.compare(at + 4, 4, "IEND") == 0) return true;
    size_t length = 0;
    for (size_t i = 0; i < 4; ++i) length = length << 8 | uint8_t(bytes[at + i]);
    at += kAround + length;
  }
  return false;
}

bool is_cut(const fs::path& path) {
  char head[4] = {};
  std::ifstream(path, std::ios::binary).read(head, sizeof head);
  const std::string start(head, sizeof head);
  if (start.rfind("\xFF\xD8", 0) == 0) return end_of_jpeg(read_file(path)) == std::string::npos;
  return start == "\x89PNG" && !is_whole_png(read_file(path));
}

/// The largest value of the type of the pixels.
float full_of(int depth) {
  return depth == CV_8U ? float(UINT8_MAX) : depth == CV_16U ? float(UINT16_MAX) : 1.0F;
}

/// An image as stored.
struct Decoded {
  cv::Mat mat;        ///< gray, BGR or BGRA
  float full = 1;     ///< value of white
  std::string fault;  ///< a line about data that may be wrong, but can be read; empty if none
};

/// Values above the white level of the header mean that the header is wrong, and are read with the
/// white level of their type.
Decoded decoded(const fs::path& path, Pnm&& image) {
  Decoded out;
  const cv::Mat rows(int(image.height), int(image.width), CV_16UC(int(image.channels)),
                     image.values.data());
  out.mat = rows.clone();
  if (image.channels == 3) cv::cvtColor(rows, out.mat, cv::COLOR_RGB2BGR);
  out.full = float(image.white);
  const uint16_t largest = *std::max_element(image.values.begin(), image.values.end());
  if (largest <= image.white) return out;
  out.full = full_of(largest > UINT8_MAX || image.white > UINT8_MAX ? CV_16U : CV_8U);
  out.fault = concat(path.string(), ": expected values up to the white level of the header, ",
                     image.white, ", found up to ", largest, ", which are read with ", out.full,
                     " as white, unlike images without such values; correct the header");
  return out;
}

/// Without pixels if the file cannot be decoded.
Decoded decode_silently(const fs::path& path, int how) {
  const DecoderOutput output;
  Decoded out;
  try {
    if (!is_cut(path)) out.mat = cv::imread(path.string(), how);
  } catch (const cv::Exception&) {
    return {};
  }
  out.full = full_of(out.mat.depth());
  out.fault = jpeg_fault(path, output.text());
  return out;
}

[[noreturn]] void refuse_kind(const fs::path& path, const std::string& kind) {
  throw DataError(concat(path.string(), ": expected values of uint8, uint16 or float32, found ",
                         kind, "; convert the image"));
}

/// @throws DataError for a TIFF of values that OpenCV does not read.
void check_kind(const fs::path& path) {
  const std::optional<ImageHeader> header = read_image_header(path);
  const std::string kind = header ? header->values : "";
  const std::set<std::string> read{"", "uint1", "uint8", "uint16", "float32"};
  if (read.count(kind) == 0) refuse_kind(path, kind);
}

constexpr int kWithoutAlpha =
    cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION;

Decoded decode(const fs::path& path, int how = kWithoutAlpha) {
  require_file(path);
  if (auto pnm = read_pnm(path)) return decoded(path, std::move(*pnm));
  Decoded found = decode_silently(path, how);
  if (!found.mat.empty()) {
    if (found.mat.depth() == CV_64F) found.mat.convertTo(found.mat, CV_32F);
    return found;
  }
  if (const std::string other = io::stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": expected an image, found ", other));
  if (!is_image_extension(extension(path))) {
    throw DataError(concat(path.string(), ": expected an image that can be read, found a ",
                           path.extension().string(), " file; convert it to .png, .jpg, .tif, ",
                           ".bmp, .webp, .ppm or .pgm, and name the new file in the list"));
  }
  check_kind(path);
  throw DataError(concat(path.string(), ": expected an image (PNG, JPEG, TIFF, …), found a file ",
                         "that cannot be decoded; is it damaged or of another type? Copy or ",
                         "export it again"));
}

/// Calls `use(T())` with the type of the pixels.
template <class Use>
torch::Tensor with_pixels(const fs::path& path, const cv::Mat& mat, const Use& use) {
  if (mat.depth() == CV_8U) return use(uint8_t());
  if (mat.depth() == CV_16U) return use(uint16_t());
  if (mat.depth() == CV_32F) return use(float());
  const std::optional<ImageHeader> header = read_image_header(path);
  refuse_kind(path, header && !header->values.empty() ? header->values : "another kind");
}

/// Maps each pixel's channels to one value: [1,H,W] of Out.
template <class T, class Out, class Value>
torch::Tensor map_pixels(const cv::Mat& mat, torch::ScalarType type, const Value& value) {
  torch::Tensor out = torch::empty({1, mat.rows, mat.cols}, type);
  Out* target = out.mutable_data_ptr<Out>();
  for (int row = 0; row < mat.rows; ++row) {
    const T* source = mat.ptr<T>(row);
    for (int column = 0; column < mat.cols; ++column) {
      *target++ = value(source + int64_t(column) * mat.channels());
    }
  }
  return out;
}

/// OpenCV decodes gray with alpha to four channels or two.
bool alpha_is_last(const cv::Mat& mat) { return mat.channels() == 4 || mat.channels() == 2; }

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// The digits from `at` on without leading zeros; advances `at` past them.
std::string number_at(const std::string& text, size_t& at) {
  size_t end = at;
  while (end < text.size() && is_digit(text[end])) ++end;
  while (at < end && text[at] == '0') ++at;
  const size_t begin = at;
  at = end;
  return text.substr(begin, end - begin);
}

/// Compares names: negative, zero or positive, like strcmp.
int compare_names(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string m = number_at(a, i), n = number_at(b, j);
      if (m.size() != n.size()) return m.size() < n.size() ? -1 : 1;
      if (m != n) return m.compare(n);
    } else {
      if (a[i] != b[j]) return uint8_t(a[i]) < uint8_t(b[j]) ? -1 : 1;
      ++i, ++j;
    }
  }
  return int(i < a.size()) - int(j < b.size());
}

}  // namespace

torch::Tensor read_image(const std::filesystem::path& path, std::string* fault) {
  if (fault != nullptr) fault->clear();
  if (extension(path) == ".npy") {
    torch::Tensor image = read_array(path);
    check_float_range(path, image);
    return image;
  }
  const Decoded found = decode(path);
  if (fault == nullptr && !found.fault.empty()) throw DataError(found.fault);
  torch::Tensor image = with_pixels(path, found.mat, [&](auto pixel) {
    return planes_from_rows<decltype(pixel)>(found.mat, 1.0F / found.full);
  });
  if (found.mat.depth() == CV_32F) check_float_range(path, image);
  if (fault != nullptr) *fault = found.fault;
  return image;
}

std::string fault_of_all(const std::vector<std::string>& faults) {
  const auto is_fault = [](const std::string& line) { return !line.empty(); };
  const auto first = std::find_if(faults.begin(), faults.end(), is_fault);
  if (first == faults.end()) return "";
  const auto others = std::count_if(first + 1, faults.end(), is_fault);
  return others == 0 ? *first : concat(*first, " (and ", others, " more files like it)");
}

torch::Tensor read_alpha(const std::filesystem::path& path) {
  const std::optional<ImageHeader> header = read_image_header(path);
  if (!header || !header->has_alpha) return {};
  const Decoded found = decode(path, cv::IMREAD_UNCHANGED);
  const cv::Mat& mat = found.mat;
  if (!alpha_is_last(mat)) return {};
  const int last = mat.channels() - 1;
  const torch::Tensor alpha = with_pixels(path, mat, [&](auto pixel) {
    using T = decltype(pixel);
    return map_pixels<T, float>(mat, torch::kFloat32, [&](const T* channels) {
      return float(channels[last]) / found.full;
    });
  });
  return alpha.min().item<float>() >= 1 ? torch::Tensor() : alpha;
}

torch::Tensor read_mask(const std::filesystem::path& path) {
  const Decoded found = decode(path, cv::IMREAD_UNCHANGED);
  const cv::Mat& mat = found.mat;
  const float full = found.full;
  const std::string format = extension(path);
  const bool lossy = format == ".jpg" || format == ".jpeg";
  if (lossy && !found.fault.empty()) throw DataError(found.fault);
  const bool alpha = alpha_is_last(mat);
  const int colors = mat.channels() - (alpha ? 1 : 0);
  return with_pixels(path, mat, [&](auto pixel) {
    using T = decltype(pixel);
    return map_pixels<T, bool>(mat, torch::kBool, [&](const T* channels) {
      const T brightest = *std::max_element(channels, channels + colors);
      const bool lit = lossy ? float(brightest) >= 0.5F * full : brightest > 0;
      return lit && (!alpha || float(channels[colors]) >= 0.5F * full);
    });
  });
}

void write_image(const std::filesystem::path& path, const torch::Tensor& image,
                 const ImageWriteOptions& options) {
  std::error_code error;
  if (path.has_parent_path()) fs::create_directories(path.parent_path(), error);
  const std::string format = extension(path);
  if (format == ".npy") {
    io::write_npy(path, checked_planes(image));
    return;
  }
  if (!is_image_extension(format)) {
    throw DataError(
        concat(path.string(), ": expected an image extension such as .png, .jpg or .npy"));
  }
  const auto bytes = encode(image, format, options, path.string());
  write_file(path, std::string(bytes.begin(), bytes.end()));
}

std::vector<uint8_t> encode_png(const torch::Tensor& image) {
  return encode(image, ".png", {}, "PNG");
}

std::vector<uint8_t> encode_jpeg(const torch::Tensor& image, int quality) {
  return encode(image, ".jpg", {8, quality}, "JPEG");
}

bool comes_before(const std::string& name, const std::string& other) {
  const int order = compare_names(name, other);
  return order != 0 ? order < 0 : name < other;  // 01 and 1 are the same number
}

bool counts_fractions(const std::vector<std::filesystem::path>& files) {
  std::set<std::pair<int64_t, int64_t>> parts;  // before and behind the point
  for (const fs::path& file : files) {
    const std::string name = file.stem().string();
    const size_t point = name.find('.');
    int64_t whole = 0, behind = 0;
    const char* const end = name.data() + name.size();
    if (point == std::string::npos ||
        std::from_chars(name.data(), name.data() + point, whole).ptr != name.data() + point ||
        std::from_chars(name.data() + point + 1, end, behind).ptr != end)
      return false;
    parts.emplace(whole, behind);
  }
  int64_t counted = 0;
  for (auto at = parts.begin(), next = at; next != parts.end() && ++next != parts.end(); ++at) {
    if (at->first != next->first) continue;
    if (next->second != at->second + 1) return false;
    ++counted;
  }
  return counted > 0;
}

bool is_image_file(const std::filesystem::path& path) {
  return is_image_extension(extension(path));
}

namespace {

/// The numbers that all names are, with a decimal point each, if no two are equal; else empty.
std::vector<double> fractions_in_names(const std::vector<fs::path>& files) {
  std::vector<double> out;
  for (const fs::path& file : files) {
    const std::string name = file.stem().string();
    double value = 0;
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), value);
    if (error != std::errc() || end != name.data() + name.size() ||
        name.find('.') == std::string::npos)
      return {};
    out.push_back(value);
  }
  if (counts_fractions(files)) return {};
  std::vector<double> sorted = out;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return {};
  return out;
}

}  // namespace

std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder) {
  std::error_code error;
  std::vector<fs::path> out;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    // "._00.png" contains 00.png's attributes, written by macOS on other file systems.
    if (entry->path().filename().string()[0] == '.') continue;
    std::error_code ignored;  // of links that lead nowhere
    if (is_image_file(entry->path()) && entry->is_regular_file(ignored)) {
      out.push_back(entry->path());
    }
  }
  if (error)
    throw DataError(concat(folder.string(), ": the folder cannot be read: ", error.message()));
  std::sort(out.begin(), out.end(), [](const fs::path& a, const fs::path& b) {
    return comes_before(a.filename().string(), b.filename().string());
  });
  const std::vector<double> values = fractions_in_names(out);
  std::vector<size_t> order(values.size());
  std::iota(order.begin(), order.end(), size_t(0));
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return values[a] < values[b]; });
  std::vector<fs::path> by_value;
  for (const size_t i : order) by_value.push_back(out[i]);
  return values.empty() ? out : by_value;
}

size_t count_pages(const fs::path& path) {
  if (extension(path) != ".tif" && extension(path) != ".tiff") return 1;
  const DecoderOutput ignored;
  try {
    const size_t count = cv::imcount(path.string(), cv::IMREAD_UNCHANGED);
    std::vector<cv::Mat> pages;
    if (count < 2 || !cv::imreadmulti(path.string(), pages, 0, 2, cv::IMREAD_UNCHANGED)) return 1;
    return pages.size() == 2 && pages[0].size() == pages[1].size() ? count : 1;
  } catch (const cv::Exception&) {
    return 1;
  }
}

std::vector<fs::path> split_pages(const fs::path& path, const fs::path& folder) {
  constexpr int kAtOnce = 16;
  fs::create_directories(folder);
  std::vector<fs::path> out;
  std::vector<uint8_t> bytes;
  const DecoderOutput ignored;
  try {
    const auto count = int(cv::imcount(path.string(), cv::IMREAD_UNCHANGED));
    for (int first = 0; first < count; first += kAtOnce) {
      std::vector<cv::Mat> pages;
      cv::imreadmulti(path.string(), pages, first, std::min(kAtOnce, count - first),
                      cv::IMREAD_UNCHANGED);
      for (const cv::Mat& page : pages) {
        char name[16];
        std::snprintf(name, sizeof name, "%08zu.tif", out.size());
        out.push_back(folder / name);
        cv::imencode(".tif", page, bytes);
        write_file(out.back(), std::string(bytes.begin(), bytes.end()));
      }
    }
    if (!out.empty() && int(out.size()) == count) return out;
  } catch (const cv::Exception&) {
    // reported below
  }
  throw DataError(concat(path.string(), ": expected a TIFF of one or more pages, found ",
                         out.size(), " that can be decoded; export it again"));
}

}  // namespace jade::imaging
