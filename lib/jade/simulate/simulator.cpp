// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/simulator.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/simulate/auto_exposure.h"
#include "jade/simulate/gaussian_source.h"
#include "jade/simulate/recorder.h"
#include "jade/simulate/sensor.h"
#include "jade/simulate/written_poses.h"
#include "jade/world/ray_caster.h"
#include "jade/world/worlds.h"

namespace jade::simulate {
namespace {

constexpr int64_t kPathStep_us = 1000;  // of the written trajectory

void add_poses(const WrittenPoses& poses, const Timeline& timeline,
               data::EvDeblurContent& content) {
  for (auto& exposure : content.train) {
    const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
    for (size_t k = 0; k < times.size(); ++k) {
      exposure.poses[k] = poses.path(static_cast<int64_t>(std::llround(times[k])));
    }
  }
  for (auto& view : content.test) view.pose = poses.frame(view.t_us);
  for (int64_t t = 0; t < timeline.end_us; t += kPathStep_us) content.path_t_us.push_back(t);
  content.path_t_us.push_back(timeline.end_us);
  for (int64_t t : content.path_t_us) content.path.push_back(poses.path(t));
}

world::Vec3 vector_or(const std::vector<double>& values, world::Vec3 fallback) {
  if (values.empty()) return fallback;
  return {static_cast<float>(values[0]), static_cast<float>(values[1]),
          static_cast<float>(values[2])};
}

world::CameraRig rig_for(const CameraOptions& o, world::CameraRig rig) {
  rig.eye = vector_or(o.eye, rig.eye), rig.target = vector_or(o.target, rig.target);
  rig.up = vector_or(o.up, rig.up);
  rig.eye_reach = vector_or(o.eye_reach, rig.eye_reach);
  rig.target_reach = vector_or(o.target_reach, rig.target_reach);
  return rig;
}

std::unique_ptr<Footage> open_footage(const SimulateRun& run, const Timeline& timeline) {
  const SimulateOptions& o = run.simulate;
  if (o.source == Source::kFrames) {
    auto footage = std::make_unique<StoredFootage>(o.path, o.frame_rate_hz, o.events.log_eps);
    if (footage->duration_us() < timeline.end_us) {
      throw ConfigError(concat("simulate.exposures: ", o.exposures, " exposures last ",
                               timeline.end_us / 1000, " ms, found frames for ",
                               footage->duration_us() / 1000,
                               " ms; lower exposures, exposure_ms or "
                               "frame_rate_hz"));
    }
    return footage;
  }
  if (o.source == Source::kPly) {
    auto source = std::make_unique<GaussianSource>(o.path);
    const world::CameraRig rig = rig_for(o.camera, source->rig());
    return std::make_unique<RenderedFootage>(run, std::move(source), rig, timeline);
  }
  auto source = std::make_unique<world::RayCaster>(
      world::make_world(o.world, static_cast<uint64_t>(run.seed)));
  const world::CameraRig rig = rig_for(o.camera, source->world().rig);
  return std::make_unique<RenderedFootage>(run, std::move(source), rig, timeline);
}

}  // namespace

SimulateResult simulate(const SimulateRun& run, Footage& footage) {
  validate(run);
  Timeline timeline = make_timeline(run.simulate);
  auto settings = exposure_settings(run.simulate, footage, timeline);
  shorten(settings, timeline);
  Recorder recorder(run, footage, timeline, std::move(settings));
  auto recording = recorder.record();
  SimulateResult result;
  result.frames = recording.frames, result.event_camera = footage.event_camera();
  result.blur_px = footage.blur_px(), result.largest_flow_px = footage.largest_flow_px();
  data::EvDeblurContent& content = result.content;
  content.train = std::move(recording.exposures);
  content.events = recording.events;
  content.color_events = run.simulate.events.bayer != Bayer::kNone;
  for (const auto& window : timeline.exposures) {
    throw_if_interrupted();
    content.sharp_mid.push_back(recorder.sharp(window.mid_us()));
  }
  for (int64_t t : timeline.tests_us) {
    throw_if_interrupted();
    data::SharpView view;
    view.image = recorder.sharp(t), view.t_us = t, view.camera = footage.camera();
    content.test.push_back(view);
    view.image = recorder.recorded(t), view.gain = recorder.setting_at(t).brightness();
    result.recorded_views.push_back(std::move(view));
  }
  add_poses(WrittenPoses(run, footage, timeline), timeline, content);
  result.pose_errors = pose_errors(content.train, footage);
  const auto depths = footage.depths(timeline);
  content.near = depths.near, content.far = depths.far;
  return result;
}

SimulateResult simulate(const SimulateRun& run) {
  validate(run);
  return simulate(run, *open_footage(run, make_timeline(run.simulate)));
}

torch::Tensor exposure_footage(const SimulateRun& run, int64_t frames) {
  validate(run);
  JADE_CHECK(frames >= 2, "exposure_footage: expected at least 2 frames, found ", frames);
  Timeline timeline = make_timeline(run.simulate);
  const auto footage = open_footage(run, timeline);
  shorten(exposure_settings(run.simulate, *footage, timeline), timeline);
  const auto samples = static_cast<int>(run.simulate.sampling.samples);
  const auto exposures = static_cast<int64_t>(timeline.exposures.size());
  const geometry::Intrinsics& camera = footage->camera();
  const Optics optics(run.simulate, camera.width, camera.height, 0);
  torch::Tensor all = torch::empty({exposures, frames, 3, camera.height, camera.width}, torch::kU8);
  Progress progress("footage", exposures * frames, 0, "frames");
  world::SharpFrame frame;
  for (int64_t e = 0; e < exposures; ++e) {
    const auto& window = timeline.exposures[static_cast<size_t>(e)];
    const int64_t length_us = window.end_us - window.begin_us;
    for (int64_t i = 0; i < frames; ++i) {
      throw_if_interrupted();
      footage->frame(window.begin_us + length_us * i / (frames - 1), samples, frame);
      optics.brighten(frame);
      all[e][i].copy_((to_image(frame) * 255).round());
      if (progress.step()) progress.show();
    }
  }
  return all;
}

void write(const SimulateResult& result, const SimulateRun& run,
           const std::filesystem::path& folder) {
  data::EvDeblurContent content = result.content;
  if (result.event_camera) content.events = {}, content.color_events = false;
  data::write_evdeblur(folder, content);
  SimulateRun copy = run;
  write_file(folder / "simulation.yaml", config::to_yaml(fields_of(copy), "jade_simulate"));
}

}  // namespace jade::simulate
