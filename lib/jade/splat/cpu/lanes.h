// SPDX-License-Identifier: Apache-2.0
// A pack's Gaussians: loads their parameters into lanes, and stores gradients.
#pragma once

#include <cstdint>
#include <cstring>
#include <type_traits>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/sh.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

namespace m = jade::splat::math;

template <class P, class T = typename P::Scalar>
JADE_HD m::Camera<P> load_camera(const RenderCall<T>& call, int view) {
  constexpr int kCount = sizeof(m::Camera<T>) / sizeof(T);
  const T* const values = call.cameras + view * kCount;
  P packs[kCount];
  for (int k = 0; k < kCount; ++k) packs[k] = P(values[k]);
  m::Camera<P> camera;
  static_assert(sizeof(camera) == sizeof(packs), "Camera holds values of its scalar type only");
  std::memcpy(&camera, packs, sizeof(packs));
  return camera;
}

/// Gathers kWidth values of each lane's Gaussian: lane l is Gaussian
/// first + min(l, last). Stores all scalars before it loads the first pack, because a load that
/// follows its scalar stores too closely stalls.
template <int kWidth, class P, class T = typename P::Scalar>
JADE_HD void load_lanes(const T* source, int64_t stride, int64_t first, int last, P* out) {
  const auto row = [&](int l) { return source + (first + (l < last ? l : last)) * stride; };
  if constexpr (m::kCanTranspose<P> && kWidth % P::kLanes == 0) {
    for (int column = 0; column < kWidth; column += P::kLanes) {
      P packs[P::kLanes];
      for (int l = 0; l < P::kLanes; ++l) packs[l] = P::load(row(l) + column);
      transpose(packs);
      for (int k = 0; k < P::kLanes; ++k) out[column + k] = packs[k];
    }
  } else {
    alignas(64) T buffer[kWidth][P::kLanes];
    for (int l = 0; l < P::kLanes; ++l) {
      for (int k = 0; k < kWidth; ++k) buffer[k][l] = row(l)[k];
    }
    for (int k = 0; k < kWidth; ++k) out[k] = P::load(buffer[k]);
  }
}

template <int kWidth, class P, class T = typename P::Scalar>
JADE_HD void store_lanes(T* target, int64_t stride, int64_t first, int lanes, const P* in) {
  const auto row = [&](int l) { return target + (first + l) * stride; };
  if constexpr (m::kCanTranspose<P> && kWidth % P::kLanes == 0) {
    for (int column = 0; column < kWidth; column += P::kLanes) {
      P packs[P::kLanes];
      for (int k = 0; k < P::kLanes; ++k) packs[k] = in[column + k];
      transpose(packs);
      for (int l = 0; l < lanes; ++l) packs[l].store(row(l) + column);
    }
  } else {
    alignas(64) T buffer[kWidth][P::kLanes];
    for (int k = 0; k < kWidth; ++k) in[k].store(buffer[k]);
    for (int l = 0; l < lanes; ++l) {
      for (int k = 0; k < kWidth; ++k) row(l)[k] = buffer[k][l];
    }
  }
}

/// Calls body with the number of coefficients (of three colours) as a compile-time constant.
template <class Body>
JADE_HD void with_coefficients(int degree, const Body& body) {
  switch (degree) {
    case m::kPlainColor:
    case 0:
      return body(std::integral_constant<int, 3>());
    case 1:
      return body(std::integral_constant<int, 12>());
    case 2:
      return body(std::integral_constant<int, 27>());
    default:
      return body(std::integral_constant<int, 48>());
  }
}

/// One Gaussian per lane of a pack, beginning with `first`.
template <class P>
struct LaneBlock {
  int64_t first;
  int lanes;  ///< number in use; the others repeat the last Gaussian
  m::RawShape<P> raw;
  P sh[48];
  typename P::Mask usable;
};

/// Loads the parameters of Gaussians first … end − 1, at most as many as lanes; unusable ones are
/// replaced by a unit Gaussian.
template <class P, class T = typename P::Scalar>
JADE_HD void load_block(const RenderCall<T>& call, int64_t first, int64_t end,
                        LaneBlock<P>* block) {
  block->first = first;
  block->lanes = static_cast<int>(end - first < P::kLanes ? end - first : P::kLanes);
  const int last = block->lanes - 1;
  m::RawShape<P>& raw = block->raw;
  load_lanes<3>(call.means, 3, first, last, raw.mean);
  load_lanes<4>(call.rotations, 4, first, last, raw.quaternion);
  load_lanes<3>(call.log_scales, 3, first, last, raw.log_scale);
  load_lanes<1>(call.logit_opacities, 1, first, last, &raw.logit_opacity);
  const int coefficients = 3 * m::sh_count(call.sh_degree);
  with_coefficients(call.sh_degree, [&](auto count) {
    load_lanes<decltype(count)::value>(call.sh, 3 * call.sh_stride, first, last, block->sh);
  });
  block->usable = m::is_usable(raw, call.activated) & m::all_finite(block->sh, coefficients);
  m::replace_unusable(block->usable, &raw);
  for (int k = 0; k < coefficients; ++k) block->sh[k] = keep(block->usable, block->sh[k]);
}

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
