// SPDX-License-Identifier: Apache-2.0
// Implements the format's public description (developer.playcanvas.com, "The SOG Format").
#include "jade/gaussians/sog_file.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/codebook.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/smallest_three.h"
#include "jade/gaussians/spatial_order.h"
#include "jade/gaussians/summary.h"
#include "jade/io/webp.h"
#include "jade/io/zip.h"

namespace jade::gaussians {
namespace {

constexpr int64_t kRowEntries = 64;  ///< palette entries per row of their image
constexpr int64_t kMostPalette = 65536;
constexpr int64_t kLeastPalette = 1024;
constexpr int64_t kFirstRotation = 252;  ///< alpha of a rotation whose largest component is w
constexpr double kSteps = 65535;         ///< of a position
const char* const kMeta = "meta.json";

/// Images of one width, one pixel per Gaussian, in an archive.
class Images {
 public:
  explicit Images(int64_t count) : width_(side(count)) {}

  /// @param columns  uint8 [N], one to four, for red, green, blue, alpha; 255 if missing
  void add(const std::string& name, const std::vector<torch::Tensor>& columns) {
    const int64_t count = columns[0].size(0);
    const int64_t height = (count + width_ - 1) / width_;
    const torch::Tensor image = torch::zeros({height * width_, 4}, torch::kUInt8);
    image.select(1, 3).fill_(255);
    for (size_t i = 0; i < columns.size(); ++i) {
      image.select(1, static_cast<int64_t>(i)).slice(0, 0, count).copy_(columns[i]);
    }
    entries_.emplace_back(name, io::encode_webp(image.reshape({height, width_, 4})));
  }
  void add_palette(const std::string& name, const torch::Tensor& labels) {
    const int64_t count = labels.size(0), pixels = labels.size(1);
    const int64_t height = (count + kRowEntries - 1) / kRowEntries;
    torch::Tensor image = torch::zeros({height * kRowEntries, pixels, 4}, torch::kUInt8);
    image.select(2, 3).fill_(255);
    image.slice(0, 0, count).slice(2, 0, 3).copy_(labels);
    entries_.emplace_back(name, io::encode_webp(image.reshape({height, kRowEntries * pixels, 4})));
  }
  void add(const std::string& name, const std::string& text) { entries_.emplace_back(name, text); }
  const io::ZipEntries& entries() const { return entries_; }

 private:
  static int64_t side(int64_t count) {
    return 4 * std::max<int64_t>(1, std::lround(std::ceil(std::sqrt(double(count)) / 4)));
  }
  int64_t width_;
  io::ZipEntries entries_;
};

std::vector<torch::Tensor> columns_of(const torch::Tensor& table) { return table.unbind(1); }

std::vector<double> list_of(const torch::Tensor& values) {
  const torch::Tensor whole = values.to(torch::kFloat64).contiguous();
  return {whole.data_ptr<double>(), whole.data_ptr<double>() + whole.numel()};
}

nlohmann::json add_means(Images& images, const torch::Tensor& means) {
  const torch::Tensor logs = means.sign() * means.abs().log1p();
  const torch::Tensor low = std::get<0>(logs.min(0)), high = std::get<0>(logs.max(0));
  const torch::Tensor steps =
      ((logs - low) / (high - low).clamp_min(1e-30) * kSteps).round().to(torch::kInt64);
  images.add("means_l.webp", columns_of(steps.bitwise_and(255).to(torch::kUInt8)));
  images.add("means_u.webp", columns_of(steps.bitwise_right_shift(8).to(torch::kUInt8)));
  return {
      {"mins", list_of(low)}, {"maxs", list_of(high)}, {"files", {"means_l.webp", "means_u.webp"}}};
}

nlohmann::json add_rotations(Images& images, const torch::Tensor& rotations) {
  const SmallestThree parts = smallest_three(rotations);
  std::vector<torch::Tensor> columns =
      columns_of(to_bytes((parts.others / std::sqrt(2.0) + 0.5) * 255));
  columns.push_back((parts.largest + kFirstRotation).to(torch::kUInt8));
  images.add("quats.webp", columns);
  return {{"files", {"quats.webp"}}};
}

nlohmann::json add_scales(Images& images, const torch::Tensor& log_scales) {
  const Codebook book = codebook_of(log_scales);
  images.add("scales.webp", columns_of(book.labels));
  return {{"codebook", list_of(book.values)}, {"files", {"scales.webp"}}};
}

nlohmann::json add_colors(Images& images, const torch::Tensor& dc, const torch::Tensor& opacities) {
  const Codebook book = codebook_of(dc);
  std::vector<torch::Tensor> columns = columns_of(book.labels);
  columns.push_back(to_bytes(opacities * 255));
  images.add("sh0.webp", columns);
  return {{"codebook", list_of(book.values)}, {"files", {"sh0.webp"}}};
}

/// @param rest  [N,K,3] float32
nlohmann::json add_sh(Images& images, const torch::Tensor& rest) {
  const int64_t count = rest.size(0);
  const int64_t at_most = std::clamp(count / 4, kLeastPalette, kMostPalette);
  const Palette palette = palette_of(rest.reshape({count, -1}), at_most);
  const int64_t entries = palette.rows.size(0);
  const Codebook book = codebook_of(palette.rows);
  images.add_palette("shN_centroids.webp", book.labels.reshape({entries, rest.size(1), 3}));
  images.add("shN_labels.webp", {palette.labels.bitwise_and(255).to(torch::kUInt8),
                                 palette.labels.bitwise_right_shift(8).to(torch::kUInt8)});
  return {{"count", entries},
          {"bands", sh_degree_of(rest.size(1) + 1)},
          {"codebook", list_of(book.values)},
          {"files", {"shN_centroids.webp", "shN_labels.webp"}}};
}

/// The parts of a file, from an archive or a folder.
class Source {
 public:
  explicit Source(const std::filesystem::path& path) : path_(path) {
    const bool unpacked = path.extension() == ".json";
    if (unpacked) {
      read_ = [folder = path.parent_path()](const std::string& name) {
        return read_file(folder / name);
      };
    } else {
      read_ = [archive = io::Zip(path, {"an archive of .sog", "copy it again"})](
                  const std::string& name) { return archive.read(name); };
    }
    try {
      meta_ = nlohmann::json::parse(read_(unpacked ? path.filename().string() : kMeta));
      if (meta_.value("version", 1) != 2) {
        throw DataError(concat(path.string(), ": expected .sog of version 2, found ",
                               meta_.value("version", 1),
                               "; write the scene again with a newer program"));
      }
      count_ = meta_.at("count").get<int64_t>();
    } catch (const nlohmann::json::exception&) {
      throw damaged("meta.json");
    }
    if (count_ < 0) throw damaged("meta.json");
  }

  int64_t count() const { return count_; }
  const nlohmann::json& meta() const { return meta_; }

  /// A list of numbers, float32. @throws DataError unless there are `size`, if that is not 0.
  torch::Tensor numbers(const nlohmann::json& part, const char* name, size_t size) const {
    const auto list = part.at(name).get<std::vector<float>>();
    if (list.size() != size) throw damaged(name);
    return torch::tensor(list);
  }
  /// [H,W,4], of the part's file of that number.
  torch::Tensor image(const nlohmann::json& part, size_t index) const {
    const auto name = part.at("files").at(index).get<std::string>();
    if (name.find("..") != std::string::npos || name.find('/') == 0) throw damaged("meta.json");
    return io::decode_webp(read_(name), concat(path_.string(), "[", name, "]"));
  }
  /// [N,4] int64: one pixel per Gaussian.
  torch::Tensor pixels(const nlohmann::json& part, size_t index) const {
    const torch::Tensor all = image(part, index).reshape({-1, 4});
    if (all.size(0) < count_) {
      throw DataError(concat(path_.string(), ": expected an image with a pixel for each of ",
                             count_, " Gaussians, found ", all.size(0),
                             " pixels; copy the file again"));
    }
    return all.slice(0, 0, count_).to(torch::kInt64);
  }
  DataError damaged(const std::string& what) const {
    return DataError(concat(path_.string(), ": expected the parts of a .sog, found a damaged ",
                            what, "; copy the file again"));
  }

 private:
  std::filesystem::path path_;
  std::function<std::string(const std::string&)> read_;
  nlohmann::json meta_;
  int64_t count_ = 0;
};

torch::Tensor means_from(const Source& source) {
  const nlohmann::json& part = source.meta().at("means");
  const torch::Tensor steps = source.pixels(part, 0) + 256 * source.pixels(part, 1);
  const torch::Tensor low = source.numbers(part, "mins", 3), high = source.numbers(part, "maxs", 3);
  const torch::Tensor logs = low + (high - low) * steps.slice(1, 0, 3).to(torch::kFloat64) / kSteps;
  return (logs.sign() * logs.abs().expm1()).to(torch::kFloat32);
}

torch::Tensor rotations_from(const Source& source) {
  const torch::Tensor pixels = source.pixels(source.meta().at("quats"), 0);
  const torch::Tensor largest = pixels.select(1, 3) - kFirstRotation;
  if (largest.numel() > 0 && largest.min().item<int64_t>() < 0) throw source.damaged("quats image");
  const torch::Tensor unit = pixels.slice(1, 0, 3).to(torch::kFloat32) / 255;
  return joined({largest, (unit - 0.5) * std::sqrt(2.0)});
}

/// [N,3]: numbers of a codebook by their labels.
torch::Tensor coded(const Source& source, const nlohmann::json& part, const torch::Tensor& labels) {
  return source.numbers(part, "codebook", 256).index({labels.slice(-1, 0, 3)});
}

/// [N,K,3], empty if the file has degree 0.
torch::Tensor sh_from(const Source& source) {
  const auto found = source.meta().find("shN");
  if (found == source.meta().end()) return torch::empty({source.count(), 0, 3});
  const auto bands = found->at("bands").get<int64_t>();
  const auto entries = found->at("count").get<int64_t>();
  if (bands < 1 || bands > 3 || entries < 1) throw source.damaged("shN");
  const int64_t rest = (bands + 1) * (bands + 1) - 1;
  const torch::Tensor image = source.image(*found, 0);
  if (image.size(1) != kRowEntries * rest || image.size(0) * kRowEntries < entries) {
    throw source.damaged("shN palette");
  }
  const torch::Tensor palette = image.reshape({-1, rest, 4}).slice(0, 0, entries).to(torch::kInt64);
  const torch::Tensor pixels = source.pixels(*found, 1);
  const torch::Tensor labels = pixels.select(1, 0) + 256 * pixels.select(1, 1);
  if (labels.numel() > 0 && labels.max().item<int64_t>() >= entries) {
    throw source.damaged("shN labels");
  }
  return coded(source, *found, palette).index_select(0, labels);
}

}  // namespace

void write_sog(const std::filesystem::path& path, const GaussianFile& file) {
  const splat::Gaussians shown = drawable(file.gaussians);
  const torch::Tensor order = spatial_order(shown.means);
  const splat::Gaussians gaussians = map_parameters(shown, [&](const auto& value) {
    return file_tensor(value, torch::kFloat64).index_select(0, order);
  });
  if (gaussians.size() == 0) {
    throw DataError(concat(path.string(), ": not written: no Gaussian can be rendered"));
  }
  Images images(gaussians.size());
  nlohmann::json meta = {{"version", 2},
                         {"asset", {{"generator", "JADE-GS"}}},
                         {"count", gaussians.size()},
                         {"antialias", file.antialiased}};
  meta["means"] = add_means(images, gaussians.means);
  meta["quats"] = add_rotations(images, gaussians.rotations);
  meta["scales"] = add_scales(images, gaussians.log_scales);
  meta["sh0"] = add_colors(images, gaussians.sh.select(1, 0), gaussians.logit_opacities.sigmoid());
  if (gaussians.sh.size(1) > 1) {
    meta["shN"] = add_sh(images, gaussians.sh.slice(1, 1).to(torch::kFloat32));
  }
  images.add(kMeta, meta.dump());
  io::write_zip(path, images.entries(), io::ZipPacking::kStore);
}

GaussianFile read_sog(const std::filesystem::path& path) {
  const Source source(path);
  try {
    GaussianFile file;
    file.antialiased = source.meta().value("antialias", false);
    splat::Gaussians& out = file.gaussians;
    out.means = means_from(source);
    out.rotations = rotations_from(source);
    const nlohmann::json &scales = source.meta().at("scales"), &colors = source.meta().at("sh0");
    out.log_scales = coded(source, scales, source.pixels(scales, 0));
    const torch::Tensor pixels = source.pixels(colors, 0);
    const torch::Tensor dc = coded(source, colors, pixels);
    out.logit_opacities = torch::logit(pixels.select(1, 3).to(torch::kFloat32) / 255);
    out.sh = torch::cat({dc.unsqueeze(1), sh_from(source)}, 1);
    make_finite(out);
    return file;
  } catch (const nlohmann::json::exception&) {
    throw source.damaged("meta.json");
  }
}

}  // namespace jade::gaussians
