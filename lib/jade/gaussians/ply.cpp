// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/log.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/init.h"
#include "jade/gaussians/ply_header.h"
#include "jade/gaussians/ply_kind.h"
#include "jade/gaussians/ply_packed.h"
#include "jade/gaussians/summary.h"
#include "jade/geometry/origin.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

const char* const kOrigin = "origin";

/// The attributes without f_rest, in the order of a standard file.
const std::vector<std::string> kGeometry = {"opacity", "scale_0", "scale_1", "scale_2",
                                            "rot_0",   "rot_1",   "rot_2",   "rot_3"};
const std::vector<std::string> kConstant = {"f_dc_0", "f_dc_1", "f_dc_2"};
const std::vector<std::vector<std::string>> kColorNames = {
    {"red", "green", "blue"}, {"diffuse_red", "diffuse_green", "diffuse_blue"}};

std::vector<std::string> rest_names(int64_t count) {
  std::vector<std::string> names;
  for (int64_t i = 0; i < count; ++i) names.push_back(concat("f_rest_", i));
  return names;
}

/// Number of f_rest properties: 0, 9, 24 or 45.
int64_t count_rest(const PlyFile& file, const std::filesystem::path& path) {
  const auto& properties = file.vertices().properties;
  const int64_t count =
      std::count_if(properties.begin(), properties.end(),
                    [](const PlyProperty& p) { return p.name.rfind("f_rest_", 0) == 0; });
  if (count != 0 && count != 9 && count != 24 && count != 45) {
    throw DataError(concat(path.string(), ": expected 0, 9, 24 or 45 f_rest properties (SH degree ",
                           "0 to 3), found ", count,
                           count == 72 ? " (SH degree 4); export the scene with SH degree 3"
                                       : "; export the scene again"));
  }
  return count;
}

bool has_all(const PlyFile& file, const std::vector<std::string>& names) {
  return std::all_of(names.begin(), names.end(),
                     [&](const auto& name) { return file.vertices().find(name) >= 0; });
}

/// Names of the colour properties of points; empty if there are none.
std::vector<std::string> color_names(const PlyFile& file) {
  for (const auto& names : kColorNames) {
    if (has_all(file, names)) return names;
  }
  return {};
}

/// Value of full brightness. Floats are in [0,1], but some tools write 0..255; values slightly
/// above 1 are unclamped colours.
double brightest_of(const PlyFile& file, PlyType type, double largest) {
  constexpr double kUnclamped = 2;
  if (type == PlyType::kUint8 || type == PlyType::kInt8) return 255;
  const bool floating = type == PlyType::kFloat32 || type == PlyType::kFloat64;
  if (floating && !(largest > kUnclamped)) return 1;
  if (type == PlyType::kUint16 || type == PlyType::kInt16 || largest > 255) {
    if (!(largest > 65535)) return 65535;
    throw DataError(concat(file.path().string(),
                           ": expected colours from 0 to 1, 255 or 65535, found ", largest,
                           "; export the colours again"));
  }
  return 255;
}

/// [N,3] in [0,1].
torch::Tensor read_colors(const PlyFile& file, const std::vector<std::string>& names,
                          std::vector<std::string>& notes) {
  torch::Tensor colors = file.read_vertices(names);
  const auto first = static_cast<size_t>(file.vertices().find(names[0]));
  const PlyType type = file.vertices().properties[first].type;
  const torch::Tensor finite = colors.masked_select(colors.isfinite());
  const double largest = finite.numel() == 0 ? 0 : finite.max().item<double>();
  const double brightest = brightest_of(file, type, largest);
  if (brightest != 1 && (type == PlyType::kFloat32 || type == PlyType::kFloat64)) {
    notes.push_back(concat(file.path().string(), ": expected ", names[0],
                           " from 0 to 1, found up to ", largest, "; colours are divided by ",
                           brightest));
  }
  return brightest == 1 ? colors : colors.div_(brightest);
}

/// Applies the 3D smoothing filter of Mip-Splatting (Yu et al., CVPR 2024): covariance S^2 becomes
/// S^2 + f^2, and the opacity is multiplied by
/// sqrt(det S^2 / det(S^2 + f^2)), which preserves the integral.
/// @param filter  [N] standard deviation f in world units
void apply_filter(splat::Gaussians& g, const torch::Tensor& filter) {
  const torch::Tensor f2 = filter.to(torch::kFloat64).square().unsqueeze(1);
  const torch::Tensor s2 = (2 * g.log_scales.to(torch::kFloat64)).exp();
  const torch::Tensor smooth = s2 + f2;
  // A scale of zero without a filter stays unchanged.
  const torch::Tensor share = torch::where(f2 > 0, s2 / smooth, torch::ones_like(s2));
  const torch::Tensor opacity =
      torch::sigmoid(g.logit_opacities.to(torch::kFloat64)) * share.prod(1).sqrt();
  const torch::Tensor changed = f2.squeeze(1) > 0;
  g.logit_opacities =
      torch::where(changed, torch::logit(opacity).to(torch::kFloat32), g.logit_opacities)
          .contiguous();
  g.log_scales =
      torch::where(changed.unsqueeze(1), (0.5 * smooth.log()).to(torch::kFloat32), g.log_scales)
          .contiguous();
}

PlyKind kind_of(const PlyFile& file) {
  const PlyElement& vertices = file.vertices();
  if (is_packed(file)) return PlyKind::kPacked;
  // Any of these suffices: a file that lacks the others is damaged, not a point cloud.
  for (const char* const name : {"f_dc_0", "scale_0", "rot_0"}) {
    if (vertices.find(name) < 0) continue;
    if (vertices.find("scale_1") >= 0 && vertices.find("scale_2") < 0) return PlyKind::kFlat;
    const bool colored = vertices.find("f_dc_0") < 0 && !color_names(file).empty();
    return colored ? PlyKind::kColored : PlyKind::kGaussians;
  }
  const PlyElement* const faces = file.element("face");
  return faces != nullptr && faces->count > 0 ? PlyKind::kMesh : PlyKind::kPoints;
}

bool holds_gaussians(PlyKind kind) { return kind != PlyKind::kPoints && kind != PlyKind::kMesh; }

/// @throws DataError for a point cloud or a mesh, and for missing attributes, which it lists.
void check_attributes(const PlyFile& file, PlyKind kind) {
  const std::string path = file.path().string();
  if (!holds_gaussians(kind)) {
    throw DataError(concat(path, ": expected the 3DGS attributes f_dc_0, scale_0, …, found a ",
                           word_of(kind), " without them",
                           kind == PlyKind::kMesh
                               ? "; only its vertices can be used, as init.ply of jade_train"
                               : "; as init.ply jade_train can start from it"));
  }
  if (kind == PlyKind::kPacked) return;
  std::string missing;
  const auto ask = [&](const std::string& name) {
    if (file.vertices().find(name) < 0) missing += (missing.empty() ? "" : ", ") + name;
  };
  for (const char* const axis : {"x", "y", "z"}) ask(axis);
  if (color_names(file).empty() || file.vertices().find("f_dc_0") >= 0) {
    for (const std::string& name : kConstant) ask(name);
  }
  for (const std::string& name : kGeometry) {
    if (kind != PlyKind::kFlat || name != "scale_2") ask(name);
  }
  if (missing.empty()) return;
  throw DataError(concat(path, ": expected the attributes of ", word_of(kind),
                         ", found none called ", missing, "; export the scene again"));
}

/// Attributes that are floats.
constexpr std::pair<const char*, const char*> kFloats[] = {{"opacity", "a logit"},
                                                           {"scale_", "a logarithm"},
                                                           {"f_dc_", "an SH coefficient"},
                                                           {"f_rest_", "an SH coefficient"},
                                                           {"rot_", "of a quaternion"}};

/// @throws DataError for integers, whose scale is unknown. The length of a quaternion has no
/// effect,
///   so signed integers are accepted there.
void check_types(const PlyFile& file) {
  for (const PlyProperty& property : file.vertices().properties) {
    const PlyType type = property.type;
    if (type == PlyType::kFloat32 || type == PlyType::kFloat64) continue;
    const bool is_signed =
        type == PlyType::kInt8 || type == PlyType::kInt16 || type == PlyType::kInt32;
    for (const auto& [start, meaning] : kFloats) {
      if (property.name.rfind(start, 0) != 0 || (is_signed && property.name[0] == 'r')) continue;
      throw DataError(concat(file.path().string(), ": expected ", property.name, " as float (",
                             meaning, "), found integers; export the scene again with floats"));
    }
  }
}

/// Notes opacities that look as if they were no logits: all from 0 to 1, 100 or 255.
void note_opacities(const torch::Tensor& logits, const std::string& path,
                    std::vector<std::string>& notes) {
  constexpr double kMostTrained = 30;
  constexpr int64_t kMany = 10;
  const torch::Tensor finite = logits.masked_select(logits.isfinite());
  if (finite.numel() < kMany) return;
  const double least = finite.min().item<double>(), most = finite.max().item<double>();
  if (least < 0 || (most > 1 && most <= kMostTrained)) return;
  if (std::get<0>(at::_unique(finite)).numel() < kMany) return;
  notes.push_back(concat(path, ": expected opacity as logits, found values from ", least, " to ",
                         most, ", which look like opacities from 0 to ",
                         most <= 1 ? "1" : "100 or 255", " and are read as logits; export them as ",
                         "log(o / (1 - o))"));
}

/// Median distance of Gaussians from their nearest others; 0 for too few.
double spacing_of(const torch::Tensor& means) {
  const torch::Tensor finite = means.index({means.isfinite().all(1)});
  if (finite.size(0) < 4) return 0;
  return mean_squared_neighbour_distance(finite).median().sqrt().item<double>();
}

/// Notes scales that look as if they were no logarithms: none is negative, and as logarithms they
/// make Gaussians much larger than their spacing, to which they are closer as lengths.
/// @param scales  [N,2] or [N,3] as read
void note_scales(const torch::Tensor& means, const torch::Tensor& scales, const std::string& path,
                 std::vector<std::string>& notes) {
  constexpr double kLarge = 3;
  const torch::Tensor finite = scales.index({scales.isfinite().all(1)});
  if (finite.size(0) == 0 || finite.min().item<double>() < 0) return;
  const double longest = finite.amax(1).median().item<double>(), spacing = spacing_of(means);
  if (spacing == 0 || longest == 0) return;
  const double as_log = longest - std::log(spacing);
  if (as_log < std::log(kLarge) || as_log < std::abs(std::log(longest / spacing))) return;
  notes.push_back(concat(path, ": expected scales as logarithms, found none below 0 and Gaussians ",
                         "of about ", std::exp(longest), " units at distances of ", spacing,
                         ": they look like lengths and are read as logarithms; export log(scale)"));
}

/// Notes attributes of time, which SpacetimeGaussians (trbf_center, motion_0, omega_0) and 4DGS
/// (scale_t, rot_r_0) write beside those of 3DGS. They are not read.
void note_motion(const PlyFile& file, std::vector<std::string>& notes) {
  std::string found;
  for (const char* const name : {"trbf_center", "motion_0", "omega_0", "scale_t", "rot_r_0"}) {
    if (file.vertices().find(name) >= 0) found += concat(found.empty() ? "" : ", ", name);
  }
  if (found.empty()) return;
  notes.push_back(concat(file.path().string(), ": expected Gaussians of a scene at rest, found ",
                         found,
                         " of one that moves, which are not read: all its moments are shown "
                         "at once; export one moment as 3DGS"));
}

const char* const kFilter = "filter_3D";

/// Reads all kinds but the packed one, in one pass over the file.
splat::Gaussians read_attributes(const PlyFile& file, std::vector<std::string>& notes) {
  check_types(file);
  const bool has_constant = file.vertices().find("f_dc_0") >= 0;
  const int64_t scales = file.vertices().find("scale_2") >= 0 ? 3 : 2;
  const std::vector<std::string> scale_names = {"scale_0", "scale_1", "scale_2"};
  std::vector<std::string> names = {"x", "y", "z", "opacity", "rot_0", "rot_1", "rot_2", "rot_3"};
  names.insert(names.end(), scale_names.begin(), scale_names.begin() + scales);
  if (has_constant) names.insert(names.end(), kConstant.begin(), kConstant.end());
  const int64_t rest = count_rest(file, file.path());
  const auto more = rest_names(rest);
  names.insert(names.end(), more.begin(), more.end());
  const bool filtered = file.vertices().find(kFilter) >= 0 && scales == 3;
  if (filtered) names.emplace_back(kFilter);
  const torch::Tensor rows = file.read_vertices(names);
  int64_t at = 0;
  const auto take = [&](int64_t count) {
    at += count;
    return rows.narrow(1, at - count, count);
  };
  splat::Gaussians g;
  g.means = take(3).contiguous();
  g.logit_opacities = take(1).squeeze(1).contiguous();
  g.rotations = take(4).contiguous();
  const torch::Tensor sizes = take(scales);
  g.log_scales =
      torch::constant_pad_nd(sizes, {0, 3 - scales}, -std::numeric_limits<double>::infinity())
          .contiguous();
  note_motion(file, notes);
  note_opacities(g.logit_opacities, file.path().string(), notes);
  note_scales(g.means, sizes, file.path().string(), notes);
  const torch::Tensor dc =
      has_constant ? take(3)
                   : (read_colors(file, color_names(file), notes) - 0.5) / splat::math::kSh0;
  const torch::Tensor by_channel = take(rest).reshape({rows.size(0), 3, rest / 3});
  g.sh = torch::cat({dc.unsqueeze(1), by_channel.transpose(1, 2)}, 1).contiguous();
  if (filtered) {
    apply_filter(g, take(1).squeeze(1));
    notes.push_back(concat(file.path().string(), ": the 3D smoothing filter of Mip-Splatting (",
                           kFilter, ") is applied to scales and opacities"));
  } else if (file.vertices().find(kFilter) >= 0) {
    notes.push_back(concat(file.path().string(), ": ", kFilter,
                           " is not applied, as the Gaussians have two scales"));
  }
  return g;
}

/// The origin in the header.
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

/// Vertices relative to an origin at which float32 resolves them.
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
  // Packed positions have no more digits than float32.
  const torch::Tensor exact = is_packed(file)
                                  ? xyz.to(torch::kFloat64)
                                  : file.read_vertices({"x", "y", "z"}, torch::kFloat64);
  const torch::Tensor moved =
      exact - torch::tensor({found[0], found[1], found[2]}, torch::kFloat64);
  return {moved.to(torch::kFloat32), found};
}

std::string header_text(const GaussianFile& file, PlyCoordinates coordinates) {
  const splat::Gaussians& gaussians = file.gaussians;
  const bool moved = !geometry::is_zero(file.origin);
  std::string text =
      concat("ply\nformat binary_little_endian 1.0\n", render_mode_line(file.antialiased));
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

/// Rows of float32 as bytes, with the first three numbers as double plus the origin.
torch::Tensor with_doubles(const torch::Tensor& rows, const geometry::Vector3& origin) {
  const torch::Tensor places = rows.narrow(1, 0, 3).to(torch::kFloat64) +
                               torch::tensor({origin[0], origin[1], origin[2]}, torch::kFloat64);
  return torch::cat({places.contiguous().view(torch::kUInt8),
                     rows.slice(1, 3).contiguous().view(torch::kUInt8)},
                    1)
      .contiguous();
}

}  // namespace

PlyScene read_scene(const std::filesystem::path& path) {
  const PlyFile file(path);
  PlyScene result;
  result.kind = kind_of(file);
  check_attributes(file, result.kind);
  result.file.antialiased = file.says_antialiased();
  splat::Gaussians& gaussians = result.file.gaussians;
  gaussians = result.kind == PlyKind::kPacked ? unpack(file) : read_attributes(file, result.notes);
  if (const std::string more = file.trailing_warning(); !more.empty()) {
    result.notes.push_back(more);
  }
  const Places places = places_of(file, gaussians.means);
  gaussians.means = places.xyz.contiguous();
  result.file.origin = places.origin;
  result.flat = make_finite(gaussians);
  return result;
}

GaussianFile read_ply(const std::filesystem::path& path) { return read_scene(path).file; }

void check_some(const splat::Gaussians& gaussians, const std::filesystem::path& path) {
  if (gaussians.size() == 0)
    throw DataError(concat(path.string(), ": expected Gaussians, found none"));
  if (!gaussians.means.isfinite().all(1).any().item<bool>()) {
    throw DataError(concat(path.string(),
                           ": expected Gaussians at finite positions, found none of ",
                           gaussians.size()));
  }
  if (drawable(gaussians).size() == 0) {
    throw DataError(concat(path.string(),
                           ": expected Gaussians that can be rendered, found none of ",
                           gaussians.size(), ": ", undrawable_reasons(gaussians)));
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
  const std::vector<std::string> names = color_names(file);
  std::vector<std::string> notes;
  cloud.colors =
      names.empty() ? torch::full_like(cloud.points, 0.5) : read_colors(file, names, notes);
  if (const std::string more = file.trailing_warning(); !more.empty()) notes.push_back(more);
  for (const std::string& note : notes) log_warn(note);
  return cloud;
}

PlyKind kind_of(const std::filesystem::path& path) { return kind_of(PlyFile(path)); }

bool has_colors(const std::filesystem::path& path) { return !color_names(PlyFile(path)).empty(); }

bool has_gaussians(const std::filesystem::path& path) { return holds_gaussians(kind_of(path)); }

}  // namespace jade::gaussians
