// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/simulate/esim.h"
#include "jade/simulate/fixed_pattern.h"
#include "jade/simulate/footage.h"
#include "jade/simulate/moving_object.h"
#include "jade/simulate/optics.h"
#include "jade/simulate/sensor.h"

namespace jade::simulate {

/// Records one footage with a frame sensor and an event sensor.
class Recorder {
 public:
  /// @param settings  of each exposure
  Recorder(const SimulateRun& run, Footage& footage, const Timeline& timeline,
           std::vector<ExposureSetting> settings);

  struct Recording {
    std::vector<data::Exposure> exposures;  ///< pictures, times and camera; no poses, no names
    events::EventStream events;
    int64_t frames = 0;  ///< number of sampled frames
  };
  /// Shows progress. @throws Interrupted.
  Recording record();

  /// A sharp picture of the scene without noise, object, flicker, optics and sensor effects.
  torch::Tensor sharp(int64_t t_us) const;
  /// A sharp picture with all of these except noise, with the setting of the previous exposure.
  torch::Tensor recorded(int64_t t_us) const;
  const ExposureSetting& setting_at(int64_t t_us) const;

 private:
  /// Views of the frame camera, and of the event camera if it is separate.
  struct Views {
    world::SharpFrame frames, events;
  };
  /// The latest next sampling time, at most `until_us`.
  int64_t latest(int64_t now_us, int64_t until_us) const;
  void look(int64_t t_us, Views& views) const;
  void light(const Views& views, int64_t t_us, Views& lit) const;
  void watch(const Views& before, const Views& after, int64_t from_us, int64_t to_us,
             std::vector<data::Exposure>& done);
  geometry::Intrinsics event_camera() const;
  MovingObject moving_object() const;
  uint64_t seed(const std::string& purpose) const;
  void feed(const Views& views, int64_t t_us);
  void expose(const world::SharpFrame& before, const world::SharpFrame& after, int64_t from_us,
              int64_t to_us, std::vector<data::Exposure>& done);

  const SimulateRun run_;
  Footage& footage_;
  const Timeline& timeline_;
  const std::vector<ExposureSetting> settings_;
  const MovingObject object_;
  const Optics optics_, event_optics_;
  const FixedPattern pattern_;
  EventSensor sensor_;
  Views mixed_, lit_before_, lit_after_;
  std::vector<float> intensity_;
  std::unique_ptr<Exposing> exposing_;
};

}  // namespace jade::simulate
