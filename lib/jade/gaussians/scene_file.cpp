// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/scene_file.h"

#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/gltf_file.h"
#include "jade/gaussians/ply_kind.h"
#include "jade/gaussians/ply_packed.h"
#include "jade/gaussians/sog_file.h"
#include "jade/gaussians/splat_file.h"
#include "jade/gaussians/spz_file.h"
#include "jade/gaussians/summary.h"
#include "jade/geometry/origin.h"
#include "jade/io/stand_in.h"
#include "jade/io/zip.h"
#include "jade/splat/math/sh.h"

namespace jade::gaussians {
namespace {

namespace fs = std::filesystem;

/// Enough of a gzip file to unpack the signature of an .spz.
constexpr size_t kStart = 4096;
const char* const kPackedPly = ".compressed.ply";

std::string start_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string start(kStart, '\0');
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<size_t>(in.gcount()));
  return start;
}

bool begins(const std::string& text, const std::string& with) {
  return text.compare(0, with.size(), with) == 0;
}

bool ends(const fs::path& path, const std::string& with) {
  const std::string name = path.filename().string();
  return name.size() > with.size() &&
         name.compare(name.size() - with.size(), with.size(), with) == 0;
}

bool is_sog_archive(const fs::path& path) {
  try {
    return io::Zip(path).has("meta.json");
  } catch (const DataError&) {
    return false;
  }
}

std::optional<SceneKind> kind_of_json(const fs::path& path) {
  const nlohmann::json document = nlohmann::json::parse(read_file(path), nullptr, false);
  if (!document.is_object()) return std::nullopt;
  if (document.contains("asset") && document.contains("meshes")) return SceneKind::kGltf;
  if (document.contains("means") && document.contains("quats")) return SceneKind::kSog;
  return std::nullopt;
}

std::optional<SceneKind> kind_of_content(const fs::path& path) {
  const std::string start = start_of(path);
  if (begins(start, "ply")) return SceneKind::kPly;
  if (begins(start, "glTF")) return SceneKind::kGltf;
  if (is_spz(start)) return SceneKind::kSpz;
  if (begins(start, "PK") && is_sog_archive(path)) return SceneKind::kSog;
  const size_t first = start.find_first_not_of(" \t\r\n");
  if (first != std::string::npos && start[first] == '{') return kind_of_json(path);
  return std::nullopt;
}

std::optional<SceneKind> kind_of_ending(const fs::path& path) {
  const std::string ending = in_small_letters(path.extension().string());
  for (const auto& [known, kind] :
       {std::pair{".ply", SceneKind::kPly}, std::pair{".spz", SceneKind::kSpz},
        std::pair{".sog", SceneKind::kSog}, std::pair{".glb", SceneKind::kGltf},
        std::pair{".gltf", SceneKind::kGltf}, std::pair{".splat", SceneKind::kSplat}}) {
    if (ending == known) return kind;
  }
  return std::nullopt;
}

SceneFile read_as(SceneKind kind, const fs::path& path) {
  switch (kind) {
    case SceneKind::kPly: {
      PlyScene scene = read_scene(path);
      return {std::move(scene.file), word_of(scene.kind), scene.flat, std::move(scene.notes)};
    }
    case SceneKind::kSpz: {
      std::vector<std::string> notes;
      GaussianFile file = parse_spz(read_file(path), path.string(), notes);
      return {std::move(file), ".spz (Niantic)", 0, std::move(notes)};
    }
    case SceneKind::kSog:
      return {read_sog(path), ".sog (PlayCanvas, SuperSplat)", 0, {}};
    case SceneKind::kGltf: {
      std::vector<std::string> notes;
      GaussianFile file = read_gltf(path, notes);
      return {std::move(file), "glTF with KHR_gaussian_splatting", 0, std::move(notes)};
    }
    case SceneKind::kSplat:
      return {read_splat(path), ".splat", 0, {}};
  }
  throw ContractError("read_as: unknown kind");
}

/// Moves means far from the origin to an origin near them, unless the file has one.
void move_far(GaussianFile& file) {
  if (!geometry::is_zero(file.origin)) return;
  const geometry::Vector3 found = found_origin(file.gaussians.means);
  if (geometry::is_zero(found)) return;
  const torch::Tensor shift = torch::tensor({found[0], found[1], found[2]}, torch::kFloat64);
  file.gaussians.means = (file.gaussians.means.to(torch::kFloat64) - shift).to(torch::kFloat32);
  file.origin = found;
}

/// Warns of colours that a format cannot store. Only visible Gaussians that lose more than the
/// format's rounding count.
void tell_lost_colors(const fs::path& path, SceneKind kind, const splat::Gaussians& g) {
  const std::string format = kind == SceneKind::kPly ? kPackedPly : path.extension().string();
  const torch::Tensor visible = g.logit_opacities.sigmoid() >= 1.0 / 255;
  const torch::Tensor rest = g.sh.slice(1, 1);
  const auto count_visible_of = [&](const torch::Tensor& mask) {
    return mask.flatten(1).any(1).logical_and(visible).sum().item<int64_t>();
  };
  if (kind == SceneKind::kSplat && count_visible_of(rest.ne(0)) > 0) {
    log_warn(concat(path.string(), ": view dependence (SH above degree 0) is left out, because ",
                    format, " cannot hold it; write .ply, .spz, .sog or .glb"));
  }
  // Limits of the coefficients of degree 0 and of those above, with half a step of rounding.
  // Renderers show negative colours as black, so that .splat loses only bright ones.
  constexpr double kNone = std::numeric_limits<double>::infinity(), kHalf = 0.5 + 0.5 / 255;
  double low = -kNone, high = kNone, most = kNone;
  if (kind == SceneKind::kSplat) high = kHalf / splat::math::kSh0;
  if (kind == SceneKind::kSpz) high = kHalf / 0.15, low = -high, most = 1 + 1.0 / 16;
  if (kind == SceneKind::kPly) most = 4 + 1.0 / 32;
  const torch::Tensor base = g.sh.select(1, 0);
  const int64_t count = count_visible_of(
      torch::cat({(base < low).logical_or(base > high).unsqueeze(1), rest.abs() > most}, 1));
  if (count == 0) return;
  log_warn(concat(path.string(), ": expected colours that ", format, " can hold, found ",
                  grouped(count), " of ", grouped(g.size()),
                  " Gaussians with larger values, which are clipped; write .ply or .sog"));
}

}  // namespace

std::optional<SceneKind> scene_kind(const fs::path& path) {
  if (!fs::is_regular_file(path)) return std::nullopt;
  const std::optional<SceneKind> found = kind_of_content(path);
  return found ? found : kind_of_ending(path);
}

void refuse_foreign_scene(const fs::path& path) {
  if (!fs::is_regular_file(path) || kind_of_content(path)) return;
  if (const std::string other = io::stand_in(path);
      !other.empty() && (kind_of_ending(path) || ends(path, ".ply.gz"))) {
    throw DataError(concat(path.string(), ": expected Gaussians, found ", other));
  }
  if (ends(path, ".ksplat")) {
    throw DataError(concat(path.string(), ": expected Gaussians in ", kReadEndings,
                           ", found .ksplat (GaussianSplats3D), which is not read; convert it: npx "
                           "@playcanvas/splat-transform ",
                           path.filename().string(), " ", path.stem().string(), ".ply"));
  }
}

SceneFile read_scene_file(const fs::path& path) {
  refuse_foreign_scene(path);
  const std::optional<SceneKind> kind = scene_kind(path);
  if (!kind) {
    throw DataError(concat(path.string(), ": expected Gaussians in ", kReadEndings, ", found ",
                           fs::is_directory(path)      ? "a folder"
                           : fs::is_regular_file(path) ? "another kind of file"
                                                       : "nothing",
                           "; give the file of the scene"));
  }
  SceneFile scene = read_as(*kind, path);
  move_far(scene.file);
  return scene;
}

GaussianFile read_gaussians(const fs::path& path) {
  SceneFile scene = read_scene_file(path);
  for (const std::string& note : scene.notes) log_warn(note);
  return std::move(scene.file);
}

bool is_exact(const fs::path& path) { return ends(path, ".ply") && !ends(path, kPackedPly); }

bool can_write(const fs::path& path) {
  return kind_of_ending(path).has_value() && !ends(path, ".gltf");
}

void write_scene_file(const fs::path& path, const GaussianFile& file, const SceneWriting& writing) {
  JADE_CHECK(can_write(path), "write_scene_file: unknown ending of ", path.string());
  if (is_exact(path)) return write_ply(path, file, writing.coordinates);
  const SceneKind kind = *kind_of_ending(path);
  if (file.antialiased && (kind == SceneKind::kGltf || kind == SceneKind::kSplat)) {
    log_warn(concat(path.string(), ": this format cannot say that the scene is antialiased ",
                    "(Mip-Splatting), without which its thin Gaussians look too opaque; write ",
                    ".ply, .spz or .sog"));
  }
  tell_lost_colors(path, kind, drawable(file.gaussians));
  switch (kind) {
    case SceneKind::kPly:
      return write_file(path, encode_packed_ply(drawable(file.gaussians), file.antialiased));
    case SceneKind::kSpz: {
      SpzOptions options;
      options.antialiased = file.antialiased;
      options.version = writing.spz_version;
      return write_spz(path, file.gaussians, options);
    }
    case SceneKind::kSog:
      return write_sog(path, file);
    case SceneKind::kGltf:
      return write_glb(path, file);
    case SceneKind::kSplat:
      return write_splat(path, file.gaussians);
  }
}

}  // namespace jade::gaussians
