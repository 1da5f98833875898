// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/losses/objective.h"
#include "jade/splat/render.h"
#include "jade/train/exposure_span.h"
#include "jade/train/visit.h"

namespace jade::train {

/// Input of L_ev: the camera at both ends of a short time window and the events between them.
struct EventWindow {
  splat::CameraBatch cameras;  ///< two: at the start and at the end of the window
  torch::Tensor u;             ///< [2] float64, their times in units of the step's exposure, in
                               ///< [0,1]
  torch::Tensor counts;        ///< [H,W] signed sum of the window's events
  torch::Tensor pixels;        ///< [P] int64, distinct pixels sampled for L_ev
  torch::Tensor color_filter;  ///< [H,W,3] bool, the colour of each pixel's events; undefined: gray

  bool defined() const { return counts.defined(); }

  /// Calls `visitor(name, tensor)` for every tensor, once.
  template <class Visitor>
  void visit(Visitor&& visitor) {
    visit_each(*this, visitor);
  }
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    visit_each(*this, visitor);
  }

 private:
  template <class Self, class Visitor>
  static void visit_each(Self& self, Visitor& visitor) {
    visit_members<EventWindow>(visitor, Member{"cameras", self.cameras}, Member{"u", self.u},
                               Member{"counts", self.counts}, Member{"pixels", self.pixels},
                               Member{"color_filter", self.color_filter});
  }
};

/// Samples the time windows of L_ev as functions of the seed and the step, like train/draws.h.
/// Keeps the recording's events on the device: 17 bytes each.
class EventWindows {
 public:
  /// Windows of `event_window_share` of the first exposure's duration, inside the step's exposure.
  /// Cameras move along its nine poses.
  EventWindows(const data::Dataset& dataset, const losses::ObjectiveOptions& options, uint64_t seed,
               torch::Device device);

  /// The window of `step` (counted from 1) for the training view `view`. Does not wait for the
  /// device.
  EventWindow at(int64_t step, int64_t view) const;

 private:
  std::vector<ExposureSpan> spans_;  // each window lies inside that of its exposure
  events::EventStream events_;       // on the CPU, for the search of windows
  events::EventStream on_device_;    // the same events, for their counts
  events::ImageSize size_;
  splat::CameraBatch cameras_;  // two, whose poses at() sets
  torch::Tensor color_filter_;
  int64_t window_us_ = 0;
  int64_t pixels_ = 0;
  uint64_t seed_ = 0;
  torch::Device device_;
};

}  // namespace jade::train
