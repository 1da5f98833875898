// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/neighbours.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace jade::gaussians {
namespace {

constexpr int64_t kLeaf = 8;

float squared_distance(const PointTree::Point& a, const PointTree::Point& b) {
  const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return x * x + y * y + z * z;
}

}  // namespace

/// The k smallest squared distances so far, in ascending order.
struct PointTree::Nearest {
  std::array<float, 8> distance;
  int k = 0;
  int64_t self = 0;  ///< tree position of the query point, which is skipped

  float worst() const { return distance[static_cast<size_t>(k - 1)]; }
  void offer(float d) {
    auto at = static_cast<size_t>(k - 1);
    if (d >= distance[at]) return;
    for (; at > 0 && distance[at - 1] > d; --at) distance[at] = distance[at - 1];
    distance[at] = d;
  }
};

PointTree::PointTree(std::vector<Point> points)
    : order_(points.size()), place_(points.size()), axis_(points.size()) {
  std::iota(order_.begin(), order_.end(), 0);
  points_ = std::move(points);
  build(0, static_cast<int64_t>(points_.size()));
  std::vector<Point> sorted(points_.size());
  for (size_t i = 0; i < order_.size(); ++i) {
    sorted[i] = points_[static_cast<size_t>(order_[i])];
    place_[static_cast<size_t>(order_[i])] = static_cast<int64_t>(i);
  }
  points_ = std::move(sorted);
}

void PointTree::build(int64_t begin, int64_t end) {
  if (end - begin <= kLeaf) return;
  Point low = points_[static_cast<size_t>(order_[static_cast<size_t>(begin)])], high = low;
  for (int64_t i = begin; i < end; ++i) {
    const Point& p = points_[static_cast<size_t>(order_[static_cast<size_t>(i)])];
    for (size_t a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], p[a]);
      high[a] = std::max(high[a], p[a]);
    }
  }
  uint8_t axis = 0;
  for (uint8_t a = 1; a < 3; ++a) {
    if (high[a] - low[a] > high[axis] - low[axis]) axis = a;
  }
  const int64_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](int64_t a, int64_t b) {
                     return points_[static_cast<size_t>(a)][axis] <
                            points_[static_cast<size_t>(b)][axis];
                   });
  axis_[static_cast<size_t>(middle)] = axis;
  build(begin, middle);
  build(middle + 1, end);
}

void PointTree::visit(int64_t begin, int64_t end, const Point& query, Nearest& nearest) const {
  if (end - begin <= kLeaf) {
    for (int64_t i = begin; i < end; ++i) {
      if (i != nearest.self) {
        nearest.offer(squared_distance(query, points_[static_cast<size_t>(i)]));
      }
    }
    return;
  }
  const int64_t middle = begin + (end - begin) / 2;
  const Point& pivot = points_[static_cast<size_t>(middle)];
  const size_t axis = axis_[static_cast<size_t>(middle)];
  const float offset = query[axis] - pivot[axis];
  if (middle != nearest.self) nearest.offer(squared_distance(query, pivot));
  const bool left_first = offset < 0;
  visit(left_first ? begin : middle + 1, left_first ? middle : end, query, nearest);
  if (offset * offset < nearest.worst()) {
    visit(left_first ? middle + 1 : begin, left_first ? end : middle, query, nearest);
  }
}

double PointTree::mean_squared_distance(int64_t index, int k) const {
  const auto others = static_cast<int64_t>(points_.size()) - 1;
  Nearest nearest;
  nearest.distance.fill(std::numeric_limits<float>::infinity());
  nearest.k = static_cast<int>(std::min<int64_t>(k, others));
  if (nearest.k <= 0) return 0;
  nearest.self = place_[static_cast<size_t>(index)];
  visit(0, others + 1, points_[static_cast<size_t>(nearest.self)], nearest);
  double sum = 0;
  for (int i = 0; i < nearest.k; ++i) sum += static_cast<double>(nearest.distance[size_t(i)]);
  return sum / nearest.k;
}

}  // namespace jade::gaussians
