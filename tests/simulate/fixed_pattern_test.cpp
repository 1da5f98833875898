// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/fixed_pattern.h"

#include "support/catch.h"

#include <cmath>
#include <numeric>

using namespace jade;
using namespace jade::simulate;

namespace {

constexpr int64_t kPatternWidth = 60, kPatternHeight = 40;

std::vector<double> offsets(const ImageSensorOptions& options, uint64_t seed = 3) {
  const FixedPattern pattern(options, kPatternWidth, kPatternHeight, seed);
  std::vector<double> values;
  for (size_t i = 0; i < kPatternWidth * kPatternHeight; ++i)
    values.push_back(pattern.apply(0.5, i) - 0.5);
  return values;
}

double deviation_of(const std::vector<double>& values) {
  double squares = 0;
  for (const double v : values) squares += v * v;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

}  // namespace

TEST_CASE("fixed pattern: rows, columns and pixels have offsets of their own", "[simulate]") {
  ImageSensorOptions rows, columns, pixels;
  rows.pattern_rows = columns.pattern_columns = pixels.pattern_pixels = 0.02;
  for (const auto& options : {rows, columns, pixels}) {
    CHECK_FALSE(FixedPattern(options, kPatternWidth, kPatternHeight, 3).is_empty());
    CHECK(deviation_of(offsets(options)) == Approx(0.02).epsilon(0.3));
    CHECK(offsets(options) == offsets(options));
    CHECK(offsets(options) != offsets(options, 4));
  }
  const auto of_row = offsets(rows), of_column = offsets(columns);
  CHECK(of_row[5 * kPatternWidth] == of_row[5 * kPatternWidth + 17]);
  CHECK(of_row[5 * kPatternWidth] != of_row[6 * kPatternWidth]);
  CHECK(of_column[5] == of_column[9 * kPatternWidth + 5]);
  CHECK(of_column[5] != of_column[6]);
  CHECK(FixedPattern({}, kPatternWidth, kPatternHeight, 3).is_empty());
}

TEST_CASE("fixed pattern: dead columns are black, as many as asked for", "[simulate]") {
  ImageSensorOptions options;
  options.dead_columns = 4;
  const FixedPattern pattern(options, kPatternWidth, kPatternHeight, 3);
  int dead = 0;
  for (size_t x = 0; x < kPatternWidth; ++x) {
    dead += pattern.apply(0.7, x) == 0;
    CHECK(pattern.apply(0.7, x) == pattern.apply(0.7, x + 7 * kPatternWidth));
  }
  CHECK(dead == 4);
  const auto drawn = drawn_columns(100, 8, 1);
  CHECK(std::accumulate(drawn.begin(), drawn.end(), 0) == 8);
}
