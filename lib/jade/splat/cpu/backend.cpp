// SPDX-License-Identifier: Apache-2.0
// Allocates tensors, splits the work into tasks and runs the kernels on them.
#include "jade/splat/backend.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <vector>

#include "jade/splat/cpu/bin.h"
#include "jade/splat/cpu/dispatch.h"
#include "jade/splat/cpu/kernels.h"
#include "jade/splat/cpu/parallel.h"
#include "jade/splat/math/projection.h"

namespace jade::splat::cpu {

namespace {

template <class T>
const Kernels<T>& kernels_for() {
  if constexpr (sizeof(T) == 4) {
    return kernels().single;
  } else {
    return kernels().precise;
  }
}

/// [C, sizeof(Camera) / sizeof(T)]
template <class T>
Tensor make_cameras(const ForwardArgs& args) {
  const int64_t views = args.camera_from_world.size(0);
  constexpr int64_t kValues = sizeof(math::Camera<T>) / sizeof(T);
  const Tensor cameras =
      new_tensor({views, kValues}, args.intrinsics.scalar_type(), args.intrinsics);
  auto* const out = reinterpret_cast<math::Camera<T>*>(pointer_to<T>(cameras));
  for (int64_t view = 0; view < views; ++view) {
    T intrinsics[4];
    math::load_intrinsics(pointer_to<T>(args.intrinsics), args.intrinsics.dim() == 3, view,
                          intrinsics);
    out[view] = math::make_camera<T>(pointer_to<T>(args.camera_from_world) + 16 * view, intrinsics,
                                     static_cast<int>(args.width), static_cast<int>(args.height));
  }
  return cameras;
}

template <class T>
RenderCall<T> make_call(const ForwardArgs& args, const Tensor& cameras, int tile_shift) {
  const Gaussians& g = args.gaussians;
  RenderCall<T> call;
  call.count = g.size();
  call.means = pointer_to<T>(g.means);
  call.rotations = pointer_to<T>(g.rotations);
  call.log_scales = pointer_to<T>(g.log_scales);
  call.logit_opacities = pointer_to<T>(g.logit_opacities);
  call.sh = pointer_to<T>(g.sh);
  call.sh_stride = static_cast<int>(g.sh.size(1));
  call.sh_degree = args.sh_degree;
  call.views = static_cast<int>(cameras.size(0));
  call.cameras = pointer_to<T>(cameras);
  static constexpr T kBlack[3] = {};
  call.background = args.background.defined() ? pointer_to<T>(args.background) : kBlack;
  call.width = static_cast<int>(args.width);
  call.height = static_cast<int>(args.height);
  call.near_plane = static_cast<T>(args.near_plane);
  call.far_plane = static_cast<T>(args.far_plane);
  call.max_alpha = static_cast<T>(args.max_alpha);
  call.activated = args.activated;
  call.antialiased = args.antialiased;
  call.smooth_cutoff = args.smooth_cutoff;
  call.depth = args.depth;
  call.interleaved = args.interleaved;
  call.tile_shift = tile_shift;
  return call;
}

/// Splats and tile lists of all views.
template <class T>
struct Lists {
  Tensor splats;        ///< bytes of Splat<T> [C, N]
  Tensor entries;       ///< int32, view after view; each tile's are ordered by index until it is
                        ///< blended
  Tensor offsets;       ///< int64 [C, tiles + 1], within the view
  Tensor view_offsets;  ///< int64 [C + 1]
  int tile_shift = 0;

  Splat<T>* splat_data() const { return reinterpret_cast<Splat<T>*>(splats.data_ptr()); }
  SavedState save() const { return {{splats, entries, offsets, view_offsets}, {tile_shift}, {}}; }
  static Lists restore(const SavedState& state) {
    const auto& t = state.tensors;
    return {t[0], t[1], t[2], t[3], static_cast<int>(state.numbers[0])};
  }

  int32_t* list_of(const TileGrid& grid, int64_t view, int64_t index) const {
    return pointer_to<int32_t>(entries) + pointer_to<int64_t>(view_offsets)[view] +
           pointer_to<int64_t>(offsets)[view * (grid.tiles() + 1) + index];
  }
  Tile<T> tile(const RenderCall<T>& call, const TileGrid& grid, int64_t view, int64_t index) const {
    const int64_t* const begin = pointer_to<int64_t>(offsets) + view * (grid.tiles() + 1) + index;
    Tile<T> tile;
    tile.splats = splat_data() + view * call.count;
    tile.list = list_of(grid, view, index);
    tile.list_size = begin[1] - begin[0];
    tile.x0 = static_cast<int>(index % grid.columns) * grid.tile_size();
    tile.y0 = static_cast<int>(index / grid.columns) * grid.tile_size();
    tile.width = std::min(grid.tile_size(), call.width - tile.x0);
    tile.height = std::min(grid.tile_size(), call.height - tile.y0);
    return tile;
  }
};

/// Gaussians are processed in chunks whose number depends on N alone, so that sums over chunks do
/// not depend on the number of threads.
struct Chunks {
  int64_t count, size, total;
  explicit Chunks(int64_t gaussians) : total(gaussians) {
    constexpr int64_t kMaxChunks = 128, kLeast = 256;
    size = std::max(kLeast, (gaussians + kMaxChunks - 1) / kMaxChunks);
    size = (size + kMaxLanes - 1) / kMaxLanes * kMaxLanes;
    count = (gaussians + size - 1) / size;
  }
  int64_t begin(int64_t chunk) const { return chunk * size; }
  int64_t end(int64_t chunk) const { return std::min(total, (chunk + 1) * size); }
};

/// Splats, and lists whose tiles are still ordered by index: a tile is sorted when it is blended,
/// because its splats are loaded into the cache then anyway.
template <class T>
Lists<T> project_and_bin(const RenderCall<T>& call, const Tensor& cameras, int64_t* rejected) {
  const TileGrid grid(call.width, call.height, call.tile_shift);
  Lists<T> lists;
  lists.tile_shift = call.tile_shift;
  lists.splats = new_tensor({call.views * call.count * static_cast<int64_t>(sizeof(Splat<T>))},
                            ScalarType::Byte, cameras);
  Splat<T>* const splats = lists.splat_data();
  const Chunks chunks(call.count);
  std::vector<int64_t> unusable(static_cast<size_t>(chunks.count), 0);
  const int64_t parts = call.views * chunks.count;
  const std::unique_ptr<uint32_t[]> counts(new uint32_t[parts * grid.tiles()]);
  parallel_tasks(chunks.count, [&](int64_t chunk) {
    unusable[chunk] =
        kernels_for<T>().project(call, chunks.begin(chunk), chunks.end(chunk), splats);
    for (int64_t view = 0; view < call.views; ++view) {
      count_instances(splats + view * call.count, chunks.begin(chunk), chunks.end(chunk), grid,
                      counts.get() + (view * chunks.count + chunk) * grid.tiles());
    }
  });
  *rejected = std::accumulate(unusable.begin(), unusable.end(), int64_t{0});

  lists.view_offsets = new_tensor({call.views + 1}, ScalarType::Long, cameras);
  lists.offsets = new_tensor({call.views, grid.tiles() + 1}, ScalarType::Long, cameras);
  int64_t* const view_offsets = pointer_to<int64_t>(lists.view_offsets);
  int64_t* const offsets = pointer_to<int64_t>(lists.offsets);
  view_offsets[0] = 0;
  std::vector<uint32_t> slots(static_cast<size_t>(parts));
  parallel_tasks(call.views, [&](int64_t view) {
    const int64_t first = view * chunks.count;
    view_offsets[view + 1] =
        assign_positions(counts.get() + first * grid.tiles(), chunks.count, grid.tiles(),
                         offsets + view * (grid.tiles() + 1), slots.data() + first);
  });
  std::partial_sum(view_offsets, view_offsets + call.views + 1, view_offsets);
  lists.entries = new_tensor({view_offsets[call.views]}, ScalarType::Int, cameras);
  int32_t* const entries = pointer_to<int32_t>(lists.entries);
  parallel_tasks(parts, [&](int64_t part) {
    const int64_t view = part / chunks.count, chunk = part % chunks.count;
    place_instances(splats + view * call.count, chunks.begin(chunk), chunks.end(chunk), grid,
                    slots[part], counts.get() + part * grid.tiles(), entries + view_offsets[view]);
  });
  return lists;
}

template <class T>
Images<T> images_of_view(const RenderCall<T>& call, const Tensor& color, const Tensor& alpha,
                         const Tensor& depth_sum, int64_t view) {
  const int64_t plane = static_cast<int64_t>(call.width) * call.height;
  Images<T> images;
  images.color = pointer_to<T>(color) + view * 3 * plane;
  images.alpha = pointer_to<T>(alpha) + view * plane;
  if (depth_sum.defined()) images.depth_sum = pointer_to<T>(depth_sum) + view * plane;
  return images;
}

template <class T>
ForwardResult forward_typed(const ForwardArgs& args) {
  const Tensor cameras = make_cameras<T>(args);
  const RenderCall<T> call = make_call<T>(args, cameras, tile_shift());
  int64_t rejected = 0;
  const Lists<T> lists = project_and_bin(call, cameras, &rejected);

  ForwardResult result;
  result.color = new_images(args, 3);
  result.alpha = new_images(args, 1);
  if (args.depth) result.depth_sum = new_like(result.alpha);
  result.rejected = new_tensor({1}, ScalarType::Long, cameras);
  *pointer_to<int64_t>(result.rejected) = rejected;
  const TileGrid grid(call.width, call.height, lists.tile_shift);
  parallel_tasks(call.views * grid.tiles(), [&](int64_t task) {
    const int64_t view = task / grid.tiles(), index = task % grid.tiles();
    const Tile<T> tile = lists.tile(call, grid, view, index);
    sort_by_depth(tile.splats, lists.list_of(grid, view, index), tile.list_size);
    kernels_for<T>().blend(
        call, tile, images_of_view(call, result.color, result.alpha, result.depth_sum, view));
  });
  if (args.needs_backward) result.state = lists.save();
  return result;
}

/// Sum of `partial` [rows, columns] over its rows, in their order and in double.
template <class T>
std::vector<double> sum_rows(const std::vector<T>& partial, int64_t columns) {
  std::vector<double> sums(static_cast<size_t>(columns), 0.0);
  for (auto row = partial.begin(); row != partial.end(); row += columns) {
    for (int64_t i = 0; i < columns; ++i) sums[i] += static_cast<double>(row[i]);
  }
  return sums;
}

/// Instance sums of all tiles [instances, instance_values]; fills the background's gradient, unless
/// it is undefined.
template <class T>
Tensor blend_adjoint(const BackwardArgs& args, const RenderCall<T>& call, const Lists<T>& lists,
                     const Tensor& grad_background) {
  const TileGrid grid(call.width, call.height, lists.tile_shift);
  const int64_t* const view_offsets = pointer_to<int64_t>(lists.view_offsets);
  const int64_t values = instance_values(call.depth);
  const Tensor instances =
      new_tensor({view_offsets[call.views], values}, args.color.scalar_type(), args.color);
  const int64_t tasks = call.views * grid.tiles();
  std::vector<T> partial(static_cast<size_t>(3 * tasks), T(0));
  const int64_t plane = args.forward.width * args.forward.height;
  parallel_tasks(tasks, [&](int64_t task) {
    const int64_t view = task / grid.tiles();
    ImageGradients<T> gradients;
    if (args.grad_color.defined()) {
      gradients.color = pointer_to<T>(args.grad_color) + view * 3 * plane;
    }
    if (args.grad_alpha.defined()) gradients.alpha = pointer_to<T>(args.grad_alpha) + view * plane;
    if (args.grad_depth_sum.defined()) {
      gradients.depth_sum = pointer_to<T>(args.grad_depth_sum) + view * plane;
    }
    kernels_for<T>().blend_adjoint(
        call, lists.tile(call, grid, view, task % grid.tiles()),
        images_of_view(call, args.color, args.alpha, args.depth_sum, view), gradients,
        pointer_to<T>(instances) + view_offsets[view] * values, partial.data() + 3 * task);
  });
  if (!grad_background.defined()) return instances;
  const std::vector<double> sums = sum_rows(partial, 3);
  for (int c = 0; c < 3; ++c) pointer_to<T>(grad_background)[c] = static_cast<T>(sums[c]);
  return instances;
}

template <class T>
Gradients<T> gradients_into(const BackwardResult& result, const BackwardArgs& args) {
  const Gaussians& grad = result.gaussians;
  Gradients<T> out;
  out.means = pointer_to<T>(grad.means);
  out.rotations = pointer_to<T>(grad.rotations);
  out.log_scales = pointer_to<T>(grad.log_scales);
  out.logit_opacities = pointer_to<T>(grad.logit_opacities);
  out.sh = pointer_to<T>(grad.sh);
  out.means2d = pointer_to<T>(result.means2d);
  if (args.statistics.defined()) {
    out.gradient_norm = pointer_to<float>(args.statistics.gradient_norm);
    out.visible_count = pointer_to<float>(args.statistics.visible_count);
    out.max_radius_px = pointer_to<float>(args.statistics.max_radius_px);
    out.statistics_views = args.statistics_views;
  }
  return out;
}

template <class T>
BackwardResult backward_typed(const BackwardArgs& args) {
  const Tensor cameras = make_cameras<T>(args.forward);
  const Lists<T> lists = Lists<T>::restore(args.state);
  const RenderCall<T> call = make_call<T>(args.forward, cameras, lists.tile_shift);
  const Gaussians& g = args.forward.gaussians;
  BackwardResult result;
  result.gaussians = {new_like(g.means), new_like(g.rotations), new_like(g.log_scales),
                      new_like(g.logit_opacities), new_like(g.sh)};
  if (args.needs_background) result.background = new_like(args.forward.background);
  if (args.needs_means2d) {
    result.means2d = new_tensor({call.views, call.count, 2}, g.means.scalar_type(), g.means);
    std::fill_n(pointer_to<T>(result.means2d), 2 * call.views * call.count, T(0));
  }
  const Tensor instance_sums = blend_adjoint(args, call, lists, result.background);
  const Instances<T> instances{lists.splat_data(), pointer_to<T>(instance_sums),
                               pointer_to<int64_t>(lists.view_offsets)};

  const Chunks chunks(call.count);
  const int64_t camera_sums = call.views * kCameraValues * kMaxLanes;
  std::vector<T> partial(static_cast<size_t>(chunks.count * camera_sums), T(0));
  const Gradients<T> gradients = gradients_into<T>(result, args);
  parallel_tasks(chunks.count, [&](int64_t chunk) {
    kernels_for<T>().project_adjoint(call, chunks.begin(chunk), chunks.end(chunk), instances,
                                     gradients, partial.data() + chunk * camera_sums);
  });
  if (args.needs_camera) {
    const std::vector<double> sums = sum_rows(partial, camera_sums);
    result.camera_from_world = new_like(args.forward.camera_from_world);
    T* const out = pointer_to<T>(result.camera_from_world);
    std::fill_n(out, 16 * call.views, T(0));
    for (int64_t view = 0; view < call.views; ++view) {
      for (int k = 0; k < kCameraValues; ++k) {
        const double* const lanes = sums.data() + (view * kCameraValues + k) * kMaxLanes;
        const int row = k < 9 ? k / 3 : k - 9, column = k < 9 ? k % 3 : 3;
        out[view * 16 + row * 4 + column] =
            static_cast<T>(std::accumulate(lanes, lanes + kMaxLanes, 0.0));
      }
    }
  }
  return result;
}

}  // namespace

ForwardResult forward(const ForwardArgs& args) {
  return args.gaussians.means.scalar_type() == ScalarType::Double ? forward_typed<double>(args)
                                                                  : forward_typed<float>(args);
}

BackwardResult backward(const BackwardArgs& args) {
  return args.forward.gaussians.means.scalar_type() == ScalarType::Double
             ? backward_typed<double>(args)
             : backward_typed<float>(args);
}

}  // namespace jade::splat::cpu
