// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/recorder.h"

#include <algorithm>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/core/random.h"
#include "jade/core/readable.h"

namespace jade::simulate {

Recorder::Recorder(const SimulateRun& run, Footage& footage, const Timeline& timeline,
                   std::vector<ExposureSetting> settings)
    : run_(run),
      footage_(footage),
      timeline_(timeline),
      settings_(std::move(settings)),
      object_(moving_object()),
      optics_(run.simulate, footage.camera().width, footage.camera().height, seed("optics")),
      event_optics_(run.simulate, event_camera().width, event_camera().height,
                    seed(footage.event_camera() ? "event optics" : "optics")),
      pattern_(run.simulate.image, footage.camera().width, footage.camera().height,
               seed("fixed pattern")),
      sensor_(run.simulate.events, event_camera().width, event_camera().height, seed("events")) {}

// Slightly behind the nearest points.
MovingObject Recorder::moving_object() const {
  const ObjectOptions& options = run_.simulate.object;
  const double depth = options.radius_px > 0 ? 1.2 * footage_.depths(timeline_).near : 1;
  return {options, footage_.camera(), footage_.pose(0.5 * static_cast<double>(timeline_.end_us)),
          depth};
}

geometry::Intrinsics Recorder::event_camera() const {
  const auto beside = footage_.event_camera();
  return beside ? beside->camera : footage_.camera();
}

uint64_t Recorder::seed(const std::string& purpose) const {
  return derive_seed(static_cast<uint64_t>(run_.seed), purpose);
}

Recorder::Recording Recorder::record() {
  Recording recording;
  // Frames must include the ends of exposures and the end of the recording.
  std::vector<int64_t> stops;
  for (const auto& window : timeline_.exposures) {
    stops.push_back(window.begin_us), stops.push_back(window.end_us);
  }
  stops.push_back(timeline_.end_us);
  Progress progress("simulate", timeline_.end_us / 1000, 0, "ms");
  Views before, after;
  look(0, before);
  light(before, 0, lit_before_);
  feed(lit_before_, 0);
  int64_t now = 0;
  for (size_t stop = 0; now < timeline_.end_us; ++recording.frames) {
    throw_if_interrupted();
    while (stops[stop] <= now) ++stop;
    const int64_t next = footage_.next_us(before.frames, now, latest(now, stops[stop]));
    look(next, after);
    watch(before, after, now, next, recording.exposures);
    if (progress.step(next / 1000 - now / 1000)) {
      progress.show(grouped(sensor_.event_count()) + " events");
    }
    std::swap(before, after);
    now = next;
  }
  recording.events = sensor_.take();
  return recording;
}

// The footage does not contain the object.
int64_t Recorder::latest(int64_t now_us, int64_t until_us) const {
  if (!object_.is_there()) return until_us;
  const double step_us = object_.time_for_us(run_.simulate.sampling.max_flow_px);
  if (step_us >= static_cast<double>(until_us - now_us)) return until_us;
  return now_us + std::max<int64_t>(1, static_cast<int64_t>(step_us));
}

torch::Tensor Recorder::sharp(int64_t t_us) const {
  world::SharpFrame frame;
  footage_.frame(t_us, static_cast<int>(run_.simulate.sampling.sharp_samples), frame);
  optics_.brighten(frame);
  return to_image(frame);
}

torch::Tensor Recorder::recorded(int64_t t_us) const {
  const auto t = static_cast<double>(t_us);
  world::SharpFrame frame;
  footage_.frame(t_us, static_cast<int>(run_.simulate.sampling.sharp_samples), frame);
  if (object_.is_there()) object_.draw(footage_.camera(), footage_.pose(t), t, frame);
  if (optics_.changes()) optics_.light(frame, t, frame);
  ImageSensorOptions noiseless = run_.simulate.image;
  noiseless.full_well = noiseless.read_noise = 0;
  Exposing exposing(noiseless, frame.width, frame.height);
  exposing.add(frame, frame, 1);
  return exposing.develop(0, setting_at(t_us), &pattern_);
}

const ExposureSetting& Recorder::setting_at(int64_t t_us) const {
  size_t i = 0;
  while (i + 1 < settings_.size() && timeline_.exposures[i + 1].begin_us <= t_us) ++i;
  return settings_[i];
}

void Recorder::look(int64_t t_us, Views& views) const {
  const auto samples = static_cast<int>(run_.simulate.sampling.samples);
  const auto t = static_cast<double>(t_us);
  footage_.frame(t_us, samples, views.frames);
  if (object_.is_there()) object_.draw(footage_.camera(), footage_.pose(t), t, views.frames);
  if (const auto beside = footage_.event_camera()) {
    footage_.event_frame(t_us, samples, views.events);
    if (object_.is_there()) {
      object_.draw(beside->camera, geometry::compose(beside->from_frames, footage_.pose(t)), t,
                   views.events);
    }
  }
}

void Recorder::light(const Views& views, int64_t t_us, Views& lit) const {
  if (!optics_.changes()) {
    lit = views;
    return;
  }
  const auto t = static_cast<double>(t_us);
  optics_.light(views.frames, t, lit.frames);
  if (footage_.event_camera()) event_optics_.light(views.events, t, lit.events);
}

// Between two frames the scene's values are linear, while the light may flicker faster.
void Recorder::watch(const Views& before, const Views& after, int64_t from_us, int64_t to_us,
                     std::vector<data::Exposure>& done) {
  const int64_t length = to_us - from_us;
  int64_t parts = 1;
  if (optics_.flickers()) {
    parts = static_cast<int64_t>(static_cast<double>(length) / optics_.flicker_step_us()) + 1;
    parts = std::min(parts, length);
  }
  int64_t now = from_us;
  for (int64_t part = 1; part <= parts; ++part) {
    const int64_t next = from_us + length * part / parts;
    const bool last = part == parts;
    if (!last) {
      const auto share = static_cast<float>(next - from_us) / static_cast<float>(length);
      mix(before.frames, after.frames, share, mixed_.frames);
      if (footage_.event_camera()) mix(before.events, after.events, share, mixed_.events);
    }
    light(last ? after : mixed_, next, lit_after_);
    feed(lit_after_, next);
    expose(lit_before_.frames, lit_after_.frames, now, next, done);
    std::swap(lit_before_, lit_after_);
    now = next;
  }
}

void Recorder::feed(const Views& views, int64_t t_us) {
  event_intensity(footage_.event_camera() ? views.events : views.frames, run_.simulate.image,
                  run_.simulate.events, intensity_);
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
  exposure.blurry = exposing_->develop(seed(concat("image noise ", done.size())),
                                       settings_[done.size()], &pattern_);
  exposure.gain = settings_[done.size()].brightness();
  exposure.t_start_us = window.begin_us, exposure.t_end_us = window.end_us;
  exposure.camera = footage_.camera();
  done.push_back(std::move(exposure));
  exposing_.reset();
}

}  // namespace jade::simulate
