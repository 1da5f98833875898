// SPDX-License-Identifier: Apache-2.0
// Buffers that the kernels of the CUDA backend exchange. Plain memory: must not include torch.
#pragma once

#include <cstdint>

#include "jade/splat/math/blend.h"

namespace jade::splat::cuda {

namespace m = jade::splat::math;

constexpr int kTile = 16;    ///< px; one block blends one tile of one view
constexpr int kSubtile = 8;  ///< px; one warp blends one quarter of a tile
/// Bits of an entry: the quarters of the tile that a splat reaches; after a forward pass with
/// gradients only those that the adjoint needs.
constexpr int kMaskBits = 4;
constexpr int kMaxGaussians = 1 << 28;  ///< an entry is index << kMaskBits | mask in 32 bits
constexpr int kMostChunkGaussians = 1024;
constexpr int kMostChunkTiles = 2048;
constexpr int kChunkBlocks = 3;  ///< per multiprocessor
constexpr int kRunBits = 11;     ///< for lengths up to kMostChunkGaussians
constexpr uint32_t kLost = 1u << 31;
constexpr int kListClasses = 128;  ///< of lists, by length

/// A projected Gaussian in one view: three 16-byte loads. `depth` is 0 if it is not rendered.
struct alignas(16) Splat {
  float x, y, a, b;  ///< mean, px; falloff (math/blend.h)
  float c, log2_opacity, red, green;
  float blue, depth, slope, shrink;  ///< the last two: rows of the ellipse (math/tile.h)
};

/// A tile's list and, without chunks, its counters. One 32-byte sector each, because atomics on one
/// sector are serialised. A tile whose list did not fit has begin >= capacity.
struct alignas(32) TileList {
  uint32_t count;  ///< zeroed before the pass
  uint32_t begin;
  uint32_t next;  ///< position of the next instance; without chunks
};

/// Counters of one forward pass, zeroed before it.
struct Counters {
  unsigned long long instances;  ///< (view, tile, Gaussian) triples, including those that did not
                                 ///< fit
  unsigned long long rejected;
  unsigned long long chunk_keys;  ///< of the chunks so far, including those that did not fit
  unsigned long long planned;     ///< instances of the lists that have a place so far
  uint32_t lists[kListClasses];   ///< by class
  uint32_t placed[kListClasses];  ///< those in `tile_order` so far
};

/// Arguments of one call of the op: Gaussians, cameras, settings, and buffers shared by the
/// kernels. Passed by value.
struct RenderCall {
  const float *means, *rotations, *log_scales, *logit_opacities, *sh;
  const float *camera_from_world, *intrinsics;
  bool matrices;            ///< intrinsics are [views, 3, 3], not [views, 4]
  const float* background;  ///< [3]; null: black
  int count, views, width, height;
  int sh_stride;  ///< coefficients in memory
  int sh_degree;
  float near_plane, far_plane;
  float max_alpha, log2_max_alpha;
  bool activated;
  bool antialiased;
  int64_t channel_stride;  ///< from one channel to the next, for colours and their gradients
  int pixel_stride;        ///< from one pixel to the next

  int tiles_x, tiles_y, tiles;  ///< of one view
  uint32_t capacity;            ///< of `keys`
  Splat* splats;                ///< [views, count]
  uint64_t* keys;  ///< depth bits << 32 | entry; after the sort 32-bit entries, each list in place
  TileList* tile_list;   ///< [views, tiles]
  uint32_t* tile_order;  ///< longest lists first

  // Intermediate lists: chunks of a view's Gaussians, each with its instances sorted by tile.
  int chunks;             ///< per view; 0: instances are written directly to the lists
  int chunk_gaussians;    ///< a multiple of 32
  uint64_t* chunk_keys;   ///< [capacity], chunks in no particular order
  uint32_t* chunk_begin;  ///< [views, chunks], in chunk_keys
  uint32_t* runs;         ///< [views, tiles, chunks]: start in the chunk << kRunBits | length
  /// [views, tiles]: a tile's instances in all chunks, with kLost if any of them did not fit.
  /// Contiguous, because chunks add to neighbours at the same time. Zeroed before the pass.
  uint32_t* chunk_counts;
  Counters* counters;
};

/// Colours of a view begin at 3 · view · height · width, laid out by the call's strides.
struct Images {
  float *color, *alpha, *depth_sum;  ///< depth_sum may be null
};

/// Memory that a forward pass zeroes for the sums of its adjoint.
struct Clearing {
  void* memory;   ///< 16-byte aligned; null: no gradient is required
  int64_t bytes;  ///< a multiple of 16
};

struct ImageGradients {
  const float *color, *alpha, *depth_sum;                 ///< the forward pass's images
  const float *grad_color, *grad_alpha, *grad_depth_sum;  ///< may be null
};

struct Gradients {
  float *means, *rotations, *log_scales, *logit_opacities, *sh;
  float* camera_from_world;                              ///< [views,4,4] or null
  float* background;                                     ///< [3] or null
  float *gradient_norm, *visible_count, *max_radius_px;  ///< null: no statistics
  int statistics_views;
  float* means2d;  ///< [views, count, 2] or null

  float* sums;                ///< [views, count, kPixelSums (+ 1 with depth)], zeroed
  float* camera_sums;         ///< [views, 12], zeroed
  float* background_sums;     ///< [3], zeroed
  unsigned int* done_blocks;  ///< zeroed
  bool with_depth;

  // Deterministic passes only.
  float* slots;               ///< [instances, 4 quarters, kPixelSums (+ 1)]
  uint32_t* progress;         ///< [views, tiles, 4]: number of entries that the quarter's warp
                              ///< processed
  float* camera_partial;      ///< [blocks, views, 12]
  float* background_partial;  ///< [views, tiles, 3]
};

constexpr int kAdjointGaussians = 64;  ///< per block of the projection's adjoint

}  // namespace jade::splat::cuda
