// SPDX-License-Identifier: Apache-2.0
// The splatting op for Python: the backends of lib/jade/splat as two functions of plain tensors.
// jade_splat/_ops.py connects them for autograd. Needs only LibTorch's stable ABI.
#include <initializer_list>
#include <optional>
#include <string>
#include <torch/csrc/stable/library.h>
#include <tuple>
#include <vector>

#include "jade/core/error.h"
#include "jade/splat/backend.h"
#include "jade/splat/cpu/dispatch.h"

namespace jade::splat {

namespace {

using Optional = std::optional<Tensor>;

constexpr int64_t kAny = -1;

/// @throws ContractError unless the tensor is contiguous, of the type and on the kind of device of
///   `like`, and has the shape.
void check(const Tensor& tensor, const char* name, std::initializer_list<int64_t> shape,
           const Tensor& like) {
  const auto expect = [&](bool holds, const char* what) {
    if (!holds) throw ContractError(concat("jade_splat: expected ", name, " ", what));
  };
  expect(tensor.dim() == static_cast<int64_t>(shape.size()), "of another number of dimensions");
  int64_t axis = 0;
  for (const int64_t size : shape) {
    expect(size == kAny || tensor.size(axis) == size, "of another shape");
    ++axis;
  }
  expect(tensor.scalar_type() == like.scalar_type(), "of the type of means");
  expect(tensor.get_device_index() == like.get_device_index(), "on the device of means");
  expect(tensor.is_contiguous(), "to be contiguous");
}

struct Scalars {
  int64_t width, height, sh_degree;
  double near_plane, far_plane, max_alpha;
  bool activated, antialiased, depth, smooth_cutoff, deterministic, interleaved;
};

ForwardArgs make_args(const Gaussians& g, const Tensor& viewmats, const Tensor& intrinsics,
                      const Scalars& s) {
  const ScalarType type = g.means.scalar_type();
  if (type != ScalarType::Float && (type != ScalarType::Double || g.means.is_cuda())) {
    throw ContractError("jade_splat: expected float32 tensors, or float64 on the CPU");
  }
  check(g.means, "means", {kAny, 3}, g.means);
  check(g.rotations, "quats", {g.size(), 4}, g.means);
  check(g.log_scales, "scales", {g.size(), 3}, g.means);
  check(g.logit_opacities, "opacities", {g.size()}, g.means);
  check(g.sh, "colors", {g.size(), kAny, 3}, g.means);
  check(viewmats, "viewmats", {kAny, 4, 4}, g.means);
  if (intrinsics.dim() == 3) {
    check(intrinsics, "Ks", {viewmats.size(0), 3, 3}, g.means);
  } else {
    check(intrinsics, "intrinsics", {viewmats.size(0), 4}, g.means);
  }
  const int64_t degree = s.sh_degree;
  if (degree < kPlainColor || degree > 3 ||
      g.sh.size(1) < (degree == kPlainColor ? 1 : (degree + 1) * (degree + 1))) {
    throw ContractError(concat("jade_splat: expected sh_degree -1 to 3 and as many coefficients, ",
                               "found ", degree, " and ", g.sh.size(1)));
  }
  ForwardArgs args;
  args.gaussians = g;
  args.camera_from_world = viewmats;
  args.intrinsics = intrinsics;
  args.width = s.width;
  args.height = s.height;
  args.sh_degree = static_cast<int>(degree);
  args.near_plane = s.near_plane;
  args.far_plane = s.far_plane;
  args.max_alpha = s.max_alpha;
  args.activated = s.activated;
  args.antialiased = s.antialiased;
  args.depth = s.depth;
  args.smooth_cutoff = s.smooth_cutoff;
  args.deterministic = s.deterministic;
  args.interleaved = s.interleaved;
  return args;
}

/// An empty tensor in place of an undefined one, which a schema cannot express.
Tensor or_empty(const Tensor& tensor, const Tensor& like) {
  return tensor.defined() ? tensor : new_tensor({0}, like.scalar_type(), like);
}

Tensor or_undefined(const Optional& tensor) { return tensor ? *tensor : Tensor(); }

/// Four tensors of SavedState::tensors, padded, and `cleared` at the third position on a GPU.
using Forward = std::tuple<Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor>;

template <ForwardResult (*run)(const ForwardArgs&)>
Forward forward(Tensor means, Tensor quats, Tensor scales, Tensor opacities, Tensor colors,
                Tensor viewmats, Tensor intrinsics, Optional /*means2d*/, int64_t width,
                int64_t height, int64_t sh_degree, double near_plane, double far_plane,
                double max_alpha, bool activated, bool antialiased, bool depth, bool smooth_cutoff,
                bool deterministic, bool interleaved, bool needs_backward) {
  ForwardArgs args =
      make_args({means, quats, scales, opacities, colors}, viewmats, intrinsics,
                {width, height, sh_degree, near_plane, far_plane, max_alpha, activated, antialiased,
                 depth, smooth_cutoff, deterministic, interleaved});
  args.needs_backward = needs_backward;
  ForwardResult result = run(args);
  std::vector<Tensor>& state = result.state.tensors;
  if (result.state.cleared.defined()) state.push_back(result.state.cleared);
  state.resize(4);
  return {result.color,
          result.alpha,
          or_empty(result.depth_sum, means),
          result.rejected,
          or_empty(state[0], means),
          or_empty(state[1], means),
          or_empty(state[2], means),
          or_empty(state[3], means)};
}

using Backward = std::tuple<Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor>;

template <BackwardResult (*run)(const BackwardArgs&)>
Backward backward(Tensor means, Tensor quats, Tensor scales, Tensor opacities, Tensor colors,
                  Tensor viewmats, Tensor intrinsics, Tensor color, Tensor alpha, Tensor depth_sum,
                  Tensor state0, Tensor state1, Tensor state2, Tensor state3, Optional cleared,
                  Optional grad_color, Optional grad_alpha, Optional grad_depth_sum, int64_t width,
                  int64_t height, int64_t sh_degree, double near_plane, double far_plane,
                  double max_alpha, bool activated, bool antialiased, bool depth,
                  bool smooth_cutoff, bool deterministic, bool interleaved, bool needs_camera,
                  bool needs_means2d) {
  BackwardArgs args;
  args.forward = make_args({means, quats, scales, opacities, colors}, viewmats, intrinsics,
                           {width, height, sh_degree, near_plane, far_plane, max_alpha, activated,
                            antialiased, depth, smooth_cutoff, deterministic, interleaved});
  args.color = color;
  args.alpha = alpha;
  if (depth) args.depth_sum = depth_sum;
  args.state.tensors = {state0, state1, state2, state3};
  args.state.numbers = {cpu::tile_shift()};
  args.state.cleared = or_undefined(cleared);
  args.grad_color = or_undefined(grad_color);
  args.grad_alpha = or_undefined(grad_alpha);
  args.grad_depth_sum = or_undefined(grad_depth_sum);
  args.needs_camera = needs_camera;
  args.needs_means2d = needs_means2d;
  const BackwardResult result = run(args);
  const Gaussians& g = result.gaussians;
  return {g.means,
          g.rotations,
          g.log_scales,
          g.logit_opacities,
          g.sh,
          or_empty(result.camera_from_world, means),
          or_empty(result.means2d, means)};
}

#define JADE_INPUTS                                                                               \
  "Tensor means, Tensor quats, Tensor scales, Tensor opacities, Tensor colors, Tensor viewmats, " \
  "Tensor intrinsics, "
#define JADE_SCALARS                                                                           \
  "int width, int height, int sh_degree, float near_plane, float far_plane, float max_alpha, " \
  "bool activated, "                                                                           \
  "bool antialiased, bool depth, bool smooth_cutoff, bool deterministic, bool interleaved, "

STABLE_TORCH_LIBRARY(jade_splat, m) {
  m.def("forward(" JADE_INPUTS "Tensor? means2d, " JADE_SCALARS
        "bool needs_backward) -> (Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor)");
  m.def("backward(" JADE_INPUTS
        "Tensor color, Tensor alpha, Tensor depth_sum, Tensor state0, Tensor state1, "
        "Tensor state2, Tensor state3, Tensor(a!)? cleared, Tensor? grad_color, "
        "Tensor? grad_alpha, Tensor? grad_depth_sum, " JADE_SCALARS
        "bool needs_camera, bool needs_means2d) "
        "-> (Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor)");
}

STABLE_TORCH_LIBRARY_IMPL(jade_splat, CPU, m) {
  m.impl("forward", TORCH_BOX(&forward<cpu::forward>));
  m.impl("backward", TORCH_BOX(&backward<cpu::backward>));
}

#ifdef JADE_WITH_CUDA
STABLE_TORCH_LIBRARY_IMPL(jade_splat, CUDA, m) {
  m.impl("forward", TORCH_BOX(&forward<cuda::forward>));
  m.impl("backward", TORCH_BOX(&backward<cuda::backward>));
}
#endif

}  // namespace

}  // namespace jade::splat
