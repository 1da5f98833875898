// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <algorithm>

#include "jade/losses/event_loss_kernels.h"

namespace jade::losses::cpu {

void event_loss(const EventPair& events, at::Tensor& loss, at::Tensor& residuals,
                at::Tensor& weight) {
  AT_DISPATCH_FLOATING_TYPES(events.renders.scalar_type(), "event_loss", [&] {
    const EventPixels<scalar_t> in = pixels_of<scalar_t>(events);
    double* const residual = residuals.mutable_data_ptr<double>();
    double sum = 0, weights = 0;
    for (int64_t p = 0; p < in.count; ++p) {
      const EventTerm term = event_term(in, in.indices[p]);
      residual[p] = term.residual;
      sum += term.value;
      weights += term.weight;
    }
    weights = std::max(weights, kLeastWeight);
    *weight.mutable_data_ptr<double>() = weights;
    *loss.mutable_data_ptr<scalar_t>() = static_cast<scalar_t>(sum / weights);
  });
}

void event_loss_gradient(const EventPair& events, const at::Tensor& residuals,
                         const at::Tensor& weight, const at::Tensor& of_loss,
                         at::Tensor& of_renders) {
  AT_DISPATCH_FLOATING_TYPES(events.renders.scalar_type(), "event_loss_gradient", [&] {
    const EventPixels<scalar_t> in = pixels_of<scalar_t>(events);
    const double scale =
        static_cast<double>(*of_loss.const_data_ptr<scalar_t>()) / *weight.const_data_ptr<double>();
    const double* const residual = residuals.const_data_ptr<double>();
    scalar_t* const out = of_renders.mutable_data_ptr<scalar_t>();
    for (int64_t p = 0; p < in.count; ++p) {
      const int64_t pixel = in.indices[p];
      event_term_adjoint(in, pixel, scale * residual[p],
                         [&](int64_t side, int64_t c, scalar_t gradient) {
                           out[(3 * side + c) * in.plane + pixel] += gradient;
                         });
    }
  });
}

}  // namespace jade::losses::cpu
