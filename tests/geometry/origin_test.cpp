// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/origin.h"

#include "support/catch.h"

#include <cmath>

namespace jade::geometry {
namespace {

TEST_CASE("origin: only a scene that float32 would blur is moved, to a round point", "[geometry]") {
  CHECK(is_zero(scene_origin({3, -4, 12}, 1)));
  CHECK(is_zero(scene_origin({200, 0, 0}, 1)));
  CHECK(is_zero(scene_origin({5e5, 5e6, 300}, 1e5)));
  CHECK(scene_origin({471234.56, 5431987.25, 312}, 2) == Vector3{471235, 5431987, 312});
  CHECK(scene_origin({471234.56, 5431987.25, 312}, 250) == Vector3{471200, 5432000, 300});
  CHECK(scene_origin({471234.56, 0, 0}, 0.2) == Vector3{471234.6, 0, 0});
  CHECK(scene_origin({1e6, 0, 0}, 0) == Vector3{1e6, 0, 0});
  CHECK(is_zero(scene_origin({NAN, 0, 0}, 1)));
}

TEST_CASE("origin: a camera sees the same from another origin", "[geometry]") {
  const Pose pose = pose_at_centre(rotation_from_vector({0.1, -0.7, 0.3}), {5e5, 5e6, 300});
  const Vector3 origin{499990, 4999900, 290};
  const Pose moved = with_origin(pose, origin);
  const Vector3 a = transform(pose, {5e5 + 3, 5e6 + 4, 305});
  const Vector3 b = transform(moved, {13, 104, 15});
  for (size_t axis = 0; axis < 3; ++axis) CHECK(a[axis] == Approx(b[axis]).margin(1e-8));
  CHECK(with_origin(pose, {0, 0, 0}).translation == pose.translation);
}

TEST_CASE("origin: text keeps every digit", "[geometry]") {
  CHECK(text_of({471234.5, 5431987, -0.125}) == "471234.5 5431987 -0.125");
}

}  // namespace
}  // namespace jade::geometry
