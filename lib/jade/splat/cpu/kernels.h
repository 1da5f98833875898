// SPDX-License-Identifier: Apache-2.0
// The CPU's inner loops as plain functions on plain pointers. Compiled once per instruction set
// (kernels_impl.h), so this header must not include torch or inline library code.
#pragma once

#include <cstdint>

#include "jade/kernel/isa.h"
#include "jade/splat/math/blend.h"

namespace jade::splat::cpu {

/// A projected Gaussian in one view; one cache line in float. Empty box: not visible.
template <class T>
struct Splat {
  T x, y;
  T a, b, c, log2_opacity;  ///< math::Falloff
  T color[3];
  T depth;
  T slope, width2, shrink;  ///< math::RowExtent
  int16_t x0, x1, y0, y1;   ///< pixels it can reach, half-open
  uint32_t slot;            ///< index of its first (splat, tile) instance in this view
};

/// Arguments of one call of the op: Gaussians, cameras and settings. Pointers are to contiguous
/// arrays.
template <class T>
struct RenderCall {
  int64_t count = 0;
  const T* means = nullptr;
  const T* rotations = nullptr;
  const T* log_scales = nullptr;
  const T* logit_opacities = nullptr;
  const T* sh = nullptr;  ///< [N, sh_stride, 3]
  int sh_stride = 1;
  int sh_degree = 0;
  int views = 0;
  const T* cameras = nullptr;     ///< [views], each a math::Camera<T>
  const T* background = nullptr;  ///< [3]
  int width = 0, height = 0;
  T near_plane = 0, far_plane = 0;
  T max_alpha = T(math::kMaxAlpha);
  bool activated = false;
  bool antialiased = false;
  bool smooth_cutoff = false;
  bool depth = false;
  bool interleaved = false;  ///< colours and their gradients are [height, width, 3], not planes
  int tile_shift = 0;        ///< tiles are 2^tile_shift pixels wide and high
};

/// A tile of one view and the splats on it, in depth order.
template <class T>
struct Tile {
  const Splat<T>* splats = nullptr;  ///< of the view
  const int32_t* list = nullptr;     ///< indices into `splats`
  int64_t list_size = 0;
  int x0 = 0, y0 = 0, width = 0, height = 0;  ///< at most kMaxTile each
};
constexpr int kMaxTile = 32;

/// Images of one view; planes of height × width.
template <class T>
struct Images {
  T* color = nullptr;  ///< 3 planes, or interleaved
  T* alpha = nullptr;
  T* depth_sum = nullptr;  ///< may be null
};
template <class T>
struct ImageGradients {
  const T* color = nullptr;  ///< each may be null, meaning zero
  const T* alpha = nullptr;
  const T* depth_sum = nullptr;
};

/// Number of sums over the pixels of one (splat, tile); includes depth if RenderCall::depth.
constexpr int instance_values(bool depth) { return math::kPixelSums + (depth ? 1 : 0); }

/// The sums of all instances, and their index: those of splat s of view v begin at
/// sums[(view_offsets[v] + s.slot) · instance_values], one per tile of its TileBox.
template <class T>
struct Instances {
  const Splat<T>* splats = nullptr;  ///< [views, count]
  const T* sums = nullptr;
  const int64_t* view_offsets = nullptr;
};

template <class T>
struct Gradients {
  T* means = nullptr;
  T* rotations = nullptr;
  T* log_scales = nullptr;
  T* logit_opacities = nullptr;
  T* sh = nullptr;
  T* means2d = nullptr;            ///< [views, count, 2], zeroed; null: not requested
  float* gradient_norm = nullptr;  ///< statistics; null: none
  float* visible_count = nullptr;
  float* max_radius_px = nullptr;
  int64_t statistics_views = -1;
};

constexpr int kCameraValues = 12;  ///< rotation 9, translation 3
constexpr int kMaxLanes = 16;

template <class T>
struct Kernels {
  /// Projects Gaussians [begin, end) into splats [views, count]; returns how many are unusable.
  int64_t (*project)(const RenderCall<T>& call, int64_t begin, int64_t end, Splat<T>* splats);
  void (*blend)(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images);
  /// Writes the sums of the tile's instances below `instances`, the first of the view, and adds to
  /// grad_background.
  void (*blend_adjoint)(const RenderCall<T>& call, const Tile<T>& tile, const Images<T>& images,
                        const ImageGradients<T>& gradients, T* instances, T* grad_background);
  /// Sums the instances of Gaussians [begin, end) and writes their gradients. Adds each view's
  /// camera gradient to grad_cameras [views, kCameraValues, kMaxLanes], spread over the last axis.
  void (*project_adjoint)(const RenderCall<T>& call, int64_t begin, int64_t end,
                          const Instances<T>& instances, const Gradients<T>& gradients,
                          T* grad_cameras);
};

using KernelSet = kernel::KernelSet<Kernels>;

namespace portable {
extern const KernelSet kKernels;
}
namespace avx2 {
extern const KernelSet kKernels;
}
namespace avx512 {
extern const KernelSet kKernels;
}

}  // namespace jade::splat::cpu
