// SPDX-License-Identifier: Apache-2.0
// Random numbers that are identical on every machine and for any number of threads.
#pragma once

#include <cstdint>

namespace jade::world {

/// Mixes all 64 bits of `v`; the step of a counter-based generator (splitmix64 finaliser).
inline uint64_t mix_bits(uint64_t v) {
  v += 0x9E3779B97F4A7C15ull;
  v = (v ^ (v >> 30)) * 0xBF58476D1CE4E5B9ull;
  v = (v ^ (v >> 27)) * 0x94D049BB133111EBull;
  return v ^ (v >> 31);
}

/// A small generator with one 64-bit word of state: cheap enough to keep one per pixel.
class Draw {
 public:
  explicit Draw(uint64_t seed, uint64_t stream = 0)
      : state_(mix_bits(seed) ^ mix_bits(~stream * 0xD1B54A32D192ED03ull)) {}

  uint64_t bits() { return mix_bits(state_ += 0x9E3779B97F4A7C15ull); }
  /// Uniform in [0,1).
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }
  float range(float low, float high) { return low + (high - low) * static_cast<float>(uniform()); }
  /// Uniform in {0, …, n-1}.
  int pick(int n) { return static_cast<int>(uniform() * n); }
  /// Standard normal (Box-Muller).
  double normal();
  /// Exponential with mean 1.
  double exponential();
  /// Poisson with the given mean; a rounded normal above 50.
  double poisson(double mean);

 private:
  uint64_t state_;
};

/// Smooth noise in [0,1] on the integer lattice, periodic after `period` cells (0: not periodic).
float value_noise(float x, float y, uint32_t seed, int period = 0);

/// Sum of `octaves` of value noise, each half as strong and twice as fine, scaled to [0,1].
float fractal_noise(float x, float y, uint32_t seed, int octaves, int period = 0);

}  // namespace jade::world
