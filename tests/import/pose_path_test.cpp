// SPDX-License-Identifier: Apache-2.0
#include "jade/import/pose_path.h"

#include "support/catch.h"

#include <cmath>

#include "jade/core/error.h"

using namespace jade;

namespace {

/// A camera that rotates about an axis by a quadratic angle while its centre moves on a parabola.
geometry::Pose moving(double t) {
  const double angle = 0.3 * t + 0.2 * t * t;
  return geometry::pose_at_centre(geometry::rotation_from_vector({0, 0.6 * angle, 0.8 * angle}),
                                  {t, 0.5 * t * t, 1 - t});
}

geometry::Pose moving_at(double t_us) { return moving(1e-6 * t_us); }

double distance(const geometry::Pose& a, const geometry::Pose& b) {
  const auto p = geometry::centre(a), q = geometry::centre(b);
  return std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
}

import::PosePath path_of(const std::vector<double>& times){std::vector<geometry::Pose> poses;
for (const double t : times) poses.push_back(moving_at(t));
return {times, poses};
}  // namespace

}  // namespace

TEST_CASE(
    "pose path: meets its poses and follows a steady acceleration between them, at uneven "
    "steps and beyond the ends",
    "[import]") {
  const std::vector<double> times{0, 5e4, 1e5, 1.2e5, 1.7e5, 2.2e5};
  const import::PosePath path = path_of(times);
  for (const double t : {0.0, 2e4, 5e4, 1.1e5, 1.2e5, 1.43e5, 2.1e5, 2.2e5, 2.3e5, -1e4}) {
    INFO(t);
    CHECK(distance(path.at(t), moving_at(t)) < 1e-12);
    CHECK(geometry::rotation_angle(path.at(t), moving_at(t)) < 2e-7);
  }
}

TEST_CASE("pose path: two poses are a line", "[import]") {
  const import::PosePath path = path_of({0, 1e6});
  CHECK(geometry::centre(path.at(5e5))[0] == Approx(0.5));
  CHECK(geometry::centre(path.at(5e5))[1] == Approx(0.25));
  CHECK(geometry::rotation_angle(path.at(0), path.at(5e5)) == Approx(0.25));
}

TEST_CASE("pose path: two poses a microsecond apart do not throw the path beside them off",
          "[import]") {
  std::vector<std::pair<double, geometry::Pose>> timed;
  for (double t = 0; t < 4.5e5; t += 5e4) timed.emplace_back(t, moving_at(t));
  // A second pose at the same moment, with an error of a thousandth of the scene, out of order.
  geometry::Pose other = moving_at(2e5);
  other.translation[0] += 1e-3;
  timed.emplace_back(2e5 + 1, other);
  const import::PosePath path = import::path_through(timed, 1e4);
  CHECK(path.t_us().size() == 9);
  for (const double t : {0.0, 1.2e5, 1.75e5, 2e5, 2.25e5, 2.8e5, 4e5}) {
    INFO(t);
    CHECK(distance(path.at(t), moving_at(t)) < 6e-4);
  }
  // Poses farther apart are not merged.
  CHECK(import::path_through(timed, 0.5).t_us().size() == 10);
  CHECK(distance(import::path_through(timed, 0.5).at(1.75e5), moving_at(1.75e5)) > 1);
}

TEST_CASE("pose path: refuses a single pose and times that do not increase", "[import]") {
  CHECK_THROWS_AS(path_of({0}), ContractError);
  CHECK_THROWS_AS(path_of({0, 0}), ContractError);
}
