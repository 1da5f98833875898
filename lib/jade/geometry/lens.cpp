// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/lens.h"

#include <cmath>
#include <limits>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
/// Angles that a plane at z = 1 represents end short of 90°: here at tan = 20.
constexpr double kPlaneAngle = 1.5208;

bool has_prism(const Lens& lens) {
  return lens.model == LensModel::kPrismFisheye || lens.model == LensModel::kRadialPrismFisheye;
}

/// Whether its formula uses the angle to the axis rather than (X, Y)/Z.
bool is_of_angle(const Lens& lens) { return lens.model == LensModel::kFisheye || has_prism(lens); }

/// Whether the lens changes only the distance from the axis.
bool is_radial(const Lens& lens) {
  switch (lens.model) {
    case LensModel::kRadialTangential:
    case LensModel::kRational:
      return lens.p1 == 0 && lens.p2 == 0;
    case LensModel::kPrismFisheye:
    case LensModel::kRadialPrismFisheye:
      return false;
    default:
      return true;
  }
}

/// The angle beyond which no pixel of a picture lies.
double end_angle(const Lens& lens) {
  return is_of_angle(lens) || lens.model == LensModel::kUnified ? kPi : kPlaneAngle;
}

/// The radial part: distance from the axis in the image at an angle, for unit focal length.
double radial(const Lens& lens, double angle) {
  if (is_of_angle(lens)) {
    const double t = angle * angle;
    return angle *
           (1 + t * (lens.k1 +
                     t * (lens.k2 + t * (lens.k3 + t * (lens.k4 + t * (lens.k5 + t * lens.k6))))));
  }
  if (lens.model == LensModel::kUnified) {
    const double sine = std::sin(angle), cosine = std::cos(angle);
    const double depth =
        lens.k1 * std::sqrt(lens.k2 * sine * sine + cosine * cosine) + (1 - lens.k1) * cosine;
    return depth > 0 ? sine / depth : kNan;
  }
  const double s = std::tan(angle), t = s * s;
  if (lens.model == LensModel::kFieldOfView) {
    return lens.k1 == 0 ? s : std::atan(2 * s * std::tan(0.5 * lens.k1)) / lens.k1;
  }
  if (lens.model == LensModel::kDivision) return 2 * s / (1 + std::sqrt(1 - 4 * lens.k1 * t));
  return s * (1 + t * (lens.k1 + t * (lens.k2 + t * lens.k3))) /
         (1 + t * (lens.k4 + t * (lens.k5 + t * lens.k6)));
}

/// Derivative of the distance from the axis by the angle; central difference.
double radial_slope(const Lens& lens, double angle) {
  constexpr double kStep = 1e-6;
  return (radial(lens, angle + kStep) - radial(lens, angle - kStep)) / (2 * kStep);
}

double fold_angle(const Lens& lens) {
  const double end = end_angle(lens);
  if (lens.model == LensModel::kPinhole) return end;
  constexpr int kSteps = 2000;
  for (int i = 1; i <= kSteps; ++i) {
    double high = end * i / kSteps;
    if (radial_slope(lens, high) > 0) continue;
    double low = end * (i - 1) / kSteps;
    for (int k = 0; k < 40; ++k) {
      const double mid = 0.5 * (low + high);
      (radial_slope(lens, mid) > 0 ? low : high) = mid;
    }
    return low;
  }
  return end;
}

/// The angle whose radial part is `distance`, or NaN beyond the fold; bisection, as the function
/// increases up to there.
double angle_at(const Lens& lens, double distance, double largest) {
  if (distance > radial(lens, largest)) return kNan;
  double low = 0, high = largest;
  for (int k = 0; k < 60; ++k) {
    const double mid = 0.5 * (low + high);
    (radial(lens, mid) < distance ? low : high) = mid;
  }
  return 0.5 * (low + high);
}

std::array<double, 2> through_prism(const Lens& lens, double a, double b) {
  double rho = a * a + b * b;
  const double r =
      1 +
      rho * (lens.k1 +
             rho * (lens.k2 + rho * (lens.k3 + rho * (lens.k4 + rho * (lens.k5 + rho * lens.k6)))));
  if (lens.model == LensModel::kPrismFisheye) {
    return {a * r + 2 * lens.p1 * a * b + lens.p2 * (rho + 2 * a * a) + lens.s1 * rho,
            b * r + 2 * lens.p2 * a * b + lens.p1 * (rho + 2 * b * b) + lens.s3 * rho};
  }
  a *= r, b *= r;
  rho = a * a + b * b;
  const double along = 2 * (lens.p2 * a + lens.p1 * b);
  return {a + along * a + lens.p2 * rho + rho * (lens.s1 + lens.s2 * rho),
          b + along * b + lens.p1 * rho + rho * (lens.s3 + lens.s4 * rho)};
}

Vector3 unit(double x, double y, double z) {
  const double length = std::sqrt(x * x + y * y + z * z);
  return {x / length, y / length, z / length};
}

Vector3 at_angle(double x, double y, double angle) {
  const double distance = std::hypot(x, y);
  if (std::isnan(angle)) return {kNan, kNan, kNan};
  const double scale = distance > 0 ? std::sin(angle) / distance : 0;
  return {x * scale, y * scale, std::cos(angle)};
}

}  // namespace

LensCamera::LensCamera(const Intrinsics& pinhole, const Lens& lens)
    : pinhole_(pinhole), lens_(lens) {
  check_camera(pinhole, "camera of a lens");
  for (const double k : {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, lens.k4, lens.k5, lens.k6,
                         lens.s1, lens.s2, lens.s3, lens.s4}) {
    JADE_CHECK(std::isfinite(k), "expected finite lens coefficients, found ", k);
  }
  largest_angle_ = fold_angle(lens);
}

std::array<double, 2> LensCamera::distorted(double x, double y) const {
  if (lens_.model == LensModel::kPinhole) return {x, y};
  if (has_prism(lens_)) return through_prism(lens_, x, y);
  const double rho = x * x + y * y;
  const double r = (1 + rho * (lens_.k1 + rho * (lens_.k2 + rho * lens_.k3))) /
                   (1 + rho * (lens_.k4 + rho * (lens_.k5 + rho * lens_.k6)));
  return {x * r + 2 * lens_.p1 * x * y + lens_.p2 * (rho + 2 * x * x),
          y * r + lens_.p1 * (rho + 2 * y * y) + 2 * lens_.p2 * x * y};
}

std::array<double, 2> LensCamera::project(const Vector3& point) const {
  const double across = std::hypot(point[0], point[1]);
  const double angle = std::atan2(across, point[2]);
  if (!(angle <= largest_angle_)) return {kNan, kNan};
  std::array<double, 2> place{};
  if (has_prism(lens_)) {
    const double scale = across > 0 ? angle / across : 0;
    place = distorted(point[0] * scale, point[1] * scale);
  } else if (lens_.model != LensModel::kPinhole && lens_.model != LensModel::kRadialTangential &&
             lens_.model != LensModel::kRational) {
    const double scale = across > 0 ? radial(lens_, angle) / across : 0;
    place = {point[0] * scale, point[1] * scale};
  } else {
    place = distorted(point[0] / point[2], point[1] / point[2]);
  }
  return {pinhole_.fx * place[0] + pinhole_.cx, pinhole_.fy * place[1] + pinhole_.cy};
}

Vector3 LensCamera::unproject(double u, double v) const {
  const double x = (u - pinhole_.cx) / pinhole_.fx, y = (v - pinhole_.cy) / pinhole_.fy;
  if (lens_.model == LensModel::kPinhole) return unit(x, y, 1);
  const double start = angle_at(lens_, std::hypot(x, y), largest_angle_);
  if (is_radial(lens_)) return at_angle(x, y, start);
  const bool of_angle = is_of_angle(lens_);
  // The tangential part is small: from the radial solution (or from the fold, if there is none)
  // Newton's method converges in a few steps. Jacobian by central differences, whose error is far
  // below the final accuracy.
  const double first = std::isnan(start) ? 0.999 * largest_angle_ : start;
  const double slope = of_angle ? first : std::tan(first);
  const double distance = std::hypot(x, y);
  double a = distance > 0 ? x / distance * slope : 0, b = distance > 0 ? y / distance * slope : 0;
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 30; ++i) {
    const auto here = distorted(a, b);
    const double rx = x - here[0], ry = y - here[1];
    if (std::abs(rx) + std::abs(ry) < 1e-13) break;
    const auto right = distorted(a + kStep, b), left = distorted(a - kStep, b);
    const auto down = distorted(a, b + kStep), up = distorted(a, b - kStep);
    const double xx = (right[0] - left[0]) / (2 * kStep), yx = (right[1] - left[1]) / (2 * kStep);
    const double xy = (down[0] - up[0]) / (2 * kStep), yy = (down[1] - up[1]) / (2 * kStep);
    const double determinant = xx * yy - xy * yx;
    if (!(std::abs(determinant) > 1e-9)) break;
    a += (yy * rx - xy * ry) / determinant;
    b += (xx * ry - yx * rx) / determinant;
  }
  const auto back = distorted(a, b);
  const double angle = of_angle ? std::hypot(a, b) : std::atan(std::hypot(a, b));
  const bool found =
      std::abs(x - back[0]) + std::abs(y - back[1]) < 1e-9 && angle <= largest_angle_;
  if (!found) return {kNan, kNan, kNan};
  return of_angle ? at_angle(a, b, angle) : unit(a, b, 1);
}

}  // namespace jade::geometry
