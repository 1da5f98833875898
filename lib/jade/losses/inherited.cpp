// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/inherited.h"

#include <cmath>

#include "jade/core/check.h"
#include "jade/imaging/color.h"

namespace jade::losses {
namespace {

constexpr double kLinLogKnee = 20;
constexpr double kColorWeights[3] = {0.4, 0.2, 0.4};

/// The sampled pixels of an [C,H,W] image, [C,P] in double: differences of logs lose digits.
torch::Tensor sample(const torch::Tensor& image, const torch::Tensor& pixels) {
  return image.flatten(1).index_select(1, pixels).to(torch::kFloat64);
}

/// Predicted log change of the sampled pixels, [P].
torch::Tensor log_change(const EventPair& events, const torch::Tensor& filter) {
  const bool color = filter.defined();
  const auto level = [&](const torch::Tensor& image) {
    return lin_log(255 * sample(color ? image : imaging::gray(image), events.pixels));
  };
  const torch::Tensor change = level(events.after) - level(events.before);
  return color ? (change * filter).sum(0) : change.squeeze(0);
}

/// g of an image that may have been through it.
torch::Tensor in_gray(const torch::Tensor& image) {
  return image.size(0) == 1 ? image : imaging::gray(image);
}

}  // namespace

imaging::L1SsimPair blur_pair(const torch::Tensor& mean_render, const imaging::SsimTarget& blurry) {
  return {mean_render, blurry};
}

imaging::L1SsimPair edi_gray_pair(const torch::Tensor& toned_render,
                                  const torch::Tensor& toned_blurry,
                                  const torch::Tensor& edi_factor, const Follow& follow) {
  const torch::Tensor render = in_gray(toned_render);
  const torch::Tensor target = in_gray(toned_blurry) * edi_factor;
  return {render, {follow ? follow(target, render) : target, {}, {}}};
}

imaging::L1SsimPair edi_color_pair(const torch::Tensor& render, const torch::Tensor& blurry,
                                   const torch::Tensor& edi_factor, const Follow& follow) {
  const torch::Tensor target = blurry * edi_factor;
  return {render, {follow ? follow(target, render) : target, {}, {}}};
}

imaging::L1SsimPair simulation_pair(const torch::Tensor& toned_render,
                                    const torch::Tensor& toned_mean,
                                    const torch::Tensor& edi_factor) {
  return {in_gray(toned_render), {in_gray(toned_mean) * edi_factor, {}, {}}};
}

imaging::L1SsimPair intensity_pair(const torch::Tensor& mean_toned,
                                   const torch::Tensor& toned_blurry) {
  return {mean_toned, {toned_blurry, {}, {}}};
}

torch::Tensor lin_log(const torch::Tensor& x) {
  const torch::Tensor line = x * (std::log(kLinLogKnee) / kLinLogKnee);
  return torch::where(x <= kLinLogKnee, line, x.clamp_min(kLinLogKnee).log());
}

torch::Tensor event_loss(const EventPair& events) {
  check_shape(events.before, "render before the events", {3, -1, -1});
  check_shape(events.after, "render after the events", events.before.sizes().vec());
  check_shape(events.counts, "event counts", {events.before.size(1), events.before.size(2)});
  check_dtype(events.pixels, "event pixels", torch::kInt64);
  const torch::Tensor measured = sample(events.counts.unsqueeze(0), events.pixels).squeeze(0);
  torch::Tensor filter;
  torch::Tensor weights = torch::ones_like(measured);
  if (events.color_filter.defined()) {
    filter = sample(events.color_filter.permute({2, 0, 1}), events.pixels);
    torch::Tensor channel = torch::ones({3, 1}, measured.options());
    if (events.weighted_colors) {
      for (int64_t c = 0; c < 3; ++c) channel.narrow(0, c, 1).fill_(kColorWeights[c]);
    }
    weights = (filter * channel).sum(0);
  }
  const torch::Tensor change = log_change(events, filter);
  const auto one_sign = [&](const torch::Tensor& selected, double threshold) {
    return (weights * selected * (change / threshold - measured).square()).sum();
  };
  const torch::Tensor sum = one_sign(measured > 0, events.threshold_positive) +
                            one_sign(measured < 0, events.threshold_negative);
  return (sum / weights.sum().clamp_min(1e-12)).to(events.before.scalar_type());
}

}  // namespace jade::losses
