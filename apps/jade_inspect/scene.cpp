// SPDX-License-Identifier: Apache-2.0
#include "jade_inspect/scene.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "jade/core/error.h"
#include "jade/core/readable.h"
#include "jade/gaussians/ply_kind.h"
#include "jade/gaussians/scene_file.h"
#include "jade/geometry/origin.h"

namespace jade::apps {
namespace {

using gaussians::GaussianSummary;
using gaussians::Spread;

nlohmann::json to_json(const Spread& s) {
  return {{"min", s.min}, {"p01", s.low}, {"median", s.median}, {"p99", s.high}, {"max", s.max}};
}

void print_spread(const char* name, const Spread& s) {
  const auto text = [](double value) { return readable(value, 4); };
  std::printf(
      "%s\n",
      concat(name,
             std::string(std::max<size_t>(12, std::strlen(name) + 1) - std::strlen(name), ' '),
             text(s.min), " to ", text(s.max), ", median ", text(s.median), ", 98 % within ",
             text(s.low), " to ", text(s.high))
          .c_str());
}

/// Prints the origin of a scene whose coordinates are relative to one.
void print_origin(const geometry::Vector3& origin) {
  if (geometry::is_zero(origin)) return;
  std::printf("origin      x, y and z above are about %s\n", geometry::text_of(origin).c_str());
}

}  // namespace

void print_text(const GaussianSummary& s, bool antialiased) {
  std::printf("Gaussians   %ld, SH degree %ld%s\n", long(s.count), long(s.sh_degree),
              antialiased ? ", antialiased (mip)" : "");
  if (s.count == 0) return;
  print_spread("x", s.x);
  print_spread("y", s.y);
  print_spread("z", s.z);
  print_spread("opacity", s.opacity);
  std::printf("            %.1f %% next to transparent (below %g)\n", 100 * s.transparent,
              gaussians::kTransparent);
  print_spread("longest axis", s.scale);
  print_spread("elongation", s.elongation);
}

nlohmann::json to_json(const GaussianSummary& s, bool antialiased) {
  return {{"gaussians", s.count},
          {"sh_degree", s.sh_degree},
          {"antialiased", antialiased},
          {"x", to_json(s.x)},
          {"y", to_json(s.y)},
          {"z", to_json(s.z)},
          {"opacity", to_json(s.opacity)},
          {"transparent_share", s.transparent},
          {"longest_axis", to_json(s.scale)},
          {"elongation", to_json(s.elongation)},
          {"problems", s.problems}};
}

namespace {

void inspect_points(const std::filesystem::path& path, bool json) {
  const gaussians::PlyKind kind = gaussians::kind_of(path);
  const gaussians::PointCloud cloud = gaussians::read_point_cloud(path);
  const bool colored = gaussians::has_colors(path);
  nlohmann::json result = {
      {"kind", word_of(kind)}, {"points", cloud.points.size(0)}, {"colored", colored}};
  const char* const axes[] = {"x", "y", "z"};
  if (!json) {
    std::printf("file        %s\n", word_of(kind));
    std::printf("points      %ld %s colours, no Gaussians\n", long(cloud.points.size(0)),
                colored ? "with" : "without");
  }
  for (int64_t i = 0; i < 3; ++i) {
    const Spread spread = gaussians::spread_of(cloud.points.select(1, i));
    result[axes[i]] = to_json(spread);
    if (!json) print_spread(axes[i], spread);
  }
  result["origin"] = cloud.origin;
  if (!json) print_origin(cloud.origin);
  if (json) std::printf("%s\n", result.dump(2).c_str());
}

}  // namespace

void inspect_scene(const std::filesystem::path& path, bool json) {
  if (gaussians::scene_kind(path) == gaussians::SceneKind::kPly &&
      !gaussians::has_gaussians(path)) {
    return inspect_points(path, json);
  }
  const gaussians::SceneFile scene = gaussians::read_scene_file(path);
  const gaussians::GaussianFile& file = scene.file;
  const GaussianSummary summary = gaussians::summarize(file.gaussians);
  if (json) {
    nlohmann::json result = to_json(summary, file.antialiased);
    result["origin"] = file.origin;
    result["kind"] = scene.kind;
    result["flat"] = scene.flat;
    result["notes"] = scene.notes;
    std::printf("%s\n", result.dump(2).c_str());
    return;
  }
  std::printf("file        %s\n", scene.kind.c_str());
  print_text(summary, file.antialiased);
  print_origin(file.origin);
  if (scene.flat > 0) {
    std::printf(
        "note        %s of %s Gaussians are flat: they are read with a thousandth of "
        "their thinnest other axis as thickness\n",
        grouped(scene.flat).c_str(), grouped(summary.count).c_str());
  }
  for (const std::string& note : scene.notes) std::printf("note        %s\n", note.c_str());
  if (summary.problems.empty()) std::printf("\nNo problems found.\n");
  for (const std::string& problem : summary.problems)
    std::printf("problem     %s\n", problem.c_str());
}

}  // namespace jade::apps
