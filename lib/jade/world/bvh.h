// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "jade/world/primitive.h"

namespace jade::world {

/// A bounding volume hierarchy over the surfaces of a scene, split by the surface area heuristic.
class Bvh {
 public:
  Bvh() = default;
  explicit Bvh(const std::vector<Primitive>& primitives);

  /// Calls meet(index, hit) for the surfaces whose box the ray enters before hit.t, nearer boxes
  /// first; `meet` reduces hit.t if the ray hits the surface.
  template <class Meet>
  void walk(const Ray& ray, Hit& hit, const Meet& meet) const;

 private:
  struct Node {
    Bounds bounds;
    int first = 0;  // leaf: first entry of order_; inner: second child (the first follows at once)
    int count = 0;  // leaf: entries; inner: 0
  };
  void build(int node, int begin, int end, const std::vector<Bounds>& boxes);

  std::vector<Node> nodes_;
  std::vector<int> order_;
};

namespace detail {

/// Ray parameter at the entry into the box, or 1e30 if the ray misses it or enters beyond `limit`.
inline float enter(const Bounds& box, Vec3 origin, Vec3 inverse, float limit) {
  const float x0 = (box.low.x - origin.x) * inverse.x, x1 = (box.high.x - origin.x) * inverse.x;
  const float y0 = (box.low.y - origin.y) * inverse.y, y1 = (box.high.y - origin.y) * inverse.y;
  const float z0 = (box.low.z - origin.z) * inverse.z, z1 = (box.high.z - origin.z) * inverse.z;
  const auto lesser = [](float a, float b) { return a < b ? a : b; };
  const auto greater = [](float a, float b) { return a > b ? a : b; };
  const float near = greater(greater(lesser(x0, x1), lesser(y0, y1)), greater(lesser(z0, z1), 0));
  const float far =
      lesser(lesser(greater(x0, x1), greater(y0, y1)), lesser(greater(z0, z1), limit));
  return near <= far ? near : 1e30f;
}

}  // namespace detail

template <class Meet>
void Bvh::walk(const Ray& ray, Hit& hit, const Meet& meet) const {
  if (nodes_.empty()) {
    return;
  }
  const auto inverse_of = [](float d) { return 1 / (std::abs(d) > 1e-12f ? d : 1e-12f); };
  const Vec3 inverse{inverse_of(ray.direction.x), inverse_of(ray.direction.y),
                     inverse_of(ray.direction.z)};
  struct Entry {
    int node;
    float t;
  };
  Entry stack[64];
  int depth = 0;
  stack[depth++] = {0, detail::enter(nodes_[0].bounds, ray.origin, inverse, hit.t)};
  while (depth > 0) {
    const Entry top = stack[--depth];
    if (top.t >= hit.t) {
      continue;
    }
    const Node& node = nodes_[static_cast<size_t>(top.node)];
    if (node.count > 0) {
      for (int i = node.first; i < node.first + node.count; ++i) {
        meet(order_[static_cast<size_t>(i)], hit);
      }
      continue;
    }
    Entry a{top.node + 1, 0}, b{node.first, 0};
    a.t = detail::enter(nodes_[static_cast<size_t>(a.node)].bounds, ray.origin, inverse, hit.t);
    b.t = detail::enter(nodes_[static_cast<size_t>(b.node)].bounds, ray.origin, inverse, hit.t);
    if (a.t > b.t) {
      const Entry swap = a;
      a = b, b = swap;
    }
    if (b.t < hit.t) {
      stack[depth++] = b;
    }
    if (a.t < hit.t) {
      stack[depth++] = a;
    }
  }
}

}  // namespace jade::world
