// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/simulator.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/core/random.h"
#include "jade/simulate/esim.h"
#include "jade/simulate/ray_caster.h"
#include "jade/simulate/sampling.h"
#include "jade/simulate/scenes.h"
#include "jade/simulate/sensor.h"

namespace jade::simulate {
namespace {

constexpr int64_t kPathStep_us = 2000;  // of the written trajectory

/// Renders frame after frame, feeds the event sensor and the running exposure.
class Recorder {
 public:
  Recorder(const SimulateRun& run, const FrameSource& source, const CameraPath& path,
           const geometry::Intrinsics& camera, const Timeline& timeline)
      : run_(run),
        source_(source),
        path_(path),
        camera_(camera),
        timeline_(timeline),
        clock_(run.simulate.sampling, path, camera),
        sensor_(run.simulate.events, camera.width, camera.height, seed("events")) {}

  void record(SimulateResult& result) {
    Progress progress("simulate", timeline_.end_us / 1000, 0, "ms");
    SharpFrame before = frame_at(0), after;
    int64_t now = 0;
    feed(before, 0);
    for (size_t stop = 0; now < timeline_.end_us;) {
      throw_if_interrupted();
      while (stops()[stop] <= now) ++stop;
      const int64_t next = clock_.next_us(before, now, stops()[stop]);
      source_.render(path_.at(static_cast<double>(next)), camera_, samples(), after);
      result.largest_flow_px = std::max(
          result.largest_flow_px, largest_flow(before, camera_, path_.at(static_cast<double>(now)),
                                               path_.at(static_cast<double>(next))));
      feed(after, next);
      expose(before, after, now, next, result);
      if (progress.step(next / 1000 - now / 1000)) {
        progress.show(concat(sensor_.event_count() / 1000, "k events"));
      }
      std::swap(before, after);
      now = next;
      ++result.frames;
    }
    result.content.events = sensor_.take();
  }

  torch::Tensor sharp_at(int64_t t_us) const {
    SharpFrame frame;
    source_.render(path_.at(static_cast<double>(t_us)), camera_,
                   static_cast<int>(run_.simulate.sampling.sharp_samples), frame);
    return to_image(frame);
  }

  uint64_t seed(const std::string& purpose) const {
    return derive_seed(static_cast<uint64_t>(run_.seed), purpose);
  }

 private:
  int samples() const { return static_cast<int>(run_.simulate.sampling.samples); }

  SharpFrame frame_at(int64_t t_us) const {
    SharpFrame frame;
    source_.render(path_.at(static_cast<double>(t_us)), camera_, samples(), frame);
    return frame;
  }

  // Frames fall on the ends of exposures and on the end of the recording.
  const std::vector<int64_t>& stops() {
    if (stops_.empty()) {
      for (const auto& window : timeline_.exposures) {
        stops_.push_back(window.begin_us), stops_.push_back(window.end_us);
      }
      stops_.push_back(timeline_.end_us);
    }
    return stops_;
  }

  void feed(const SharpFrame& frame, int64_t t_us) {
    event_intensity(frame, run_.simulate.image, run_.simulate.events, intensity_);
    sensor_.feed(intensity_, t_us);
  }

  void expose(const SharpFrame& before, const SharpFrame& after, int64_t from, int64_t to,
              SimulateResult& result) {
    auto& train = result.content.train;
    if (train.size() == timeline_.exposures.size()) return;
    const auto& window = timeline_.exposures[train.size()];
    if (from < window.begin_us) return;
    if (!exposing_) {
      exposing_ = std::make_unique<Exposing>(run_.simulate.image, camera_.width, camera_.height);
    }
    exposing_->add(before, after, static_cast<double>(to - from));
    if (to < window.end_us) return;
    data::Exposure exposure;
    exposure.blurry = exposing_->develop(seed(concat("image noise ", train.size())));
    exposure.t_start_us = window.begin_us, exposure.t_end_us = window.end_us;
    exposure.camera = camera_;
    train.push_back(std::move(exposure));
    exposing_.reset();
  }

  const SimulateRun& run_;
  const FrameSource& source_;
  const CameraPath& path_;
  const geometry::Intrinsics camera_;
  const Timeline& timeline_;
  FrameClock clock_;
  EventSensor sensor_;
  std::vector<float> intensity_;
  std::vector<int64_t> stops_;
  std::unique_ptr<Exposing> exposing_;
};

/// Poses as they are written: the true ones, or with the smooth error of a reconstruction. The
/// error is drawn at the nine poses of every exposure (one draw an eighth of an exposure) and runs
/// straight in between.
class WrittenPoses {
 public:
  WrittenPoses(const SimulateRun& run, const CameraPath& path)
      : options_(run.simulate.poses),
        path_(path),
        seed_(derive_seed(static_cast<uint64_t>(run.seed), "pose noise")),
        step_us_(run.simulate.exposure_ms * 125) {}

  geometry::Pose at(int64_t t_us) const {
    const geometry::Pose pose = path_.at(static_cast<double>(t_us));
    if (options_.rotation_deg == 0 && options_.position == 0) return pose;
    const double place = static_cast<double>(t_us) / step_us_, cell = std::floor(place);
    const auto a = error(static_cast<int64_t>(cell)), b = error(static_cast<int64_t>(cell) + 1);
    std::array<double, 6> e{};
    for (size_t i = 0; i < 6; ++i) e[i] = a[i] + (b[i] - a[i]) * (place - cell);
    const double angle = options_.rotation_deg * 3.141592653589793 / 180;
    const geometry::Pose turn{
        geometry::rotation_from_vector({e[0] * angle, e[1] * angle, e[2] * angle}), {0, 0, 0}};
    auto centre = geometry::centre(pose);
    for (size_t i = 0; i < 3; ++i) centre[i] += options_.position * e[i + 3];
    return geometry::pose_at_centre(geometry::compose(turn, pose).rotation, centre);
  }

 private:
  std::array<double, 6> error(int64_t knot) const {
    Draw draw(seed_, static_cast<uint64_t>(knot));
    std::array<double, 6> e{};
    for (double& v : e) v = draw.normal();
    return e;
  }

  const PoseNoiseOptions options_;
  const CameraPath& path_;
  const uint64_t seed_;
  const double step_us_;
};

void write_poses(const WrittenPoses& poses, const Timeline& timeline, SimulateResult& result) {
  auto& content = result.content;
  for (auto& exposure : content.train) {
    const auto times = geometry::exposure_times(exposure.t_start_us, exposure.t_end_us);
    for (size_t k = 0; k < times.size(); ++k) {
      exposure.poses[k] = poses.at(static_cast<int64_t>(std::llround(times[k])));
    }
  }
  for (auto& view : content.test) view.pose = poses.at(view.t_us);
  for (int64_t t = 0; t < timeline.end_us; t += kPathStep_us) content.path_t_us.push_back(t);
  content.path_t_us.push_back(timeline.end_us);
  for (int64_t t : content.path_t_us) content.path.push_back(poses.at(t));
}

// Bounds that hold nearly all that is seen: the half per cent nearest and furthest is left out.
void find_bounds(const FrameSource& source, const CameraPath& path,
                 const geometry::Intrinsics& camera, const Timeline& timeline,
                 data::EvDeblurContent& content) {
  const auto coarse = geometry::scaled(camera, 64, 48);
  std::vector<float> depths;
  SharpFrame frame;
  for (const auto& window : timeline.exposures) {
    source.render(path.at(static_cast<double>(window.mid_us())), coarse, 1, frame);
    for (float depth : frame.depth) {
      if (depth < 1e5f) depths.push_back(depth);
    }
  }
  if (depths.empty())
    throw DataError("simulate: the camera sees nothing; check the source's poses");
  std::sort(depths.begin(), depths.end());
  content.near = 0.9 * depths[depths.size() / 200];
  content.far = 1.1 * depths[depths.size() - 1 - depths.size() / 200];
}

}  // namespace

SimulateResult simulate(const SimulateRun& run, const FrameSource& source, const CameraRig& rig) {
  validate(run);
  const SimulateOptions& o = run.simulate;
  const auto camera = geometry::Intrinsics::centred(o.focal_px, o.width, o.height);
  const Timeline timeline = make_timeline(o);
  CameraPath path(rig, o.motion.reach, derive_seed(static_cast<uint64_t>(run.seed), "camera path"));
  SimulateResult result;
  result.blur_px = set_speed_for_blur(path, source, camera, timeline, o.motion.blur_px);
  Recorder recorder(run, source, path, camera, timeline);
  recorder.record(result);
  for (const auto& window : timeline.exposures) {
    throw_if_interrupted();
    result.content.sharp_mid.push_back(recorder.sharp_at(window.mid_us()));
  }
  for (int64_t t : timeline.tests_us) {
    throw_if_interrupted();
    data::SharpView view;
    view.image = recorder.sharp_at(t), view.t_us = t, view.camera = camera;
    result.content.test.push_back(std::move(view));
  }
  write_poses(WrittenPoses(run, path), timeline, result);
  find_bounds(source, path, camera, timeline, result.content);
  return result;
}

SimulateResult simulate(const SimulateRun& run) {
  validate(run);
  const RayCaster source(make_scene(run.simulate.scene, static_cast<uint64_t>(run.seed)));
  return simulate(run, source, source.scene().rig);
}

void write(const SimulateResult& result, const SimulateRun& run,
           const std::filesystem::path& folder) {
  data::write_evdeblur(folder, result.content);
  SimulateRun copy = run;
  write_file(folder / "simulation.yaml", config::to_yaml(fields_of(copy), "jade_simulate"));
}

}  // namespace jade::simulate
