// SPDX-License-Identifier: Apache-2.0
// One pose of an exposure's path, and its derivative along one direction, for one thread.
#pragma once

#include <cstdint>
#include <type_traits>

#include "jade/geometry/se3_math.h"

namespace jade::geometry {

/// Largest number of control twists that affect one moment of the path.
constexpr int kMaxControl = 4;

/// The tensors of an ExposurePath.
struct PathPointers {
  const double* twists;
  const double* u;
  const double* base;
  int control;
  bool corrects;
};

/// A row-major [4,4] matrix.
template <class S>
JADE_HD Motion<S> load_motion(const double* m) {
  return {{{S(m[0]), S(m[4]), S(m[8])}, {S(m[1]), S(m[5]), S(m[9])}, {S(m[2]), S(m[6]), S(m[10])}},
          {S(m[3]), S(m[7]), S(m[11])}};
}

JADE_HD void store_motion(const Motion<double>& motion, double* m) {
  for (int i = 0; i < 3; ++i) {
    m[i] = motion.columns[i].x;
    m[4 + i] = motion.columns[i].y;
    m[8 + i] = motion.columns[i].z;
  }
  m[3] = motion.shift.x, m[7] = motion.shift.y, m[11] = motion.shift.z;
  m[12] = m[13] = m[14] = 0, m[15] = 1;
}

/// b_j(u); they sum to one.
JADE_HD void basis(double u, int control, double* b) {
  if (control == 2) {
    b[0] = 1 - u, b[1] = u;
    return;
  }
  const double v = 1 - u;
  b[0] = v * v * v / 6;
  b[1] = (4 + u * u * (3 * u - 6)) / 6;
  b[2] = (4 + v * v * (3 * v - 6)) / 6;
  b[3] = u * u * u / 6;
}

/// data(u) · exp(ξ(u)) as camera_from_world.
template <class S>
JADE_HD Motion<S> corrected_pose(const Twist<S>* twists, int control, double u,
                                 const double* camera_from_world) {
  double b[kMaxControl];
  basis(u, control, b);
  Twist<S> back = S(-b[0]) * twists[0];
  for (int j = 1; j < control; ++j) back = back + S(-b[j]) * twists[j];
  return product(exp_of(back), load_motion<S>(camera_from_world));
}

/// P_0 Π_j exp(w_j(u) log(P_{j−1}⁻¹ P_j)) as camera_from_world, P_j = C_j exp(ξ_j).
template <class S>
JADE_HD Motion<S> spline_pose(const Twist<S>* twists, int control, double u, const double* poses) {
  double b[kMaxControl];
  basis(u, control, b);
  Motion<S> before = product(load_motion<S>(poses), exp_of(twists[0]));
  Motion<S> path = before;
  double rest = 1;
  for (int j = 1; j < control; ++j) {
    rest -= b[j - 1];  // b_j + b_{j+1} + …
    const Motion<S> here = product(load_motion<S>(poses + 16 * j), exp_of(twists[j]));
    path = product(path, exp_of(S(rest) * log_of(product(inverse_of(before), here))));
    before = here;
  }
  return inverse_of(path);
}

/// The twists that affect a moment, and its position between them.
struct Segment {
  int first, control;
  double u;
};

JADE_HD Segment segment_of(double u, int control) {
  if (control <= kMaxControl) return {0, control, u};
  const int segments = control - kMaxControl + 1;
  const double place = u * segments;
  const int first = static_cast<int>(kernel::max(0.0, kernel::min(place, segments - 1.0)));
  return {first, kMaxControl, place - first};
}

/// camera_from_world of pose `m`, with the derivative for twists moved along `direction` (0 … 6K −
/// 1; −1: none).
template <class S>
JADE_HD Motion<S> path_pose(const PathPointers& path, int64_t m, int direction) {
  const Segment at = segment_of(path.u[m], path.control);
  Twist<S> twists[kMaxControl];
  for (int j = 0; j < at.control; ++j) {
    S number[6];
    for (int i = 0; i < 6; ++i) {
      const int index = 6 * (at.first + j) + i;
      number[i] = S(path.twists[index]);
      if constexpr (std::is_same_v<S, Dual>) number[i].slope = direction == index ? 1 : 0;
    }
    twists[j] = {{number[0], number[1], number[2]}, {number[3], number[4], number[5]}};
  }
  return path.corrects ? corrected_pose(twists, at.control, at.u, path.base + 16 * m)
                       : spline_pose(twists, at.control, at.u, path.base);
}

/// Contribution of pose `m` to the gradient of the twists along `direction`.
JADE_HD double gradient_along(const PathPointers& path, const double* gradient, int64_t m,
                              int direction) {
  const Motion<Dual> pose = path_pose<Dual>(path, m, direction);
  const double* g = gradient + 16 * m;
  double sum = g[3] * pose.shift.x.slope + g[7] * pose.shift.y.slope + g[11] * pose.shift.z.slope;
  for (int i = 0; i < 3; ++i) {
    sum += g[i] * pose.columns[i].x.slope + g[4 + i] * pose.columns[i].y.slope +
           g[8 + i] * pose.columns[i].z.slope;
  }
  return sum;
}

}  // namespace jade::geometry
