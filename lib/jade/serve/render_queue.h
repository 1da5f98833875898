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
  torch::Tensor image;              ///< [3,H,W] or [1,H,W] float32 on the CPU, not modified later
  std::function<void()> finish;     ///< waits until `image` is complete; empty: it is complete
  int64_t step = 0, gaussians = 0;  ///< of the scene that it shows
  /// PSNR of `image` against a true sharp image, dB, once it is complete; empty if there is none.
  /// Evaluated on the answering thread, so that it costs the rendering thread nothing.
  std::function<double()> psnr;
  std::string json;  ///< for kCamera, instead of an image: {"poses": [[12 numbers]]}
};

/// Thrown while rendering: the picture is still being computed; the client should retry.
struct NotYet {};

/// Outcome of a viewer's request.
struct Answer {
  enum class Kind { kRendered, kTooLate, kFull, kFailed };
  Kind kind = Kind::kTooLate;
  Rendered rendered;   ///< for kRendered
  std::string reason;  ///< for kFailed
};

/// Queue between viewers and the one rendering thread. Viewers send requests and wait; the thread
/// renders when it has time. Without requests it costs one atomic load. The newest request of a
/// viewer replaces its older ones for the same picture; a viewer that sends no request receives
/// nothing, so slow and vanished ones block nothing. kMostWaiting limits the memory.
class RenderQueue {
 public:
  static constexpr size_t kMostWaiting = 32;
  using Render = std::function<Rendered(const Wanted&)>;
  using Seconds = std::chrono::duration<double>;

  // --- rendering thread

  bool asked() const { return waiting_.load(std::memory_order_relaxed) > 0; }
  /// Waits for a request or for a change of paused(). Returns true if there is a request.
  bool wait(Seconds at_most);
  /// Renders the request that has waited longest, if any. Errors of `render` become the answer: a
  /// picture that cannot be rendered must not end a run. NotYet becomes kTooLate.
  void render_one(const Render& render);

  // --- requesting threads

  /// @param key  viewer and picture; an older request with the same key is answered with kTooLate
  Answer ask(const std::string& key, const Wanted& wanted, Seconds at_most);
  void set_paused(bool paused);
  /// Records that a viewer was active.
  void note(const std::string& viewer);

  // --- any thread

  bool paused() const { return paused_; }
  /// Number of viewers that were active within the last ten seconds.
  int64_t viewers() const;
  /// Time since a viewer was active.
  Seconds silence() const;
  /// Answers all waiting and future requests with kTooLate.
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
