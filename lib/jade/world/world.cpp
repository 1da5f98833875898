// SPDX-License-Identifier: Apache-2.0
#include "jade/world/world.h"

#include <algorithm>
#include <cmath>

namespace jade::world {
namespace {

// Compresses values above 0.75 so that bright spots keep their detail instead of clipping.
float shoulder(float v) {
  constexpr float kKnee = 0.75f;
  if (v <= kKnee) return v;
  const float x = (v - kKnee) / (1 - kKnee);
  return kKnee + (1 - kKnee) * x / (1 + x);
}

}  // namespace

Rgb LightMap::sample(float u, float v) const {
  const float x = u * static_cast<float>(width) - 0.5f, y = v * static_cast<float>(height) - 0.5f;
  const int ix = floor_int(x), iy = floor_int(y);
  const auto column = [&](int i) {
    return wrap_u ? (i + width) % width : std::clamp(i, 0, width - 1);
  };
  const auto row = [&](int j) { return std::clamp(j, 0, height - 1); };
  const int x0 = column(ix), x1 = column(ix + 1);
  const int y0 = row(iy), y1 = row(iy + 1);
  const auto at = [&](int i, int j) { return texels[static_cast<size_t>(j * width + i)]; };
  return mix(mix(at(x0, y0), at(x1, y0), x - static_cast<float>(ix)),
             mix(at(x0, y1), at(x1, y1), x - static_cast<float>(ix)), y - static_cast<float>(iy));
}

void cast(const World& scene, const Ray& ray, float pixel_angle, Hit& hit) {
  scene.bvh.walk(ray, hit, [&](int index, Hit& best) {
    const Primitive& p = scene.primitives[static_cast<size_t>(index)];
    Hit candidate = best;
    if (!intersect(p, ray, candidate)) return;
    if (p.cutout) {
      const Texture& texture = scene.materials[static_cast<size_t>(p.material)].texture;
      const float footprint = candidate.t * pixel_angle * 0.5f * p.repeat_u / p.texture_width;
      if (texture.opacity(candidate.u * p.repeat_u, candidate.v * p.repeat_v, footprint) < 0.5f) {
        return;
      }
    }
    candidate.primitive = index;
    best = candidate;
  });
}

Rgb shade(const World& scene, const Hit& hit, const Ray& ray, float footprint) {
  if (hit.primitive < 0) return scene.background;
  const Primitive& p = scene.primitives[static_cast<size_t>(hit.primitive)];
  const Material& material = scene.materials[static_cast<size_t>(p.material)];
  float slant = 1;
  if (p.shape == Shape::kQuad || p.shape == Shape::kDisc) {
    const float cosine = std::abs(dot(p.normal, ray.direction)) / length(ray.direction);
    slant = 1 / std::sqrt(std::max(cosine, 0.1f));
  }
  const float scale = footprint * slant * p.repeat_u / p.texture_width;
  const Rgb albedo = material.texture.sample(hit.u * p.repeat_u, hit.v * p.repeat_v, scale);
  const Rgb light = scene.light_maps[static_cast<size_t>(hit.primitive)].sample(hit.u, hit.v);
  const Rgb seen = albedo * (light + Rgb{material.emission, material.emission, material.emission});
  return {shoulder(seen.r), shoulder(seen.g), shoulder(seen.b)};
}

}  // namespace jade::world
