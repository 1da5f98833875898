// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/world/bvh.h"
#include "jade/world/texture.h"

namespace jade::world {

struct Material {
  Texture texture;
  bool cutout = false;  ///< transparent where the texture's opacity is below a half
  float emission = 0;   ///< emitted light: colour times this, added to the reflected light
};

/// A round lamp, or the sun if `distant`: `position` is then the direction towards it.
struct Light {
  Vec3 position;
  Rgb color;  ///< light on a surface facing it at distance 1 (distant: at any distance)
  float radius = 0.1f;
  bool distant = false;
};

/// Light on one surface, sampled on a grid over its (u,v).
struct LightMap {
  int width = 1, height = 1;
  bool wrap_u = false;  ///< tubes and ellipsoids wrap around
  std::vector<Rgb> texels;

  Rgb sample(float u, float v) const;
};

/// Range of camera positions in front of a scene; simulate/camera_path.h generates the path.
struct CameraRig {
  Vec3 eye{0, 1.2f, 3}, target{0, 0.9f, 0};  ///< means
  Vec3 eye_reach{0.5f, 0.3f, 0.3f};          ///< largest amplitudes, world units
  Vec3 target_reach{0.35f, 0.25f, 0.1f};
  Vec3 up{0, 1, 0};
};

/// A static room, street or garden with baked light.
struct World {
  std::string name;
  std::vector<Material> materials;
  std::vector<Primitive> primitives;
  std::vector<LightMap> light_maps;  ///< one per primitive
  std::vector<Light> lights;
  Rgb ambient_up{0.55f, 0.57f, 0.6f}, ambient_down{0.3f, 0.28f, 0.26f};
  Rgb background{0.5f, 0.5f, 0.5f};
  float exposure = 1.35f;  ///< multiplies all light
  CameraRig rig;
  Bvh bvh;
};

/// Finds the nearest visible surface along the ray, passing transparent parts. hit.primitive is -1
/// if there is none before hit.t.
/// @param pixel_angle  width of a pixel at unit depth, for sampling transparent textures
void cast(const World& scene, const Ray& ray, float pixel_angle, Hit& hit);

/// Colour seen at a hit. @param footprint world width of the pixel there
Rgb shade(const World& scene, const Hit& hit, const Ray& ray, float footprint);

/// Computes the light maps: ambient light with occlusion, and soft shadows of every light.
/// Multithreaded; deterministic for any number of threads.
void bake_light(World& scene, uint64_t seed);

}  // namespace jade::world
