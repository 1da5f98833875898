// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <torch/types.h>
#include <vector>

namespace jade::geometry {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;     ///< row-major
using Quaternion = std::array<double, 4>;  ///< w, x, y, z

/// camera_from_world: x_camera = R x_world + t, camera axes x right, y down, z forward.
struct Pose {
  Matrix3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< R
  Vector3 translation{0, 0, 0};                 ///< t
};

/// world_from_camera of a camera_from_world, and vice versa.
Pose inverse(const Pose& pose);

/// a_from_c = compose(a_from_b, b_from_c).
Pose compose(const Pose& a_from_b, const Pose& b_from_c);

/// R x + t.
Vector3 transform(const Pose& pose, const Vector3& point);

/// Camera centre in world axes: −Rᵀ t.
Vector3 centre(const Pose& camera_from_world);

/// The pose with rotation R of a camera at `centre`: t = −R c.
Pose pose_at_centre(const Matrix3& rotation, const Vector3& centre);

/// Camera at `eye` that looks at `target` with the image's up direction along `up`.
/// @throws ContractError if `eye`, `target` and `up` leave the orientation undefined.
Pose look_at(const Vector3& eye, const Vector3& target, const Vector3& up);

/// Unit quaternion with w ≥ 0 of a rotation matrix, any angle.
Quaternion quaternion_from_rotation(const Matrix3& rotation);

/// Rotation matrix of a quaternion, which need not be normalised.
/// @throws ContractError for a zero or non-finite quaternion.
Matrix3 rotation_from_quaternion(const Quaternion& quaternion);

/// Shortest-arc spherical interpolation, s in [0,1]: a at 0, b at 1.
Quaternion slerp(const Quaternion& a, const Quaternion& b, double s);

/// exp of a rotation vector (axis times angle in radians).
Matrix3 rotation_from_vector(const Vector3& rotation_vector);

/// Angle in radians, [0, π], of the rotation between two poses.
double rotation_angle(const Pose& a, const Pose& b);

/// The nearest rotation (polar factor) of a matrix that a file stores with few digits.
/// @throws ContractError if the matrix differs by more than 0.1 (largest entry) from a rotation.
Matrix3 nearest_rotation(const Matrix3& matrix);

/// [4,4] float64 with last row 0 0 0 1.
torch::Tensor to_tensor(const Pose& pose);
/// Matrices of several poses, [N,4,4] float64.
torch::Tensor to_tensor(const std::vector<Pose>& poses);

/// Pose of a [4,4] or [3,4] tensor of any floating type and device.
Pose pose_from_tensor(const torch::Tensor& matrix);

}  // namespace jade::geometry
