// SPDX-License-Identifier: Apache-2.0
#include "jade/run/draw_clock.h"

#include <algorithm>
#include <c10/core/Event.h>
#include <c10/core/impl/VirtualGuardImpl.h>

namespace jade::run {

struct DrawClock::Marks {
  c10::Event start{torch::kCUDA, c10::EventFlag::BACKEND_DEFAULT};
  c10::Event stop{torch::kCUDA, c10::EventFlag::BACKEND_DEFAULT};
};

DrawClock::DrawClock(torch::Device device) : device_(device) {}

DrawClock::~DrawClock() = default;

void DrawClock::start() {
  here_.reset();
  start_ = Clock::now();
  if (!device_.is_cuda()) return;
  marks_ = std::make_unique<Marks>();
  marks_->start.record(c10::impl::VirtualGuardImpl(device_.type()).getStream(device_));
}

void DrawClock::stop() {
  here_ = std::chrono::duration<double>(Clock::now() - start_).count();
  if (marks_) marks_->stop.record(c10::impl::VirtualGuardImpl(device_.type()).getStream(device_));
}

std::optional<double> DrawClock::seconds() const {
  if (!here_ || !marks_) return here_;
  if (!marks_->stop.query()) return std::nullopt;
  return std::max(*here_, 1e-3 * marks_->start.elapsedTime(marks_->stop));
}

}  // namespace jade::run
