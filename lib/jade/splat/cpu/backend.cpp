// SPDX-License-Identifier: Apache-2.0
// Tensors in, tensors out: allocates, cuts the work into tasks and runs the kernels on them.
#include "jade/splat/backend.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <torch/types.h>

#include "jade/core/check.h"
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

template <class T>
T* pointer(const torch::Tensor& tensor) {
  return tensor.defined() ? tensor.data_ptr<T>() : nullptr;
}

/// [C, sizeof(Camera) / sizeof(T)]
template <class T>
torch::Tensor make_cameras(const ForwardArgs& args) {
  const int64_t views = args.camera_from_world.size(0);
  constexpr int64_t kValues = sizeof(math::Camera<T>) / sizeof(T);
  const torch::Tensor cameras = torch::empty({views, kValues}, args.intrinsics.options());
  auto* const out = reinterpret_cast<math::Camera<T>*>(cameras.data_ptr<T>());
  for (int64_t view = 0; view < views; ++view) {
    out[view] = math::make_camera<T>(args.camera_from_world.data_ptr<T>() + 16 * view,
                                     args.intrinsics.data_ptr<T>() + 4 * view,
                                     static_cast<int>(args.width), static_cast<int>(args.height));
  }
  return cameras;
}

template <class T>
RenderCall<T> make_call(const ForwardArgs& args, const torch::Tensor& cameras, int tile_shift) {
  const Gaussians& g = args.gaussians;
  RenderCall<T> call;
  call.count = g.size();
  call.means = g.means.data_ptr<T>();
  call.rotations = g.rotations.data_ptr<T>();
  call.log_scales = g.log_scales.data_ptr<T>();
  call.logit_opacities = g.logit_opacities.data_ptr<T>();
  call.sh = g.sh.data_ptr<T>();
  call.sh_stride = static_cast<int>(g.sh.size(1));
  call.sh_degree = args.sh_degree;
  call.views = static_cast<int>(cameras.size(0));
  call.cameras = cameras.data_ptr<T>();
  static constexpr T kBlack[3] = {};
  call.background = args.background.defined() ? args.background.data_ptr<T>() : kBlack;
  call.width = static_cast<int>(args.width);
  call.height = static_cast<int>(args.height);
  call.near_plane = static_cast<T>(args.near_plane);
  call.antialiased = args.antialiased;
  call.smooth_cutoff = args.smooth_cutoff;
  call.depth = args.depth;
  call.tile_shift = tile_shift;
  return call;
}

/// Splats and tile lists of all views.
template <class T>
struct Lists {
  torch::Tensor splats;        ///< bytes of Splat<T> [C, N]
  torch::Tensor entries;       ///< int32, view after view; each tile's by index until it is blended
  torch::Tensor offsets;       ///< int64 [C, tiles + 1], within the view
  torch::Tensor view_offsets;  ///< int64 [C + 1]
  int tile_shift = 0;

  Splat<T>* splat_data() const { return reinterpret_cast<Splat<T>*>(splats.data_ptr()); }
  SavedState save() const { return {{splats, entries, offsets, view_offsets}, {tile_shift}, {}}; }
  static Lists restore(const SavedState& state) {
    const auto& t = state.tensors;
    return {t[0], t[1], t[2], t[3], static_cast<int>(state.numbers[0])};
  }

  int32_t* list_of(const TileGrid& grid, int64_t view, int64_t index) const {
    return entries.data_ptr<int32_t>() + view_offsets.data_ptr<int64_t>()[view] +
           offsets.data_ptr<int64_t>()[view * (grid.tiles() + 1) + index];
  }
  Tile<T> tile(const RenderCall<T>& call, const TileGrid& grid, int64_t view, int64_t index) const {
    const int64_t* const begin = offsets.data_ptr<int64_t>() + view * (grid.tiles() + 1) + index;
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

/// Gaussians are handled in chunks whose number depends on N alone: sums over chunks are then the
/// same for any thread count.
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

/// Splats, and lists whose tiles are still by index: a tile is sorted when it is blended, while its
/// splats are on their way to the cache anyway.
template <class T>
Lists<T> project_and_bin(const RenderCall<T>& call, int64_t* rejected) {
  const TileGrid grid(call.width, call.height, call.tile_shift);
  const auto bytes = torch::TensorOptions().dtype(torch::kUInt8);
  const auto longs = torch::TensorOptions().dtype(torch::kInt64);
  Lists<T> lists;
  lists.tile_shift = call.tile_shift;
  lists.splats =
      torch::empty({call.views * call.count * static_cast<int64_t>(sizeof(Splat<T>))}, bytes);
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

  lists.view_offsets = torch::zeros({call.views + 1}, longs);
  lists.offsets = torch::empty({call.views, grid.tiles() + 1}, longs);
  int64_t* const view_offsets = lists.view_offsets.template data_ptr<int64_t>();
  int64_t* const offsets = lists.offsets.template data_ptr<int64_t>();
  std::vector<uint32_t> slots(static_cast<size_t>(parts));
  parallel_tasks(call.views, [&](int64_t view) {
    const int64_t first = view * chunks.count;
    view_offsets[view + 1] =
        assign_positions(counts.get() + first * grid.tiles(), chunks.count, grid.tiles(),
                         offsets + view * (grid.tiles() + 1), slots.data() + first);
  });
  std::partial_sum(view_offsets, view_offsets + call.views + 1, view_offsets);
  lists.entries =
      torch::empty({view_offsets[call.views]}, torch::TensorOptions().dtype(torch::kInt32));
  int32_t* const entries = lists.entries.template data_ptr<int32_t>();
  parallel_tasks(parts, [&](int64_t part) {
    const int64_t view = part / chunks.count, chunk = part % chunks.count;
    place_instances(splats + view * call.count, chunks.begin(chunk), chunks.end(chunk), grid,
                    slots[part], counts.get() + part * grid.tiles(), entries + view_offsets[view]);
  });
  return lists;
}

template <class T>
Images<T> images_of_view(const torch::Tensor& color, const torch::Tensor& alpha,
                         const torch::Tensor& depth_sum, int64_t view) {
  const int64_t plane = color.size(2) * color.size(3);
  Images<T> images;
  images.color = color.data_ptr<T>() + view * 3 * plane;
  images.alpha = alpha.data_ptr<T>() + view * plane;
  if (depth_sum.defined()) images.depth_sum = depth_sum.data_ptr<T>() + view * plane;
  return images;
}

template <class T>
ForwardResult forward_typed(const ForwardArgs& args) {
  const torch::Tensor cameras = make_cameras<T>(args);
  const RenderCall<T> call = make_call<T>(args, cameras, tile_shift());
  int64_t rejected = 0;
  const Lists<T> lists = project_and_bin(call, &rejected);

  const auto options = args.gaussians.means.options();
  ForwardResult result;
  result.color = torch::empty({call.views, 3, args.height, args.width}, options);
  result.alpha = torch::empty({call.views, 1, args.height, args.width}, options);
  if (args.depth) result.depth_sum = torch::empty_like(result.alpha);
  result.rejected = torch::full({1}, rejected, torch::kInt64);
  const TileGrid grid(call.width, call.height, lists.tile_shift);
  parallel_tasks(call.views * grid.tiles(), [&](int64_t task) {
    const int64_t view = task / grid.tiles(), index = task % grid.tiles();
    const Tile<T> tile = lists.tile(call, grid, view, index);
    sort_by_depth(tile.splats, lists.list_of(grid, view, index), tile.list_size);
    kernels_for<T>().blend(call, tile,
                           images_of_view<T>(result.color, result.alpha, result.depth_sum, view));
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
torch::Tensor blend_adjoint(const BackwardArgs& args, const RenderCall<T>& call,
                            const Lists<T>& lists, const torch::Tensor& grad_background) {
  const TileGrid grid(call.width, call.height, lists.tile_shift);
  const int64_t* const view_offsets = lists.view_offsets.template data_ptr<int64_t>();
  const int64_t values = instance_values(call.depth);
  const torch::Tensor instances =
      torch::empty({view_offsets[call.views], values}, args.color.options());
  const int64_t tasks = call.views * grid.tiles();
  std::vector<T> partial(static_cast<size_t>(3 * tasks), T(0));
  const int64_t plane = args.forward.width * args.forward.height;
  parallel_tasks(tasks, [&](int64_t task) {
    const int64_t view = task / grid.tiles();
    ImageGradients<T> gradients;
    if (args.grad_color.defined()) {
      gradients.color = args.grad_color.data_ptr<T>() + view * 3 * plane;
    }
    if (args.grad_alpha.defined()) gradients.alpha = args.grad_alpha.data_ptr<T>() + view * plane;
    if (args.grad_depth_sum.defined()) {
      gradients.depth_sum = args.grad_depth_sum.data_ptr<T>() + view * plane;
    }
    kernels_for<T>().blend_adjoint(call, lists.tile(call, grid, view, task % grid.tiles()),
                                   images_of_view<T>(args.color, args.alpha, args.depth_sum, view),
                                   gradients, instances.data_ptr<T>() + view_offsets[view] * values,
                                   partial.data() + 3 * task);
  });
  if (!grad_background.defined()) return instances;
  const std::vector<double> sums = sum_rows(partial, 3);
  for (int c = 0; c < 3; ++c) grad_background.data_ptr<T>()[c] = static_cast<T>(sums[c]);
  return instances;
}

template <class T>
Gradients<T> gradients_into(const Gaussians& grad, const BackwardArgs& args) {
  Gradients<T> out;
  out.means = grad.means.data_ptr<T>();
  out.rotations = grad.rotations.data_ptr<T>();
  out.log_scales = grad.log_scales.data_ptr<T>();
  out.logit_opacities = grad.logit_opacities.data_ptr<T>();
  out.sh = grad.sh.data_ptr<T>();
  if (args.statistics.defined()) {
    out.gradient_norm = args.statistics.gradient_norm.data_ptr<float>();
    out.visible_count = args.statistics.visible_count.data_ptr<float>();
    out.max_radius_px = args.statistics.max_radius_px.data_ptr<float>();
    out.statistics_views = args.statistics_views;
  }
  return out;
}

template <class T>
BackwardResult backward_typed(const BackwardArgs& args) {
  const torch::Tensor cameras = make_cameras<T>(args.forward);
  const Lists<T> lists = Lists<T>::restore(args.state);
  const RenderCall<T> call = make_call<T>(args.forward, cameras, lists.tile_shift);
  const Gaussians& g = args.forward.gaussians;
  BackwardResult result;
  result.gaussians = {torch::empty_like(g.means), torch::empty_like(g.rotations),
                      torch::empty_like(g.log_scales), torch::empty_like(g.logit_opacities),
                      torch::empty_like(g.sh)};
  if (args.needs_background) result.background = torch::empty_like(args.forward.background);
  const torch::Tensor instance_sums = blend_adjoint(args, call, lists, result.background);
  const Instances<T> instances{lists.splat_data(), instance_sums.data_ptr<T>(),
                               lists.view_offsets.template data_ptr<int64_t>()};

  const Chunks chunks(call.count);
  const int64_t camera_sums = call.views * kCameraValues * kMaxLanes;
  std::vector<T> partial(static_cast<size_t>(chunks.count * camera_sums), T(0));
  const Gradients<T> gradients = gradients_into<T>(result.gaussians, args);
  parallel_tasks(chunks.count, [&](int64_t chunk) {
    kernels_for<T>().project_adjoint(call, chunks.begin(chunk), chunks.end(chunk), instances,
                                     gradients, partial.data() + chunk * camera_sums);
  });
  if (args.needs_camera) {
    const std::vector<double> sums = sum_rows(partial, camera_sums);
    result.camera_from_world = torch::zeros_like(args.forward.camera_from_world);
    T* const out = result.camera_from_world.template data_ptr<T>();
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
  return args.gaussians.means.scalar_type() == torch::kFloat64 ? forward_typed<double>(args)
                                                               : forward_typed<float>(args);
}

BackwardResult backward(const BackwardArgs& args) {
  return args.forward.gaussians.means.scalar_type() == torch::kFloat64
             ? backward_typed<double>(args)
             : backward_typed<float>(args);
}

}  // namespace jade::splat::cpu
