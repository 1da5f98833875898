// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace jade {

/// Turns progress reports off for the whole program (--quiet) or on again.
void set_progress_enabled(bool enabled);

/// Reports the progress of long work: a live bar with rate and remaining time on a terminal, a
/// plain line every 10 s otherwise. Costs one clock reading per step:
///
///   Progress progress("simulate", frames);
///   for (...) { work(); if (progress.step()) progress.show("12 events/µs"); }
class Progress {
 public:
  /// Shows the bar on a terminal.
  /// @param total number of steps; `done` of them are already complete (a resumed run).
  Progress(std::string title, int64_t total, int64_t done = 0, std::string unit = "it");
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Counts `count` steps. Returns true when a report is due (about ten times per second on a
  /// terminal, every 10 s otherwise), so that the caller formats a text for show() only then.
  bool step(int64_t count = 1);

  /// Shows the bar with `details` behind it.
  void show(const std::string& details = "");

  /// Steps per second since construction.
  double rate() const;

  /// Removes the live bar; the destructor does the same.
  void finish();

 private:
  std::string title_;
  std::string unit_;
  int64_t total_;
  int64_t first_;
  int64_t done_;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point next_report_;
};

/// "1:02:03" or "4:05".
std::string duration_text(double seconds);

}  // namespace jade
