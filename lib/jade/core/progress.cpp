// SPDX-License-Identifier: Apache-2.0
#include "jade/core/progress.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>

#include "jade/core/readable.h"
#include "jade/core/terminal.h"

namespace jade {
namespace {

using Clock = std::chrono::steady_clock;

std::atomic<bool>& enabled() {
  static std::atomic<bool> value{true};
  return value;
}

std::string bar(double fraction) {
  constexpr int kCells = 20;
  const int full = static_cast<int>(std::floor(fraction * kCells));
  const char* const cells[] = {terminal_is_utf8() ? "░" : "-", terminal_is_utf8() ? "█" : "#"};
  std::string text;
  for (int i = 0; i < kCells; ++i) text += cells[i < full ? 1 : 0];
  return text;
}

Clock::duration period() {
  return terminal_is_live() ? Clock::duration(std::chrono::milliseconds(100))
                            : Clock::duration(std::chrono::seconds(10));
}

}  // namespace

void set_progress_enabled(bool value) { enabled() = value; }

std::string duration_text(double seconds) {
  const auto whole = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
  char text[32];
  if (whole >= 3600) {
    std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", static_cast<long long>(whole / 3600),
                  static_cast<long long>(whole / 60 % 60), static_cast<long long>(whole % 60));
  } else {
    std::snprintf(text, sizeof text, "%lld:%02lld", static_cast<long long>(whole / 60),
                  static_cast<long long>(whole % 60));
  }
  return text;
}

Progress::Progress(std::string title, int64_t total, int64_t done, std::string unit)
    : title_(std::move(title)),
      unit_(std::move(unit)),
      total_(total),
      first_(done),
      done_(done),
      start_(Clock::now()),
      next_report_(start_ + period()) {
  if (terminal_is_live()) show();
}

Progress::~Progress() { finish(); }

bool Progress::step(int64_t count) {
  done_ += count;
  const auto now = Clock::now();
  if (now < next_report_ || !enabled()) return false;
  next_report_ = now + period();
  return true;
}

double Progress::rate() const {
  const double seconds = std::chrono::duration<double>(Clock::now() - start_).count();
  return seconds > 0 ? static_cast<double>(done_ - first_) / seconds : 0.0;
}

void Progress::show(const std::string& details) {
  if (!enabled()) return;
  const double speed = rate();
  const double fraction =
      total_ > 0 ? static_cast<double>(done_) / static_cast<double>(total_) : 1.0;
  std::string numbers = grouped(done_) + "/" + grouped(total_);
  if (done_ > first_ && speed > 0) {
    char pace[96];
    std::snprintf(pace, sizeof pace, "  %.*f %s/s  %s left", speed < 10 ? 2 : 0, speed,
                  unit_.c_str(),
                  duration_text(static_cast<double>(total_ - done_) / speed).c_str());
    numbers += pace;
  }
  const std::string tail = details.empty() ? "" : "  " + details;
  if (terminal_is_live()) {
    terminal_set_live_line(title_ + " " + bar(std::clamp(fraction, 0.0, 1.0)) + " " + numbers +
                           tail);
  } else {
    terminal_print_line(title_ + ": " + numbers + tail);
  }
}

void Progress::finish() { terminal_set_live_line(""); }

}  // namespace jade
