// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/camera_path.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/world/noise.h"

namespace jade::simulate {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kRollReach = 0.05;  // radians

std::array<double, 3> to_array(world::Vec3 v) { return {v.x, v.y, v.z}; }

// Moves the point at depth z on the ray of pixel (u,v) by `relative` and projects it.
std::array<double, 2> moved(const geometry::Intrinsics& camera, const geometry::Pose& relative,
                            double u, double v, double depth) {
  auto p = geometry::unproject(camera, u, v);
  for (double& c : p) c *= depth;
  const auto q = geometry::transform(relative, p);
  return geometry::project(camera, {q[0], q[1], std::max(q[2], 1e-3)});
}

}  // namespace

double CameraPath::Wander::at(double t) const {
  double sum = 0;
  for (size_t i = 0; i < 3; ++i)
    sum += amplitude[i] * std::sin(kTurn * (frequency[i] * t + phase[i]));
  return sum;
}

CameraPath::CameraPath(const world::CameraRig& rig, double reach, uint64_t seed)
    : eye_(to_array(rig.eye)), target_(to_array(rig.target)), up_(to_array(rig.up)) {
  world::Draw draw(seed);
  const auto eye_reach = to_array(rig.eye_reach), target_reach = to_array(rig.target_reach);
  constexpr std::array<double, 3> kShare{0.68, 0.24, 0.08}, kPitch{1, 2.6, 6.1};
  for (size_t axis = 0; axis < 7; ++axis) {
    const double size = axis < 3 ? eye_reach[axis] : axis < 6 ? target_reach[axis - 3] : kRollReach;
    for (size_t i = 0; i < 3; ++i) {
      wander_[axis].amplitude[i] = size * reach * kShare[i];
      wander_[axis].frequency[i] = kPitch[i] * draw.range(0.75f, 1.3f);
      wander_[axis].phase[i] = draw.uniform();
    }
  }
}

// Accelerates and brakes like a cosine, so that the path is smooth.
double CameraPath::moved_until(double t_us) const {
  if (rest_ <= 0) return t_us;
  const double periods = t_us / rest_period_us_, whole = std::floor(periods);
  const double u = std::max(0.0, (periods - whole - rest_) / (1 - rest_));
  return rest_period_us_ * (whole + u - std::sin(kTurn * u) / kTurn);
}

geometry::Pose CameraPath::at(double t_us) const {
  const double t = moved_until(t_us) * 1e-6 * speed_;
  geometry::Vector3 eye = eye_, target = target_;
  for (size_t axis = 0; axis < 3; ++axis) {
    eye[axis] += wander_[axis].at(t);
    target[axis] += wander_[axis + 3].at(t);
  }
  const geometry::Pose level = geometry::look_at(eye, target, up_);
  const geometry::Pose roll{geometry::rotation_from_vector({0, 0, wander_[6].at(t)}), {0, 0, 0}};
  return geometry::compose(roll, level);
}

double blur_length(const CameraPath& path, const geometry::Intrinsics& camera,
                   const world::SharpFrame& mid, double begin_us, double end_us) {
  constexpr int kLegs = 12;
  const geometry::Pose from_mid = geometry::inverse(path.at(0.5 * (begin_us + end_us)));
  std::array<geometry::Pose, kLegs + 1> relative;
  for (int k = 0; k <= kLegs; ++k) {
    const double t = begin_us + (end_us - begin_us) * k / kLegs;
    relative[static_cast<size_t>(k)] = geometry::compose(path.at(t), from_mid);
  }
  const double scale_x = static_cast<double>(camera.width) / static_cast<double>(mid.width);
  const double scale_y = static_cast<double>(camera.height) / static_cast<double>(mid.height);
  double sum = 0;
  for (int64_t y = 0; y < mid.height; ++y) {
    for (int64_t x = 0; x < mid.width; ++x) {
      const double u = (static_cast<double>(x) + 0.5) * scale_x;
      const double v = (static_cast<double>(y) + 0.5) * scale_y;
      const double depth = mid.depth[static_cast<size_t>(y * mid.width + x)];
      auto last = moved(camera, relative[0], u, v, depth);
      for (size_t k = 1; k <= kLegs; ++k) {
        const auto next = moved(camera, relative[k], u, v, depth);
        sum += std::hypot(next[0] - last[0], next[1] - last[1]);
        last = next;
      }
    }
  }
  return sum / static_cast<double>(mid.width * mid.height);
}

double largest_flow(const world::SharpFrame& frame, const geometry::Intrinsics& camera,
                    const geometry::Pose& from, const geometry::Pose& to) {
  const geometry::Pose relative = geometry::compose(to, geometry::inverse(from));
  const double squared = at::parallel_reduce(
      int64_t{0}, frame.height, 8, 0.0,
      [&](int64_t begin, int64_t end, double most) {
        for (int64_t y = begin; y < end; ++y) {
          for (int64_t x = 0; x < frame.width; ++x) {
            const double u = static_cast<double>(x) + 0.5, v = static_cast<double>(y) + 0.5;
            const auto p = moved(camera, relative, u, v,
                                 frame.depth[static_cast<size_t>(y * frame.width + x)]);
            most = std::max(most, (p[0] - u) * (p[0] - u) + (p[1] - v) * (p[1] - v));
          }
        }
        return most;
      },
      [](double a, double b) { return std::max(a, b); });
  return std::sqrt(squared);
}

double mean_square_distance(const world::SharpFrame& frame, const geometry::Intrinsics& camera,
                            const geometry::Pose& from, const geometry::Pose& a,
                            const geometry::Pose& b) {
  const geometry::Pose back = geometry::inverse(from);
  const geometry::Pose to_a = geometry::compose(a, back), to_b = geometry::compose(b, back);
  double sum = 0;
  for (int64_t y = 0; y < frame.height; ++y) {
    for (int64_t x = 0; x < frame.width; ++x) {
      const double u = static_cast<double>(x) + 0.5, v = static_cast<double>(y) + 0.5;
      const double depth = frame.depth[static_cast<size_t>(y * frame.width + x)];
      const auto p = moved(camera, to_a, u, v, depth), q = moved(camera, to_b, u, v, depth);
      sum += (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]);
    }
  }
  return sum / static_cast<double>(frame.width * frame.height);
}

}  // namespace jade::simulate
