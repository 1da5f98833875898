// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply.h"

#include <fstream>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/ply_header.h"
#include "jade/geometry/origin.h"

namespace jade::gaussians {
namespace {

const char* const kRenderMode = "SplatRenderMode: ";
const char* const kOrigin = "origin";

/// Its opacity is 1 in float32. Converters write infinity where a format of bytes has 255.
constexpr double kFullLogit = 30;

/// The attributes without f_rest, in the order of a standard file.
const std::vector<std::string> kGeometry = {"opacity", "scale_0", "scale_1", "scale_2",
                                            "rot_0",   "rot_1",   "rot_2",   "rot_3"};

std::vector<std::string> rest_names(int64_t count) {
  std::vector<std::string> names;
  for (int64_t i = 0; i < count; ++i) names.push_back(concat("f_rest_", i));
  return names;
}

/// How many f_rest properties there are: 0, 9, 24 or 45.
int64_t count_rest(const PlyFile& file, const std::filesystem::path& path) {
  int64_t count = 0;
  while (file.vertices().find(concat("f_rest_", count)) >= 0) ++count;
  if (count != 0 && count != 9 && count != 24 && count != 45) {
    throw DataError(concat(path.string(), ": expected 0, 9, 24 or 45 f_rest properties (SH degree ",
                           "0 to 3), found ", count));
  }
  return count;
}

bool holds_gaussians(const PlyFile& file) {
  return file.vertices().find("f_dc_0") >= 0 && file.vertices().find("scale_0") >= 0;
}

bool says_mip(const PlyFile& file) {
  for (const std::string& comment : file.header().comments) {
    const size_t at = comment.find(kRenderMode);
    if (at != std::string::npos) return comment.find("mip", at) != std::string::npos;
  }
  return false;
}

/// The origin that the header names.
geometry::Vector3 said_origin(const PlyFile& file) {
  for (const std::string& comment : file.header().comments) {
    std::istringstream words(comment);
    std::string name;
    geometry::Vector3 origin{};
    if (words >> name && name == kOrigin && words >> origin[0] >> origin[1] >> origin[2]) {
      return origin;
    }
  }
  return {0, 0, 0};
}

/// An origin near the vertices where they lie far from their own.
geometry::Vector3 found_origin(const torch::Tensor& places) {
  const torch::Tensor finite = places.index({places.isfinite().all(1)}).to(torch::kFloat64);
  if (finite.size(0) == 0) return {0, 0, 0};
  const torch::Tensor middle = std::get<0>(finite.median(0));
  const double size = (finite - middle).norm(2, 1).median().item<double>();
  return geometry::scene_origin(
      {middle[0].item<double>(), middle[1].item<double>(), middle[2].item<double>()}, size);
}

/// Vertices about an origin that float32 can tell apart there.
struct Places {
  torch::Tensor xyz;  ///< [P,3] float32
  geometry::Vector3 origin;
};

/// @param xyz  [P,3] float32 as read
Places places_of(const PlyFile& file, const torch::Tensor& xyz) {
  const geometry::Vector3 origin = said_origin(file);
  if (!geometry::is_zero(origin)) return {xyz, origin};
  const geometry::Vector3 found = found_origin(xyz);
  if (geometry::is_zero(found)) return {xyz, found};
  const torch::Tensor exact = file.read_vertices({"x", "y", "z"}, torch::kFloat64);
  const torch::Tensor moved =
      exact - torch::tensor({found[0], found[1], found[2]}, torch::kFloat64);
  return {moved.to(torch::kFloat32), found};
}

std::string header_text(const GaussianFile& file, PlyCoordinates coordinates) {
  const splat::Gaussians& gaussians = file.gaussians;
  const bool moved = !geometry::is_zero(file.origin);
  std::string text = concat("ply\nformat binary_little_endian 1.0\ncomment ", kRenderMode,
                            file.antialiased ? "mip" : "default", "\n");
  if (moved && coordinates == PlyCoordinates::kOwn) {
    text += concat("comment ", kOrigin, " ", geometry::text_of(file.origin), "\n");
  }
  text += concat("element vertex ", gaussians.size(), "\n");
  const bool doubles = moved && coordinates == PlyCoordinates::kDataset;
  for (const char* name : {"x", "y", "z"}) {
    text += concat("property ", doubles ? "double " : "float ", name, "\n");
  }
  std::vector<std::string> names = {"nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"};
  const auto rest = rest_names(3 * (gaussians.sh.size(1) - 1));
  names.insert(names.end(), rest.begin(), rest.end());
  names.insert(names.end(), kGeometry.begin(), kGeometry.end());
  for (const std::string& name : names) text += "property float " + name + "\n";
  return text + "end_header\n";
}

/// Rows of float32 as bytes, the first three numbers as double with the origin added.
torch::Tensor with_doubles(const torch::Tensor& rows, const geometry::Vector3& origin) {
  const torch::Tensor places = rows.narrow(1, 0, 3).to(torch::kFloat64) +
                               torch::tensor({origin[0], origin[1], origin[2]}, torch::kFloat64);
  return torch::cat({places.contiguous().view(torch::kUInt8),
                     rows.slice(1, 3).contiguous().view(torch::kUInt8)},
                    1)
      .contiguous();
}

}  // namespace

GaussianFile read_ply(const std::filesystem::path& path) {
  const PlyFile file(path);
  if (!holds_gaussians(file)) {
    throw DataError(concat(path.string(),
                           ": expected the 3DGS attributes f_dc_0, scale_0, …, found ",
                           "other vertex properties; is this a plain point cloud?"));
  }
  const int64_t rest = count_rest(file, path);
  std::vector<std::string> names = {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"};
  names.insert(names.end(), kGeometry.begin(), kGeometry.end());
  const auto more = rest_names(rest);
  names.insert(names.end(), more.begin(), more.end());
  const torch::Tensor rows = file.read_vertices(names);
  const auto columns = [&](int64_t begin, int64_t count) { return rows.narrow(1, begin, count); };
  GaussianFile result;
  result.antialiased = says_mip(file);
  const Places places = places_of(file, columns(0, 3));
  result.origin = places.origin;
  splat::Gaussians& g = result.gaussians;
  g.means = places.xyz.contiguous();
  const torch::Tensor logits = columns(6, 1).squeeze(1);
  g.logit_opacities =
      torch::where(logits.isinf(), logits.clamp(-kFullLogit, kFullLogit), logits).contiguous();
  g.log_scales = columns(7, 3).contiguous();
  g.rotations = columns(10, 4).contiguous();
  const torch::Tensor dc = columns(3, 3).unsqueeze(1);
  const torch::Tensor by_channel = columns(14, rest).reshape({rows.size(0), 3, rest / 3});
  g.sh = torch::cat({dc, by_channel.transpose(1, 2)}, 1).contiguous();
  return result;
}

void check_some(const splat::Gaussians& gaussians, const std::filesystem::path& path) {
  if (gaussians.size() == 0)
    throw DataError(concat(path.string(), ": expected Gaussians, found none"));
  if (!gaussians.means.isfinite().all(1).any().item<bool>()) {
    throw DataError(concat(path.string(),
                           ": expected Gaussians at finite positions, found none of ",
                           gaussians.size()));
  }
}

void write_ply(const std::filesystem::path& path, const GaussianFile& file,
               PlyCoordinates coordinates) {
  const splat::Gaussians& g = file.gaussians;
  check_shape(g.sh, "sh", {g.size(), -1, 3});
  const torch::Tensor means = file_tensor(g.means);
  const torch::Tensor sh = file_tensor(g.sh);
  const torch::Tensor rest =
      sh.slice(1, 1).transpose(1, 2).reshape({g.size(), 3 * (sh.size(1) - 1)});
  const torch::Tensor rows = torch::cat({means, torch::zeros_like(means), sh.select(1, 0), rest,
                                         file_tensor(g.logit_opacities).unsqueeze(1),
                                         file_tensor(g.log_scales), file_tensor(g.rotations)},
                                        1)
                                 .contiguous();
  const std::string header = header_text(file, coordinates);
  const bool doubles = coordinates == PlyCoordinates::kDataset && !geometry::is_zero(file.origin);
  const torch::Tensor bytes = doubles ? with_doubles(rows, file.origin) : rows;
  AtomicFile target(path);
  std::ofstream out(target.temporary_path(), std::ios::binary);
  out.write(header.data(), static_cast<std::streamsize>(header.size()));
  out.write(static_cast<const char*>(bytes.data_ptr()),
            static_cast<std::streamsize>(bytes.numel() * bytes.element_size()));
  out.close();
  if (!out) throw DataError(concat(path.string(), ": cannot be written; is the disk full?"));
  target.commit();
}

PointCloud read_point_cloud(const std::filesystem::path& path) {
  const PlyFile file(path);
  PointCloud cloud;
  const Places places = places_of(file, file.read_vertices({"x", "y", "z"}));
  cloud.points = places.xyz;
  cloud.origin = places.origin;
  const int64_t red = file.vertices().find("red");
  if (red < 0) {
    cloud.colors = torch::full_like(cloud.points, 0.5);
    return cloud;
  }
  cloud.colors = file.read_vertices({"red", "green", "blue"});
  const PlyType type = file.vertices().properties[static_cast<size_t>(red)].type;
  if (type != PlyType::kFloat32 && type != PlyType::kFloat64) cloud.colors.div_(255);
  return cloud;
}

bool has_gaussians(const std::filesystem::path& path) { return holds_gaussians(PlyFile(path)); }

}  // namespace jade::gaussians
