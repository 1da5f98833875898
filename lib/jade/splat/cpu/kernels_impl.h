// SPDX-License-Identifier: Apache-2.0
// The bodies of the CPU kernels, compiled once per instruction set by jade_add_isa_sources().
#pragma once

#include <cstdint>
#include <cstring>
#include <type_traits>

#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/pack.h"
#include "jade/splat/math/blend.h"
#include "jade/splat/math/projection.h"
#include "jade/splat/math/sh.h"
#include "jade/splat/math/tile.h"

namespace jade::splat::cpu {
namespace JADE_ISA {

namespace m = jade::splat::math;

constexpr double kMaxColor = 1e30;  ///< a brighter splat is culled

// ---- projection -------------------------------------------------------------------------------

template <class P, class T = typename P::Scalar>
JADE_HD m::Camera<P> load_camera(const T* values) {
  constexpr int kCount = sizeof(m::Camera<T>) / sizeof(T);
  P packs[kCount];
  for (int k = 0; k < kCount; ++k) packs[k] = P(values[k]);
  m::Camera<P> camera;
  static_assert(sizeof(camera) == sizeof(packs), "Camera holds values of its scalar type only");
  std::memcpy(&camera, packs, sizeof(packs));
  return camera;
}

/// Gathers kWidth values of each of the lanes' Gaussians: lane l is Gaussian
/// first + min(l, last). All scalars are stored before the first pack is read, as a pack cannot be
/// read while its scalars are still on their way to the cache.
template <int kWidth, class P, class T = typename P::Scalar>
JADE_HD void load_lanes(const T* source, int64_t stride, int64_t first, int last, P* out) {
  alignas(64) T buffer[kWidth][P::kLanes];
  for (int l = 0; l < P::kLanes; ++l) {
    const T* const row = source + (first + (l < last ? l : last)) * stride;
    for (int k = 0; k < kWidth; ++k) buffer[k][l] = row[k];
  }
  for (int k = 0; k < kWidth; ++k) out[k] = P::load(buffer[k]);
}

template <int kWidth, class P, class T = typename P::Scalar>
JADE_HD void store_lanes(T* target, int64_t stride, int64_t first, int lanes, const P* in) {
  alignas(64) T buffer[kWidth][P::kLanes];
  for (int k = 0; k < kWidth; ++k) in[k].store(buffer[k]);
  for (int l = 0; l < lanes; ++l) {
    T* const row = target + (first + l) * stride;
    for (int k = 0; k < kWidth; ++k) row[k] = buffer[k][l];
  }
}

/// Calls body with the number of coefficients (three colours) as a compile-time constant.
template <class Body>
JADE_HD void with_coefficients(int degree, const Body& body) {
  switch (degree) {
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

template <class P>
struct LaneBlock {
  m::RawShape<P> raw;
  P sh[48];
  typename P::Mask usable;
};

/// Loads the parameters of up to kLanes Gaussians; unusable ones become a harmless unit Gaussian.
template <class P, class T = typename P::Scalar>
JADE_HD void load_block(const Scene<T>& scene, int64_t first, int last, LaneBlock<P>* block) {
  m::RawShape<P>& raw = block->raw;
  load_lanes<3>(scene.means, 3, first, last, raw.mean);
  load_lanes<4>(scene.rotations, 4, first, last, raw.quaternion);
  load_lanes<3>(scene.log_scales, 3, first, last, raw.log_scale);
  load_lanes<1>(scene.logit_opacities, 1, first, last, &raw.logit_opacity);
  const int coefficients = 3 * m::sh_count(scene.sh_degree);
  with_coefficients(scene.sh_degree, [&](auto count) {
    load_lanes<decltype(count)::value>(scene.sh, 3 * scene.sh_stride, first, last, block->sh);
  });
  P zero(0), poison(0);  // stays 0 unless a coefficient is not finite
  for (int k = 0; k < coefficients; ++k) poison = poison + block->sh[k] * zero;
  block->usable = m::is_usable(raw) & m::within(poison, zero);
  const auto usable = block->usable;
  for (int k = 0; k < 3; ++k) {
    raw.mean[k] = keep(usable, raw.mean[k]);
    raw.log_scale[k] = keep(usable, raw.log_scale[k]);
  }
  for (int k = 0; k < 4; ++k) raw.quaternion[k] = select(usable, raw.quaternion[k], P(k == 0));
  raw.logit_opacity = keep(usable, raw.logit_opacity);
  for (int k = 0; k < coefficients; ++k) block->sh[k] = keep(usable, block->sh[k]);
}

/// floor(value) + 1 for value ≥ −1, at least 0 and at most `limit`.
template <class T>
JADE_HD int16_t count_up_to(T value, int limit) {
  if (!(value >= T(0))) return 0;
  if (value >= T(limit)) return static_cast<int16_t>(limit);
  return static_cast<int16_t>(static_cast<int>(value) + 1);
}

template <class P, class T = typename P::Scalar>
int64_t project(const Scene<T>& scene, int64_t begin, int64_t end, Splat<T>* splats) {
  constexpr int kLanes = P::kLanes;
  constexpr int kValues = 13, kBox = 4;
  int64_t unusable = 0;
  LaneBlock<P> block;
  for (int64_t first = begin; first < end; first += kLanes) {
    const int lanes = static_cast<int>(end - first < kLanes ? end - first : kLanes);
    load_block(scene, first, lanes - 1, &block);
    const uint32_t all = lanes == 32 ? ~0u : (1u << lanes) - 1;
    unusable += __builtin_popcount(all & ~m::bits(block.usable));
    const m::Shape<P> shape = m::activate(block.raw);
    const P shared_log2 = log2(shape.opacity);
    for (int view = 0; view < scene.views; ++view) {
      constexpr int kCameraSize = sizeof(m::Camera<T>) / sizeof(T);
      const m::Camera<P> camera = load_camera<P>(scene.cameras + view * kCameraSize);
      const m::Screen<P> screen = m::project(shape, camera, scene.antialiased);
      auto visible = block.usable & m::is_drawable(screen, P(scene.near_plane));
      Splat<T>* const out = splats + view * scene.count + first;
      if (m::bits(visible) == 0) {
        for (int l = 0; l < lanes; ++l) out[l] = Splat<T>{};
        continue;
      }
      P direction[3], basis[16], color[3];
      m::view_direction(shape.mean, camera, direction);
      m::sh_basis(scene.sh_degree, direction, basis);
      m::sh_color(scene.sh_degree, basis, block.sh, color);
      for (int c = 0; c < 3; ++c) visible = visible & m::within(color[c], P(kMaxColor));
      const P log2_opacity = scene.antialiased ? log2(screen.opacity) : shared_log2;
      const P reach = m::reach(log2_opacity);
      visible = visible & (reach > P(0));
      P half_x, half_y;
      m::half_extents(reach, screen.cov_xx, screen.cov_yy, &half_x, &half_y);
      const auto falloff = m::make_falloff(screen.cov_xx, screen.cov_xy, screen.cov_yy, screen.det);
      const auto row = m::make_row_extent(reach, screen.cov_xy, screen.cov_yy, screen.det);
      const P half(T(0.5));
      const P values[kValues + kBox] = {screen.x, screen.y, falloff.a, falloff.b, falloff.c,
                                        log2_opacity, color[0], color[1], color[2], screen.depth,
                                        row.slope, row.width2, row.shrink,
                                        // A pixel i is reached where i + ½ is within the extent.
                                        screen.x - half_x - half, screen.x + half_x - half,
                                        screen.y - half_y - half, screen.y + half_y - half};
      alignas(64) T lane_values[kValues + kBox][kLanes];
      for (int k = 0; k < kValues + kBox; ++k) values[k].store(lane_values[k]);
      const uint32_t visible_bits = m::bits(visible);
      for (int l = 0; l < lanes; ++l) {
        Splat<T> splat{};
        if (visible_bits >> l & 1) {
          T copy[kValues];
          for (int k = 0; k < kValues; ++k) copy[k] = lane_values[k][l];
          std::memcpy(&splat, copy, sizeof(copy));
          const T* const box = &lane_values[kValues][l];
          splat.x0 = count_up_to(box[0], scene.width);
          splat.x1 = count_up_to(box[kLanes], scene.width);
          splat.y0 = count_up_to(box[2 * kLanes], scene.height);
          splat.y1 = count_up_to(box[3 * kLanes], scene.height);
          if (splat.x0 >= splat.x1 || splat.y0 >= splat.y1) splat = Splat<T>{};
        }
        out[l] = splat;
      }
    }
  }
  return unusable;
}

JADE_HD int tiles_across(int begin, int end, int tile_shift) {
  return ((end - 1) >> tile_shift) - (begin >> tile_shift) + 1;
}

template <class P, class T = typename P::Scalar>
void project_adjoint(const Scene<T>& scene, int64_t begin, int64_t end, const Splat<T>* splats,
                     int tile_shift, const T* instances, const int64_t* view_offsets,
                     const Gradients<T>& gradients, T* grad_cameras) {
  constexpr int kLanes = P::kLanes;
  const int values = instance_values(scene.depth);
  const int coefficients = 3 * m::sh_count(scene.sh_degree);
  LaneBlock<P> block;
  for (int64_t first = begin; first < end; first += kLanes) {
    const int lanes = static_cast<int>(end - first < kLanes ? end - first : kLanes);
    load_block(scene, first, lanes - 1, &block);
    const m::Shape<P> shape = m::activate(block.raw);
    P grad_mean[3], grad_axes[9], grad_log_opacity(0), grad_sh[48];
    for (P& g : grad_mean) g = P(0);
    for (P& g : grad_axes) g = P(0);
    for (P& g : grad_sh) g = P(0);
    P norm_sum(0), visible_sum(0), radius_max(0);
    for (int view = 0; view < scene.views; ++view) {
      const Splat<T>* const seen = splats + view * scene.count + first;
      alignas(64) T sums[kInstanceValues + 1][kLanes] = {};
      alignas(64) T splat_values[6][kLanes] = {};  // a, b, c, colour
      alignas(64) T shown[kLanes] = {};
      bool any = false;
      for (int l = 0; l < lanes; ++l) {
        const Splat<T>& splat = seen[l];
        if (splat.x0 >= splat.x1) continue;
        any = true;
        shown[l] = 1;
        splat_values[0][l] = splat.a;
        splat_values[1][l] = splat.b;
        splat_values[2][l] = splat.c;
        for (int c = 0; c < 3; ++c) splat_values[3 + c][l] = splat.color[c];
        const int count = tiles_across(splat.x0, splat.x1, tile_shift) *
                          tiles_across(splat.y0, splat.y1, tile_shift);
        const T* source = instances + (view_offsets[view] + splat.slot) * values;
        T total[kInstanceValues + 1] = {};
        for (int i = 0; i < count; ++i, source += values) {
          for (int k = 0; k < kInstanceValues; ++k) total[k] += source[k];
          if (scene.depth) total[kInstanceValues] += source[kInstanceValues];
        }
        for (int k = 0; k <= kInstanceValues; ++k) sums[k][l] = total[k];
      }
      if (!any) continue;
      constexpr int kCameraSize = sizeof(m::Camera<T>) / sizeof(T);
      const m::Camera<P> camera = load_camera<P>(scene.cameras + view * kCameraSize);
      const auto visible = P::load(shown) > P(0);
      const m::Falloff<P> falloff{P::load(splat_values[0]), P::load(splat_values[1]),
                                  P::load(splat_values[2])};
      const m::Moments<P> moments{P::load(sums[0]), P::load(sums[1]), P::load(sums[2]),
                                  P::load(sums[3]), P::load(sums[4]), P::load(sums[5])};
      m::ScreenGradient<P> on_screen;
      m::falloff_adjoint(falloff, moments, &on_screen.x, &on_screen.y, &on_screen.cov_xx,
                         &on_screen.cov_xy, &on_screen.cov_yy);
      on_screen.log_opacity = moments.u;
      on_screen.depth = P::load(sums[kInstanceValues]);
      P mean[3], axes[9];
      m::CameraGradient<P> on_camera;
      for (P& g : mean) g = P(0);
      for (P& g : axes) g = P(0);
      for (P& g : on_camera.rotation) g = P(0);
      for (P& g : on_camera.translation) g = P(0);
      const P log_opacity =
          m::project_adjoint(shape, camera, scene.antialiased, on_screen, mean, axes, &on_camera);

      P direction[3], basis[16], grad_basis[16], grad_direction[3];
      const P inverse_norm = m::view_direction(shape.mean, camera, direction);
      m::sh_basis(scene.sh_degree, direction, basis);
      const P color[3] = {P::load(splat_values[3]), P::load(splat_values[4]),
                          P::load(splat_values[5])};
      const P grad_color[3] = {P::load(sums[6]), P::load(sums[7]), P::load(sums[8])};
      // Directions of invisible lanes may be undefined; their colour gradients are 0.
      for (P& b : basis) b = keep(visible, b);
      m::sh_color_adjoint(scene.sh_degree, basis, block.sh, color, grad_color, grad_sh, grad_basis);
      for (P& g : grad_direction) g = P(0);
      m::sh_basis_adjoint(scene.sh_degree, direction, grad_basis, grad_direction);
      m::view_direction_adjoint(direction, inverse_norm, grad_direction, camera, mean, &on_camera);

      for (int k = 0; k < 3; ++k) grad_mean[k] = grad_mean[k] + keep(visible, mean[k]);
      for (int k = 0; k < 9; ++k) grad_axes[k] = grad_axes[k] + keep(visible, axes[k]);
      grad_log_opacity = grad_log_opacity + keep(visible, log_opacity);
      T* const camera_sums = grad_cameras + static_cast<int64_t>(view) * kCameraValues * kMaxLanes;
      for (int k = 0; k < kCameraValues; ++k) {
        const P g = k < 9 ? on_camera.rotation[k] : on_camera.translation[k - 9];
        T* const target = camera_sums + k * kMaxLanes;
        (P::load(target) + keep(visible, g)).store(target);
      }
      if (gradients.gradient_norm != nullptr &&
          (gradients.statistics_view < 0 || gradients.statistics_view == view)) {
        const P gx = on_screen.x * P(T(0.5) * scene.width);
        const P gy = on_screen.y * P(T(0.5) * scene.height);
        const m::Screen<P> screen = m::project(shape, camera, false);
        const P radius = m::screen_radius(screen.cov_xx, screen.cov_yy, screen.det);
        norm_sum = norm_sum + keep(visible, sqrt(gx * gx + gy * gy));
        visible_sum = visible_sum + keep(visible, P(1));
        radius_max = max(radius_max, keep(visible, radius));
      }
    }
    const m::RawShape<P> grad =
        m::activate_adjoint(block.raw, shape, grad_mean, grad_axes, grad_log_opacity);
    store_lanes<3>(gradients.means, 3, first, lanes, grad.mean);
    store_lanes<4>(gradients.rotations, 4, first, lanes, grad.quaternion);
    store_lanes<3>(gradients.log_scales, 3, first, lanes, grad.log_scale);
    store_lanes<1>(gradients.logit_opacities, 1, first, lanes, &grad.logit_opacity);
    with_coefficients(scene.sh_degree, [&](auto count) {
      store_lanes<decltype(count)::value>(gradients.sh, 3 * scene.sh_stride, first, lanes, grad_sh);
    });
    for (int l = 0; l < lanes; ++l) {
      T* const rest = gradients.sh + (first + l) * 3 * scene.sh_stride;
      for (int k = coefficients; k < 3 * scene.sh_stride; ++k) rest[k] = 0;
    }
    if (gradients.gradient_norm != nullptr) {
      alignas(64) T norm[kLanes], seen[kLanes], radius[kLanes];
      norm_sum.store(norm);
      visible_sum.store(seen);
      radius_max.store(radius);
      for (int l = 0; l < lanes; ++l) {
        gradients.gradient_norm[first + l] += static_cast<float>(norm[l]);
        gradients.visible_count[first + l] += static_cast<float>(seen[l]);
        float& largest = gradients.max_radius_px[first + l];
        if (static_cast<float>(radius[l]) > largest) largest = static_cast<float>(radius[l]);
      }
    }
  }
}

// ---- blending ---------------------------------------------------------------------------------

/// What both blending passes keep about a tile. Pixels are in rows of kStride values; those beyond
/// the tile, where a pack may reach, count as stopped.
template <class P>
struct TileState {
  using T = typename P::Scalar;
  static constexpr int kStride = kMaxTile + P::kLanes;
  static constexpr int kSize = kMaxTile * kStride;

  alignas(64) T transmittance[kSize];  ///< negative once a pixel has stopped
  alignas(64) T center_x[kStride];     ///< of each column, px
  uint32_t live[kMaxTile];             ///< by row, one bit a pixel that has not stopped

  JADE_HD void reset(const Tile<T>& tile) {
    for (int i = 0; i < tile.height * kStride; ++i) transmittance[i] = T(-1);
    std::memset(live, 0, sizeof(live));
    for (int y = 0; y < tile.height; ++y) {
      for (int x = 0; x < tile.width; ++x) transmittance[y * kStride + x] = T(1);
      live[y] = tile.width == 32 ? ~0u : (1u << tile.width) - 1;
    }
    for (int x = 0; x < kStride; ++x) center_x[x] = T(tile.x0 + x) + T(0.5);
  }

  /// Takes out the stopped pixels, whose bits begin at column x. No branch: it would be
  /// mispredicted.
  JADE_HD void stop(uint32_t y, uint32_t x, uint32_t stopped) { live[y] &= ~(stopped << x); }

  JADE_HD bool any_live() const {
    uint32_t any = 0;
    for (const uint32_t row : live) any |= row;
    return any != 0;
  }
};

/// The packs of pixels that a splat may cover on a tile, as one list: a loop over rows with an
/// inner loop over one or two packs would be mispredicted in every other row.
template <class P>
struct PackList {
  using T = typename P::Scalar;
  static constexpr int kPerRow = kMaxTile / P::kLanes;

  using Columns = typename m::VectorOf<int32_t, P::kLanes>::Type;
  using Bits = typename m::VectorOf<uint32_t, P::kLanes>::Type;

  int count;
  uint32_t places[kMaxTile * kPerRow + kPerRow];  ///< y · 2^16 + x
  // By row of the tile; see cover().
  alignas(64) T dy[kMaxTile + P::kLanes];
  alignas(64) T row_b[kMaxTile + P::kLanes];
  alignas(64) T row_c[kMaxTile + P::kLanes];
  alignas(64) uint32_t span[kMaxTile + P::kLanes];  ///< one bit a column

  JADE_HD void build(const Splat<T>& splat, const Tile<T>& tile, const uint32_t* live) {
    const int y0 = splat.y0 > tile.y0 ? splat.y0 - tile.y0 : 0;
    const int y1 = splat.y1 < tile.y0 + tile.height ? splat.y1 - tile.y0 : tile.height;
    set_rows(splat, tile, y0, y1);
    int next = 0;
    for (int y = y0; y < y1; ++y) {
      const uint32_t wanted = live[y] & span[y];
      if (wanted == 0) continue;
      const int first = __builtin_ctz(wanted), last = 31 - __builtin_clz(wanted);
      const uint32_t place = static_cast<uint32_t>(y) << 16 | static_cast<uint32_t>(first);
      for (int k = 0; k < kPerRow; ++k) places[next + k] = place + k * P::kLanes;
      next += static_cast<unsigned>(last - first) / P::kLanes + 1;
    }
    count = next;
  }

 private:
  JADE_HD void set_rows(const Splat<T>& splat, const Tile<T>& tile, int y0, int y1) {
    const int x0 = splat.x0 > tile.x0 ? splat.x0 - tile.x0 : 0;
    const int x1 = splat.x1 < tile.x0 + tile.width ? splat.x1 - tile.x0 : tile.width;
    const P low(static_cast<T>(x0)), high(static_cast<T>(x1));
    const P center(splat.x - T(tile.x0) + T(0.5));
    for (int y = y0; y < y1; y += P::kLanes) {
      const P d = (P::iota() + P(T(tile.y0 + y) + T(0.5))) - P(splat.y);
      d.store(dy + y);
      (P(splat.b) * d).store(row_b + y);
      fma(P(splat.c) * d, d, P(splat.log2_opacity)).store(row_c + y);
      const P half =
          sqrt(max(P(splat.width2) - P(splat.shrink) * d * d, P(0))) + P(T(m::kExtentSlackPx));
      // The first column at or after the left end, and one past the last before the right end.
      const P middle = center + P(splat.slope) * d;
      const P left = min(max(middle - half, low), high);
      const P right = max(min(middle + half, high), left);
      const Columns bits = bits_below(right) ^ bits_below(left);
      std::memcpy(span + y, &bits, sizeof(bits));
    }
  }
  /// The lowest floor(n) bits of 32, for n from 0 to 32. (32 is cut in two: no shift by 32.)
  JADE_HD static Columns bits_below(P n) {
    const Columns columns = __builtin_convertvector(n.v, Columns);
    const Columns half = columns >> 1;
    const Bits one = Bits{} + 1;
    return (Columns)(((one << (Bits)half) << (Bits)(columns - half)) - one);
  }
};

/// A splat's α on one pack of pixels.
template <class P>
struct Coverage {
  P raw_alpha;  ///< before the cap (and, in the smooth variant, before the fade)
  P alpha;
  typename P::Mask visible;
};

template <class P, bool kSmooth>
JADE_HD Coverage<P> cover(P a, P row_b, P row_c, P dx) {
  using T = typename P::Scalar;
  Coverage<P> r;
  const P e = fma(fma(a, dx, row_b), dx, row_c);
  r.visible = m::is_visible(e);
  r.raw_alpha = exp2(e);
  const P faded = kSmooth ? r.raw_alpha * m::fade(r.raw_alpha) : r.raw_alpha;
  r.alpha = min(faded, P(T(m::kMaxAlpha)));
  return r;
}

template <class P, bool kSmooth, bool kDepth, class T = typename P::Scalar>
void blend_tile(const Scene<T>& scene, const T* background, const Tile<T>& tile,
                const Images<T>& images) {
  constexpr int kStride = TileState<P>::kStride;
  constexpr int kPlanes = kDepth ? 4 : 3;
  TileState<P> state;
  state.reset(tile);
  alignas(64) T planes[kPlanes][TileState<P>::kSize];
  for (int k = 0; k < kPlanes; ++k) {
    std::memset(planes[k], 0, sizeof(T) * kStride * tile.height);
  }
  const P least(T(kSmooth ? -1 : m::kMinTransmittance));
  PackList<P> packs;
  for (int64_t i = 0; i < tile.list_size && state.any_live(); ++i) {
    const Splat<T>& splat = tile.splats[tile.list[i]];
    if (i + 2 < tile.list_size) __builtin_prefetch(tile.splats + tile.list[i + 2]);
    packs.build(splat, tile, state.live);
    const P center(splat.x), a(splat.a);
    const P values[4] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2]), P(splat.depth)};
    for (int n = 0; n < packs.count; ++n) {
      const uint32_t place = packs.places[n];
      const uint32_t x = place & 0xffff, y = place >> 16, p = y * kStride + x;
      const P dx = P::load(state.center_x + x) - center;
      const Coverage<P> splat_cover =
          cover<P, kSmooth>(a, P(packs.row_b[y]), P(packs.row_c[y]), dx);
      const P t = P::load(state.transmittance + p);
      const P used = splat_cover.alpha * t;
      const auto fits = (t - used) > least;
      const P weight = keep(splat_cover.visible & fits, used);
      const auto stopped = and_not(splat_cover.visible, fits);
      make_negative(stopped, t - weight).store(state.transmittance + p);
      for (int k = 0; k < kPlanes; ++k) {
        fma(weight, values[k], P::load(planes[k] + p)).store(planes[k] + p);
      }
      state.stop(y, x, bits(stopped));
    }
  }
  const int64_t plane_size = static_cast<int64_t>(scene.width) * scene.height;
  for (int y = 0; y < tile.height; ++y) {
    const int64_t row = static_cast<int64_t>(tile.y0 + y) * scene.width + tile.x0;
    for (int x = 0; x < tile.width; ++x) {
      const int p = y * kStride + x;
      const T t = m::abs(state.transmittance[p]);
      for (int c = 0; c < 3; ++c) {
        images.color[c * plane_size + row + x] = planes[c][p] + t * background[c];
      }
      images.alpha[row + x] = T(1) - t;
      if (kDepth) images.depth_sum[row + x] = planes[kPlanes - 1][p];
    }
  }
}

/// Front-to-back replay; see math/blend.h. kExtra: gradients of alpha or depth take part.
template <class P, bool kSmooth, bool kExtra, class T = typename P::Scalar>
void blend_tile_adjoint(const Scene<T>& scene, const T* background, const Tile<T>& tile,
                        int tile_shift, const Images<T>& images, const ImageGradients<T>& gradients,
                        T* instances, T* grad_background) {
  constexpr int kStride = TileState<P>::kStride;
  constexpr int kPlanes = kExtra ? 5 : 3;  // dL/dcolour, dL/dalpha, dL/ddepth
  TileState<P> state;
  state.reset(tile);
  alignas(64) T behind[TileState<P>::kSize];
  alignas(64) T planes[kPlanes][TileState<P>::kSize];
  const int64_t plane_size = static_cast<int64_t>(scene.width) * scene.height;
  std::memset(behind, 0, sizeof(T) * kStride * tile.height);
  for (int k = 0; k < kPlanes; ++k) {
    std::memset(planes[k], 0, sizeof(T) * kStride * tile.height);
  }
  for (int y = 0; y < tile.height; ++y) {
    const int64_t row = static_cast<int64_t>(tile.y0 + y) * scene.width + tile.x0;
    for (int k = 0; k < kPlanes; ++k) {
      const T* const grad = k < 3 ? (gradients.color ? gradients.color + k * plane_size : nullptr)
                                  : (k == 3 ? gradients.alpha : gradients.depth_sum);
      const T* const image =
          k < 3 ? images.color + k * plane_size : (k == 3 ? images.alpha : images.depth_sum);
      if (grad == nullptr) continue;
      for (int x = 0; x < tile.width; ++x) {
        const T g = grad[row + x];
        planes[k][y * kStride + x] = g;
        behind[y * kStride + x] += g * image[row + x];
      }
    }
  }

  const P least(T(kSmooth ? -1 : m::kMinTransmittance)), cap(T(m::kMaxAlpha)), one(1);
  const int values = instance_values(scene.depth);
  PackList<P> packs;
  for (int64_t i = 0; i < tile.list_size; ++i) {
    const Splat<T>& splat = tile.splats[tile.list[i]];
    if (i + 2 < tile.list_size) __builtin_prefetch(tile.splats + tile.list[i + 2]);
    const int tile_column = (tile.x0 >> tile_shift) - (splat.x0 >> tile_shift);
    const int tile_row = (tile.y0 >> tile_shift) - (splat.y0 >> tile_shift);
    T* const out =
        instances + (splat.slot +
                     static_cast<int64_t>(tile_row) * tiles_across(splat.x0, splat.x1, tile_shift) +
                     tile_column) *
                        values;
    if (!state.any_live()) {
      for (int k = 0; k < values; ++k) out[k] = 0;
      continue;
    }
    const P center(splat.x), a(splat.a), depth(splat.depth);
    const P color[3] = {P(splat.color[0]), P(splat.color[1]), P(splat.color[2])};
    P sum_u(0), sum_x(0), sum_y(0), sum_xx(0), sum_xy(0), sum_yy(0), sum_depth(0);
    P sum_color[3] = {P(0), P(0), P(0)};
    packs.build(splat, tile, state.live);
    for (int n = 0; n < packs.count; ++n) {
      const uint32_t place = packs.places[n];
      const uint32_t x = place & 0xffff, y = place >> 16, p = y * kStride + x;
      const P dx = P::load(state.center_x + x) - center, dy(packs.dy[y]);
      const Coverage<P> splat_cover =
          cover<P, kSmooth>(a, P(packs.row_b[y]), P(packs.row_c[y]), dx);
      const P t = P::load(state.transmittance + p);
      const P used = splat_cover.alpha * t;
      const auto fits = (t - used) > least;
      const auto hit = splat_cover.visible & fits;
      const P weight = keep(hit, used);
      const auto stopped = and_not(splat_cover.visible, fits);
      make_negative(stopped, t - weight).store(state.transmittance + p);
      state.stop(y, x, bits(stopped));

      P value(0);
      for (int k = 0; k < 3; ++k) {
        const P g = P::load(planes[k] + p);
        value = fma(g, color[k], value);
        sum_color[k] = fma(weight, g, sum_color[k]);
      }
      if constexpr (kExtra) {
        const P g_depth = P::load(planes[kPlanes - 1] + p);
        value = fma(g_depth, depth, value) + P::load(planes[kPlanes - 2] + p);
        sum_depth = fma(weight, g_depth, sum_depth);
      }
      const P weight_value = weight * value;
      const P rest = P::load(behind + p) - weight_value;
      rest.store(behind + p);
      P u = m::blend_adjoint(splat_cover.alpha, weight_value, rest);
      if constexpr (kSmooth) u = u * m::fade_adjoint(splat_cover.raw_alpha);
      u = keep(hit & (splat_cover.alpha < cap), u);
      const P ux = u * dx, uy = u * dy;
      sum_u = sum_u + u;
      sum_x = sum_x + ux;
      sum_y = sum_y + uy;
      sum_xx = fma(ux, dx, sum_xx);
      sum_xy = fma(ux, dy, sum_xy);
      sum_yy = fma(uy, dy, sum_yy);
    }
    out[0] = sum(sum_u);
    out[1] = sum(sum_x);
    out[2] = sum(sum_y);
    out[3] = sum(sum_xx);
    out[4] = sum(sum_xy);
    out[5] = sum(sum_yy);
    for (int k = 0; k < 3; ++k) out[6 + k] = sum(sum_color[k]);
    if (scene.depth) out[9] = sum(sum_depth);
  }
  (void)background;
  for (int c = 0; c < 3 && gradients.color != nullptr; ++c) {
    T total(0);
    for (int y = 0; y < tile.height; ++y) {
      for (int x = 0; x < tile.width; ++x) {
        const int p = y * kStride + x;
        total += planes[c][p] * m::abs(state.transmittance[p]);
      }
    }
    grad_background[c] += total;
  }
}

template <class P, class T = typename P::Scalar>
void blend(const Scene<T>& scene, const T* background, const Tile<T>& tile,
           const Images<T>& images) {
  if (scene.smooth_cutoff) {
    scene.depth ? blend_tile<P, true, true>(scene, background, tile, images)
                : blend_tile<P, true, false>(scene, background, tile, images);
  } else {
    scene.depth ? blend_tile<P, false, true>(scene, background, tile, images)
                : blend_tile<P, false, false>(scene, background, tile, images);
  }
}

template <class P, class T = typename P::Scalar>
void blend_adjoint(const Scene<T>& scene, const T* background, const Tile<T>& tile, int tile_shift,
                   const Images<T>& images, const ImageGradients<T>& gradients, T* instances,
                   T* grad_background) {
  const bool extra = gradients.alpha != nullptr || gradients.depth_sum != nullptr;
  const auto run =
      scene.smooth_cutoff
          ? (extra ? blend_tile_adjoint<P, true, true, T> : blend_tile_adjoint<P, true, false, T>)
          : (extra ? blend_tile_adjoint<P, false, true, T>
                   : blend_tile_adjoint<P, false, false, T>);
  run(scene, background, tile, tile_shift, images, gradients, instances, grad_background);
}

template <class P>
constexpr Kernels<typename P::Scalar> make_kernels() {
  return {project<P>, blend<P>, blend_adjoint<P>, project_adjoint<P>};
}

// A splat's row is about ten pixels long: packs of more than 32 bytes run half empty.
constexpr int kPackBytes = JADE_VECTOR_BYTES < 32 ? JADE_VECTOR_BYTES : 32;

const KernelSet kKernels = {make_kernels<m::Pack<float, kPackBytes / sizeof(float)>>(),
                            make_kernels<m::Pack<double, kPackBytes / sizeof(double)>>()};

}  // namespace JADE_ISA
}  // namespace jade::splat::cpu
