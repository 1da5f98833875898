// SPDX-License-Identifier: Apache-2.0
#include "jade/data/pose_matrix.h"

#include <array>
#include <cmath>

#include "jade/core/error.h"

namespace jade::data {
namespace {

using nlohmann::json;

/// Why a 3x3 matrix is not a rotation, and what to do.
std::string fault_of(const geometry::Matrix3& m) {
  const double determinant = m[0] * (m[4] * m[8] - m[5] * m[7]) -
                             m[1] * (m[3] * m[8] - m[5] * m[6]) +
                             m[2] * (m[3] * m[7] - m[4] * m[6]);
  const double scale = std::cbrt(std::abs(determinant));
  if (!(scale > 1e-6)) {
    return "axes that do not span the space (determinant 0); remove the frame or correct its pose";
  }
  if (determinant < 0) {
    return concat("a mirrored one (determinant ", determinant,
                  "); negate the axis that was flipped, or export in right-handed axes");
  }
  if (std::abs(scale - 1) > 0.05) {
    return concat("a rotation scaled by ", scale, "; divide its first three columns by that");
  }
  return "axes that are not perpendicular; correct the pose";
}

/// Whether the values are 0, 0, 0 and 1 up to rounding.
bool is_last_row(const std::array<double, 4>& values) {
  constexpr double kRounding = 1e-4;
  for (size_t i = 0; i < 4; ++i) {
    if (!(std::abs(values[i] - (i == 3 ? 1 : 0)) < kRounding)) return false;
  }
  return true;
}

/// Why the last row of a 4x4 matrix is wrong, and what to do; empty if it is 0, 0, 0, 1.
/// @param m the rows above it
std::string fault_of_last_row(const json& row, const double (&m)[3][4]) {
  std::array<double, 4> last{};
  if (!row.is_array() || row.size() != 4) return row.dump().substr(0, 40) + "; correct it";
  for (size_t i = 0; i < 4; ++i) {
    if (!row[i].is_number()) return row.dump().substr(0, 40) + "; correct it";
    last[i] = row[i].get<double>();
  }
  if (is_last_row(last)) return "";
  const std::string found = "the last row " + row.dump().substr(0, 80) + " in place of [0,0,0,1]";
  if (is_last_row({m[0][3], m[1][3], m[2][3], last[3]})) {
    return found + ", which is its last column: the matrix looks transposed; store it by rows";
  }
  return found + "; correct it";
}

}  // namespace

geometry::Matrix3 rotation_near(const geometry::Matrix3& matrix, const std::string& expected) {
  try {
    return geometry::nearest_rotation(matrix);
  } catch (const ContractError&) {
    throw DataError(concat(expected, ", found ", fault_of(matrix)));
  }
}

geometry::Pose rigid_pose(const json& matrix, const std::string& expected) {
  double m[3][4];
  const auto wrong = [&](const std::string& found) {
    return DataError(concat(expected, ", found ", found));
  };
  const auto malformed = [&](const json& part) {
    return wrong(part.dump().substr(0, 40) + "; correct it");
  };
  if (!matrix.is_array() || matrix.size() < 3 || matrix.size() > 4) throw malformed(matrix);
  for (size_t row = 0; row < 3; ++row) {
    if (!matrix[row].is_array() || matrix[row].size() != 4) throw malformed(matrix[row]);
    for (size_t column = 0; column < 4; ++column) {
      if (!matrix[row][column].is_number()) throw malformed(matrix[row]);
      m[row][column] = matrix[row][column].get<double>();
      if (!std::isfinite(m[row][column])) throw malformed(matrix[row]);
    }
  }
  if (matrix.size() > 3) {
    if (const std::string fault = fault_of_last_row(matrix[3], m); !fault.empty()) {
      throw wrong(fault);
    }
  }
  geometry::Pose pose;
  for (size_t row = 0; row < 3; ++row) {
    for (size_t column = 0; column < 3; ++column) pose.rotation[3 * row + column] = m[row][column];
    pose.translation[row] = m[row][3];
  }
  pose.rotation = rotation_near(pose.rotation, expected);
  return pose;
}

}  // namespace jade::data
