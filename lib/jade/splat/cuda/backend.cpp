// SPDX-License-Identifier: Apache-2.0
// Allocates tensors and enqueues kernels. After the first call of a size nothing here waits for the
// device or depends on its results, so a caller may capture it in a CUDA graph.
#include "jade/splat/backend.h"

#include <algorithm>
#include <cmath>
#include <cuda_runtime_api.h>
#include <string>
#include <utility>
#include <vector>

#include "jade/core/error.h"
#include "jade/kernel/launch.h"
#include "jade/splat/cuda/capacity.h"
#include "jade/splat/cuda/chunk_size.h"
#include "jade/splat/cuda/device_stream.h"
#include "jade/splat/cuda/launch.h"

namespace jade::splat::cuda {

namespace {

void check_cuda(cudaError_t error, const char* what) {
  if (error != cudaSuccess) throw DeviceError(concat(what, ": ", cudaGetErrorString(error)));
}

bool is_capturing(cudaStream_t stream) {
  cudaStreamCaptureStatus status = cudaStreamCaptureStatusNone;
  check_cuda(cudaStreamIsCapturing(stream, &status), "stream state");
  return status != cudaStreamCaptureStatusNone;
}

/// Divides one allocation into aligned pieces: first add() them all, then allocate(), then take().
class Arena {
 public:
  int64_t add(int64_t bytes) {
    const int64_t at = size_;
    size_ += (bytes + 255) / 256 * 256;
    return at;
  }
  void allocate(const Tensor& like) { tensor_ = new_tensor({size_}, ScalarType::Byte, like); }
  template <class T>
  T* take(int64_t at) const {
    return reinterpret_cast<T*>(static_cast<char*>(tensor_.data_ptr()) + at);
  }
  const Tensor& tensor() const { return tensor_; }

 private:
  int64_t size_ = 0;
  Tensor tensor_;
};

float* pointer(const Tensor& tensor) { return pointer_to<float>(tensor); }

RenderCall make_call(const ForwardArgs& args) {
  const Gaussians& g = args.gaussians;
  const auto check = [](bool holds, const std::string& message) {
    if (!holds) throw ContractError(message);
  };
  check(g.size() < kMaxGaussians,
        concat("at most ", kMaxGaussians, " Gaussians on a GPU, found ", g.size()));
  check(!args.smooth_cutoff, "smooth_cutoff is for gradient tests on the CPU");
  check(args.camera_from_world.size(0) < 65536,
        concat("at most 65535 views in one call, found ", args.camera_from_world.size(0)));
  RenderCall call{};
  call.means = pointer_to<float>(g.means);
  call.rotations = pointer_to<float>(g.rotations);
  call.log_scales = pointer_to<float>(g.log_scales);
  call.logit_opacities = pointer_to<float>(g.logit_opacities);
  call.sh = pointer_to<float>(g.sh);
  call.camera_from_world = pointer_to<float>(args.camera_from_world);
  call.intrinsics = pointer_to<float>(args.intrinsics);
  call.matrices = args.intrinsics.dim() == 3;
  call.background = pointer(args.background);
  call.count = static_cast<int>(g.size());
  call.views = static_cast<int>(args.camera_from_world.size(0));
  call.width = static_cast<int>(args.width);
  call.height = static_cast<int>(args.height);
  call.sh_stride = static_cast<int>(g.sh.size(1));
  call.sh_degree = args.sh_degree;
  call.near_plane = static_cast<float>(args.near_plane);
  call.far_plane = static_cast<float>(args.far_plane);
  call.max_alpha = static_cast<float>(args.max_alpha);
  call.log2_max_alpha = std::log2(call.max_alpha);
  call.activated = args.activated;
  call.antialiased = args.antialiased;
  call.channel_stride = args.interleaved ? 1 : args.width * args.height;
  call.pixel_stride = args.interleaved ? 3 : 1;
  call.tiles_x = (call.width + kTile - 1) / kTile;
  call.tiles_y = (call.height + kTile - 1) / kTile;
  call.tiles = call.tiles_x * call.tiles_y;
  return call;
}

/// Screen records and tile tables in one allocation, the instances in another, whose size is known
/// only after the first call of a size has counted.
struct Lists {
  static constexpr int kParts = 5;  ///< of the tables
  Tensor tables, keys;

  static Arena lay_out(const RenderCall& call, int64_t* at) {
    const int64_t tiles = int64_t{call.views} * call.tiles;
    Arena arena;
    at[0] = arena.add(sizeof(Counters));  // zeroed together with the next two
    at[1] = arena.add(tiles * sizeof(TileList));
    at[2] = arena.add(tiles * sizeof(uint32_t));
    at[3] = arena.add(tiles * sizeof(uint32_t));
    at[4] = arena.add(int64_t{call.views} * call.count * sizeof(Splat));
    return arena;
  }

  void bind(RenderCall* call) const {
    int64_t at[kParts];
    lay_out(*call, at);
    char* const base = static_cast<char*>(tables.data_ptr());
    call->counters = reinterpret_cast<Counters*>(base + at[0]);
    call->tile_list = reinterpret_cast<TileList*>(base + at[1]);
    call->chunk_counts = reinterpret_cast<uint32_t*>(base + at[2]);
    call->tile_order = reinterpret_cast<uint32_t*>(base + at[3]);
    call->splats = reinterpret_cast<Splat*>(base + at[4]);
    if (keys.defined()) {
      call->keys = reinterpret_cast<uint64_t*>(keys.data_ptr());
      call->capacity = static_cast<uint32_t>(keys.size(0));
    }
  }
};

/// Waits for the device.
uint64_t read_instances(const RenderCall& call, cudaStream_t stream) {
  uint64_t instances = 0;
  check_cuda(cudaMemcpyAsync(&instances, &call.counters->instances, sizeof(instances),
                             cudaMemcpyDeviceToHost, stream),
             "counting instances");
  check_cuda(cudaStreamSynchronize(stream), "counting instances");
  return instances;
}

/// Temporary buffers of the sort from instances to lists.
Tensor bind_chunks(RenderCall* call, const Tensor& like) {
  const int64_t views = call->views, chunks = call->chunks;
  Arena arena;
  const int64_t keys = arena.add(int64_t{call->capacity} * sizeof(uint64_t));
  const int64_t begin = arena.add(views * chunks * sizeof(uint32_t));
  const int64_t runs = arena.add(views * call->tiles * chunks * sizeof(uint32_t));
  arena.allocate(like);
  call->chunk_keys = arena.take<uint64_t>(keys);
  call->chunk_begin = arena.take<uint32_t>(begin);
  call->runs = arena.take<uint32_t>(runs);
  return arena.tensor();
}

/// Projects all views and divides an instance buffer. The first call of a size counts first and
/// waits for the result. So does every deterministic call, whose gradients need every list and
/// exactly as much memory: it writes 144 B per list entry. Calls with a known capacity use chunks.
Lists project_and_bin(RenderCall* call, const ForwardArgs& args, long long* rejected,
                      cudaStream_t stream) {
  const Tensor& like = args.gaussians.means;
  int64_t at[Lists::kParts];
  Arena arena = Lists::lay_out(*call, at);
  arena.allocate(like);
  Lists lists;
  lists.tables = arena.tensor();
  lists.bind(call);
  check_cuda(cudaMemsetAsync(call->counters, 0, static_cast<size_t>(at[3]), stream), "clearing");
  InstanceBudget& budget = InstanceBudget::of(static_cast<int>(like.get_device()), call->views,
                                              call->width, call->height);
  const bool counts = (args.deterministic || !budget.known()) && !is_capturing(stream);
  call->chunk_gaussians = counts ? 0 : chunk_gaussians(*call);
  if (call->chunk_gaussians > 0) {
    call->chunks = (call->count + call->chunk_gaussians - 1) / call->chunk_gaussians;
  }
  launch_project(*call, stream);
  int64_t counted = kMostInstances;
  if (counts) {
    launch_count_lists(*call, stream);
    const uint64_t instances = read_instances(*call, stream);
    budget.learn(instances, call->count);
    if (args.deterministic) counted = static_cast<int64_t>(std::min<uint64_t>(instances, counted));
  }
  const int64_t forced = instance_capacity_for_test();
  const int64_t capacity = forced >= 0 ? forced : std::min(counted, budget.capacity(call->count));
  lists.keys = new_tensor({capacity}, ScalarType::Long, like);
  lists.bind(call);
  Tensor chunks;
  if (call->chunks > 0) {
    chunks = bind_chunks(call, like);
    launch_chunks(*call, stream);
  }
  if (!counts) launch_count_lists(*call, stream);
  launch_plan(*call, rejected, budget.inbox(), stream);
  launch_fill(*call, stream);
  return lists;
}

/// Accumulators of the backward pass, zero at its start.
struct Sums {
  Tensor tensor;

  static Arena lay_out(const RenderCall& call, int64_t values, int64_t* at) {
    Arena arena;
    at[0] = arena.add(sizeof(unsigned int));
    at[1] = arena.add(3 * sizeof(float));
    at[2] = arena.add(int64_t{call.views} * 12 * sizeof(float));
    at[3] = arena.add(int64_t{call.views} * call.count * values * sizeof(float));
    return arena;
  }

  Sums(const RenderCall& call, int64_t values, const Tensor& like) {
    int64_t at[4];
    Arena arena = lay_out(call, values, at);
    arena.allocate(like);
    tensor = arena.tensor();
  }
  /// Memory for at least that many values.
  explicit Sums(Tensor cleared) : tensor(std::move(cleared)) {}

  Clearing clearing() const { return {tensor.data_ptr(), tensor.numel()}; }
  void bind(const RenderCall& call, int64_t values, Gradients* gradients) const {
    int64_t at[4];
    lay_out(call, values, at);
    char* const base = static_cast<char*>(tensor.data_ptr());
    gradients->done_blocks = reinterpret_cast<unsigned int*>(base + at[0]);
    gradients->background_sums = reinterpret_cast<float*>(base + at[1]);
    gradients->camera_sums = reinterpret_cast<float*>(base + at[2]);
    gradients->sums = reinterpret_cast<float*>(base + at[3]);
  }
};

int64_t values_of(bool depth) { return m::kPixelSums + (depth ? 1 : 0); }

/// The backward pass's scratch memory. The forward pass has zeroed the buffers to which the first
/// backward pass adds.
std::vector<Tensor> bind_workspace(const BackwardArgs& args, const RenderCall& call,
                                   Gradients* gradients, cudaStream_t stream) {
  const int64_t values = values_of(gradients->with_depth);
  const bool first = args.state.cleared.defined();
  const Sums sums = first ? Sums(args.state.cleared) : Sums(call, values, args.color);
  sums.bind(call, values, gradients);
  if (!first) {
    check_cuda(cudaMemsetAsync(sums.tensor.data_ptr(), 0, static_cast<size_t>(sums.tensor.numel()),
                               stream),
               "clearing");
  }
  if (!args.forward.deterministic) return {sums.tensor};
  const int64_t tiles = int64_t{call.views} * call.tiles;
  const int64_t blocks = std::max(1, (call.count + kAdjointGaussians - 1) / kAdjointGaussians);
  Arena arena;
  const int64_t slots = arena.add(int64_t{call.capacity} * 4 * values * sizeof(float));
  const int64_t progress = arena.add(tiles * 4 * sizeof(uint32_t));
  const int64_t camera_partial = arena.add(blocks * call.views * 12 * sizeof(float));
  const int64_t background_partial = arena.add(tiles * 3 * sizeof(float));
  arena.allocate(args.color);
  gradients->slots = arena.take<float>(slots);
  gradients->progress = arena.take<uint32_t>(progress);
  gradients->camera_partial = arena.take<float>(camera_partial);
  gradients->background_partial = arena.take<float>(background_partial);
  return {sums.tensor, arena.tensor()};
}

}  // namespace

ForwardResult forward(const ForwardArgs& args) {
  const Tensor& like = args.gaussians.means;
  const DeviceStream device(like);
  const cudaStream_t stream = device.stream();
  RenderCall call = make_call(args);
  ForwardResult result;
  result.rejected = new_tensor({1}, ScalarType::Long, like);
  auto* const rejected = reinterpret_cast<long long*>(result.rejected.data_ptr());
  const Lists lists = project_and_bin(&call, args, rejected, stream);
  // Allocate while the device is busy.
  result.color = new_images(args, 3);
  result.alpha = new_images(args, 1);
  if (args.depth) result.depth_sum = new_like(result.alpha);
  Clearing clearing{};
  if (args.needs_backward) {
    const Sums sums(call, values_of(args.depth), like);
    clearing = sums.clearing();
    result.state = {{lists.tables, lists.keys}, {}, sums.tensor};
  }
  launch_blend(call, {pointer(result.color), pointer(result.alpha), pointer(result.depth_sum)},
               clearing, stream);
  kernel::check_launch("splatting, forward");
  return result;
}

BackwardResult backward(const BackwardArgs& args) {
  const DeviceStream device(args.color);
  const cudaStream_t stream = device.stream();
  RenderCall call = make_call(args.forward);
  const Lists lists{args.state.tensors.at(0), args.state.tensors.at(1)};
  lists.bind(&call);
  const Gaussians& g = args.forward.gaussians;
  BackwardResult result;
  result.gaussians = {new_like(g.means), new_like(g.rotations), new_like(g.log_scales),
                      new_like(g.logit_opacities), new_like(g.sh)};
  if (args.needs_background) result.background = new_like(args.forward.background);
  if (args.needs_camera) {
    result.camera_from_world = new_like(args.forward.camera_from_world);
  }
  if (args.needs_means2d) {
    result.means2d = new_tensor({call.views, call.count, 2}, ScalarType::Float, g.means);
  }
  Gradients gradients{};
  gradients.means = pointer(result.gaussians.means);
  gradients.rotations = pointer(result.gaussians.rotations);
  gradients.log_scales = pointer(result.gaussians.log_scales);
  gradients.logit_opacities = pointer(result.gaussians.logit_opacities);
  gradients.sh = pointer(result.gaussians.sh);
  gradients.camera_from_world = pointer(result.camera_from_world);
  gradients.background = pointer(result.background);
  gradients.means2d = pointer(result.means2d);
  gradients.gradient_norm = pointer(args.statistics.gradient_norm);
  gradients.visible_count = pointer(args.statistics.visible_count);
  gradients.max_radius_px = pointer(args.statistics.max_radius_px);
  gradients.statistics_views = static_cast<int>(args.statistics_views);
  gradients.with_depth = args.forward.depth && args.grad_depth_sum.defined();
  const auto workspace = bind_workspace(args, call, &gradients, stream);
  launch_blend_adjoint(
      call,
      {pointer(args.color), pointer(args.alpha), pointer(args.depth_sum), pointer(args.grad_color),
       pointer(args.grad_alpha), pointer(args.grad_depth_sum)},
      gradients, stream);
  if (args.forward.deterministic) launch_gather(call, gradients, stream);
  launch_project_adjoint(call, gradients, stream);
  kernel::check_launch("splatting, backward");
  return result;
}

}  // namespace jade::splat::cuda
