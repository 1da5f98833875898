// SPDX-License-Identifier: Apache-2.0
#include "jade/world/bvh.h"

#include <algorithm>
#include <numeric>

namespace jade::world {
namespace {

constexpr int kLeafSize = 3;

float area(const Bounds& b) {
  const Vec3 s = b.high - b.low;
  return s.x * s.y + s.y * s.z + s.z * s.x;
}

float center(const Bounds& b, int axis) {
  return axis == 0 ? b.low.x + b.high.x : axis == 1 ? b.low.y + b.high.y : b.low.z + b.high.z;
}

}  // namespace

Bvh::Bvh(const std::vector<Primitive>& primitives) : order_(primitives.size()) {
  if (primitives.empty()) {
    return;
  }
  std::vector<Bounds> boxes;
  for (const Primitive& p : primitives) {
    boxes.push_back(bounds_of(p));
  }
  std::iota(order_.begin(), order_.end(), 0);
  nodes_.reserve(2 * primitives.size());
  nodes_.emplace_back();
  build(0, 0, static_cast<int>(primitives.size()), boxes);
}

void Bvh::build(int index, int begin, int end, const std::vector<Bounds>& boxes) {
  const auto box = [&](int i) -> const Bounds& {
    return boxes[static_cast<size_t>(order_[static_cast<size_t>(i)])];
  };
  Bounds whole;
  for (int i = begin; i < end; ++i) {
    whole.add(box(i));
  }
  nodes_[static_cast<size_t>(index)].bounds = whole;
  float best = 1e30f;
  int best_axis = 0, best_split = (begin + end) / 2;
  const auto sort_along = [&](int axis) {
    std::sort(order_.begin() + begin, order_.begin() + end, [&](int a, int b) {
      const float ca = center(boxes[static_cast<size_t>(a)], axis);
      const float cb = center(boxes[static_cast<size_t>(b)], axis);
      return ca != cb ? ca < cb : a < b;
    });
  };
  for (int axis = 0; axis < 3 && end - begin > kLeafSize; ++axis) {
    sort_along(axis);
    std::vector<float> right(static_cast<size_t>(end - begin));
    Bounds sweep;
    for (int i = end - 1; i > begin; --i) {
      sweep.add(box(i));
      right[static_cast<size_t>(i - begin)] = area(sweep) * static_cast<float>(end - i);
    }
    sweep = Bounds{};
    for (int i = begin + 1; i < end; ++i) {
      sweep.add(box(i - 1));
      const float cost =
          area(sweep) * static_cast<float>(i - begin) + right[static_cast<size_t>(i - begin)];
      if (cost < best) {
        best = cost, best_axis = axis, best_split = i;
      }
    }
  }
  if (end - begin <= kLeafSize) {
    nodes_[static_cast<size_t>(index)].first = begin;
    nodes_[static_cast<size_t>(index)].count = end - begin;
    return;
  }
  sort_along(best_axis);
  const int left = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  build(left, begin, best_split, boxes);
  const int second = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  nodes_[static_cast<size_t>(index)].first = second;
  build(second, best_split, end, boxes);
}

}  // namespace jade::world
