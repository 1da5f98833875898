// SPDX-License-Identifier: Apache-2.0
#include "jade/world/ray_caster.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>

namespace jade::world {
namespace {

// Sample i of n: regular in x, bit-reversed in y, so that every row and column of strips has one.
std::vector<std::array<double, 2>> sample_places(int count) {
  std::vector<std::array<double, 2>> places;
  for (int i = 0; i < count; ++i) {
    double y = 0.5 / count, digit = 0.5;
    for (int k = i; k > 0; k /= 2, digit *= 0.5) {
      y += digit * (k % 2);
    }
    places.push_back({(i + 0.5) / count, y - static_cast<int>(y)});
  }
  return places;
}

}  // namespace

void SharpFrame::resize(int64_t new_width, int64_t new_height) {
  width = new_width, height = new_height;
  rgb.resize(static_cast<size_t>(3 * width * height));
  depth.resize(static_cast<size_t>(width * height));
}

void RayCaster::render(const geometry::Pose& camera_from_world, const geometry::Intrinsics& camera,
                       int samples, SharpFrame& frame) const {
  frame.resize(camera.width, camera.height);
  const auto& r = camera_from_world.rotation;
  const geometry::Vector3 eye = geometry::centre(camera_from_world);
  const Vec3 origin{static_cast<float>(eye[0]), static_cast<float>(eye[1]),
                    static_cast<float>(eye[2])};
  const auto places = sample_places(samples);
  const auto pixel = static_cast<float>(1 / camera.fx);
  const float footprint = pixel / std::sqrt(static_cast<float>(samples)) * 1.2f;
  const int64_t plane = camera.width * camera.height;
  at::parallel_for(0, camera.height, 4, [&](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      for (int64_t column = 0; column < camera.width; ++column) {
        Rgb sum;
        float nearest = kNoDepth;
        for (const auto& place : places) {
          const auto d = geometry::unproject(camera, static_cast<double>(column) + place[0],
                                             static_cast<double>(row) + place[1]);
          const Vec3 direction{static_cast<float>(r[0] * d[0] + r[3] * d[1] + r[6]),
                               static_cast<float>(r[1] * d[0] + r[4] * d[1] + r[7]),
                               static_cast<float>(r[2] * d[0] + r[5] * d[1] + r[8])};
          const Ray ray{origin, direction};
          Hit hit{kNoDepth};
          cast(world_, ray, pixel, hit);
          sum = sum + shade(world_, hit, ray, footprint * hit.t);
          nearest = std::min(nearest, hit.t);
        }
        sum = sum * (1.0f / static_cast<float>(samples));
        const auto at = static_cast<size_t>(row * camera.width + column);
        frame.rgb[at] = sum.r;
        frame.rgb[at + static_cast<size_t>(plane)] = sum.g;
        frame.rgb[at + 2 * static_cast<size_t>(plane)] = sum.b;
        frame.depth[at] = nearest;
      }
    }
  });
}

}  // namespace jade::world
