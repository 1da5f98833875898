// SPDX-License-Identifier: Apache-2.0
#include "jade/run/pace.h"

#include <algorithm>
#include <chrono>
#include <torch/cuda.h>
#include <torch/types.h>
#include <utility>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/restore/restored_exposure.h"
#include "jade/restore/view_restorer.h"
#include "jade/train/plan.h"
#include "jade/train/state.h"
#include "jade/train/step.h"
#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"

namespace jade::run {
namespace {

using losses::RestoredPoses;
using losses::Target;

// The laptop preset; its density control is that of the demo, where it outperforms MCMC.
constexpr int64_t kCpuSteps = 2000, kCpuMoments = 9, kCpuGaussians = 50000, kCpuCheckpoints = 500;
constexpr double kCpuGradientThreshold = 5e-4;

constexpr double kMostRestoration = 1.0 / 3;  ///< largest share of a run
constexpr double kShortRestoration_s = 20;    ///< always acceptable
constexpr double kForSteps = 0.9;             ///< share of the given minutes; the rest is
                                              ///< evaluation
constexpr int64_t kFewestSteps = 100, kMostSteps = 25000, kStepsForAllMoments = 4000;

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

template <class T>
void choose(const Choices& choices, const std::string& key, T& value, const T& choice) {
  if (choices.leave(key)) value = choice;
}

bool leaves_density(const Choices& choices) {
  return std::none_of(choices.named.begin(), choices.named.end(),
                      [](const std::string& key) { return key.rfind("densify.", 0) == 0; });
}

void choose_short_density(const Choices& choices, train::RunOptions& options) {
  if (!leaves_density(choices)) return;
  options.densify.strategy = gaussians::DensifyStrategy::kAdc;
  options.densify.gradient_threshold = kCpuGradientThreshold;
  options.densify.max_gaussians = kCpuGaussians;
}

/// Whether the learned restorer restores every moment of an exposure, not only one.
bool is_blurred(const data::Exposure& exposure) { return exposure.duration_us() > 0; }

/// Whether fewer moments than in the options may be restored.
bool may_restore_less(const Choices& choices, const train::RunOptions& options) {
  return train::needs_efnet(options) && choices.leave("objective.target") &&
         choices.leave("objective.restored_poses");
}

std::string restored_text(const RestoredFrames& frames, const train::RunOptions& options) {
  const int64_t all = frames.moving + frames.still;
  std::string text = concat(grouped(all), all == 1 ? " frame" : " frames");
  const int64_t each = restored_moments({1, 0}, options);
  return each == 1 ? text + " at mid-exposure" : concat(text, " x ", each, " moments");
}

/// Reduces the restored moments by one level; returns false if there is none.
bool restore_less(train::RunOptions& options) {
  if (options.objective.target == Target::kNone) return false;
  RestoredPoses& poses = options.objective.restored_poses;
  if (poses == RestoredPoses::kMiddle) {
    options.objective.target = Target::kNone;
  } else {
    poses = poses == RestoredPoses::kNine ? RestoredPoses::kThree : RestoredPoses::kMiddle;
  }
  return true;
}

/// @param most_s  upper limit of the restoration's seconds
void bound_restoration(const Speed& speed, const RestoredFrames& frames, double most_s,
                       train::RunOptions& options) {
  const auto takes_s = [&] {
    return train::needs_efnet(options) ? speed.restore_s * double(restored_moments(frames, options))
                                       : 0;
  };
  while (takes_s() > most_s && restore_less(options)) {
  }
}

int64_t rounded_steps(double steps) {
  const auto tens = static_cast<int64_t>(steps / 10) * 10;
  return std::clamp(tens, kFewestSteps, kMostSteps);
}

double all_steps_s(const Speed& speed, const train::RunOptions& options) {
  return speed.step_s * double(options.train.iterations) * train::mean_share_of_moments(options);
}

/// Number of steps that fit into the minutes left by restoration.
double steps_in(double minutes, double restoration_s, double step_s) {
  return (60 * minutes * kForSteps - restoration_s) / std::max(step_s, 1e-6);
}

/// Chooses moments per exposure and steps for choices.minutes, with a limit on restoration.
void fit_minutes(const Speed& speed, const RestoredFrames& frames, const Choices& choices,
                 train::RunOptions& options) {
  const double most_s = 60 * choices.minutes * kMostRestoration;
  const auto measured_moments = double(options.exposure.samples);
  const auto fitted = [&](int64_t samples) {
    train::RunOptions fit = options;
    fit.exposure.samples = samples;
    if (may_restore_less(choices, fit)) bound_restoration(speed, frames, most_s, fit);
    const double restoration_s =
        train::needs_efnet(fit) ? speed.restore_s * double(restored_moments(frames, fit)) : 0;
    train::settle(fit);
    const double step_s =
        speed.step_s * double(samples) / measured_moments * train::mean_share_of_moments(fit);
    const double steps = steps_in(choices.minutes, restoration_s, step_s);
    if (choices.leave("train.iterations")) fit.train.iterations = rounded_steps(steps);
    return fit;
  };
  train::RunOptions fit = fitted(options.exposure.samples);
  if (choices.leave("exposure.samples") && choices.leave("exposure.quadrature") &&
      fit.train.iterations < kStepsForAllMoments && options.exposure.samples > kCpuMoments) {
    fit = fitted(kCpuMoments);
  }
  options = fit;
}

/// Seconds per moment of one frame, after a first call that initialises libraries; 0 if the cache
/// has the restorations. `restorer` then contains the network.
double measure_restorer(const data::Dataset& dataset, const train::RunOptions& options,
                        torch::Device device, std::future<restore::Restorer>& restorer) {
  const torch::NoGradGuard no_grad;
  std::vector<double> times = train::restored_times(options);
  if (times.empty()) times = {0.5};
  restore::ViewRestorer kept(options.cache, options.efnet, device, dataset.monochrome);
  // The network's input does not depend on EDI's windows, so sum as few as possible.
  restore::RestoreOptions how{options.events, options.exposure, 0};
  how.events.ramp_ms = 0;
  how.events.edi_samples = 3;
  const auto events_of = [&](const data::Exposure& exposure) {
    return restore::sum_events(exposure, dataset.events, how, &kept.metadata()).network;
  };
  const auto first = std::find_if(dataset.train.begin(), dataset.train.end(), is_blurred);
  const data::Exposure& one = first == dataset.train.end() ? dataset.train.front() : *first;
  const torch::Tensor events = events_of(one), image = one.blurry.to(device);
  // A frame of zero duration is restored at one moment.
  const auto times_of = [&](const data::Exposure& exposure) {
    return is_blurred(exposure) ? times : std::vector<double>{0.5};
  };
  const data::Exposure& last = dataset.train.back();
  if (kept.kept_efnet(image, events, times_of(one)).images.defined() &&
      kept.kept_efnet(last.blurry.to(device), events_of(last), times_of(last)).images.defined()) {
    return 0;
  }
  restore::Restorer network =
      restorer.valid() ? restorer.get() : restore::Restorer(options.efnet, device);
  const auto restore_once = [&] {
    throw_if_interrupted();
    const Clock::time_point start = Clock::now();
    network.restore(image, events, {0.5});
    if (device.is_cuda()) torch::cuda::synchronize();
    return seconds_since(start);
  };
  restore_once();
  const double seconds = restore_once();
  std::promise<restore::Restorer> ready;
  ready.set_value(std::move(network));
  restorer = ready.get_future();
  return seconds;
}

/// Seconds per step with every term but the target. With mcmc, measured on half of max_gaussians,
/// because it adds all of them; else on the initial Gaussians, multiplied by the expected growth.
double measure_step(const data::Dataset& dataset, const train::RunOptions& options,
                    torch::Device device) {
  constexpr double kLeast_s = 1;
  constexpr int64_t kLeastSteps = 2;
  const int64_t warm = device.is_cuda() ? 20 : 1;
  data::Dataset some = dataset;
  some.train.resize(1);
  train::RunOptions probe = options;
  probe.objective.target = Target::kNone;
  probe.objective.restored_poses = RestoredPoses::kMiddle;
  probe.cache.enabled = false;
  double growth = 1.2;  // 12,000 Gaussians became 22,000, and a moment took 1.16 times as long
  if (probe.densify.strategy == gaussians::DensifyStrategy::kMcmc) {
    probe.init.kind = gaussians::InitKind::kRandomFrusta;
    probe.init.points = std::max<int64_t>(int64_t{options.densify.max_gaussians} / 2, 1);
    growth = 1;
  }
  train::settle(probe);
  train::TrainState state = train::make_state(probe, some, device);
  train::StepFeed feed(some, probe, device);
  train::StepGraph graph;
  const int64_t from = std::max<int64_t>(probe.train.iterations * 3 / 4, 1);
  Clock::time_point start;
  int64_t done = 0;
  while (done <= warm || done < warm + kLeastSteps || seconds_since(start) < kLeast_s) {
    throw_if_interrupted();
    if (done == warm) {
      if (device.is_cuda()) torch::cuda::synchronize();
      start = Clock::now();
    }
    const int64_t step = from + done++;
    graph.run(state, feed.at(step), train::plan_step(probe, step), probe);
    train::update_exposures(state, probe, step);
    state.step = step;
  }
  if (device.is_cuda()) torch::cuda::synchronize();
  return growth * seconds_since(start) / double(done - warm);
}

}  // namespace

const std::vector<std::string>& chosen_keys() {
  static const std::vector<std::string> keys{
      "exposure.samples",      "densify.strategy", "densify.gradient_threshold",
      "densify.max_gaussians", "objective.target", "objective.restored_poses",
      "train.iterations",      "checkpoint.every"};
  return keys;
}

void keep_choices(train::RunOptions saved, const Choices& choices, train::RunOptions& options) {
  config::Sources sources;
  for (const auto& [key, value] : config::values(fields_of(saved))) {
    const bool chosen =
        std::find(chosen_keys().begin(), chosen_keys().end(), key) != chosen_keys().end();
    if (chosen && choices.leave(key)) sources.overrides.push_back(key + "=" + value);
  }
  config::read(sources, fields_of(options));
  train::settle(options);
}

std::string choose_for_cpu(const Choices& choices, train::RunOptions& options) {
  if (!choices.leave("train.iterations")) return "";
  choose_short_density(choices, options);
  choose(choices, "checkpoint.every", options.checkpoint.every, kCpuCheckpoints);
  if (choices.minutes > 0) return "";
  choose(choices, "exposure.samples", options.exposure.samples, kCpuMoments);
  options.train.iterations = kCpuSteps;
  train::settle(options);
  return concat("on a CPU: ", options.exposure.samples, " moments, ", grouped(kCpuSteps),
                " steps, at most ", grouped(int64_t{options.densify.max_gaussians}),
                " Gaussians; --set train.iterations=4000 for the full preset, --minutes M for as ",
                "many as fit");
}

RestoredFrames restored_frames(const data::Dataset& dataset) {
  RestoredFrames frames;
  for (const data::Exposure& exposure : dataset.train) {
    ++(is_blurred(exposure) ? frames.moving : frames.still);
  }
  return frames;
}

int64_t restored_moments(const RestoredFrames& frames, const train::RunOptions& options) {
  const auto each = static_cast<int64_t>(train::restored_times(options).size());
  return frames.moving * std::max<int64_t>(each, 1) + frames.still;
}

std::vector<std::string> fit_to_speed(const Speed& speed, const RestoredFrames& frames,
                                      const Choices& choices, train::RunOptions& options) {
  const train::RunOptions before = options;
  if (choices.minutes > 0) {
    fit_minutes(speed, frames, choices, options);
  } else if (may_restore_less(choices, options)) {
    train::settle(options);
    const double steps_s = all_steps_s(speed, options);
    const double most_s = steps_s * kMostRestoration / (1 - kMostRestoration);
    bound_restoration(speed, frames, std::max(most_s, kShortRestoration_s), options);
  }
  train::settle(options);
  std::vector<std::string> said;
  if (choices.minutes > 0) {
    said.push_back(concat(choices.minutes, " min: ", options.exposure.samples, " moments, ",
                          grouped(options.train.iterations), " steps"));
  }
  if (options.objective.target != before.objective.target) {
    said.push_back(concat("no target is restored: ", restored_text(frames, before), " would take ",
                          about_time(speed.restore_s * double(restored_moments(frames, before))),
                          ", more than a third of the run; --set objective.target=",
                          word_of(before.objective.target), " restores it"));
  } else if (options.objective.restored_poses != before.objective.restored_poses) {
    said.push_back(concat(restored_text(frames, options),
                          " are restored: ", restored_text(frames, before), " would take ",
                          about_time(speed.restore_s * double(restored_moments(frames, before))),
                          ", more than a third of the run; --set objective.restored_poses=",
                          word_of(before.objective.restored_poses), " restores them"));
  }
  return said;
}

void choose_pace(const data::Dataset& dataset, const Choices& choices, torch::Device device,
                 train::RunOptions& options, std::future<restore::Restorer>& restorer) {
  if (device.is_cpu()) {
    const std::string said = choose_for_cpu(choices, options);
    train::apply_dataset(dataset, options);
    if (!said.empty()) log_info(said);
  }
  if (!device.is_cpu() && choices.minutes == 0) return;
  const RestoredFrames frames = restored_frames(dataset);
  Speed speed;
  if (train::needs_efnet(options)) {
    speed.restore_s = measure_restorer(dataset, options, device, restorer);
  }
  const double restoration_s = speed.restore_s * double(restored_moments(frames, options));
  if (choices.minutes > 0 ||
      (restoration_s > kShortRestoration_s && may_restore_less(choices, options))) {
    log_info("measuring the speed of the steps");
    speed.step_s = measure_step(dataset, options, device);
  }
  for (const std::string& line : fit_to_speed(speed, frames, choices, options)) log_info(line);
  train::validate(options);
  if (train::needs_efnet(options) && speed.restore_s > 0) {
    log_info(concat("restoring ", restored_text(frames, options), ", ",
                    about_time(speed.restore_s * double(restored_moments(frames, options))),
                    device.is_cpu() ? " on this CPU" : " on this GPU"));
  }
  if (speed.step_s > 0) {
    log_info(concat("then ", grouped(options.train.iterations), " steps, ",
                    about_time(all_steps_s(speed, options))));
  }
}

}  // namespace jade::run
