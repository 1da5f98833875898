// SPDX-License-Identifier: Apache-2.0
// The splatting op for Python: the backends of lib/jade/splat as two functions of plain tensors.
// jade_splat/_ops.py connects them for autograd. Needs only LibTorch's stable ABI.
#include <cstddef>
#include <initializer_list>
#include <optional>
#include <torch/csrc/stable/library.h>
#include <tuple>
#include <vector>

#include "jade/core/error.h"
#include "jade/splat/backend.h"
#include "jade/splat/cpu/dispatch.h"

namespace jade::splat {

namespace {

using Boxed = torch::stable::Tensor;  // as TORCH_BOX() knows tensors
using Optional = std::optional<Boxed>;
using Tensors = std::vector<Boxed>;
using Backward = std::tuple<Boxed, Boxed, Boxed, Boxed, Boxed, Boxed, Boxed>;

constexpr int64_t kAny = -1;

/// Compares inputs with the means. Reads each property once, because each is a call of LibTorch.
class Like {
 public:
  explicit Like(const Tensor& means)
      : type_(type_of(means)), kind_(kind_of(means)), device_(means.get_device_index()) {}

  /// @throws ContractError unless the tensor is contiguous, of the type and on the device of the
  ///   means, and has the shape.
  void check(const Tensor& tensor, const char* name, std::initializer_list<int64_t> shape) const {
    const auto expect = [&](bool holds, const char* what) {
      if (!holds) throw ContractError(concat("jade_splat: expected ", name, " ", what));
    };
    expect(tensor.dim() == static_cast<int64_t>(shape.size()), "of another number of dimensions");
    int64_t* found = nullptr;
    TORCH_ERROR_CODE_CHECK(aoti_torch_get_sizes(tensor.get(), &found));
    for (const int64_t size : shape) {
      expect(size == kAny || *found == size, "of another shape");
      ++found;
    }
    expect(type_of(tensor) == type_, "of the type of means");
    expect(kind_of(tensor) == kind_ && tensor.get_device_index() == device_,
           "on the device of means");
    expect(tensor.is_contiguous(), "to be contiguous");
  }

 private:
  static int32_t type_of(const Tensor& tensor) {
    int32_t type = 0;
    TORCH_ERROR_CODE_CHECK(aoti_torch_get_dtype(tensor.get(), &type));
    return type;
  }
  static int32_t kind_of(const Tensor& tensor) {
    int32_t kind = 0;
    TORCH_ERROR_CODE_CHECK(aoti_torch_get_device_type(tensor.get(), &kind));
    return kind;
  }

  int32_t type_, kind_, device_;
};

/// A contiguous tensor's elements in another shape.
Tensor reshaped(const Tensor& tensor, std::initializer_list<int64_t> shape) {
  int64_t strides[3] = {1, 1, 1};
  for (size_t axis = shape.size() - 1; axis > 0; --axis) {
    strides[axis - 1] = strides[axis] * shape.begin()[axis];
  }
  AtenTensorHandle made = nullptr;
  TORCH_ERROR_CODE_CHECK(aoti_torch__reinterpret_tensor(
      tensor.get(), static_cast<int64_t>(shape.size()), shape.begin(), strides, 0, &made));
  return Tensor(made);
}

struct Scalars {
  int64_t width, height, sh_degree;
  double near_plane, far_plane, max_alpha;
  bool activated, antialiased, depth, smooth_cutoff, deterministic, interleaved;
};

/// `colors` are [N,K,3] or, as plain colours, [N,3].
ForwardArgs make_args(const Tensor& means, const Tensor& quats, const Tensor& scales,
                      const Tensor& opacities, const Tensor& colors, const Tensor& viewmats,
                      const Tensor& intrinsics, const Scalars& s, bool needs_backward) {
  const ScalarType type = means.scalar_type();
  if (type != ScalarType::Float && (type != ScalarType::Double || means.is_cuda())) {
    throw ContractError("jade_splat: expected float32 tensors, or float64 on the CPU");
  }
  const Like like(means);
  like.check(means, "means", {kAny, 3});
  const int64_t count = means.size(0);
  like.check(quats, "quats", {count, 4});
  like.check(scales, "scales", {count, 3});
  like.check(opacities, "opacities", {count});
  const int64_t degree = s.sh_degree;
  const bool flat = degree == kPlainColor && colors.dim() == 2;
  if (flat) {
    like.check(colors, "colors", {count, 3});
  } else {
    like.check(colors, "colors", {count, kAny, 3});
  }
  const Tensor sh = flat ? reshaped(colors, {count, 1, 3}) : colors;
  like.check(viewmats, "viewmats", {kAny, 4, 4});
  const int64_t views = viewmats.size(0);
  if (views < 1) throw ContractError("jade_splat: expected viewmats of at least one camera");
  if (intrinsics.dim() == 3) {
    like.check(intrinsics, "Ks", {views, 3, 3});
  } else {
    like.check(intrinsics, "intrinsics", {views, 4});
  }
  if (degree < kPlainColor || degree > 3 ||
      sh.size(1) < (degree == kPlainColor ? 1 : (degree + 1) * (degree + 1))) {
    throw ContractError(concat("jade_splat: expected sh_degree -1 to 3 and as many coefficients, ",
                               "found ", degree, " and ", sh.size(1)));
  }
  return {{means, quats, scales, opacities, sh},
          viewmats,
          intrinsics,
          Tensor(),
          s.width,
          s.height,
          static_cast<int>(degree),
          s.near_plane,
          s.far_plane,
          s.max_alpha,
          s.activated,
          s.antialiased,
          s.depth,
          s.smooth_cutoff,
          s.deterministic,
          s.interleaved,
          needs_backward};
}

/// The colour, alpha, Σ w z if requested, and with `needs_backward` SavedState: its tensors and, on
/// a GPU, `cleared`.
template <ForwardResult (*run)(const ForwardArgs&)>
Tensors forward(const Boxed& means, const Boxed& quats, const Boxed& scales, const Boxed& opacities,
                const Boxed& colors, const Boxed& viewmats, const Boxed& intrinsics, int64_t width,
                int64_t height, int64_t sh_degree, double near_plane, double far_plane,
                double max_alpha, bool activated, bool antialiased, bool depth, bool smooth_cutoff,
                bool deterministic, bool interleaved, bool needs_backward) {
  const ForwardResult result =
      run(make_args(means, quats, scales, opacities, colors, viewmats, intrinsics,
                    {width, height, sh_degree, near_plane, far_plane, max_alpha, activated,
                     antialiased, depth, smooth_cutoff, deterministic, interleaved},
                    needs_backward));
  Tensors outputs = {result.color, result.alpha};
  if (depth) outputs.push_back(result.depth_sum);
  if (needs_backward) {
    const SavedState& state = result.state;
    outputs.insert(outputs.end(), state.tensors.begin(), state.tensors.end());
    if (state.cleared.defined()) outputs.push_back(state.cleared);
  }
  return outputs;
}

/// `kState` is the number of SavedState::tensors. `saved` are the inputs and outputs of forward()
/// without `cleared`, which is passed on once. Returns the gradients of the Gaussians, the cameras
/// and means2d; empty if not needed. No list, because torch.compile refuses one of an op with an
/// output among its inputs.
template <BackwardResult (*run)(const BackwardArgs&), size_t kState>
Backward backward(const Tensors& saved, const Optional& cleared, const Optional& grad_color,
                  const Optional& grad_alpha, const Optional& grad_depth_sum, int64_t width,
                  int64_t height, int64_t sh_degree, double near_plane, double far_plane,
                  double max_alpha, bool activated, bool antialiased, bool depth,
                  bool smooth_cutoff, bool deterministic, bool interleaved, bool needs_camera,
                  bool needs_means2d) {
  constexpr size_t kInputs = 7;
  const size_t state = kInputs + (depth ? 3 : 2);
  if (saved.size() != state + kState) throw ContractError("jade_splat: expected all saved tensors");
  const auto or_undefined = [](const Optional& tensor) {
    return tensor ? Tensor(*tensor) : Tensor();
  };
  BackwardArgs args{
      make_args(saved[0], saved[1], saved[2], saved[3], saved[4], saved[5], saved[6],
                {width, height, sh_degree, near_plane, far_plane, max_alpha, activated, antialiased,
                 depth, smooth_cutoff, deterministic, interleaved},
                false),
      {std::vector<Tensor>(saved.begin() + static_cast<std::ptrdiff_t>(state), saved.end()),
       {cpu::tile_shift()},
       or_undefined(cleared)},
      saved[kInputs],
      saved[kInputs + 1],
      depth ? Tensor(saved[kInputs + 2]) : Tensor(),
      or_undefined(grad_color),
      or_undefined(grad_alpha),
      or_undefined(grad_depth_sum),
      {},
      -1,
      needs_camera,
      false,
      needs_means2d};
  const BackwardResult result = run(args);
  const Gaussians& g = result.gaussians;
  const auto or_empty = [&g](const Tensor& tensor) {
    return tensor.defined() ? tensor : new_tensor({0}, g.means.scalar_type(), g.means);
  };
  return {g.means,
          g.rotations,
          g.log_scales,
          g.logit_opacities,
          saved[4].dim() == 2 ? reshaped(g.sh, {g.sh.size(0), 3}) : g.sh,
          or_empty(result.camera_from_world),
          or_empty(result.means2d)};
}

#define JADE_SCALARS                                                                           \
  "int width, int height, int sh_degree, float near_plane, float far_plane, float max_alpha, " \
  "bool activated, bool antialiased, bool depth, bool smooth_cutoff, bool deterministic, "     \
  "bool interleaved, "

STABLE_TORCH_LIBRARY(jade_splat, m) {
  m.def(
      "forward(Tensor means, Tensor quats, Tensor scales, Tensor opacities, Tensor colors, "
      "Tensor viewmats, Tensor intrinsics, " JADE_SCALARS "bool needs_backward) -> Tensor[]");
  m.def(
      "backward(Tensor[] saved, Tensor(a!)? cleared, Tensor? grad_color, Tensor? grad_alpha, "
      "Tensor? grad_depth_sum, " JADE_SCALARS
      "bool needs_camera, bool needs_means2d) "
      "-> (Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor)");
}

STABLE_TORCH_LIBRARY_IMPL(jade_splat, CPU, m) {
  m.impl("forward", TORCH_BOX(&forward<cpu::forward>));
  m.impl("backward", TORCH_BOX((&backward<cpu::backward, 4>)));
}

#ifdef JADE_WITH_CUDA
STABLE_TORCH_LIBRARY_IMPL(jade_splat, CUDA, m) {
  m.impl("forward", TORCH_BOX(&forward<cuda::forward>));
  m.impl("backward", TORCH_BOX((&backward<cuda::backward, 2>)));
}
#endif

}  // namespace

}  // namespace jade::splat
