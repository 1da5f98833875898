// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/fixed_pattern.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "jade/core/random.h"
#include "jade/world/noise.h"

namespace jade::simulate {

std::vector<uint8_t> drawn_columns(int64_t count, int64_t width, uint64_t seed) {
  std::vector<size_t> columns(static_cast<size_t>(width));
  std::iota(columns.begin(), columns.end(), size_t{0});
  std::vector<uint8_t> sampled(columns.size());
  world::Draw draw(seed);
  for (size_t i = 0; i < std::min(static_cast<size_t>(count), columns.size()); ++i) {
    std::swap(columns[i],
              columns[i + static_cast<size_t>(draw.pick(static_cast<int>(columns.size() - i)))]);
    sampled[columns[i]] = 1;
  }
  return sampled;
}

FixedPattern::FixedPattern(const ImageSensorOptions& o, int64_t width, int64_t height,
                           uint64_t seed)
    : width_(static_cast<size_t>(width)) {
  if (o.dead_columns > 0) {
    dead_ = drawn_columns(o.dead_columns, width, derive_seed(seed, "dead columns"));
  }
  if (o.pattern_rows <= 0 && o.pattern_columns <= 0 && o.pattern_pixels <= 0) return;
  world::Draw draw(seed);
  const auto normals = [&](size_t count, double deviation) {
    std::vector<double> values(count);
    for (double& v : values) v = deviation * draw.normal();
    return values;
  };
  const auto rows = normals(static_cast<size_t>(height), o.pattern_rows);
  const auto columns = normals(width_, o.pattern_columns);
  const auto pixels = normals(rows.size() * width_, o.pattern_pixels);
  for (size_t i = 0; i < pixels.size(); ++i) {
    offset_.push_back(static_cast<float>(pixels[i] + rows[i / width_] + columns[i % width_]));
  }
}

double FixedPattern::apply(double value, size_t pixel) const {
  if (!dead_.empty() && dead_[pixel % width_]) return 0;
  return offset_.empty() ? value : value + offset_[pixel];
}

}  // namespace jade::simulate
