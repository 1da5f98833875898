// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <torch/types.h>

#include "jade/serve/wanted.h"

namespace jade::serve {

/// A picture rendered for a viewer.
struct Rendered {
  torch::Tensor image;              ///< [3,H,W] or [1,H,W] float32 on the CPU, not written again
  std::function<void()> finish;     ///< waits until `image` is there; empty: it is
  int64_t step = 0, gaussians = 0;  ///< of the scene that it shows
  /// PSNR of `image` to a sharp truth, dB, once it is there; empty where none tells. Asked by the
  /// thread that answers, so that it costs the one that renders nothing.
  std::function<double()> psnr;
  std::string json;  ///< of kCamera, in place of an image: {"poses": [[12 numbers]]}
};

/// Thrown while drawing: it is being made and comes by itself; whoever asked asks again.
struct NotYet {};

/// Outcome of a viewer's request.
struct Answer {
  enum class Kind { kRendered, kTooLate, kFull, kFailed };
  Kind kind = Kind::kTooLate;
  Rendered rendered;   ///< of kRendered
  std::string reason;  ///< of kFailed
};

/// Queue between viewers and the one rendering thread. Viewers ask and wait; the thread renders
/// when it has time. Without requests it costs one atomic load. The newest request of a viewer
/// replaces its older ones for the same thing; a viewer that does not ask again gets nothing more,
/// so that slow and vanished ones hold nothing up. Memory is bounded by kMostWaiting.
class RenderQueue {
 public:
  static constexpr size_t kMostWaiting = 32;
  using Render = std::function<Rendered(const Wanted&)>;
  using Seconds = std::chrono::duration<double>;

  // --- the thread that renders

  bool asked() const { return waiting_.load(std::memory_order_relaxed) > 0; }
  /// Waits for somebody to ask or for a change of paused(). True once somebody does.
  bool wait(Seconds at_most);
  /// Renders the request that has waited longest, if there is one. What `render` throws is the
  /// answer: a picture that cannot be rendered must not end a run. NotYet is kTooLate.
  void render_one(const Render& render);

  // --- the threads of those who ask

  /// @param key  of the viewer and the thing; a request under the same key is answered kTooLate
  Answer ask(const std::string& key, const Wanted& wanted, Seconds at_most);
  void set_paused(bool paused);
  /// A viewer was there.
  void note(const std::string& viewer);

  // --- any thread

  bool paused() const { return paused_; }
  /// Viewers that were there within the last ten seconds.
  int64_t viewers() const;
  /// Since the last viewer was there.
  Seconds silence() const;
  /// Answers all that wait and whoever asks from now on with kTooLate.
  void close();

 private:
  using Clock = std::chrono::steady_clock;
  struct Request {
    std::string key;
    Wanted wanted;
    Answer answer;
    bool done = false;
  };
  using Waiting = std::list<std::shared_ptr<Request>>;

  void finish(Waiting::iterator at);

  mutable std::mutex mutex_;
  std::condition_variable asked_, answered_;
  Waiting requests_;
  std::atomic<size_t> waiting_{0};
  std::atomic<bool> paused_{false};
  bool closed_ = false;
  std::map<std::string, Clock::time_point> seen_;
  Clock::time_point last_seen_ = Clock::now();
};

}  // namespace jade::serve
