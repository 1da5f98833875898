// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace jade::serve {

/// Progress of a run for its viewers.
struct Progress {
  int64_t step = 0, steps = 0, gaussians = 0;
  std::string phase;  ///< "training", "paused", "finishing"; "still" for a scene that does not
                      ///< change
};

/// Scores of an evaluation, by camera of the data set: "test.0".
struct Scored {
  int64_t step = 0;
  std::map<std::string, double> psnr;
};

/// Progress and lines of metrics.jsonl for all viewers, which poll about once per second. No state
/// per viewer. Thread-safe.
class Board {
 public:
  /// At this many lines every second one is dropped, except the newest.
  static constexpr size_t kMostLines = 2000;

  Board();
  /// Identifies this server, so that a page notices when another server has taken its port.
  const std::string& id() const { return id_; }

  void set(const Progress& progress);
  void set(const Scored& scored);
  void add(const std::string& line);

  /// {"id", "step", "steps", "gaussians", "phase", "scored": {"step", "psnr": {…}}, "viewers",
  /// "generation", "count", "lines": […]}: the lines from `from` on, or all if `generation` is
  /// outdated, because lines have been dropped. The next request sends the answer's generation, and
  /// its count as `from`.
  std::string json(int64_t generation, int64_t from, int64_t viewers) const;

 private:
  const std::string id_;
  mutable std::mutex mutex_;
  Progress progress_;
  Scored scored_;
  std::vector<std::string> lines_;
  int64_t generation_ = 0;
};

}  // namespace jade::serve
