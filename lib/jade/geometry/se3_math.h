// SPDX-License-Identifier: Apache-2.0
// exp, log and products of rigid motions for one thread, for plain or dual numbers, whose second
// part is the derivative along one direction. se3.h has the equations.
#pragma once

#include <cmath>

#include "jade/kernel/host_device.h"

namespace jade::geometry {

/// A number and its derivative along one direction.
struct Dual {
  double value, slope;
  Dual() = default;
  JADE_HD Dual(double v, double s = 0)  // NOLINT(google-explicit-constructor)
      : value(v), slope(s) {}
};

JADE_HD Dual operator+(Dual a, Dual b) { return {a.value + b.value, a.slope + b.slope}; }
JADE_HD Dual operator-(Dual a, Dual b) { return {a.value - b.value, a.slope - b.slope}; }
JADE_HD Dual operator-(Dual a) { return {-a.value, -a.slope}; }
JADE_HD Dual operator*(Dual a, Dual b) {
  return {a.value * b.value, a.slope * b.value + a.value * b.slope};
}
JADE_HD Dual operator/(Dual a, Dual b) {
  const double ratio = a.value / b.value;
  return {ratio, (a.slope - ratio * b.slope) / b.value};
}

JADE_HD double value_of(double x) { return x; }
JADE_HD double value_of(Dual x) { return x.value; }

JADE_HD double root(double x) { return kernel::sqrt(x); }
JADE_HD Dual root(Dual x) {
  const double value = root(x.value);
  return {value, x.slope / (2 * value)};
}
JADE_HD double sine(double x) { return ::sin(x); }
JADE_HD Dual sine(Dual x) { return {::sin(x.value), x.slope * ::cos(x.value)}; }
JADE_HD double cosine(double x) { return ::cos(x); }
JADE_HD Dual cosine(Dual x) { return {::cos(x.value), -x.slope * ::sin(x.value)}; }
JADE_HD double arcsine(double x) { return ::asin(x); }
JADE_HD Dual arcsine(Dual x) { return {::asin(x.value), x.slope / root(1 - x.value * x.value)}; }

template <class S>
struct Vector {
  S x, y, z;
};

template <class S>
JADE_HD Vector<S> operator+(const Vector<S>& a, const Vector<S>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class S>
JADE_HD Vector<S> operator*(S s, const Vector<S>& a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <class S>
JADE_HD S dot(const Vector<S>& a, const Vector<S>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class S>
JADE_HD Vector<S> cross(const Vector<S>& a, const Vector<S>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class S>
struct Twist {
  Vector<S> rho, omega;
};

template <class S>
JADE_HD Twist<S> operator+(const Twist<S>& a, const Twist<S>& b) {
  return {a.rho + b.rho, a.omega + b.omega};
}
template <class S>
JADE_HD Twist<S> operator*(S s, const Twist<S>& a) {
  return {s * a.rho, s * a.omega};
}

/// x ↦ (columns) x + shift.
template <class S>
struct Motion {
  Vector<S> columns[3];
  Vector<S> shift;
};

template <class S>
JADE_HD Vector<S> turned(const Motion<S>& motion, const Vector<S>& v) {
  return v.x * motion.columns[0] + v.y * motion.columns[1] + v.z * motion.columns[2];
}
template <class S>
JADE_HD Vector<S> turned_back(const Motion<S>& motion, const Vector<S>& v) {
  return {dot(motion.columns[0], v), dot(motion.columns[1], v), dot(motion.columns[2], v)};
}

template <class S>
JADE_HD Motion<S> product(const Motion<S>& a, const Motion<S>& b) {
  return {{turned(a, b.columns[0]), turned(a, b.columns[1]), turned(a, b.columns[2])},
          turned(a, b.shift) + a.shift};
}

template <class S>
JADE_HD Motion<S> inverse_of(const Motion<S>& m) {
  return {{{m.columns[0].x, m.columns[1].x, m.columns[2].x},
           {m.columns[0].y, m.columns[1].y, m.columns[2].y},
           {m.columns[0].z, m.columns[1].z, m.columns[2].z}},
          S(-1) * turned_back(m, m.shift)};
}

/// Below this θ² the closed forms suffer from cancellation and the series are exact to 1e-16.
constexpr double kSeriesBelow = 1e-2;

/// c[0] + c[1] x + … + c[5] x⁵.
template <class S>
JADE_HD S polynomial(S x, const double (&c)[6]) {
  S sum(c[5]);
  for (int i = 4; i >= 0; --i) sum = sum * x + S(c[i]);
  return sum;
}

template <class S>
JADE_HD Motion<S> exp_of(const Twist<S>& twist) {
  const Vector<S>& w = twist.omega;
  const S square = dot(w, w);
  S a, b, c;
  if (value_of(square) < kSeriesBelow) {
    a = polynomial(square, {1, -1. / 6, 1. / 120, -1. / 5040, 1. / 362880, -1. / 39916800});
    b = polynomial(square,
                   {1. / 2, -1. / 24, 1. / 720, -1. / 40320, 1. / 3628800, -1. / 479001600});
    c = polynomial(square,
                   {1. / 6, -1. / 120, 1. / 5040, -1. / 362880, 1. / 39916800, -1. / 6227020800});
  } else {
    const S angle = root(square);
    a = sine(angle) / angle;
    b = (S(1) - cosine(angle)) / square;
    c = (angle - sine(angle)) / (square * angle);
  }
  Motion<S> motion;
  const Vector<S> axes[3] = {{S(1), S(0), S(0)}, {S(0), S(1), S(0)}, {S(0), S(0), S(1)}};
  for (int i = 0; i < 3; ++i) {
    const Vector<S> once = cross(w, axes[i]);
    motion.columns[i] = axes[i] + a * once + b * cross(w, once);
  }
  const Vector<S> once = cross(w, twist.rho);
  motion.shift = twist.rho + b * once + c * cross(w, once);
  return motion;
}

/// Logarithm of a motion whose rotation is less than 90°.
template <class S>
JADE_HD Twist<S> log_of(const Motion<S>& motion) {
  const Vector<S>* r = motion.columns;
  const Vector<S> sines = S(0.5) * Vector<S>{r[1].z - r[2].y, r[2].x - r[0].z, r[0].y - r[1].x};
  const S sine_square = dot(sines, sines);
  S ratio;  // arcsin(s)/s
  if (value_of(sine_square) < kSeriesBelow) {
    ratio = polynomial(sine_square, {1, 1. / 6, 3. / 40, 15. / 336, 105. / 3456, 945. / 42240}) +
            S(10395. / 599040) * sine_square * sine_square * sine_square * sine_square *
                sine_square * sine_square;
  } else {
    ratio = arcsine(root(sine_square)) / root(sine_square);
  }
  const Vector<S> w = ratio * sines;
  const S square = dot(w, w);
  S d;  // (I + B[ω] + C[ω]²)⁻¹ = I − [ω]/2 + D[ω]²
  if (value_of(square) < kSeriesBelow) {
    d = polynomial(
        square, {1. / 12, 1. / 720, 1. / 30240, 1. / 1209600, 1. / 47900160, 691. / 1307674368000});
  } else {
    const S angle = root(square);
    d = (S(1) - angle * sine(angle) / (S(2) * (S(1) - cosine(angle)))) / square;
  }
  const Vector<S> once = cross(w, motion.shift);
  return {motion.shift + S(-0.5) * once + d * cross(w, once), w};
}

}  // namespace jade::geometry
