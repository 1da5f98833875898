// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/simulate/esim.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/sensor.h"

namespace jade::simulate {

/// Lets a frame sensor and an event sensor watch the same footage.
class Recorder {
 public:
  Recorder(const SimulateRun& run, Footage& footage, const Timeline& timeline);

  struct Recording {
    std::vector<data::Exposure> exposures;  ///< pictures, times and camera; no poses, no names
    events::EventStream events;
    int64_t frames = 0;  ///< looked at
  };
  /// Shows progress. @throws Interrupted.
  Recording record();

  /// A sharp, noiseless picture.
  torch::Tensor sharp(int64_t t_us) const;

 private:
  geometry::Intrinsics event_camera() const;
  uint64_t seed(const std::string& purpose) const;
  void feed(const world::SharpFrame& frame, int64_t t_us);
  void expose(const world::SharpFrame& before, const world::SharpFrame& after, int64_t from_us,
              int64_t to_us, std::vector<data::Exposure>& done);

  const SimulateRun run_;
  Footage& footage_;
  const Timeline& timeline_;
  EventSensor sensor_;
  world::SharpFrame event_view_;  // of an event camera beside that of the frames
  std::vector<float> intensity_;
  std::unique_ptr<Exposing> exposing_;
};

}  // namespace jade::simulate
