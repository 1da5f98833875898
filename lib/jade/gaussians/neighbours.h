// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace jade::gaussians {

/// A k-d tree over 3D points for nearest-neighbour queries.
class PointTree {
 public:
  using Point = std::array<float, 3>;

  explicit PointTree(std::vector<Point> points);

  /// Mean squared distance of point `index` (input order) to its nearest `k` others, k ≤ 8.
  double mean_squared_distance(int64_t index, int k) const;

 private:
  struct Nearest;
  void build(int64_t begin, int64_t end);
  void visit(int64_t begin, int64_t end, const Point& query, Nearest& nearest) const;

  /// Implicit tree: the middle of a range splits it along the middle's axis_.
  std::vector<Point> points_;
  std::vector<int64_t> order_;  ///< tree position → input index
  std::vector<int64_t> place_;  ///< input index → tree position
  std::vector<uint8_t> axis_;   ///< by tree position
};

}  // namespace jade::gaussians
