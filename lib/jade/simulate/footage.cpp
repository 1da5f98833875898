// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/footage.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/random.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"

namespace jade::simulate {
namespace {

constexpr double kRadians = 3.14159265358979323846 / 180;

std::optional<EventCamera> event_camera_of(const SimulateOptions& o) {
  const EventCameraOptions& beside = o.event_camera;
  if (!beside.is_beside()) return std::nullopt;
  const auto or_else = [](auto value, auto fallback) { return value > 0 ? value : fallback; };
  geometry::Vector3 turn{};
  for (size_t i = 0; i < beside.turn_deg.size(); ++i) turn[i] = beside.turn_deg[i] * kRadians;
  const geometry::Pose frames_from_events{geometry::rotation_from_vector(turn),
                                          {beside.centre[0], beside.centre[1], beside.centre[2]}};
  return EventCamera{geometry::Intrinsics::centred(or_else(beside.focal_px, o.focal_px),
                                                   or_else(beside.width, o.width),
                                                   or_else(beside.height, o.height)),
                     geometry::inverse(frames_from_events)};
}

/// Limits the flow in the camera with the finer resolution; their different positions matter
/// little.
SamplingOptions sampling_of(const SimulateOptions& o, const std::optional<EventCamera>& events) {
  SamplingOptions sampling = o.sampling;
  if (events) sampling.max_flow_px *= std::min(1.0, o.focal_px / events->camera.fx);
  return sampling;
}

}  // namespace

void Footage::event_frame(int64_t, int, world::SharpFrame&) const {
  throw ContractError("event_frame: expected footage of two cameras, found one");
}

RenderedFootage::RenderedFootage(const SimulateRun& run, std::unique_ptr<world::FrameSource> source,
                                 const world::CameraRig& rig, const Timeline& timeline)
    : source_(std::move(source)),
      camera_(geometry::Intrinsics::centred(run.simulate.focal_px, run.simulate.width,
                                            run.simulate.height)),
      event_camera_(event_camera_of(run.simulate)),
      path_(rig, run.simulate.motion.reach,
            derive_seed(static_cast<uint64_t>(run.seed), "camera path")),
      clock_(sampling_of(run.simulate, event_camera_), path_, camera_) {
  path_.set_rest(run.simulate.motion.rest, 1000 * run.simulate.motion.rest_period_ms);
  blur_px_ = set_speed_for_blur(path_, *source_, camera_, timeline, run.simulate.motion.blur_px);
}

void RenderedFootage::frame(int64_t t_us, int samples, world::SharpFrame& frame) const {
  source_->render(path_.at(static_cast<double>(t_us)), camera_, samples, frame);
}

void RenderedFootage::event_frame(int64_t t_us, int samples, world::SharpFrame& frame) const {
  source_->render(geometry::compose(event_camera_->from_frames, path_.at(double(t_us))),
                  event_camera_->camera, samples, frame);
}

int64_t RenderedFootage::next_us(const world::SharpFrame& frame, int64_t now_us, int64_t until_us) {
  const int64_t next = clock_.next_us(frame, now_us, until_us);
  const double flow = largest_flow(frame, camera_, path_.at(static_cast<double>(now_us)),
                                   path_.at(static_cast<double>(next)));
  largest_flow_px_ = std::max(largest_flow_px_, flow);
  return next;
}

// Excludes the nearest and farthest half per cent.
Footage::Depths RenderedFootage::depths(const Timeline& timeline) const {
  const auto coarse = geometry::scaled(camera_, 64, 48);
  std::vector<float> depths;
  world::SharpFrame frame;
  for (const auto& window : timeline.exposures) {
    source_->render(path_.at(static_cast<double>(window.mid_us())), coarse, 1, frame);
    for (float depth : frame.depth) {
      if (depth > 0 && depth < world::kNoDepth) depths.push_back(depth);
    }
  }
  if (depths.empty()) {
    throw DataError(
        "simulate: the camera sees nothing; set simulate.camera.eye and simulate.camera.target");
  }
  std::sort(depths.begin(), depths.end());
  const size_t cut = depths.size() / 200;
  return {0.9 * depths[cut], 1.1 * depths[depths.size() - 1 - cut]};
}

StoredFootage::StoredFootage(const std::filesystem::path& path, double frames_per_second,
                             double log_eps)
    : log_eps_(log_eps) {
  data::DatasetOptions options;
  options.path = path, options.kind = data::DatasetKind::kTransforms,
  options.split = data::SplitKind::kNone;
  std::vector<std::string> warnings;
  data::Dataset frames = data::load_dataset(options, &warnings);
  for (const std::string& warning : warnings) log_warn(warning);
  if (frames.train.size() < 2) {
    throw DataError(concat(path.string(), ": expected at least two frames, found ",
                           frames.train.size(), "; events need a change"));
  }
  std::sort(frames.train.begin(), frames.train.end(),
            [](const auto& a, const auto& b) { return imaging::comes_before(a.name, b.name); });
  camera_ = frames.train.front().camera;
  std::vector<double> times;
  std::vector<geometry::Pose> poses;
  for (const auto& exposure : frames.train) {
    if (exposure.camera != camera_) {
      throw DataError(concat(
          path.string(), ": expected one camera for all frames, found another at ", exposure.name));
    }
    times_us_.push_back(
        std::llround(1e6 * static_cast<double>(times_us_.size()) / frames_per_second));
    times.push_back(static_cast<double>(times_us_.back()));
    poses.push_back(exposure.poses[geometry::kMidPose]);
    frames_.push_back(exposure.blurry);
  }
  trajectory_ = geometry::Trajectory(times, poses);
  depths_ = {frames.near > 0 ? frames.near : 0.1, frames.far > frames.near ? frames.far : 100};
}

void StoredFootage::frame(int64_t t_us, int, world::SharpFrame& out) const {
  const auto after = std::upper_bound(times_us_.begin(), times_us_.end(), t_us);
  const auto last = static_cast<int64_t>(times_us_.size()) - 1;
  const int64_t i = std::clamp<int64_t>(after - times_us_.begin() - 1, 0, last);
  const int64_t j = std::min(i + 1, last);
  const auto begin = times_us_[static_cast<size_t>(i)], end = times_us_[static_cast<size_t>(j)];
  const auto s = end > begin ? static_cast<float>(static_cast<double>(std::min(t_us, end) - begin) /
                                                  static_cast<double>(end - begin))
                             : 0.0f;
  const float* a = frames_[static_cast<size_t>(i)].data_ptr<float>();
  const float* b = frames_[static_cast<size_t>(j)].data_ptr<float>();
  const auto eps = static_cast<float>(log_eps_);
  out.resize(camera_.width, camera_.height);
  for (size_t k = 0; k < out.rgb.size(); ++k) {
    out.rgb[k] =
        s == 0 ? a[k] : std::exp((1 - s) * std::log(a[k] + eps) + s * std::log(b[k] + eps)) - eps;
  }
  std::fill(out.depth.begin(), out.depth.end(), world::kNoDepth);
}

int64_t StoredFootage::next_us(const world::SharpFrame&, int64_t now_us, int64_t until_us) {
  const auto after = std::upper_bound(times_us_.begin(), times_us_.end(), now_us);
  return after == times_us_.end() ? until_us : std::min(*after, until_us);
}

Footage::Depths StoredFootage::depths(const Timeline&) const { return depths_; }

}  // namespace jade::simulate
