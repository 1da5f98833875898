// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/recorder.h"

#include <utility>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/core/random.h"

namespace jade::simulate {

Recorder::Recorder(const SimulateRun& run, Footage& footage, const Timeline& timeline)
    : run_(run),
      footage_(footage),
      timeline_(timeline),
      sensor_(run.simulate.events, event_camera().width, event_camera().height, seed("events")) {}

geometry::Intrinsics Recorder::event_camera() const {
  const auto beside = footage_.event_camera();
  return beside ? beside->camera : footage_.camera();
}

uint64_t Recorder::seed(const std::string& purpose) const {
  return derive_seed(static_cast<uint64_t>(run_.seed), purpose);
}

Recorder::Recording Recorder::record() {
  Recording recording;
  const auto samples = static_cast<int>(run_.simulate.sampling.samples);
  // Frames fall on the ends of exposures and on the end of the recording.
  std::vector<int64_t> stops;
  for (const auto& window : timeline_.exposures) {
    stops.push_back(window.begin_us), stops.push_back(window.end_us);
  }
  stops.push_back(timeline_.end_us);
  Progress progress("simulate", timeline_.end_us / 1000, 0, "ms");
  world::SharpFrame before, after;
  footage_.frame(0, samples, before);
  feed(before, 0);
  int64_t now = 0;
  for (size_t stop = 0; now < timeline_.end_us; ++recording.frames) {
    throw_if_interrupted();
    while (stops[stop] <= now) ++stop;
    const int64_t next = footage_.next_us(before, now, stops[stop]);
    footage_.frame(next, samples, after);
    feed(after, next);
    expose(before, after, now, next, recording.exposures);
    if (progress.step(next / 1000 - now / 1000)) {
      progress.show(concat(sensor_.event_count() / 1000, "k events"));
    }
    std::swap(before, after);
    now = next;
  }
  recording.events = sensor_.take();
  return recording;
}

torch::Tensor Recorder::sharp(int64_t t_us) const {
  world::SharpFrame frame;
  footage_.frame(t_us, static_cast<int>(run_.simulate.sampling.sharp_samples), frame);
  return to_image(frame);
}

void Recorder::feed(const world::SharpFrame& frame, int64_t t_us) {
  const bool beside = footage_.event_camera().has_value();
  if (beside) {
    footage_.event_frame(t_us, static_cast<int>(run_.simulate.sampling.samples), event_view_);
  }
  event_intensity(beside ? event_view_ : frame, run_.simulate.image, run_.simulate.events,
                  intensity_);
  sensor_.feed(intensity_, t_us);
}

void Recorder::expose(const world::SharpFrame& before, const world::SharpFrame& after,
                      int64_t from_us, int64_t to_us, std::vector<data::Exposure>& done) {
  if (done.size() == timeline_.exposures.size()) return;
  const auto& window = timeline_.exposures[done.size()];
  if (from_us < window.begin_us) return;
  if (!exposing_) {
    exposing_ = std::make_unique<Exposing>(run_.simulate.image, before.width, before.height);
  }
  exposing_->add(before, after, static_cast<double>(to_us - from_us));
  if (to_us < window.end_us) return;
  data::Exposure exposure;
  exposure.blurry = exposing_->develop(seed(concat("image noise ", done.size())));
  exposure.t_start_us = window.begin_us, exposure.t_end_us = window.end_us;
  exposure.camera = footage_.camera();
  done.push_back(std::move(exposure));
  exposing_.reset();
}

}  // namespace jade::simulate
