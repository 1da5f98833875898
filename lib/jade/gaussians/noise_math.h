// SPDX-License-Identifier: Apache-2.0
// One Gaussian's exploration noise (Eq. 8 of 3DGS-MCMC, Kheradmand et al., NeurIPS 2024), from a
// counter-based generator (Philox4x32-10, Salmon et al., SC 2011): any number of threads sample the
// same numbers on either device, up to the rounding of log, sine and cosine.
#pragma once

#include "jade/gaussians/noise.h"
#include "jade/kernel/host_device.h"

namespace jade::gaussians {

struct Philox {
  uint32_t word[4];
};

/// Four words of random bits per pair of key and counter.
JADE_HD Philox philox(uint64_t key, uint64_t counter) {
  uint32_t k0 = static_cast<uint32_t>(key), k1 = static_cast<uint32_t>(key >> 32);
  uint32_t c0 = static_cast<uint32_t>(counter), c1 = static_cast<uint32_t>(counter >> 32);
  uint32_t c2 = 0, c3 = 0;
  for (int round = 0; round < 10; ++round) {
    const uint64_t a = uint64_t{0xD2511F53} * c0, b = uint64_t{0xCD9E8D57} * c2;
    c0 = static_cast<uint32_t>(b >> 32) ^ c1 ^ k0;
    c2 = static_cast<uint32_t>(a >> 32) ^ c3 ^ k1;
    c1 = static_cast<uint32_t>(b);
    c3 = static_cast<uint32_t>(a);
    k0 += 0x9E3779B9u;
    k1 += 0xBB67AE85u;
  }
  return {{c0, c1, c2, c3}};
}

/// Maps bits to (0,1): the upper 24 bits plus half a step.
JADE_HD float unit_interval(uint32_t bits) {
  return (static_cast<float>(bits >> 8) + 0.5f) * (1.0f / 16777216.0f);
}

/// Two independent normal numbers (Box and Muller, 1958).
JADE_HD void normal_pair(uint32_t radius_bits, uint32_t angle_bits, float* a, float* b) {
  constexpr float kTwoPi = 6.28318530718f;
  // −2 ln u = −2 ln 2 log2 u.
  const float radius = kernel::sqrt(-1.38629436112f * kernel::log2(unit_interval(radius_bits)));
  const float angle = kTwoPi * unit_interval(angle_bits);
  *a = radius * kernel::cos(angle);
  *b = radius * kernel::sin(angle);
}

/// Rows of the rotation matrix of a quaternion wxyz of any norm; the identity for zero.
JADE_HD void rotation_matrix(const float* q, float r[3][3]) {
  const float squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  const float s = squared > 1e-24f ? 2 / squared : 0.0f;
  const float w = q[0], x = q[1], y = q[2], z = q[3];
  r[0][0] = 1 - s * (y * y + z * z);
  r[0][1] = s * (x * y - w * z);
  r[0][2] = s * (x * z + w * y);
  r[1][0] = s * (x * y + w * z);
  r[1][1] = 1 - s * (x * x + z * z);
  r[1][2] = s * (y * z - w * x);
  r[2][0] = s * (x * z - w * y);
  r[2][1] = s * (y * z + w * x);
  r[2][2] = 1 - s * (x * x + y * y);
}

/// 1 / (1 + exp(100 (o − 0.005))): faint Gaussians explore, opaque ones stay.
JADE_HD float noise_damping(float logit_opacity) {
  const float opacity = 1 / (1 + kernel::exp(-logit_opacity));
  return 1 / (1 + kernel::exp(100 * (opacity - 0.005f)));
}

/// Adds damped and scaled Σ ε = R S² Rᵀ ε to the mean of `row`, unless it is not finite.
JADE_HD void add_noise_to(const NoiseStep& step, int64_t row) {
  const Philox bits = philox(step.seed, static_cast<uint64_t>(row));
  float normal[4];
  normal_pair(bits.word[0], bits.word[1], &normal[0], &normal[1]);
  normal_pair(bits.word[2], bits.word[3], &normal[2], &normal[3]);
  float r[3][3];
  rotation_matrix(step.rotations + 4 * row, r);
  float local[3];
  for (int j = 0; j < 3; ++j) {
    const float scale = kernel::exp(step.log_scales[3 * row + j]);
    local[j] = scale * scale * (r[0][j] * normal[0] + r[1][j] * normal[1] + r[2][j] * normal[2]);
  }
  const float gain = step.scale * noise_damping(step.logit_opacities[row]);
  for (int i = 0; i < 3; ++i) {
    const float offset = gain * (r[i][0] * local[0] + r[i][1] * local[1] + r[i][2] * local[2]);
    if (kernel::within(offset, 3e38f)) step.means[3 * row + i] += offset;
  }
}

}  // namespace jade::gaussians
