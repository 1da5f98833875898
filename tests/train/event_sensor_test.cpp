// SPDX-License-Identifier: Apache-2.0
#include "jade/train/event_sensor.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/events/ramps.h"
#include "jade/geometry/quadrature.h"
#include "jade/losses/objective.h"
#include "train/bench.h"

using namespace jade;

namespace {

constexpr events::ImageSize kFrame{20, 24};
constexpr events::TimeWindow kExposure{0, 80000};
constexpr events::Thresholds kConfigured{0.25, 0.25};
constexpr int64_t kRenders = 9, kIntegralParts = 64;

/// What the sensor that recorded the events does and the configuration does not say.
struct TrueSensor {
  double threshold = 0.25;
  int64_t late_us = 0;        ///< stamps beyond the frames' clock
  torch::Tensor gain = {};    ///< [H,W]
  bool counts_levels = true;  ///< an event at each level crossed, else where a threshold is passed
  int64_t ramp_us = 0;        ///< events are read with such a reach
};

/// [H,W] of a pattern that drifts eight pixels in the exposure, above a part that never changes.
torch::Tensor brightness(double t_us) {
  const auto y = torch::arange(kFrame.height, torch::kFloat64).view({-1, 1});
  const auto x = torch::arange(kFrame.width, torch::kFloat64).view({1, -1}) + 1e-4 * t_us;
  const auto waves = (0.6 * x + 0.2 * y).sin() * (0.4 * y).cos() + 0.5 * (0.45 * x - 0.5 * y).cos();
  const auto moving = 0.02 + 0.56 * (1.7 * (waves - 1.5)).exp();
  return torch::where(y < 16, moving, torch::full_like(moving, 0.5));
}

/// The sharp images at the moments [K] of the exposure, [K,3,H,W] in one gray.
torch::Tensor sharp_images(const torch::Tensor& u) {
  std::vector<torch::Tensor> images;
  for (int64_t k = 0; k < u.size(0); ++k) {
    const double t_us = u[k].item<double>() * double(kExposure.end_us);
    images.push_back(brightness(t_us).to(torch::kFloat32).expand({3, -1, -1}));
  }
  return torch::stack(images);
}

/// Events on a grid of 100 µs, from 20 ms before the exposure to 20 ms after it; each pixel's
/// reference starts anywhere within a threshold.
events::EventStream recorded(const TrueSensor& sensor) {
  auto generator = make_generator(3, "references");
  auto reference = brightness(-20000).log();
  const auto gain = sensor.gain.defined() ? sensor.gain : torch::ones_like(reference);
  const auto threshold = sensor.threshold * gain;
  const double lowest = sensor.counts_levels ? -1 : -0.5;
  reference += (torch::rand(reference.sizes(), generator, torch::kFloat64) + lowest) * threshold;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int64_t now = -20000; now < 100000; now += 100) {
    const auto passed = (brightness(double(now)).log() - reference) / threshold;
    const auto steps = sensor.counts_levels ? passed.floor() : passed.trunc();
    reference += steps * threshold;
    const auto at = steps.nonzero();
    for (int64_t i = 0; i < at.size(0); ++i) {
      const auto row = at[i][0].item<int64_t>(), column = at[i][1].item<int64_t>();
      const auto count = steps[row][column].item<int64_t>();
      for (int64_t n = 0; n < std::abs(count); ++n) {
        x.push_back(float(column));
        y.push_back(float(row));
        t.push_back(now + sensor.late_us);
        p.push_back(count > 0 ? 1 : -1);
      }
    }
  }
  return events::EventStream::from_lists(x, y, t, p);
}

/// What a run knows of the events.
imaging::EdiCounts known(const TrueSensor& truth, const train::SensorOptions& options) {
  data::Exposure exposure;
  exposure.t_end_us = kExposure.end_us;
  const int64_t margin = train::count_margin(options, {exposure}, kIntegralParts);
  const auto windows = events::ramped_windows(recorded(truth), kExposure, kIntegralParts,
                                              truth.ramp_us, kFrame, margin);
  return imaging::edi_counts(windows, margin, geometry::QuadratureRule::kTrapezoid);
}

/// The sensor after so many steps on L_edi and L_sim, the true images at drawn moments as renders.
train::EventSensor fitted(const TrueSensor& truth, const train::SensorOptions& options, int steps) {
  const imaging::EdiCounts counts = known(truth, options);
  const auto per_ms = torch::tensor(1000.0f / float(kExposure.end_us));
  losses::ObjectiveInputs inputs;
  inputs.samples = kRenders;
  inputs.blurry = sharp_images((torch::arange(320, torch::kFloat64) + 0.5) / 320).mean(0);
  losses::ObjectivePlan plan;
  plan.edi = plan.simulation = true;
  train::EventSensor sensor(options, kConfigured, kFrame.height, kFrame.width);
  train::ModuleAdam adam = sensor.optimizer();
  auto generator = make_generator(5, "draws");
  for (int step = 0; step < steps; ++step) {
    const torch::Tensor u = geometry::jittered_times(generator, 1, kRenders)[0];
    inputs.renders = sharp_images(u);
    inputs.pose_draws = torch::randint(kRenders, {3}, generator, torch::kInt64);
    const auto log_gain =
        imaging::edi_log_gain(counts, sensor.at(per_ms), u.index_select(0, inputs.pose_draws));
    inputs.edi_factors = losses::EdiFactors::of(log_gain.exp().unsqueeze(1));
    adam.zero_grad();
    (losses::objective(inputs, plan, {}).total + sensor.prior()).backward();
    adam.step();
  }
  return sensor;
}

torch::Tensor parameter(const train::EventSensor& sensor, const std::string& name) {
  return sensor.named_parameters()[name];
}

}  // namespace

TEST_CASE("event sensor: thresholds that are configured too low are found", "[train]") {
  train::SensorOptions options;
  options.learn_thresholds = true;
  const train::SensorEstimate found = fitted({0.3}, options, 400).estimate();
  CHECK(found.threshold_positive == Approx(0.3).epsilon(0.05));
  CHECK(found.threshold_negative == Approx(0.3).epsilon(0.05));
  CHECK(found.offset_ms == 0);
  CHECK(found.gain_std == 0);
}

TEST_CASE("event sensor: one that waits for a threshold on the way back seems to have larger ones",
          "[train]") {
  train::SensorOptions options;
  options.learn_thresholds = true;
  const train::SensorEstimate found = fitted({0.3, 0, {}, false, 20000}, options, 400).estimate();
  CHECK(found.threshold_positive == Approx(0.33).epsilon(0.05));
  CHECK(found.threshold_negative == Approx(0.33).epsilon(0.05));
}

TEST_CASE("event sensor: the offset of the events' clock is found, with its sign", "[train]") {
  train::SensorOptions options;
  options.learn_offset = true;
  const auto offset_of = [&](const TrueSensor& truth) {
    const train::SensorEstimate found = fitted(truth, options, 600).estimate();
    CHECK(found.threshold_positive == 0.25);
    return found.offset_ms;
  };
  CHECK(offset_of({0.25, 4000}) == Approx(4).margin(1));
  CHECK(offset_of({0.25, -4000}) == Approx(-4).margin(1));
  // A sensor that waits for a whole threshold also on the way back, read with ramps.
  CHECK(offset_of({0.25, 4000, {}, false, 20000}) == Approx(4).margin(1));
  CHECK(offset_of({0.25, -4000, {}, false, 20000}) == Approx(-4).margin(1));
}

TEST_CASE("event sensor: thresholds and offset are found together", "[train]") {
  train::SensorOptions options;
  options.learn_thresholds = options.learn_offset = true;
  const train::SensorEstimate found = fitted({0.3, 4000}, options, 600).estimate();
  CHECK(found.threshold_positive == Approx(0.3).epsilon(0.05));
  CHECK(found.threshold_negative == Approx(0.3).epsilon(0.05));
  CHECK(found.offset_ms == Approx(4).margin(1));
}

TEST_CASE("event sensor: a pixel's gain moves to its own, and rests where there are no events",
          "[train]") {
  train::SensorOptions options;
  options.learn_gain = true;
  options.gain_lr = 1e-3;
  TrueSensor truth;
  truth.gain = torch::ones({kFrame.height, kFrame.width}, torch::kFloat64);
  truth.gain.slice(1, 0, 12).fill_(1.1);
  const train::EventSensor sensor = fitted(truth, options, 300);
  const auto gain = parameter(sensor, "log_gain").exp();
  const double strong = gain.slice(0, 0, 16).slice(1, 0, 12).mean().item<double>();
  const double plain = gain.slice(0, 0, 16).slice(1, 12).mean().item<double>();
  INFO(strong << " and " << plain);
  CHECK(strong > 1.03);
  CHECK(strong < 1.1);
  CHECK(strong / plain == Approx(1.1).margin(0.05));
  CHECK(gain.slice(0, 16).equal(torch::ones({4, kFrame.width})));
}

TEST_CASE("event sensor: without events the priors lead back to what is configured", "[train]") {
  train::SensorOptions options;
  options.learn_thresholds = options.learn_gain = options.learn_offset = true;
  train::EventSensor sensor(options, {0.3, 0.2}, kFrame.height, kFrame.width);
  imaging::EdiCounts none;
  none.positive = none.negative = torch::zeros({9, kFrame.height, kFrame.width});
  none.weights = torch::full({9}, 1.0f / 9);
  {
    const torch::NoGradGuard no_grad;
    parameter(sensor, "log_positive").fill_(0.05);
    parameter(sensor, "log_gain").fill_(-0.02);
    parameter(sensor, "offset_ms").fill_(1);
  }
  train::ModuleAdam adam = sensor.optimizer();
  CHECK(sensor.estimate().threshold_positive == Approx(0.3 * std::exp(0.05)));
  for (int step = 0; step < 400; ++step) {
    adam.zero_grad();
    const auto gain = imaging::edi_log_gain(none, sensor.at(torch::tensor(0.01f)),
                                            torch::tensor({0.1, 0.7}, torch::kFloat64));
    (gain.exp().mean() + sensor.prior()).backward();
    adam.step();
  }
  const train::SensorEstimate found = sensor.estimate();
  CHECK(found.threshold_positive == Approx(0.3).epsilon(1e-3));
  CHECK(found.threshold_negative == Approx(0.2));
  CHECK(std::abs(found.offset_ms) < 0.01);
  CHECK(parameter(sensor, "log_gain").abs().max().item<double>() < 1e-3);
}

TEST_CASE("event sensor: the priors by hand, over what is learned alone", "[train]") {
  const auto prior = [](const train::SensorOptions& options) {
    const train::EventSensor sensor(options, kConfigured, 1, 2);
    const torch::NoGradGuard no_grad;
    parameter(sensor, "log_positive").fill_(0.1);
    parameter(sensor, "log_negative").fill_(-0.2);
    parameter(sensor, "log_gain").copy_(torch::tensor({{0.03f, 0.06f}}));
    parameter(sensor, "offset_ms").fill_(6);
    return sensor.prior().item<double>();
  };
  train::SensorOptions options;
  options.prior_weight = 2;
  options.learn_thresholds = true;
  CHECK(prior(options) == Approx(1 + 4));
  options.learn_offset = true;
  CHECK(prior(options) == Approx(1 + 4 + 4));
  options.learn_gain = true;
  CHECK(prior(options) == Approx(1 + 4 + 4 + 2.5));
}

TEST_CASE("event sensor: counts reach three deviations of the offset, and at most an exposure",
          "[train]") {
  train::SensorOptions options;
  std::vector<data::Exposure> exposures(3);
  exposures[0].t_end_us = 100000;
  exposures[1].t_end_us = 80000;  // the third has no duration
  CHECK(train::count_margin(options, exposures, 64) == 0);
  options.learn_offset = true;
  CHECK(train::count_margin(options, exposures, 64) == 8);  // 9 ms of 80 ms / 64
  CHECK(train::count_margin(options, {exposures[2]}, 64) == 0);
  options.offset_prior_ms = 50;
  CHECK(train::count_margin(options, exposures, 64) == 64);
}

TEST_CASE("event sensor: as configured, R is that of EDI; each parameter moves it", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  options.sensor.learn_thresholds = options.sensor.learn_gain = options.sensor.learn_offset = true;
  for (const auto rule : {geometry::QuadratureRule::kEqual, geometry::QuadratureRule::kTrapezoid}) {
    options.exposure.quadrature = rule;
    const data::Dataset dataset = data::load_dataset(options.dataset);
    const train::View view = train::prepare_views(dataset, options, torch::kCPU)[1];
    CHECK(view.edi_counts.positive.size(0) == 9 + 2 * 2);  // 9 ms of 40 ms / 8
    const train::TrainState state = train::make_state(options, dataset, torch::kCPU);
    const auto factors = [&] {
      return imaging::edi_log_gain(view.edi_counts, state.sensor->at(view.per_ms), view.u)
          .exp()
          .unsqueeze(1)
          .detach();
    };
    CHECK(torch::allclose(factors(), view.edi_factors, 1e-5, 1e-6));
    const torch::NoGradGuard no_grad;
    for (auto& item : state.sensor->named_parameters()) {
      INFO(item.key());
      item.value().add_(0.1);
      CHECK((factors() - view.edi_factors).abs().max().item<double>() > 1e-3);
      item.value().zero_();
    }
  }
}
