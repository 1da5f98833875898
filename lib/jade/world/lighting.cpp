// SPDX-License-Identifier: Apache-2.0
#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/world/noise.h"
#include "jade/world/world.h"

namespace jade::world {
namespace {

constexpr float kTexel = 0.06f;  // world width of a light map texel
constexpr int kLongest = 48;     // texels along an edge
constexpr int kAmbientRays = 28;
constexpr int kShadowRays = 8;
constexpr float kAmbientReach = 1.2f;  // occluders farther away are ignored

int texels_along(float length) {
  return std::clamp(static_cast<int>(std::ceil(length / kTexel)), 2, kLongest);
}

LightMap layout(const Primitive& p) {
  LightMap map;
  if (p.shape == Shape::kTube) {
    map.width = 8, map.height = texels_along(p.height), map.wrap_u = true;
  } else if (p.shape == Shape::kEllipsoid) {
    map.width = 14, map.height = 8, map.wrap_u = true;
  } else {
    map.width = texels_along(length(p.b)), map.height = texels_along(length(p.c));
  }
  map.texels.resize(static_cast<size_t>(map.width * map.height));
  return map;
}

bool blocked(const World& scene, Vec3 from, Vec3 direction, float reach) {
  Hit hit{reach};
  cast(scene, {from, direction}, 0.01f, hit);
  return hit.primitive >= 0 &&
         scene.materials[static_cast<size_t>(
                             scene.primitives[static_cast<size_t>(hit.primitive)].material)]
                 .emission == 0;
}

Vec3 around(Vec3 axis, float cosine, float angle) {
  const Vec3 s = perpendicular(axis), t = cross(axis, s);
  const float sine = std::sqrt(std::max(0.0f, 1 - cosine * cosine));
  return axis * cosine + s * (sine * std::cos(angle)) + t * (sine * std::sin(angle));
}

Rgb ambient(const World& scene, const SurfacePoint& at, Draw& draw) {
  Rgb sum;
  for (int i = 0; i < kAmbientRays; ++i) {
    const float cosine = std::sqrt((static_cast<float>(i) + 0.5f) / kAmbientRays);
    const Vec3 out = around(at.normal, cosine, draw.range(0, 6.2831853f));
    if (!blocked(scene, at.position, out, kAmbientReach)) {
      sum = sum + mix(scene.ambient_down, scene.ambient_up, 0.5f + 0.5f * out.y);
    }
  }
  // Blocked directions are not black: the occluders reflect some light.
  const Rgb bounce = mix(scene.ambient_down, scene.ambient_up, 0.5f) * 0.22f;
  return sum * (1.0f / kAmbientRays) + bounce;
}

Rgb direct(const World& scene, const Light& light, const SurfacePoint& at, Draw& draw) {
  Rgb sum;
  for (int i = 0; i < kShadowRays; ++i) {
    Vec3 to = light.distant ? light.position * 20.0f : light.position - at.position;
    const float spread = light.distant ? 20 * light.radius : light.radius;
    const Vec3 jitter{draw.range(-spread, spread), draw.range(-spread, spread),
                      draw.range(-spread, spread)};
    to = to + jitter;
    const float distance = length(to);
    const Vec3 out = to * (1 / distance);
    const float facing = dot(out, at.normal);
    if (facing <= 0 || blocked(scene, at.position, out, distance)) continue;
    const float falloff = light.distant ? 1 : 1 / (0.05f + distance * distance);
    sum = sum + light.color * (facing * falloff);
  }
  return sum * (1.0f / kShadowRays);
}

void bake_one(World& scene, size_t index, uint64_t seed) {
  const Primitive& p = scene.primitives[index];
  LightMap& map = scene.light_maps[index];
  Draw draw(seed, index);
  for (int j = 0; j < map.height; ++j) {
    for (int i = 0; i < map.width; ++i) {
      const float u = (static_cast<float>(i) + 0.5f) / static_cast<float>(map.width);
      const float v = (static_cast<float>(j) + 0.5f) / static_cast<float>(map.height);
      SurfacePoint at = surface_point(p, u, v);
      // Flat surfaces have two sides: use the one visible to the camera.
      if (p.shape <= Shape::kDisc && dot(at.normal, scene.rig.eye - at.position) < 0) {
        at.normal = -at.normal;
      }
      at.position = at.position + at.normal * 2e-3f;
      Rgb light = ambient(scene, at, draw);
      for (const Light& lamp : scene.lights) {
        light = light + direct(scene, lamp, at, draw);
      }
      map.texels[static_cast<size_t>(j * map.width + i)] = light * scene.exposure;
    }
  }
}

}  // namespace

void bake_light(World& scene, uint64_t seed) {
  scene.light_maps.clear();
  for (const Primitive& p : scene.primitives) {
    scene.light_maps.push_back(layout(p));
  }
  at::parallel_for(0, static_cast<int64_t>(scene.primitives.size()), 4,
                   [&](int64_t begin, int64_t end) {
                     for (int64_t i = begin; i < end; ++i) {
                       bake_one(scene, static_cast<size_t>(i), seed);
                     }
                   });
}

}  // namespace jade::world
