// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/exposure_path.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"

namespace jade::geometry {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr char kWork[] = "the path of an exposure";

class PathFunction : public torch::autograd::Function<PathFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& twists,
                               const torch::Tensor& u, const torch::Tensor& base, bool corrects) {
    const ExposurePath path{twists.contiguous(), u.contiguous(),
                            base.to(torch::kFloat64).contiguous(), corrects};
    context->save_for_backward({path.twists, path.u, path.base});
    context->saved_data["corrects"] = corrects;
    if (!twists.is_cuda()) return cpu::exposure_path(path);
    return kernel::on_cuda(kWork, [&] { return cuda::exposure_path(path); });
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const ExposurePath path{saved[0], saved[1], saved[2], context->saved_data["corrects"].toBool()};
    const torch::Tensor gradient = gradients[0].contiguous();
    const torch::Tensor of_twists =
        !gradient.is_cuda()
            ? cpu::exposure_path_backward(path, gradient)
            : kernel::on_cuda(kWork, [&] { return cuda::exposure_path_backward(path, gradient); });
    return {of_twists, torch::Tensor(), torch::Tensor(), torch::Tensor()};
  }
};

torch::Tensor path_of(const torch::Tensor& twists, const torch::Tensor& u,
                      const torch::Tensor& base, bool corrects) {
  check_shape(twists, "twists", {-1, 6});
  const int64_t control = twists.size(0);
  JADE_CHECK(control == 2 || control == 4 || (corrects && control > 4),
             "expected two or four twists per exposure, or more of a correction, found ", control);
  check_dtype(twists, "twists", torch::kFloat64);
  check_shape(u, "times", {-1});
  check_dtype(u, "times", torch::kFloat64);
  check_shape(base, "poses", {corrects ? u.size(0) : twists.size(0), 4, 4});
  check_same_device(twists, "twists", u, "times");
  check_same_device(twists, "twists", base, "poses");
  return PathFunction::apply(twists, u, base, corrects);
}

}  // namespace

torch::Tensor corrected_path(const torch::Tensor& twists, const torch::Tensor& u,
                             const torch::Tensor& camera_from_world) {
  return path_of(twists, u, camera_from_world, true);
}

torch::Tensor spline_path(const torch::Tensor& twists, const torch::Tensor& u,
                          const torch::Tensor& control) {
  return path_of(twists, u, control, false);
}

}  // namespace jade::geometry
