// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_run.h"

#include <fstream>
#include <thread>

#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/page/page.h"
#include "jade/run/run_directory.h"

namespace jade::run {
namespace {

/// Share of the training time spent on rendering for viewers; encoding costs more on other threads.
constexpr double kShare = 0.1;

/// How soon a paused run reacts to Ctrl-C.
constexpr serve::RenderQueue::Seconds kGlance{0.05};

/// Pages poll the state once per second; a viewer silent for longer is gone.
constexpr serve::RenderQueue::Seconds kHeard{3}, kGone{3};

}  // namespace

LiveRun::LiveRun(serve::Server& server, std::chrono::duration<double> patience)
    : server_(server), patience_(patience) {}

LiveRun::~LiveRun() {
  const serve::RenderQueue& queue = server_.queue();
  while (ended_at_ && Clock::now() - *ended_at_ < kHeard && queue.viewers() > 0 &&
         queue.silence() < kGone && !interrupt_requested()) {
    std::this_thread::sleep_for(kGlance);
  }
}

void LiveRun::begin(const WatchedRun& run) {
  state_ = &run.state;
  steps_ = run.options.train.iterations;
  const splat::RenderOptions draw = train::render_options(run.options);
  const GaussianSource gaussians = [state = state_] {
    return gaussians::map_parameters(state->gaussians.parameters(),
                                     [](const torch::Tensor& tensor) { return tensor.detach(); });
  };
  cameras_.emplace(run.dataset, run.state.poses.module);
  cameras_->update_all();
  const data::Dataset& posed = cameras_->dataset();
  scene_.emplace(posed, draw, gaussians);
  for (int64_t i = 0; i < run.bank.size(); ++i) {
    scene_->add(concat("train.", i), training_pictures(posed, run.bank, i, run.state, draw));
  }
  for (size_t i = 0; i < posed.test.size(); ++i) {
    scene_->add(concat("test.", i), test_pictures(posed.test[i], gaussians, draw));
  }
  clock_.emplace(state_->gaussians.device());
  std::ifstream metrics(run.folder / "metrics.jsonl");
  for (std::string line; std::getline(metrics, line);) on_metrics(line);
  tell("training");
  server_.show(page::live_page(scene_->page_data(
      {{concat(run.dataset.train.size(), " exposures"), device_name(state_->gaussians.device())},
       read_file(run.folder / "config.yaml"),
       server_.board().id(),
       /*pausable=*/true,
       cameras_->are_learned(),
       (run.folder / kReportFile).string()})));
}

void LiveRun::tell(const std::string& phase) {
  server_.board().set({state_->step, steps_, state_->gaussians.size(), phase});
}

bool LiveRun::may_draw() {
  if (drawing_) {
    const std::optional<double> seconds = clock_->seconds();
    if (!seconds) return false;
    drawing_ = false;
    const std::chrono::duration<double> apart(*seconds / kShare);
    next_draw_ = rendered_at_ + std::chrono::duration_cast<Clock::duration>(apart);
  }
  return Clock::now() >= next_draw_;
}

void LiveRun::render_one() {
  rendered_at_ = Clock::now();
  clock_->start();
  server_.queue().render_one([this](const serve::Wanted& wanted) {
    // A frame's request contains its pose.
    if (wanted.kind != serve::Wanted::Kind::kColor) cameras_->update(wanted.view);
    return scene_->draw(wanted, state_->step);
  });
  clock_->stop();
  drawing_ = true;
}

double LiveRun::after_step() {
  tell("training");
  if (server_.queue().asked() && may_draw()) render_one();
  return server_.queue().paused() ? hold() : 0.0;
}

double LiveRun::hold() {
  const Clock::time_point start = Clock::now();
  log_info(concat("a viewer has paused the run at step ", state_->step));
  tell("paused");
  serve::RenderQueue& queue = server_.queue();
  while (queue.paused() && !interrupt_requested()) {
    if (queue.silence() > patience_) {
      log_info("no viewer is left");
      queue.set_paused(false);
    } else if (queue.wait(kGlance)) {
      render_one();
    }
  }
  if (!interrupt_requested()) log_info("the run continues");
  tell("training");
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void LiveRun::on_evaluation(const data::Dataset& posed, const eval::Evaluation& evaluation) {
  cameras_->refit(posed);
  serve::Scored scored{state_->step, {}};
  for (size_t i = 0; i < evaluation.views.size(); ++i) {
    scored.psnr[concat("test.", i)] = evaluation.views[i].psnr;
  }
  server_.board().set(scored);
}

void LiveRun::on_metrics(const std::string& line) { server_.board().add(line); }

void LiveRun::ended() {
  tell("finishing");
  ended_at_ = Clock::now();
}

}  // namespace jade::run
