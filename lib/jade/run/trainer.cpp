// SPDX-License-Identifier: Apache-2.0
#include "jade/run/trainer.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <future>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/core/version.h"
#include "jade/data/pattern_estimate.h"
#include "jade/data/trained_frames.h"
#include "jade/eval/metrics.h"
#include "jade/gaussians/ply.h"
#include "jade/geometry/origin.h"
#include "jade/imaging/image_io.h"
#include "jade/losses/poses.h"
#include "jade/response/identity_response.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"
#include "jade/run/report.h"
#include "jade/run/thresholds.h"
#include "jade/train/memory_plan.h"
#include "jade/train/routing_step.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

double now_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string yaml_of(train::RunOptions options) {
  return config::to_yaml(fields_of(options), "Resolved configuration of this run");
}

/// @throws DataError if a new run's folder contains a run, and for a data set that cannot be
///   trained on.
RunData load_data(const RunDirectory& directory, const train::RunOptions& options,
                  torch::Device device, bool is_new) {
  if (is_new && directory.holds_a_run()) {
    throw DataError(
        concat(directory.path().string(),
               ": holds a run already; go on with it (--resume) or choose another --output"));
  }
  RunData data;
  // Report wrong paths before minutes of loading.
  data.restorer_sha256 = train::restorer_sha256(options);
  data::kind_of(options.dataset);
  // Set up before anything that may warn.
  set_log_file(directory.path() / "train.log");
  if (train::needs_efnet(options) && device.is_cuda() &&
      !restore::restored_before(options.cache, data.restorer_sha256, device,
                                options.dataset.path)) {
    data.restorer = restore::load_beside(options.efnet, device);
  }
  if (device.is_cuda()) {
    data.kernels = std::async(std::launch::async, [device] { train::load_kernels(device); });
  }
  if (options.response.enabled) response::identity_response();  // fails before the data are read
  log_info(concat("reading     ", options.dataset.path.string()));
  std::vector<std::string> warnings;
  {
    const Progress progress("reading", 1, 0, "data sets");
    data.dataset = data::load_dataset(options.dataset, &warnings);
  }
  for (const std::string& warning : warnings) log_warn(warning);
  if (data.dataset.train.empty()) {
    throw DataError(concat(data.dataset.root.string(),
                           ": expected at least one training exposure, found none"));
  }
  data.fingerprint = data_fingerprint(data.dataset);
  return data;
}

constexpr char kLooks[] = "looks on the way";

/// Divisor of poses.test_fit_steps for evaluations after the first, which continue its fit.
constexpr int64_t kWarmFitShare = 4;

/// True when `due` divides the step; 0 is never.
bool every(int64_t step, int64_t due) { return due > 0 && step % due == 0; }

}  // namespace

Trainer::Trainer(const train::RunOptions& options, const fs::path& run, const std::string& resume,
                 const std::optional<Choices>& choices)
    : options_(options),
      choices_(choices),
      device_(select_device(options.device)),
      directory_(run),
      data_(load_data(directory_, options, device_, resume.empty())),
      stream_(device_) {
  times_.end("data");
  limit_threads_beside(device_);
  train::settle(options_);
  train::apply_dataset(data_.dataset, options_);
  const int64_t budget = train::memory_budget(options_, device_);
  if (resume.empty() || !resume_from(resume)) {
    settle_thresholds(data_.dataset, data_.fingerprint, /*log_offset=*/0, options_);
    options_.splat.near_plane = train::near_plane(options_.splat, data_.dataset);
    settle_pattern();
    options_.densify.max_gaussians = train::max_gaussians(options_, data_.dataset, budget);
    if (choices_) choose_pace(data_.dataset, *choices_, device_, options_, data_.restorer);
    if (!train::needs_efnet(options_)) data_.restorer_sha256.clear();
    state_ = train::make_state(options_, data_.dataset, device_);
  }
  announce();
  write_file(directory_.path() / "config.yaml", yaml_of(options_));
  write_environment();
  times_.end("start");
  const int64_t most = train::most_gaussians(state_, options_);
  train::MemoryPlan plan = train::memory_plan(options_, data_.dataset, most);
  feed_ = train::StepFeed(data_.dataset, options_, device_, std::move(data_.restorer),
                          train::constants_budget(plan, budget));
  if (data_.kernels.valid()) data_.kernels.wait();  // a graph must not be recorded beside it
  times_.end("restorations");
  if (device_.is_cuda()) {
    plan.constants = bank().bytes_on_device();
    log_info(concat("memory      of ", budget >> 20, " MiB for tensors ",
                    train::text_of(plan, bank().size(), most), "; peak so far ",
                    peak_memory_bytes(device_) >> 20, " MiB"));
  }
  metrics_ = std::make_unique<MetricsLog>(directory_.path() / "metrics.jsonl", state_.step);
}

Trainer::~Trainer() {
  // Keep the log file open while an exception unwinds, so that its handler's message is logged.
  if (std::uncaught_exceptions() == 0) set_log_file({});
}

void Trainer::settle_pattern() {
  train::LearnPattern& learn = options_.pattern.learn;
  if (learn != train::LearnPattern::kAuto) return;
  const data::PatternEstimate found = data::estimate_pattern(data_.dataset);
  learn = found.is_worth_learning() ? train::LearnPattern::kOn : train::LearnPattern::kOff;
  if (learn == train::LearnPattern::kOn) {
    log_info(concat("pattern     ", std::round(1e4 * found.strength) / 100,
                    " % of white (standard deviation) is the same in all frames and becomes no "
                    "scene; --set pattern.learn=off leaves it"));
  }
}

bool Trainer::resume_from(const std::string& choice) {
  if (choice != "latest" && fs::is_directory(choice)) {
    throw ConfigError(concat("--resume: expected a checkpoint, found the folder ", choice,
                             "; name one of its files, or go on with the newest of a run by ",
                             "--output FOLDER --resume alone"));
  }
  std::vector<fs::path> candidates =
      choice == "latest" ? list_checkpoints(directory_.path()) : std::vector<fs::path>{choice};
  if (candidates.empty()) {
    if (directory_.holds_results()) {
      throw ConfigError(concat(directory_.path().string(),
                               ": expected a checkpoint to go on from, found a scene without one; ",
                               "name another --output, or remove the scene to start again"));
    }
    // A run that was killed before its first checkpoint, or the first start by a script.
    log_info(concat(directory_.path().string(), ": no checkpoint yet; starting at step 0"));
    return false;
  }
  for (size_t i = 0; i < candidates.size(); ++i) {
    CheckpointInfo info;
    try {
      info = read_checkpoint_info(candidates[i]);
    } catch (const CheckpointError& error) {
      if (i + 1 == candidates.size()) throw;
      log_warn(concat(error.what(), "; trying ", candidates[i + 1].filename().string()));
      continue;
    }
    // Reject an undamaged checkpoint of another run; an older one would be of that run too.
    keep_decisions(saved_options(info.config));
    check_same_run(candidates[i], info);
    state_ = train::make_state_to_load(options_, data_.dataset, device_);
    load_checkpoint(candidates[i], state_);
    if (state_.step > options_.train.iterations) {
      throw ConfigError(concat("train.iterations: expected at least ", state_.step,
                               ", the steps that ", candidates[i].string(), " has already, found ",
                               options_.train.iterations,
                               "; go on from an earlier one with --resume FILE"));
    }
    log_info(concat("resumed from ", candidates[i].filename().string(), ", step ", state_.step));
    return true;
  }
  return false;
}

void Trainer::keep_decisions(const train::RunOptions& saved) {
  if (keep_calendar(saved, options_)) {
    log_info(concat("calendar    stays that of ", options_.train.calendar,
                    " steps, as the run began; a new --output follows that of ",
                    options_.train.iterations));
  }
  if (choices_) keep_choices(saved, *choices_, options_);
  if (options_.events.threshold_positive.is_auto()) {
    options_.events.threshold_positive = saved.events.threshold_positive;
    if (options_.events.threshold_negative == 0) {
      options_.events.threshold_negative = saved.events.threshold_negative;
    }
  }
  if (options_.densify.max_gaussians.is_auto()) {
    options_.densify.max_gaussians = saved.densify.max_gaussians;
  }
  // The run may have begun with a version without these keys.
  if (options_.pattern.learn == train::LearnPattern::kAuto)
    options_.pattern.learn = saved.pattern.learn;
  if (options_.splat.near_plane == 0) options_.splat.near_plane = saved.splat.near_plane;
}

void Trainer::check_same_run(const fs::path& checkpoint, const CheckpointInfo& info) const {
  const ConfigDifference difference = compare_configs(info.config, options_);
  if (!difference.refused.empty()) {
    std::string keys;
    for (const std::string& line : difference.refused) keys += (keys.empty() ? "" : "; ") + line;
    throw ConfigError(concat(checkpoint.string(),
                             ": this run was made with other settings, and changing them on "
                             "resume would mix two runs: ",
                             keys, ". Put them back or start a new --output"));
  }
  for (const std::string& line : difference.allowed) log_info("changed on resume: " + line);
  if (info.fingerprint != data_.fingerprint && !had_fingerprint(data_.dataset, info.fingerprint)) {
    throw CheckpointError(
        concat(checkpoint.string(), ": made from other data than ", data_.dataset.root.string(),
               "; check dataset.path, dataset.color and whether its events or its camera changed"));
  }
  if (data_.restorer_sha256.empty()) return;
  if (info.restorer_sha256.empty()) {
    log_warn(concat(checkpoint.string(),
                    ": holds no hash of the restorer, as an older program wrote it; make sure that "
                    "efnet.path is the file the run began with"));
  } else if (info.restorer_sha256 != data_.restorer_sha256) {
    throw CheckpointError(concat(checkpoint.string(), ": expected the restorer with SHA-256 ",
                                 info.restorer_sha256, ", found ", data_.restorer_sha256,
                                 "; set efnet.path to the file the run began with or start a new "
                                 "--output"));
  }
}

void Trainer::announce() const {
  int64_t event_count = 0;
  for (const data::Exposure& exposure : data_.dataset.train) event_count += exposure.events.size();
  const auto& camera = data_.dataset.train.front().camera;
  log_info(concat("device      ", device_name(device_)));
  log_info(concat("data        ", data_.dataset.name, " (", word_of(data_.dataset.kind),
                  "): ", data_.dataset.train.size(), " exposures of ", camera.width, "x",
                  camera.height, data_.dataset.monochrome ? ", monochrome, " : " in colour, ",
                  grouped(event_count), " events; ", data_.dataset.test.size(),
                  data_.dataset.test.size() == 1 ? " sharp test view (" : " sharp test views (",
                  data_.dataset.split, ")"));
  for (const std::string& note : data_.dataset.notes) log_info("data        " + note);
  log_info(concat("scene       ", grouped(state_.gaussians.size()), " Gaussians, extent ",
                  readable(state_.gaussians.extent(), 3), ", near plane ",
                  train::render_options(options_).near_plane));
  if (state_.allocation) {
    int64_t count = 0;
    for (const auto& parameter : state_.allocation->parameters()) count += parameter.numel();
    log_info(concat("allocation  ", word_of(options_.allocation.kind), ", ", grouped(count),
                    " parameters"));
  } else {
    log_info(concat("target      ", word_of(options_.objective.target)));
  }
  if (train::needs_efnet(options_))
    log_info(concat("restorer    ", restore::restorer_path(options_.efnet).string()));
  log_info(concat("budget      ", grouped(options_.train.iterations), " steps, at most ",
                  grouped(int64_t{options_.densify.max_gaussians}), " Gaussians, seed ",
                  options_.seed));
}

void Trainer::write_environment() const {
  nlohmann::ordered_json environment{{"program", "jade_train " + version()},
                                     {"commit", git_commit()},
                                     {"torch", torch_version()},
                                     {"cuda", cuda_version()},
                                     {"device", device_name(device_)},
                                     {"seed", options_.seed},
                                     {"data_fingerprint", data_.fingerprint}};
  if (!data_.restorer_sha256.empty()) environment["restorer_sha256"] = data_.restorer_sha256;
  if (!geometry::is_zero(data_.dataset.origin)) environment["origin"] = data_.dataset.origin;
  environment[kTrainedKey] = nlohmann::ordered_json::array();
  for (const data::TrainedFrame& frame : data::trained_frames(data_.dataset)) {
    environment[kTrainedKey].push_back({{"name", frame.name}, {"sha256", frame.sha256}});
  }
  write_file(directory_.path() / kEnvironmentFile, environment.dump(2) + "\n");
}

void Trainer::step(const std::function<void()>& look) {
  const int64_t step = state_.step + 1;
  const train::StepInputs inputs = feed_.at(step);
  const train::StepPlan plan = train::plan_step(options_, step);
  const train::StepOutputs out = step_graph_.run(state_, inputs, plan, options_);
  train::update_exposures(state_, options_, step);
  state_.step = step;
  monitor_.watch(out.terms, step);
  if (metrics_ && (every(step, options_.train.log_every) || step == options_.train.iterations)) {
    log_step(inputs, out);
  }
  if (look) look();
  if (state_.densifier.due(step)) {
    state_.densifier.update(step, state_.gaussians, state_.gaussian_adam,
                            train::gradient_factor(options_, plan.moment_stride));
  }
}

void Trainer::log_step(const train::StepInputs& inputs, const train::StepOutputs& out) {
  monitor_.check();
  const torch::NoGradGuard no_grad;
  const train::View& view = inputs.view;
  const int64_t index = inputs.view_index;
  nlohmann::ordered_json line{{"step", state_.step}};
  double total = 0;
  for (const losses::NamedTerm& term : out.terms) {
    const double value = term.value.item<double>();
    line[term.name] = value;
    if (term.in_total) total += value;
  }
  line["loss"] = total;
  // How well the simulated blur explains the frame: the only PSNR that needs no true sharp image.
  const torch::Tensor all =
      out.renders.all_poses
          ? out.renders.color.detach()
          : train::as_in_frame(
                state_, inputs,
                splat::render(state_.gaussians.detached(), train::exposure_cameras(state_, inputs),
                              train::render_options(options_))
                    .color);
  double psnr = eval::psnr(losses::weighted_mean(all, view.weights), view.blurry);
  // Masked pixels are black in both and do not count.
  if (view.mask.defined()) psnr += 10 * std::log10(view.mask.mean().item<double>());
  line["psnr_train"] = psnr;
  if (state_.allocation) {
    const auto alpha = train::allocation_map(state_, view, index);
    line["alpha_mean"] = alpha.mean().item<double>();
    line["alpha_std"] = alpha.numel() > 1 ? alpha.std().item<double>() : 0.0;
  }
  if (state_.gains) {
    const auto [least, most] = state_.gains->range();
    line["gain_min"] = least;
    line["gain_max"] = most;
  }
  line["gaussians"] = state_.gaussians.size();
  const double seconds = now_seconds();
  if (logged_seconds_ > 0) {
    line["iterations_per_second"] =
        static_cast<double>(state_.step - logged_step_) / (seconds - logged_seconds_);
  }
  line["seconds"] = run_seconds();
  line["memory_bytes"] = peak_memory_bytes(device_);
  logged_seconds_ = seconds;
  logged_step_ = state_.step;
  metrics_->append(line.dump());
  char text[128];
  std::snprintf(text, sizeof text, "loss %.4f  re-blur PSNR %.2f dB  %s Gaussians  %lld MiB", total,
                psnr, grouped(state_.gaussians.size()).c_str(),
                static_cast<long long>(peak_memory_bytes(device_) >> 20));
  status_ = text;
}

void Trainer::save() {
  monitor_.check();
  save_checkpoint(
      directory_.path(), state_,
      {yaml_of(options_), data_.fingerprint, data_.restorer_sha256, data_.dataset.origin},
      options_.checkpoint.keep);
}

bool Trainer::can_evaluate() const {
  return !data_.dataset.test.empty() || !data_.dataset.held_out.empty();
}

eval::Evaluation Trainer::evaluate() { return evaluate(posed_dataset()); }

eval::Evaluation Trainer::evaluate(const data::Dataset& posed) {
  const eval::Lpips lpips(device_);
  return evaluate_dataset(state_.gaussians.detached(), posed, lpips, options_);
}

eval::Evaluation Trainer::log_evaluation(const data::Dataset& posed, double seconds) {
  const eval::Evaluation evaluation = evaluate(posed);
  const eval::Scores& mean = evaluation.mean;
  nlohmann::ordered_json line{{"step", state_.step}, {"seconds", seconds}};
  if (!evaluation.views.empty()) {
    log_info(concat("step ", state_.step, ": test PSNR ", mean.psnr, " dB, SSIM ", mean.ssim));
    line["test_psnr"] = mean.psnr;
    line["test_psnr_channel_mean"] = mean.psnr_channel_mean;
    line["test_ssim"] = mean.ssim;
  }
  if (mean.psnr_reblur) {
    log_info(concat("step ", state_.step, ": held-out PSNR after reblur ", *mean.psnr_reblur));
    line["test_psnr_reblur"] = *mean.psnr_reblur;
  }
  if (mean.lpips_alex01) line["test_lpips_alex01"] = *mean.lpips_alex01;
  if (mean.lpips_vgg) line["test_lpips_vgg"] = *mean.lpips_vgg;
  const auto split = [&](const std::optional<eval::Scores>& part, const std::string& ending) {
    if (!part) return;
    line["test_psnr_" + ending] = part->psnr;
    line["test_psnr_channel_mean_" + ending] = part->psnr_channel_mean;
  };
  split(evaluation.mean_seen, "seen");
  split(evaluation.mean_unseen, "unseen");
  metrics_->append(line.dump());
  return evaluation;
}

data::Dataset Trainer::posed_dataset() {
  monitor_.check();
  if (!state_.poses) return data_.dataset;
  PoseFit fit;
  fit.steps = options_.poses.test_fit_steps;
  fit.gain = learns_gains();
  return with_learned_poses(data_.dataset, *state_.poses, state_.gaussians.detached(), fit,
                            train::render_options(options_));
}

const data::Dataset& Trainer::look_at_dataset() {
  if (!state_.poses) return data_.dataset;
  PoseFit fit;
  fit.steps = options_.poses.test_fit_steps;
  fit.gain = learns_gains();
  // Ignore interrupts: the checkpoint that follows assumes that this evaluation is complete.
  fit.on_interrupt = OnInterrupt::kFinish;
  if (looked_at_) {
    fit.from = &*looked_at_;
    fit.steps = (fit.steps + kWarmFitShare - 1) / kWarmFitShare;
  }
  looked_at_ = with_learned_poses(data_.dataset, *state_.poses, state_.gaussians.detached(), fit,
                                  train::render_options(options_));
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
  // The end of the run has its own evaluation.
  if (state_.step == options_.train.iterations) return;
  const bool evaluation_due = every(state_.step, options_.train.evaluate_every) && can_evaluate();
  const bool pictures_due = every(state_.step, options_.train.picture_every);
  if (!evaluation_due && !pictures_due) return;
  monitor_.check();
  times_.end("steps");
  const double seconds = run_seconds();
  const data::Dataset& posed = look_at_dataset();
  if (evaluation_due) {
    const eval::Evaluation evaluation = log_evaluation(posed, seconds);
    if (watcher) watcher->on_evaluation(posed, evaluation);
  }
  if (pictures_due) write_pictures(posed);
  times_.end(kLooks);
}

void Trainer::stop() {
  save();
  log_info(concat("saved at step ", state_.step, "; go on with jade_train --output ",
                  directory_.path().string(), " --resume"));
  pictures_.wait();
  throw Interrupted();
}

void Trainer::finish() {
  monitor_.check();
  times_.end("steps");
  save();
  times_.end("checkpoint");
  const data::Dataset posed = posed_dataset();
  if (state_.poses) {
    if (interrupt_requested()) stop();  // discard half-fitted poses
    write_learned_cameras(directory_.path() / kLearnedCamerasFile, posed);
  }
  // Written after its cameras, because its existence marks the end of the run.
  gaussians::write_ply(directory_.path() / kSceneFile,
                       {state_.gaussians.detached(), false, data_.dataset.origin});
  times_.end("test poses, scene");
  write_pictures(posed, /*truths=*/true);
  times_.end("pictures");
  if (can_evaluate()) {
    const eval::Evaluation evaluation = evaluate(posed);
    write_file(directory_.path() / kScoresFile, eval::to_json(evaluation));
    log_info((data_.dataset.test.empty() ? "on the held-out exposures:\n"
                                         : "on the sharp test views:\n") +
             eval::to_table(evaluation));
  }
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
  times_.end("scores");
  write_report(directory_.path(), posed, bank(), state_, options_);
  pictures_.wait();
  times_.end("report");
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
  if (state_.step < options_.train.iterations) directory_.remove_results();
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
  while (state_.step < options_.train.iterations) {
    step([&] { look(watcher); });
    if (progress.step()) progress.show(status_);
    if (watcher) logged_seconds_ += watcher->after_step();
    if (interrupt_requested()) stop();
    if (state_.step < options_.train.iterations && every(state_.step, options_.checkpoint.every)) {
      save();
    }
  }
  progress.finish();
  if (watcher) watcher->ended();
  finish();
}

}  // namespace jade::run
