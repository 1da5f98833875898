// SPDX-License-Identifier: Apache-2.0
// Which pixels a splat can reach: a box, and an interval for each row. Both depend on the splat
// alone, so the division of the image into tiles cannot change them.
#pragma once

#include "jade/splat/math/blend.h"
#include "jade/splat/math/scalar.h"

namespace jade::splat::math {
inline namespace JADE_ISA {

/// Allowance for rounding of the extents below, in pixels: one pixel too many costs a test, one too
/// few leaves a hole.
constexpr double kExtentSlackPx = 0.01;

/// Half of the reach: α ≥ 1/255 where q ≤ reach = 2 ln(255 o). Not positive: nowhere.
template <class S>
JADE_HD S reach(S log2_opacity) {
  return S(2.0 / kLog2E) * (log2_opacity - S(kLog2MinAlpha));
}

/// Half the width (or height) of the box around {q ≤ reach} from the variance along it: sqrt(reach
/// · variance). Requires a non-negative reach.
template <class S>
JADE_HD S half_extent(S reach_value, S variance) {
  return sqrt(reach_value * variance) + S(kExtentSlackPx);
}

/// Row interval at height dy from the centre: centre ± sqrt(width2 − shrink dy²), and the centre
/// moves by slope · dy. From a dx² + 2b dx dy + c dy² ≤ reach, in terms of Σ2d.
template <class S>
struct RowExtent {
  S slope, width2, shrink;
};

template <class S>
JADE_HD RowExtent<S> make_row_extent(S reach_value, S cov_xy, S cov_yy, S det) {
  const S inverse = S(1) / cov_yy;
  return {cov_xy * inverse, reach_value * det * inverse, det * inverse * inverse};
}

/// Half the length of that interval, squared and without slack; 0 if the row is not reached.
template <class S>
JADE_HD S half_width2(const RowExtent<S>& row, S dy) {
  return max(row.width2 - row.shrink * dy * dy, S(0));
}

template <class S>
JADE_HD S half_width(const RowExtent<S>& row, S dy) {
  return sqrt(half_width2(row, dy));
}

}  // namespace JADE_ISA
}  // namespace jade::splat::math
