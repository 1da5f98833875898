// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/pose.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

Matrix3 transpose(const Matrix3& m) {
  return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}

Matrix3 multiply(const Matrix3& a, const Matrix3& b) {
  Matrix3 out{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    }
  }
  return out;
}

Vector3 multiply(const Matrix3& m, const Vector3& v) {
  return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
          m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double norm(const Vector3& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

Vector3 unit(const Vector3& v, const char* what) {
  const double length = norm(v);
  JADE_CHECK(std::isfinite(length) && length > 1e-12, "look_at: ", what, " leaves the view open");
  return {v[0] / length, v[1] / length, v[2] / length};
}

Quaternion unit(const Quaternion& q) {
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  JADE_CHECK(std::isfinite(length) && length > 0,
             "expected a finite quaternion other than zero, found ", q[0], " ", q[1], " ", q[2],
             " ", q[3]);
  return {q[0] / length, q[1] / length, q[2] / length, q[3] / length};
}

/// Inverse transpose of a matrix, from its cofactors.
Matrix3 inverse_transpose(const Matrix3& m) {
  const Vector3 a{m[0], m[1], m[2]}, b{m[3], m[4], m[5]}, c{m[6], m[7], m[8]};
  const Vector3 bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
  const double determinant = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2];
  JADE_CHECK(determinant > 0.1, "expected a rotation matrix, found determinant ", determinant);
  Matrix3 out{bc[0], bc[1], bc[2], ca[0], ca[1], ca[2], ab[0], ab[1], ab[2]};
  for (double& value : out) value /= determinant;
  return out;
}

}  // namespace

Pose inverse(const Pose& pose) { return {transpose(pose.rotation), centre(pose)}; }

Pose compose(const Pose& a_from_b, const Pose& b_from_c) {
  return {multiply(a_from_b.rotation, b_from_c.rotation),
          transform(a_from_b, b_from_c.translation)};
}

Vector3 transform(const Pose& pose, const Vector3& point) {
  Vector3 out = multiply(pose.rotation, point);
  for (int i = 0; i < 3; ++i) out[i] += pose.translation[i];
  return out;
}

Vector3 centre(const Pose& camera_from_world) {
  const Vector3 c = multiply(transpose(camera_from_world.rotation), camera_from_world.translation);
  return {-c[0], -c[1], -c[2]};
}

Pose pose_at_centre(const Matrix3& rotation, const Vector3& centre) {
  const Vector3 c = multiply(rotation, centre);
  return {rotation, {-c[0], -c[1], -c[2]}};
}

Pose look_at(const Vector3& eye, const Vector3& target, const Vector3& up) {
  const Vector3 forward = unit(Vector3{target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]},
                               "a target at the eye");
  const Vector3 right = unit(cross(forward, up), "an up direction along the line of sight");
  const Vector3 down = cross(forward, right);
  return pose_at_centre(
      {right[0], right[1], right[2], down[0], down[1], down[2], forward[0], forward[1], forward[2]},
      eye);
}

Quaternion quaternion_from_rotation(const Matrix3& r) {
  // Find the component with the largest magnitude first, to avoid division by a small one.
  const double squares[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8], 1 - r[0] + r[4] - r[8],
                             1 - r[0] - r[4] + r[8]};
  const auto largest = std::max_element(squares, squares + 4) - squares;
  Quaternion q{};
  switch (largest) {
    case 0:
      q = {squares[0], r[7] - r[5], r[2] - r[6], r[3] - r[1]};
      break;
    case 1:
      q = {r[7] - r[5], squares[1], r[3] + r[1], r[2] + r[6]};
      break;
    case 2:
      q = {r[2] - r[6], r[3] + r[1], squares[2], r[7] + r[5]};
      break;
    default:
      q = {r[3] - r[1], r[2] + r[6], r[7] + r[5], squares[3]};
      break;
  }
  q = unit(q);
  if (q[0] < 0) q = {-q[0], -q[1], -q[2], -q[3]};
  return q;
}

Matrix3 rotation_from_quaternion(const Quaternion& quaternion) {
  const auto [w, x, y, z] = unit(quaternion);
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

Quaternion slerp(const Quaternion& from, const Quaternion& to, double s) {
  const Quaternion a = unit(from);
  Quaternion b = unit(to);
  double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  if (cosine < 0) {  // q and −q are one rotation; take the shorter arc
    cosine = -cosine;
    for (double& value : b) value = -value;
  }
  double weight_a = 1 - s, weight_b = s;
  if (cosine < 1 - 1e-12) {
    const double angle = std::acos(cosine);
    weight_a = std::sin((1 - s) * angle) / std::sin(angle);
    weight_b = std::sin(s * angle) / std::sin(angle);
  }
  Quaternion out{};
  for (int i = 0; i < 4; ++i) out[i] = weight_a * a[i] + weight_b * b[i];
  return unit(out);
}

Matrix3 rotation_from_vector(const Vector3& v) {
  const double angle = norm(v);
  const double scale = angle > 1e-12 ? std::sin(0.5 * angle) / angle : 0.5;
  return rotation_from_quaternion(
      {std::cos(0.5 * angle), scale * v[0], scale * v[1], scale * v[2]});
}

double rotation_angle(const Pose& a, const Pose& b) {
  const Quaternion q = quaternion_from_rotation(multiply(a.rotation, transpose(b.rotation)));
  return 2 * std::atan2(norm({q[1], q[2], q[3]}), q[0]);
}

Matrix3 nearest_rotation(const Matrix3& matrix) {
  // Newton's iteration for the polar factor: M ← (M + M⁻ᵀ) / 2.
  Matrix3 m = matrix;
  for (int step = 0; step < 20; ++step) {
    const Matrix3 other = inverse_transpose(m);
    double change = 0;
    for (int i = 0; i < 9; ++i) {
      const double next = 0.5 * (m[i] + other[i]);
      change = std::max(change, std::abs(next - m[i]));
      m[i] = next;
    }
    if (change < 1e-15) break;
  }
  for (int i = 0; i < 9; ++i) {
    JADE_CHECK(std::abs(m[i] - matrix[i]) < 0.1, "expected a rotation matrix, found entry ", i,
               " off by ", std::abs(m[i] - matrix[i]));
  }
  return m;
}

torch::Tensor to_tensor(const Pose& pose) { return to_tensor(std::vector<Pose>{pose})[0]; }

torch::Tensor to_tensor(const std::vector<Pose>& poses) {
  torch::Tensor out = torch::zeros({static_cast<int64_t>(poses.size()), 4, 4}, torch::kFloat64);
  auto* row = out.mutable_data_ptr<double>();
  for (const Pose& pose : poses) {
    for (size_t i = 0; i < 3; ++i, row += 4) {
      for (size_t j = 0; j < 3; ++j) row[j] = pose.rotation[3 * i + j];
      row[3] = pose.translation[i];
    }
    row[3] = 1;
    row += 4;
  }
  return out;
}

Pose pose_from_tensor(const torch::Tensor& matrix) {
  JADE_CHECK(matrix.defined() && matrix.dim() == 2 && matrix.size(1) == 4 &&
                 (matrix.size(0) == 3 || matrix.size(0) == 4),
             "expected a [4,4] or [3,4] pose, found ", shape_string(matrix));
  const auto host = matrix.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* data = host.const_data_ptr<double>();
  Pose pose;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) pose.rotation[3 * i + j] = data[4 * i + j];
    pose.translation[i] = data[4 * i + 3];
  }
  return pose;
}

}  // namespace jade::geometry
