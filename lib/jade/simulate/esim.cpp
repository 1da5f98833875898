// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/esim.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <utility>

#include "jade/core/check.h"
#include "jade/core/random.h"
#include "jade/simulate/fixed_pattern.h"

namespace jade::simulate {
namespace {

constexpr int64_t kBandRows = 8;
constexpr double kSmallest = 0.01;  // smallest threshold of a pixel
constexpr double kNever = -1e18;

template <class T>
torch::Tensor adopt(std::vector<T>&& values, torch::ScalarType type) {
  auto owner = std::make_shared<std::vector<T>>(std::move(values));
  const auto size = static_cast<int64_t>(owner->size());
  if (size == 0) return torch::empty({0}, type);
  return torch::from_blob(
      owner->data(), {size}, [owner](void*) {}, type);
}

float spread(float mean, double deviation, world::Draw& draw) {
  return static_cast<float>(std::max(kSmallest, mean + deviation * draw.normal()));
}

}  // namespace

EventSensor::EventSensor(const EventSensorOptions& options, int64_t width, int64_t height,
                         uint64_t seed)
    : options_(options), width_(width), height_(height), burst_draw_(derive_seed(seed, "bursts")) {
  const auto pixels = static_cast<size_t>(width * height);
  input_.resize(pixels), level_.resize(pixels), reference_.resize(pixels);
  last_us_.assign(pixels, kNever);
  for (size_t i = 0; i < pixels; ++i) {
    draw_.emplace_back(seed, i);
    on_.push_back(
        spread(static_cast<float>(options.threshold_positive), options.threshold_spread, draw_[i]));
    off_.push_back(
        spread(static_cast<float>(options.threshold_negative), options.threshold_spread, draw_[i]));
    hot_.push_back(draw_[i].uniform() < options.hot_fraction);
    hazard_.push_back(static_cast<float>(draw_[i].exponential()));
  }
  if (options.dead_columns > 0) {
    dead_ = drawn_columns(options.dead_columns, width, derive_seed(seed, "dead columns"));
  }
  if (options.latency_us > 0 || options.dark_latency_us > 0) latest_us_.resize(pixels, INT64_MIN);
  if (options.burst_hz > 0) next_burst_us_ = 1e6 * burst_draw_.exponential() / options.burst_hz;
}

std::vector<double> EventSensor::bursts_until(double end_us) {
  std::vector<double> bursts;
  while (options_.burst_hz > 0 && next_burst_us_ < end_us) {
    bursts.push_back(next_burst_us_);
    next_burst_us_ += 1e6 * burst_draw_.exponential() / options_.burst_hz;
  }
  return bursts;
}

void EventSensor::feed(const std::vector<float>& intensity, int64_t t_us) {
  JADE_CHECK(intensity.size() == level_.size(), "intensity: expected ", level_.size(),
             " pixels, found ", intensity.size());
  JADE_CHECK(!started_ || t_us > now_us_, "t_us: expected a time after ", now_us_, ", found ",
             t_us);
  const auto eps = static_cast<float>(options_.log_eps);
  if (!started_) {
    for (size_t i = 0; i < intensity.size(); ++i) {
      reference_[i] = input_[i] = level_[i] = std::log(std::max(intensity[i], 0.0f) + eps);
    }
    started_ = true, now_us_ = t_us;
    return;
  }
  const Span span{static_cast<double>(now_us_), static_cast<double>(t_us)};
  const std::vector<double> bursts = bursts_until(span.end_us);
  const int64_t bands = (height_ + kBandRows - 1) / kBandRows;
  std::vector<std::vector<Event>> sent(static_cast<size_t>(bands));
  at::parallel_for(0, bands, 1, [&](int64_t first, int64_t last) {
    for (int64_t band = first; band < last; ++band) {
      auto& out = sent[static_cast<size_t>(band)];
      const auto begin = static_cast<size_t>(band * kBandRows * width_);
      const auto end = static_cast<size_t>(std::min((band + 1) * kBandRows, height_) * width_);
      for (size_t i = begin; i < end; ++i) {
        const float input = std::log(std::max(intensity[i], 0.0f) + eps);
        const float target = low_pass(i, input, intensity[i], span.end_us - span.begin_us);
        advance_through(bursts, i, target, intensity[i], span, out);
        input_[i] = input, level_[i] = target;
      }
    }
  });
  append(sent);
  now_us_ = t_us;
}

// Exact response of y' = (x − y)/τ to an input that is linear from x0 to x1.
float EventSensor::low_pass(size_t i, float x1, float intensity, double duration_us) {
  if (options_.cutoff_hz <= 0) return x1;
  const double cutoff = options_.cutoff_hz * std::max(0.1, static_cast<double>(intensity));
  const double tau_us = 1e6 / (2 * 3.141592653589793 * cutoff);
  const double slope = (x1 - input_[i]) / duration_us;
  const double kept = std::exp(-duration_us / tau_us);
  return static_cast<float>(x1 - slope * tau_us + (level_[i] - input_[i] + slope * tau_us) * kept);
}

void EventSensor::advance_through(const std::vector<double>& bursts, size_t i, float target,
                                  float intensity, Span span, std::vector<Event>& out) {
  for (const double burst_us : bursts) {
    if (burst_us <= span.begin_us) continue;  // before the first picture
    const auto share =
        static_cast<float>((burst_us - span.begin_us) / (span.end_us - span.begin_us));
    const float reached = level_[i] + share * (target - level_[i]);
    advance_pixel(i, reached, intensity, {span.begin_us, burst_us}, out);
    level_[i] = reached, span.begin_us = burst_us;
    send(i, burst_us, intensity, draw_[i].uniform() < 0.5 ? int8_t{1} : int8_t{-1}, out);
    reference_[i] = reached + options_.leak_hz * 1e-6 * on_[i] * burst_us;
  }
  advance_pixel(i, target, intensity, span, out);
}

// The leak lowers ref at a constant rate, which is equivalent to raising L: both ends of the line
// are raised by the accumulated leak.
void EventSensor::advance_pixel(size_t i, float target, float intensity, const Span& span,
                                std::vector<Event>& out) {
  const double leak = options_.leak_hz * 1e-6 * on_[i];
  const double from = level_[i] + leak * span.begin_us, to = target + leak * span.end_us;
  const double slope = (to - from) / (span.end_us - span.begin_us);
  const auto cross_until = [&](double t_us) {
    const double reached = t_us >= span.end_us ? to : from + slope * (t_us - span.begin_us);
    const auto polarity = static_cast<int8_t>(slope > 0 ? 1 : -1);
    const double step = slope > 0 ? on_[i] : off_[i];
    while (slope != 0) {
      const double next = reference_[i] + polarity * step;
      if ((reached - next) * polarity < 0) break;
      const double t = std::max(span.begin_us, span.begin_us + (next - from) / slope);
      send(i, std::min(t, t_us), intensity, polarity, out);
      reference_[i] = next;
    }
    return reached;
  };
  const double rate_hz = (hot_[i] ? options_.hot_hz : 0) +
                         options_.shot_hz * (1 - 0.75 * std::min(1.0f, std::max(0.0f, intensity)));
  double t = span.begin_us;
  while (rate_hz > 0) {
    const double wait_us = hazard_[i] / rate_hz * 1e6;
    if (t + wait_us > span.end_us) {
      hazard_[i] -= static_cast<float>((span.end_us - t) * rate_hz * 1e-6);
      break;
    }
    t += wait_us;
    hazard_[i] = static_cast<float>(draw_[i].exponential());
    const double now = cross_until(t);
    const bool on = hot_[i] || draw_[i].uniform() < 0.5;
    send(i, t, intensity, on ? int8_t{1} : int8_t{-1}, out);
    reference_[i] = now;
  }
  cross_until(span.end_us);
}

// The photoreceptor is slower with less light.
double EventSensor::latency_us(float intensity) const {
  constexpr float kDark = 0.1f;
  return options_.latency_us + options_.dark_latency_us * kDark / std::max(intensity, kDark);
}

void EventSensor::send(size_t i, double t_us, float intensity, int8_t polarity,
                       std::vector<Event>& out) {
  if (t_us - last_us_[i] < static_cast<double>(options_.refractory_us)) return;
  last_us_[i] = t_us;
  if (!dead_.empty() && dead_[i % static_cast<size_t>(width_)]) return;
  int64_t stamp_us = std::llround(t_us);
  if (!latest_us_.empty()) {  // events of a pixel stay in order
    stamp_us = std::max<int64_t>(std::llround(t_us + latency_us(intensity)), latest_us_[i]);
    latest_us_[i] = stamp_us;
  }
  out.push_back({stamp_us, static_cast<int32_t>(i), polarity});
}

void EventSensor::append(std::vector<std::vector<Event>>& bands) {
  std::vector<Event> all;
  for (auto& band : bands) all.insert(all.end(), band.begin(), band.end());
  std::stable_sort(all.begin(), all.end(),
                   [](const Event& a, const Event& b) { return a.t_us < b.t_us; });
  for (const Event& event : all) {
    x_.push_back(static_cast<float>(event.pixel % width_));
    y_.push_back(static_cast<float>(event.pixel / width_));
    t_us_.push_back(event.t_us);
    polarity_.push_back(event.polarity);
  }
}

// Late events can overtake each other between pictures.
void EventSensor::sort_by_time() {
  std::vector<size_t> order(t_us_.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return t_us_[a] < t_us_[b]; });
  const auto reorder = [&](auto& values) {
    auto sorted = values;
    for (size_t i = 0; i < order.size(); ++i) sorted[i] = values[order[i]];
    values.swap(sorted);
  };
  reorder(x_), reorder(y_), reorder(t_us_), reorder(polarity_);
}

events::EventStream EventSensor::take() {
  if (!latest_us_.empty()) sort_by_time();
  events::EventStream stream(
      adopt(std::move(x_), torch::kFloat32), adopt(std::move(y_), torch::kFloat32),
      adopt(std::move(t_us_), torch::kInt64), adopt(std::move(polarity_), torch::kInt8));
  x_.clear(), y_.clear(), t_us_.clear(), polarity_.clear();
  return stream;
}

}  // namespace jade::simulate
