// SPDX-License-Identifier: Apache-2.0
#include "jade/world/noise.h"

#include <algorithm>
#include <cmath>

namespace jade::world {
namespace {

float lattice(int x, int y, uint32_t seed, int period) {
  if (period > 0) {
    x = ((x % period) + period) % period;
    y = ((y % period) + period) % period;
  }
  uint32_t h = seed * 0x27D4EB2Fu ^ static_cast<uint32_t>(x) * 0x85EBCA6Bu;
  h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
  h ^= static_cast<uint32_t>(y) * 0xC2B2AE35u;
  h = (h ^ (h >> 13)) * 0x297A2D39u;
  return static_cast<float>((h ^ (h >> 16)) >> 8) * 0x1.0p-24f;
}

float smooth(float t) { return t * t * (3 - 2 * t); }

}  // namespace

double Draw::normal() {
  const double radius = std::sqrt(-2 * std::log(1 - uniform()));
  return radius * std::cos(6.283185307179586 * uniform());
}

double Draw::exponential() { return -std::log(1 - uniform()); }

double Draw::poisson(double mean) {
  if (mean > 50) {
    return std::max(0.0, std::round(mean + std::sqrt(mean) * normal()));
  }
  const double limit = std::exp(-mean);
  double product = uniform();
  int count = 0;
  while (product > limit) {
    product *= uniform();
    ++count;
  }
  return count;
}

float value_noise(float x, float y, uint32_t seed, int period) {
  const float fx = std::floor(x), fy = std::floor(y);
  const int ix = static_cast<int>(fx), iy = static_cast<int>(fy);
  const float sx = smooth(x - fx), sy = smooth(y - fy);
  const float top =
      lattice(ix, iy, seed, period) * (1 - sx) + lattice(ix + 1, iy, seed, period) * sx;
  const float bottom =
      lattice(ix, iy + 1, seed, period) * (1 - sx) + lattice(ix + 1, iy + 1, seed, period) * sx;
  return top * (1 - sy) + bottom * sy;
}

float fractal_noise(float x, float y, uint32_t seed, int octaves, int period) {
  float sum = 0, weight = 0.5f, total = 0;
  for (int i = 0; i < octaves; ++i) {
    sum += weight * value_noise(x, y, seed + static_cast<uint32_t>(i) * 101u, period);
    total += weight;
    x *= 2, y *= 2, period *= 2, weight *= 0.5f;
  }
  return sum / total;
}

}  // namespace jade::world
