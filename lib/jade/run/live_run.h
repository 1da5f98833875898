// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "jade/run/draw_clock.h"
#include "jade/run/live_cameras.h"
#include "jade/run/live_scene.h"
#include "jade/run/watcher.h"
#include "jade/serve/server.h"

namespace jade::run {

/// Shows a run on the live page. Between two steps it renders what viewers request, for at most a
/// tenth of the time; while paused, at any time. It only reads the state.
class LiveRun : public Watcher {
 public:
  /// @param server    must outlive this
  /// @param patience  a pause ends if no viewer has sent a request for this long, so that a
  ///   vanished viewer cannot block the run. Browsers let a hidden page send one request per
  ///   minute.
  explicit LiveRun(serve::Server& server,
                   std::chrono::duration<double> patience = std::chrono::minutes(3));
  /// After the end of a run, waits until recent viewers can have received the message.
  ~LiveRun() override;

  void begin(const WatchedRun& run) override;
  double after_step() override;
  void on_evaluation(const data::Dataset& posed, const eval::Evaluation& evaluation) override;
  void on_metrics(const std::string& line) override;
  void ended() override;

 private:
  using Clock = std::chrono::steady_clock;

  void tell(const std::string& phase);
  bool may_draw();
  void render_one();
  double hold();

  serve::Server& server_;
  std::chrono::duration<double> patience_;
  train::TrainState* state_ = nullptr;
  int64_t steps_ = 0;
  std::optional<LiveCameras> cameras_;
  std::optional<LiveScene> scene_;
  std::optional<DrawClock> clock_;
  bool drawing_ = false;
  Clock::time_point rendered_at_, next_draw_;
  std::optional<Clock::time_point> ended_at_;
};

}  // namespace jade::run
