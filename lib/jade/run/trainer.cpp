// SPDX-License-Identifier: Apache-2.0
#include "jade/run/trainer.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>

#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/gaussians/ply.h"
#include "jade/geometry/origin.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"
#include "jade/run/report.h"
#include "jade/train/routing_step.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

constexpr char kLooks[] = "looks on the way";

/// Divisor of poses.test_fit_steps for evaluations after the first, which continue its fit.
constexpr int64_t kWarmFitShare = 4;

/// True when `due` divides the step; 0 is never.
bool every(int64_t step, int64_t due) { return due > 0 && step % due == 0; }

}  // namespace

Trainer::Trainer(const train::RunOptions& options, const fs::path& run, const std::string& from,
                 const std::optional<Choices>& choices)
    : Trainer(prepare(options, run, from, choices)) {}

Trainer::Trainer(Prepared parts)
    : times_(std::move(parts.times)),
      options_(std::move(parts.options)),
      device_(parts.device),
      directory_(std::move(parts.directory)),
      data_(std::move(parts.data)),
      stream_(std::move(parts.stream)),
      state_(std::move(parts.state)),
      feed_(std::move(parts.feed)),
      metrics_(std::make_unique<MetricsLog>(directory_.path() / "metrics.jsonl", state_.step)) {}

Trainer::~Trainer() {
  // Keep the log file open while an exception unwinds, so that its handler's message is logged.
  if (std::uncaught_exceptions() == 0) set_log_file({});
}

void Trainer::step() {
  const int64_t step = state_.step + 1;
  const train::StepInputs inputs = feed_.at(step);
  const train::StepOutputs out =
      step_graph_.run(state_, inputs, train::plan_step(options_, step), options_);
  train::update_exposures(state_, options_, step);
  state_.step = step;
  monitor_.watch(out.terms, step);
  if (every(step, options_.train.log_every) || is_over()) log_step(inputs, out);
}

void Trainer::densify() {
  if (!state_.densifier.due(state_.step)) return;
  const int64_t stride = train::plan_step(options_, state_.step).moment_stride;
  state_.densifier.update(state_.step, state_.gaussians, state_.gaussian_adam,
                          train::gradient_factor(options_, stride));
}

void Trainer::log_step(const train::StepInputs& inputs, const train::StepOutputs& out) {
  monitor_.check();
  if (saving_.valid() && saving_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
    finish_save();  // reports a full disk
  }
  nlohmann::ordered_json line = step_line(inputs, out, state_, options_);
  const double seconds = now_seconds();
  if (logged_seconds_ > 0) {
    line["iterations_per_second"] =
        static_cast<double>(state_.step - logged_step_) / (seconds - logged_seconds_);
  }
  logged_seconds_ = seconds;
  logged_step_ = state_.step;
  const int64_t bytes = peak_memory_bytes(device_);
  line["seconds"] = run_seconds();
  line["memory_bytes"] = bytes;
  metrics_->append(line);
  char text[128];
  std::snprintf(text, sizeof text, "loss %.4f  re-blur PSNR %.2f dB  %s Gaussians  %lld MiB",
                line["loss"].get<double>(), line["psnr_train"].get<double>(),
                grouped(state_.gaussians.size()).c_str(), static_cast<long long>(bytes >> 20));
  status_ = text;
}

bool Trainer::is_over() const { return state_.step >= options_.train.iterations; }

void Trainer::save() {
  monitor_.check();
  finish_save();
  saving_ = std::async(std::launch::async, write_checkpoint, directory_.path(),
                       checkpoint_of(state_, {resolved_yaml(options_), data_.fingerprint,
                                              data_.restorer_sha256, data_.dataset.origin}),
                       options_.checkpoint.keep);
}

void Trainer::finish_save() {
  if (saving_.valid()) saving_.get();
}

bool Trainer::can_evaluate() const {
  return !data_.dataset.test.empty() || !data_.dataset.held_out.empty();
}

eval::Evaluation Trainer::evaluate() {
  monitor_.check();
  return evaluate(posed_dataset());
}

eval::Evaluation Trainer::evaluate(const data::Dataset& posed) {
  const eval::Lpips lpips(device_);
  return evaluate_dataset(state_.gaussians.detached(), posed, lpips, options_);
}

data::Dataset Trainer::posed_dataset(const data::Dataset* last, OnInterrupt on_interrupt) {
  if (!state_.poses) return data_.dataset;
  PoseFit fit{options_.poses.test_fit_steps, learns_gains(), on_interrupt, last};
  if (last) fit.steps = (fit.steps + kWarmFitShare - 1) / kWarmFitShare;
  return with_learned_poses(data_.dataset, *state_.poses, state_.gaussians.detached(), fit,
                            train::render_options(options_));
}

const data::Dataset& Trainer::look_at_dataset() {
  if (!state_.poses) return data_.dataset;
  // Ignore interrupts: the checkpoint that follows assumes that this evaluation is complete.
  looked_at_ = posed_dataset(looked_at_ ? &*looked_at_ : nullptr, OnInterrupt::kFinish);
  return *looked_at_;
}

double Trainer::run_seconds() const { return metrics_->seconds_before() + times_.without(kLooks); }

bool Trainer::learns_gains() const { return train::learns_gains(options_.gains, data_.dataset); }

void Trainer::write_pictures(const data::Dataset& posed, bool truths) {
  const splat::Gaussians gaussians = state_.gaussians.detached();
  const splat::RenderOptions draw = train::render_options(options_);
  const auto add = [this](const fs::path& name, const torch::Tensor& image) {
    pictures_.add(directory_.path() / name, image);
  };
  for (const data::SharpView& view : posed.test) {
    add("images/test_" + view.name + ".png", render_view(gaussians, view.pose, view.camera, draw));
    if (truths) add("images/truth_" + view.name + ".png", view.image);
  }
  for (int64_t i = 0; i < bank().size(); ++i) {
    const data::Exposure& exposure = posed.train[static_cast<size_t>(i)];
    add("images/train_" + exposure.name + ".png",
        render_view(gaussians, exposure.poses[geometry::kMidPose], exposure.camera, draw));
    const auto alpha = train::allocation_map(state_, bank().picture_view(i), i);
    if (alpha.defined()) {
      add("alpha/" + exposure.name + ".png",
          alpha.expand({1, exposure.camera.height, exposure.camera.width}));
    }
  }
  pictures_.begin();
}

void Trainer::look(Watcher* watcher) {
  if (is_over()) return;  // the end of the run has its own evaluation
  const bool evaluation_due = every(state_.step, options_.train.evaluate_every) && can_evaluate();
  const bool pictures_due = every(state_.step, options_.train.picture_every);
  if (!evaluation_due && !pictures_due) return;
  monitor_.check();
  times_.end("steps");
  step_graph_.release(state_, device_);
  const double seconds = run_seconds();
  const data::Dataset& posed = look_at_dataset();
  if (evaluation_due) {
    const eval::Evaluation evaluation = evaluate(posed);
    metrics_->append(evaluation_line(state_.step, seconds, evaluation));
    if (watcher) watcher->on_evaluation(posed, evaluation);
  }
  if (pictures_due) write_pictures(posed);
  times_.end(kLooks);
}

void Trainer::stop() {
  // An earlier checkpoint may have failed for lack of space where this one finds some.
  if (saving_.valid()) saving_.wait();
  saving_ = {};
  save();
  finish_save();
  log_info(concat("saved at step ", state_.step));
  pictures_.wait();
  throw Interrupted();
}

void Trainer::finish() {
  monitor_.check();
  times_.end("steps");
  step_graph_.release(state_, device_);
  save();
  Report report(data_.dataset, bank(), state_);
  const data::Dataset posed = posed_dataset();
  if (state_.poses && interrupt_requested()) stop();  // discard half-fitted poses
  times_.end("test poses");
  write_pictures(posed, /*truths=*/true);
  times_.end("pictures");
  std::optional<eval::Evaluation> evaluation;
  if (can_evaluate()) evaluation = evaluate(posed);
  times_.end("scores");
  // The scores and the scene, written after its cameras, mark the end of the run.
  finish_save();
  times_.end("checkpoint");
  if (evaluation) {
    write_file(directory_.path() / kScoresFile, eval::to_json(*evaluation));
    log_info((data_.dataset.test.empty() ? "on the held-out exposures:\n"
                                         : "on the sharp test views:\n") +
             eval::to_table(*evaluation));
  }
  write_cameras(directory_.path() / kCamerasFile, posed);
  gaussians::write_ply(directory_.path() / kSceneFile,
                       {state_.gaussians.detached(), false, data_.dataset.origin});
  times_.end("scene");
  if (state_.gains) {
    const auto [least, most] = state_.gains->range();
    log_info(concat("gains       of the frames ", least, " to ", most,
                    learns_gains() ? ", learned" : ", as the data have them"));
  }
  if (state_.pattern) {
    log_info(
        concat("pattern     of the sensor: ", 0.01 * std::round(1e4 * state_.pattern->strength()),
               " % of white (root mean square), kept out of the scene"));
  }
  if (state_.gaussians.size() == 0) {
    log_warn(
        "the scene is empty: every Gaussian became too faint (opacity below 0.005); look at the "
        "losses in metrics.jsonl, and at thresholds, poses and time stamps of the data");
  }
  report.write(directory_.path(), posed, bank(), state_, options_);
  pictures_.wait();
  times_.end("report");
  directory_.remove_left_results();
  log_info("time        " + times_.text());
  log_info(concat("report      ", (directory_.path() / kReportFile).string()));
  log_info(concat("scene       ", (directory_.path() / kSceneFile).string()));
  if (!geometry::is_zero(data_.dataset.origin)) {
    log_info(concat("coordinates of the scene are about (", geometry::text_of(data_.dataset.origin),
                    ") of the data set; jade_export --run ", directory_.path().string(),
                    " --output FILE.ply writes those of the data set"));
  }
}

void Trainer::run(Watcher* watcher) {
  if (!is_over() && directory_.set_aside_results()) {
    log_info(concat("results of the earlier end are kept as ",
                    (directory_.path() / "left_point_cloud.ply").string(),
                    " and so on, until the new ones are written"));
  }
  if (const int64_t left = set_aside_checkpoints(directory_.path(), state_.step); left > 0) {
    log_warn(concat("checkpoints of later steps, no part of the run any more: ", left, ", kept as ",
                    (directory_.path() / "checkpoints/left_*.pt").string()));
  }
  Progress progress("training", options_.train.iterations, state_.step);
  if (watcher) {
    watcher->begin({data_.dataset, bank(), state_, options_, directory_.path()});
    metrics_->tell([watcher](const std::string& line) { watcher->on_metrics(line); });
  }
  logged_seconds_ = now_seconds();
  logged_step_ = state_.step;
  while (!is_over()) {
    step();
    look(watcher);
    densify();
    if (progress.step()) progress.show(status_);
    if (watcher) logged_seconds_ += watcher->after_step();
    if (interrupt_requested()) stop();
    if (!is_over() && every(state_.step, options_.checkpoint.every)) save();
  }
  progress.finish();
  if (watcher) watcher->ended();
  finish();
}

}  // namespace jade::run
