// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_consistency.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/interrupt.h"
#include "jade/events/counts.h"
#include "jade/imaging/color.h"

namespace jade::data {
namespace {

constexpr double kDark = 0.04, kBright = 0.96;
// least brightness of a usable pixel, in standard deviations of the noise
constexpr double kDarkNoises = 2.5;
constexpr double kMostFrameNoise = 0.1;
constexpr double kMostChange = 3;  // largest change of a logarithm from frame to frame
/// Least standard deviation of a change that events do not explain, in thresholds.
constexpr double kLeastRemainder = 0.2;
constexpr int64_t kMoments = 17;  // per exposure
// threshold of the Huber weight, in standard deviations of the residual
constexpr double kHuber = 2;
constexpr double kSmallest = 0.01, kLargest = 3;
constexpr double kLongestStep_us = 20000;
constexpr int64_t kGroups = 8;  // groups of pixels for the jackknife
constexpr int64_t kFewPixels = 100;

/// Evenly chosen pixels among those that have events.
torch::Tensor chosen_pixels(const events::EventStream& events, const events::ImageSize& size,
                            int64_t most) {
  const torch::Tensor active =
      (events::event_density(events, size).flatten() >= 1).nonzero().flatten();
  const int64_t count = std::min(active.numel(), most);
  if (count == 0) return active;
  const torch::Tensor places =
      (torch::arange(count, torch::kFloat64) * (double(active.numel()) / double(count)))
          .to(torch::kInt64);
  return active.index_select(0, places);
}

/// Assigns each event to one pixel. Sharing it among the four pixels around its rectified place
/// would smooth the counts and bias thresholds high by a sixth.
events::EventStream at_whole_pixels(const events::EventStream& events,
                                    const events::TimeWindow& span) {
  const events::EventStream near = events.slice(span);
  return {near.x().round(), near.y().round(), near.t_us(), near.polarity()};
}

double median_of(const torch::Tensor& values) {
  return values.numel() == 0 ? 0 : values.median().item<double>();
}

/// The prediction, linear in each pixel's thresholds: change = X θ + (change − model).
struct Linear {
  torch::Tensor by_threshold;  ///< X, [P,V−1,2]
  torch::Tensor model;         ///< [P,V−1]
};

/// @param until  [2,P,V,K] events
Linear linearise(const torch::Tensor& until, const torch::Tensor& thresholds) {
  torch::Tensor rule = torch::full({kMoments}, 1.0 / double(kMoments - 1), torch::kFloat64);
  rule[0] *= 0.5, rule[kMoments - 1] *= 0.5;
  const torch::Tensor positive = thresholds.select(1, 0).reshape({-1, 1, 1});
  const torch::Tensor negative = thresholds.select(1, 1).reshape({-1, 1, 1});
  const torch::Tensor j = positive * until[0] - negative * until[1] + rule.log();
  const torch::Tensor weight = torch::softmax(j, 2);
  const torch::Tensor x =
      torch::stack({(weight * until[0]).sum(2).diff(), -(weight * until[1]).sum(2).diff()}, 2);
  return {x, torch::logsumexp(j, 2).diff()};
}

/// The mixed model: θ of a pixel ~ N(mean, spread²), change ~ N(X θ, noise² + ν² by_noise).
struct Mixed {
  torch::Tensor mean = torch::full({2}, 0.25, torch::kFloat64);
  torch::Tensor variance = torch::full({2}, 0.03 * 0.03, torch::kFloat64);
  double noise = 0.1, frame_noise = 0;
  torch::Tensor thresholds;  ///< [P,2], the mean for pixels without information

  double threshold() const { return mean.mean().item<double>(); }
};

/// Fits the noise of a change as noise² + ν² q to the medians of residuals in bins of q.
void fit_noise(const torch::Tensor& residual, const torch::Tensor& q, Mixed& model) {
  constexpr int64_t kBins = 8;
  const torch::Tensor order = q.argsort();
  double sw = 0, sq = 0, sqq = 0, sv = 0, sqv = 0;
  for (int64_t k = 0; k < kBins; ++k) {
    const int64_t begin = order.numel() * k / kBins, end = order.numel() * (k + 1) / kBins;
    if (end <= begin) continue;
    const torch::Tensor some = order.slice(0, begin, end);
    const double deviation = median_of(residual.index_select(0, some).abs()) / 0.6745;
    const double at = median_of(q.index_select(0, some)), v = deviation * deviation + 1e-8;
    const double w = 1 / (v * v);  // weight of a variance, whose error is proportional to it
    sw += w, sq += w * at, sqq += w * at * at, sv += w * v, sqv += w * at * v;
  }
  const double spread = sw * sqq - sq * sq;
  double slope = spread > 1e-9 * sw * sqq ? (sw * sqv - sq * sv) / spread : 0;
  slope = std::clamp(slope, 0.0, kMostFrameNoise * kMostFrameNoise);
  double constant = sw > 0 ? (sv - slope * sq) / sw : 0;
  if (constant < 0) {
    constant = 0;
    slope = std::clamp(sqv / sqq, 0.0, kMostFrameNoise * kMostFrameNoise);
  }
  // Add a tenth for the variance that the fit of the pixels' own thresholds absorbs.
  model.noise = std::max(std::sqrt(1.1 * constant), kLeastRemainder * model.threshold());
  model.frame_noise = std::sqrt(slope);
}

/// Sets the median residual of each pair of frames.
void set_steps(const torch::Tensor& residual, const torch::Tensor& usable, ConsistencyFit& fit) {
  fit.steps.clear(), fit.step_errors.clear();
  for (int64_t v = 0; v < residual.size(1); ++v) {
    const torch::Tensor some = residual.select(1, v).masked_select(usable.select(1, v));
    fit.steps.push_back(0), fit.step_errors.push_back(INFINITY);
    if (some.numel() < kFewPixels) continue;
    const double median = median_of(some);
    fit.steps.back() = median;
    // Standard error of a median; nine pixels count as one, because neighbours have correlated
    // errors.
    fit.step_errors.back() =
        1.2533 * median_of((some - median).abs()) / 0.6745 / std::sqrt(double(some.numel()) / 9);
  }
}

/// Mean thresholds without each group of pixels in turn, and their standard error.
events::Thresholds jackknife(const torch::Tensor& left, const torch::Tensor& right) {
  const int64_t count = left.size(0);
  const torch::Tensor all_left = left.sum(0), all_right = right.sum(0);
  std::vector<torch::Tensor> means;
  for (int64_t g = 0; g < kGroups; ++g) {
    // Whole bands of the image, because neighbours are correlated.
    const int64_t begin = count * g / kGroups, end = count * (g + 1) / kGroups;
    means.push_back(torch::linalg_solve(all_left - left.slice(0, begin, end).sum(0),
                                        all_right - right.slice(0, begin, end).sum(0))
                        .flatten());
  }
  const torch::Tensor scatter = torch::stack(means);
  const torch::Tensor error =
      ((scatter - scatter.mean(0)).square().sum(0) * (double(kGroups - 1) / double(kGroups)))
          .sqrt();
  return {error[0].item<double>(), error[1].item<double>()};
}

}  // namespace

PixelCurves::PixelCurves(const events::EventStream& events, const events::ImageSize& size,
                         const torch::Tensor& pixels)
    : pixels_(pixels.numel()) {
  std::vector<int64_t> number(size_t(size.height * size.width), -1);
  for (int64_t i = 0; i < pixels_; ++i) number[size_t(pixels[i].item<int64_t>())] = i;
  struct Last {
    double t_us = -1e18;
    int8_t polarity = 0;
  };
  std::vector<Last> last(static_cast<size_t>(pixels_));
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p = events.polarity().const_data_ptr<int8_t>();
  const auto pixel_of = [&](int64_t i) {
    const bool inside =
        x[i] >= 0 && x[i] < float(size.width) && y[i] >= 0 && y[i] < float(size.height);
    return inside ? number[size_t(int64_t(y[i]) * size.width + int64_t(x[i]))] : -1;
  };
  const auto add = [&](int64_t pixel, int64_t i) {
    Last& before = last[size_t(pixel)];
    const double time = double(t[i]);
    double wait = std::min(time - before.t_us, kLongestStep_us);
    // After a change of sign, most of that time passed before the change began.
    if (before.polarity != p[i]) wait *= 0.25;
    steps_.push_back({pixel, time - wait, time, p[i] > 0});
    before = {time, p[i]};
  };
  // Few events are at these pixels; all threads search for them.
  const int64_t parts = (events.size() + events::kEventGrain - 1) / events::kEventGrain;
  std::vector<std::vector<int64_t>> found(static_cast<size_t>(parts));
  at::parallel_for(0, parts, 1, [&](int64_t part, int64_t last_part) {
    for (; part < last_part; ++part) {
      const int64_t begin = part * events::kEventGrain;
      const int64_t end = std::min(begin + events::kEventGrain, events.size());
      for (int64_t i = begin; i < end; ++i) {
        if (pixel_of(i) >= 0) found[size_t(part)].push_back(i);
      }
    }
  });
  for (const std::vector<int64_t>& part : found) {
    for (const int64_t i : part) add(pixel_of(i), i);
  }
}

torch::Tensor PixelCurves::until(const std::vector<double>& times_us) const {
  const auto count = int64_t(times_us.size());
  std::vector<int64_t> order(times_us.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int64_t a, int64_t b) { return times_us[size_t(a)] < times_us[size_t(b)]; });
  std::vector<double> times;
  for (const int64_t i : order) times.push_back(times_us[size_t(i)]);
  torch::Tensor rise = torch::zeros({2, pixels_, count}, torch::kFloat64);
  double* const out = rise.data_ptr<double>();
  for (const Step& step : steps_) {
    double* const row = out + ((step.positive ? 0 : 1) * pixels_ + step.pixel) * count;
    auto at = std::upper_bound(times.begin(), times.end(), step.begin_us);
    double so_far = 0;
    for (; at != times.end() && so_far < 1; ++at) {
      const double part =
          step.end_us > *at ? (*at - step.begin_us) / (step.end_us - step.begin_us) : 1;
      row[at - times.begin()] += part - so_far;
      so_far = part;
    }
  }
  std::vector<int64_t> place(order.size());
  for (size_t i = 0; i < order.size(); ++i) place[size_t(order[i])] = int64_t(i);
  return rise.cumsum(2).index_select(2, torch::tensor(place, torch::kInt64));
}

/// Difference between frames and the prediction from events, [P,V−1] each.
struct Residuals {
  torch::Tensor value;     ///< residual of the log intensity, at the predicted brightness
  torch::Tensor by_noise;  ///< coefficient of ν² in its variance
  torch::Tensor usable;    ///< bool
};

/// @param gray,smooth  [P,V] frames, and their means over 3x3 pixels, both with the sensor's offset
/// @param model        [P,V−1] predicted changes
Residuals residuals(const torch::Tensor& gray, const torch::Tensor& smooth,
                    const torch::Tensor& model, double frame_noise) {
  const int64_t count = gray.size(1);
  const auto before = [&](const torch::Tensor& each) { return each.slice(1, 0, count - 1); };
  const auto after = [&](const torch::Tensor& each) { return each.slice(1, 1); };
  const torch::Tensor half = (0.5 * model.clamp(-kMostChange, kMostChange)).exp();
  // Selects by the prediction, not by each frame: the pixel's own noise would bias the selection.
  const torch::Tensor level = (before(smooth) + after(smooth)) / (half + 1 / half);
  const double darkest = std::max(kDark, kDarkNoises * frame_noise);
  const torch::Tensor scale = level.clamp_min(darkest);
  return {(after(gray) / half - before(gray) * half) / scale,
          (half.square() + 1 / half.square()) / scale.square(),
          (level > darkest) & (before(smooth) < kBright) & (after(smooth) < kBright)};
}

EventConsistency::EventConsistency(const std::vector<torch::Tensor>& frames,
                                   const std::vector<bool>& is_neighbour,
                                   const events::EventStream& events,
                                   const events::TimeWindow& span,
                                   const ConsistencyOptions& options)
    : options_(options), curves_({}, {}, torch::empty({0}, torch::kInt64)) {
  JADE_CHECK(frames.size() >= 2 && is_neighbour.size() + 1 == frames.size(),
             "expected frames and one fewer gaps between them, found ", frames.size(), " and ",
             is_neighbour.size());
  const events::ImageSize size{frames.front().size(-2), frames.front().size(-1)};
  const events::EventStream whole = at_whole_pixels(events, span);
  pixels_ = chosen_pixels(whole, size, options.pixels);
  curves_ = PixelCurves(whole, size, pixels_);
  std::vector<torch::Tensor> grays, smooths;
  for (const torch::Tensor& frame : frames) {
    const torch::Tensor gray = imaging::gray(frame).reshape({1, 1, size.height, size.width});
    const torch::Tensor smooth =
        at::avg_pool2d(gray, 3, 1, 1, /*ceil_mode=*/false, /*count_include_pad=*/false);
    grays.push_back(gray.flatten().index_select(0, pixels_).to(torch::kFloat64));
    smooths.push_back(smooth.flatten().index_select(0, pixels_).to(torch::kFloat64));
  }
  gray_ = torch::stack(grays, 1);
  smooth_ = torch::stack(smooths, 1);
  neighbour_ = torch::empty({int64_t(is_neighbour.size())}, torch::kBool);
  for (size_t i = 0; i < is_neighbour.size(); ++i) neighbour_[int64_t(i)] = bool(is_neighbour[i]);
}

ConsistencyFit EventConsistency::fit(const std::vector<events::TimeWindow>& exposures) const {
  const torch::NoGradGuard no_grad;
  ConsistencyFit fit;
  const auto views = int64_t(exposures.size());
  JADE_CHECK(views == gray_.size(1), "expected ", gray_.size(1), " exposures, found ", views);
  std::vector<double> times;
  for (const events::TimeWindow& window : exposures) {
    for (int64_t k = 0; k < kMoments; ++k) {
      times.push_back(double(window.begin_us) +
                      double(window.duration_us()) * double(k) / double(kMoments - 1));
    }
  }
  if (pixels_.numel() < kFewPixels) return fit;
  const torch::Tensor gray = gray_ + options_.log_offset, smooth = smooth_ + options_.log_offset;
  const torch::Tensor until =
      curves_.until(times).reshape({2, pixels_.numel(), views, kMoments}).contiguous();
  Mixed model;
  model.thresholds = model.mean.repeat({pixels_.numel(), 1});
  for (int round = 0; round < options_.rounds; ++round) {
    throw_if_interrupted();
    const Linear linear = linearise(until, model.thresholds);
    const torch::Tensor& x = linear.by_threshold;
    const Residuals frames = residuals(gray, smooth, linear.model, model.frame_noise);
    const torch::Tensor said = (x * model.thresholds.unsqueeze(1)).sum(2);
    const torch::Tensor usable = frames.usable & neighbour_;
    set_steps(frames.value, usable, fit);
    const torch::Tensor here = frames.value - torch::tensor(fit.steps, torch::kFloat64);
    const torch::Tensor target = here + said;
    const torch::Tensor active = usable & (x.abs().sum(2) >= 0.5);
    const torch::Tensor index = (active.sum(1) >= 2).nonzero().flatten();
    fit.pixels = index.numel();
    if (fit.pixels < kFewPixels) return fit;
    const torch::Tensor variance =
        model.noise * model.noise + model.frame_noise * model.frame_noise * frames.by_noise;
    const torch::Tensor weight =
        active * (kHuber * variance.sqrt() / here.abs().clamp_min(1e-9)).clamp_max(1) / variance;
    const torch::Tensor weighted = x * weight.unsqueeze(2);
    const torch::Tensor gram = weighted.transpose(1, 2).matmul(x).index_select(0, index);
    const torch::Tensor seen =
        weighted.transpose(1, 2).matmul(target.unsqueeze(2)).index_select(0, index);  // [p,2,1]
    // With events of one polarity, the other threshold is undetermined.
    if (gram.sum(0).diagonal().min().item<double>() <= 0) return fit;
    const torch::Tensor precision = torch::diag(1 / model.variance);
    const torch::Tensor covariance = torch::linalg_inv(gram + precision);
    // Xᵀ V⁻¹ X and Xᵀ V⁻¹ y of V = noise² + X spread² Xᵀ, without forming V.
    const torch::Tensor left = precision - precision.matmul(covariance).matmul(precision);
    const torch::Tensor right = precision.matmul(covariance).matmul(seen);
    const torch::Tensor mean =
        torch::linalg_solve(left.sum(0), right.sum(0)).flatten().clamp(kSmallest, kLargest);
    const torch::Tensor own =
        covariance.matmul(seen + precision.matmul(mean.unsqueeze(1))).squeeze(2);
    if (round + 1 == options_.rounds) {
      // Terms of the marginal likelihood, with all pixels' thresholds integrated out.
      const torch::Tensor rest = (target - (x * mean).sum(2)).index_select(0, index);
      const torch::Tensor w = weight.index_select(0, index);
      const torch::Tensor xs = x.index_select(0, index);
      const torch::Tensor b = (xs * (w * rest).unsqueeze(2)).sum(1, true).transpose(1, 2);
      const torch::Tensor counted = active.index_select(0, index).to(torch::kFloat64);
      // Per pixel, [p].
      const torch::Tensor squares =
          (w * rest.square()).sum(1) - b.transpose(1, 2).matmul(covariance).matmul(b).flatten();
      const torch::Tensor logs =
          (variance.index_select(0, index).log() * counted).sum(1) +
          torch::logdet(torch::eye(2, torch::kFloat64) + gram.matmul(torch::diag(model.variance)));
      fit.loss = ((squares + logs).sum() / counted.sum()).item<double>();
      for (int64_t g = 0; g < kGroups; ++g) {
        const int64_t begin = fit.pixels * g / kGroups, end = fit.pixels * (g + 1) / kGroups;
        fit.part_losses.push_back(((squares + logs).slice(0, begin, end).sum() /
                                   counted.slice(0, begin, end).sum().clamp_min(1))
                                      .item<double>());
      }
      fit.standard_error = jackknife(left, right);
    }
    model.mean = mean;
    model.variance = ((own - mean).square() + covariance.diagonal(0, 1, 2))
                         .mean(0)
                         .clamp(1e-5, kLargest * kLargest);
    model.thresholds = mean.repeat({x.size(0), 1});
    model.thresholds.index_copy_(0, index, own.clamp(kSmallest, kLargest));
    const torch::Tensor counted = active.index_select(0, index);
    const torch::Tensor left_over = (target - (x * model.thresholds.unsqueeze(1)).sum(2))
                                        .index_select(0, index)
                                        .masked_select(counted);
    fit_noise(left_over, frames.by_noise.index_select(0, index).masked_select(counted), model);
    const torch::Tensor change = target.index_select(0, index).masked_select(counted);
    const double photon =
        model.frame_noise * model.frame_noise *
        frames.by_noise.index_select(0, index).masked_select(counted).sum().item<double>();
    // Subtract the noise of the frames, which the events do not cause.
    fit.unexplained = std::max(0.0, left_over.square().sum().item<double>() - photon) /
                      std::max(1e-12, change.square().sum().item<double>() - photon);
  }
  const torch::Tensor spread = model.variance.sqrt();
  fit.thresholds = {model.mean[0].item<double>(), model.mean[1].item<double>()};
  fit.spread = {spread[0].item<double>(), spread[1].item<double>()};
  fit.noise = model.noise;
  fit.frame_noise = model.frame_noise;
  fit.solved = true;
  return fit;
}

}  // namespace jade::data
