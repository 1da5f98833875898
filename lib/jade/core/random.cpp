// SPDX-License-Identifier: Apache-2.0
#include "jade/core/random.h"

#include <ATen/CPUGeneratorImpl.h>
#include <mutex>

#include "jade/core/check.h"

namespace jade {
namespace {

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014) decorrelates neighbouring seeds.
uint64_t mix(uint64_t x) {
  x += 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

}  // namespace

uint64_t derive_seed(uint64_t seed, const std::string& purpose) {
  uint64_t hash = mix(seed);
  for (const char c : purpose) hash = mix(hash ^ static_cast<unsigned char>(c));
  return hash;
}

at::Generator make_generator(uint64_t seed, const std::string& purpose) {
  return at::detail::createCPUGenerator(derive_seed(seed, purpose));
}

uint64_t draw_bits(at::Generator& generator) {
  auto* implementation = at::check_generator<at::CPUGeneratorImpl>(generator);
  const std::lock_guard<std::mutex> lock(generator.mutex());
  return implementation->random64();
}

int64_t draw_index(at::Generator& generator, int64_t bound) {
  JADE_CHECK(bound > 0, "draw_index: expected a positive bound, found ", bound);
  // 64 random bits against a bound far below 2^32: the modulo's bias is below 2^-32.
  return static_cast<int64_t>(draw_bits(generator) % static_cast<uint64_t>(bound));
}

}  // namespace jade
