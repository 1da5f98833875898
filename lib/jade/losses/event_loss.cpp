// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/event_loss.h"

#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/check.h"
#include "jade/kernel/on_cuda.h"
#include "jade/losses/event_loss_kernels.h"

namespace jade::losses {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

class EventLossFunction : public torch::autograd::Function<EventLossFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, const torch::Tensor& renders,
                               const EventPair& others) {
    EventPair events = others;
    events.renders = renders;
    const auto options = renders.options();
    torch::Tensor loss = torch::empty({}, options);
    torch::Tensor residuals = torch::empty({events.pixels.numel()}, options.dtype(torch::kFloat64));
    torch::Tensor weight = torch::empty({1}, options.dtype(torch::kFloat64));
    if (renders.is_cuda()) {
      kernel::on_cuda("the loss of the events",
                      [&] { cuda::event_loss(events, loss, residuals, weight); });
    } else {
      cpu::event_loss(events, loss, residuals, weight);
    }
    context->save_for_backward(
        {renders, events.counts, events.pixels, events.color_filter, residuals, weight});
    return loss;
  }

  static variable_list backward(AutogradContext* context, const variable_list& gradients) {
    const variable_list saved = context->get_saved_variables();
    EventPair events;
    events.renders = saved[0];
    events.counts = saved[1];
    events.pixels = saved[2];
    events.color_filter = saved[3];
    torch::Tensor of_renders = torch::zeros_like(saved[0]);
    const torch::Tensor of_loss = gradients[0].contiguous();
    if (of_renders.is_cuda()) {
      kernel::on_cuda("the loss of the events", [&] {
        cuda::event_loss_gradient(events, saved[4], saved[5], of_loss, of_renders);
      });
    } else {
      cpu::event_loss_gradient(events, saved[4], saved[5], of_loss, of_renders);
    }
    return {of_renders, torch::Tensor()};
  }
};

}  // namespace

torch::Tensor event_loss(const EventPair& events) {
  const torch::Tensor& renders = events.renders;
  check_shape(renders, "renders before and after the events", {2, 3, -1, -1});
  if (renders.is_cuda()) check_dtype(renders, "renders on a GPU", torch::kFloat32);
  check_shape(events.counts, "event counts", {renders.size(2), renders.size(3)});
  check_shape(events.pixels, "event pixels", {-1});
  check_dtype(events.pixels, "event pixels", torch::kInt64);
  check_same_device(renders, "renders", events.pixels, "event pixels");
  check_same_device(renders, "renders", events.counts, "event counts");
  EventPair plain = events;
  plain.renders = torch::Tensor();
  plain.counts = events.counts.to(renders.scalar_type()).contiguous();
  plain.pixels = events.pixels.contiguous();
  if (events.color_filter.defined()) {
    check_shape(events.color_filter, "color filter", {renders.size(2), renders.size(3), 3});
    check_dtype(events.color_filter, "color filter", torch::kBool);
    check_same_device(renders, "renders", events.color_filter, "color filter");
    plain.color_filter = events.color_filter.contiguous();
  }
  return EventLossFunction::apply(renders.contiguous(), plain);
}

}  // namespace jade::losses
