// SPDX-License-Identifier: Apache-2.0
#include "jade_inspect/ply.h"

#include <cstdio>

#include "jade/gaussians/ply.h"
#include "jade/geometry/origin.h"

namespace jade::apps {
namespace {

using gaussians::GaussianSummary;
using gaussians::Spread;

nlohmann::json to_json(const Spread& s) {
  return {{"min", s.min}, {"p01", s.low}, {"median", s.median}, {"p99", s.high}, {"max", s.max}};
}

void print_spread(const char* name, const Spread& s) {
  std::printf("%-11s %.4g to %.4g, median %.4g, 98 %% within %.4g to %.4g\n", name, s.min, s.max,
              s.median, s.low, s.high);
}

/// Of a scene far from the origin x, y and z are about one of its own.
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

void inspect_ply(const std::filesystem::path& path, bool json) {
  if (!gaussians::has_gaussians(path)) {
    const gaussians::PointCloud cloud = gaussians::read_point_cloud(path);
    nlohmann::json result = {{"points", cloud.points.size(0)}};
    const char* const axes[] = {"x", "y", "z"};
    if (!json) std::printf("points      %ld with colours, no Gaussians\n", long(result["points"]));
    for (int64_t i = 0; i < 3; ++i) {
      const Spread spread = gaussians::spread_of(cloud.points.select(1, i));
      result[axes[i]] = to_json(spread);
      if (!json) print_spread(axes[i], spread);
    }
    result["origin"] = cloud.origin;
    if (!json) print_origin(cloud.origin);
    if (json) std::printf("%s\n", result.dump(2).c_str());
    return;
  }
  const gaussians::GaussianFile file = gaussians::read_ply(path);
  const GaussianSummary summary = gaussians::summarize(file.gaussians);
  if (json) {
    nlohmann::json result = to_json(summary, file.antialiased);
    result["origin"] = file.origin;
    std::printf("%s\n", result.dump(2).c_str());
    return;
  }
  print_text(summary, file.antialiased);
  print_origin(file.origin);
  if (summary.problems.empty()) std::printf("\nNo problems found.\n");
  for (const std::string& problem : summary.problems)
    std::printf("problem     %s\n", problem.c_str());
}

}  // namespace jade::apps
