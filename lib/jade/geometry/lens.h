// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "jade/core/words.h"
#include "jade/geometry/camera.h"
#include "jade/geometry/pose.h"

namespace jade::geometry {

/// Lens distortion models, with the order and signs of OpenCV, Kalibr and COLMAP.
enum class LensModel {
  kPinhole,
  kRadialTangential,
  kRational,
  kFisheye,
  kFieldOfView,
  kDivision,
  kUnified,
  kPrismFisheye,
  kRadialPrismFisheye
};

constexpr auto words_of(LensModel) {
  return std::array{
      Word{"pinhole", LensModel::kPinhole, "no distortion"},
      Word{"radtan", LensModel::kRadialTangential, "k1 k2 p1 p2 k3"},
      Word{"rational", LensModel::kRational, "k1 k2 p1 p2 k3 k4 k5 k6"},
      Word{"fisheye", LensModel::kFisheye, "k1 k2 k3 k4, equidistant"},
      Word{"fov", LensModel::kFieldOfView, "k1: the angle, radians"},
      Word{"division", LensModel::kDivision, "k1"},
      Word{"eucm", LensModel::kUnified, "k1 k2: alpha and beta"},
      Word{"prism_fisheye", LensModel::kPrismFisheye, "k1 k2 p1 p2 k3 k4 s1 s3"},
      Word{"radial_prism_fisheye", LensModel::kRadialPrismFisheye, "k1 to k6 p1 p2 s1 to s4"}};
}

/// With (x, y) = (X/Z, Y/Z) and ρ = x² + y², radial-tangential and rational lenses project a
/// direction to
///     x' = x r + 2 p1 x y + p2 (ρ + 2x²),  y' = y r + p1 (ρ + 2y²) + 2 p2 x y,
///     r = (1 + k1 ρ + k2 ρ² + k3 ρ³) / (1 + k4 ρ + k5 ρ² + k6 ρ³),
/// fisheyes (Kannala and Brandt, PAMI 2006), with θ the angle to the axis, to
///     (X, Y)/√(X²+Y²) · θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).
/// Three more depend only on the angle; with R = √(x²+y²) they project to (x, y)/R times
///     fov (Devernay and Faugeras, 2001): atan(2 R tan(k1/2)) / k1,
///     division (Fitzgibbon, CVPR 2001): the r with r / (1 + k1 r²) = R,
///     eucm (Khomutenko et al., 2016): sin θ / (k1 √(k2 sin²θ + cos²θ) + (1 − k1) cos θ). Fisheyes
///     with thin-prism terms use (a, b) = (X, Y)/√(X²+Y²) · θ and ρ = a² + b²,
///     prism: a (1 + k1 ρ + … + k4 ρ⁴) + 2 p1 a b + p2 (ρ + 2a²) + s1 ρ, and for y
///            b (1 + k1 ρ + … + k4 ρ⁴) + 2 p2 a b + p1 (ρ + 2b²) + s3 ρ,
///     radial prism, first (a, b) ← (a, b)(1 + k1 ρ + … + k6 ρ⁶), then, with ρ recomputed,
///            a + 2 (p2 a + p1 b) a + p2 ρ + s1 ρ + s2 ρ², and for y
///            b + 2 (p2 a + p1 b) b + p1 ρ + s3 ρ + s4 ρ².
struct Lens {
  LensModel model = LensModel::kPinhole;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;
  double s1 = 0, s2 = 0, s3 = 0, s4 = 0;  ///< thin-prism coefficients
};

/// A pinhole camera with a lens.
class LensCamera {
 public:
  LensCamera() = default;
  /// @throws ContractError unless check_camera(pinhole) passes and the coefficients are finite.
  LensCamera(const Intrinsics& pinhole, const Lens& lens);

  const Intrinsics& pinhole() const { return pinhole_; }
  const Lens& lens() const { return lens_; }

  /// Projection coordinates of a point in camera axes. NaN for points behind a lens that is neither
  /// fisheye nor eucm, and beyond the angle at which the formula stops increasing and would project
  /// a second direction to the same pixel.
  std::array<double, 2> project(const Vector3& point) const;

  /// The unit direction in camera axes that projects to (u, v), by Newton's method; NaN if there is
  /// none.
  Vector3 unproject(double u, double v) const;

  /// The largest angle to the axis, radians, up to which the radial part of the formula is
  /// one-to-one.
  double largest_angle() const { return largest_angle_; }

 private:
  /// Distorts (x, y) = (X, Y)/Z or, for fisheyes, (X, Y)/√(X²+Y²) · θ.
  std::array<double, 2> distorted(double x, double y) const;

  Intrinsics pinhole_;
  Lens lens_;
  double largest_angle_ = 0;
};

}  // namespace jade::geometry
