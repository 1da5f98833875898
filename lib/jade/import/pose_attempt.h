// SPDX-License-Identifier: Apache-2.0
// One attempt of structure from motion, and which of two is better.
#pragma once

#include <cstdint>
#include <string>

#include "jade/import/reconstruction.h"

namespace jade::import {

/// Result of one attempt.
struct Attempt {
  std::string name;
  int64_t images = 0, registered = 0;
  int64_t points = 0, observations = 0;
  double error_px = 0;        ///< mean reprojection error, px of the shots
  double parallax_deg = 0;    ///< median angle between the outermost rays to a point
  double explained_blur = 0;  ///< share of the blur of the frames that its poses explain
  double blur_px = 0;   ///< length of that blur: the larger one of its poses and of the events
  std::string problem;  ///< why it failed; empty if it produced a model

  /// Whether the frames have enough blur to check the poses by it. With less, noise hides the
  /// share.
  bool has_blur() const { return blur_px >= 2; }
};

/// "80 % of the blur explained", or that there is too little blur.
std::string said_of_blur(const Attempt& attempt);

/// The figures of a reconstruction, without those of the blur.
Attempt attempt_of(const std::string& name, size_t images, const Reconstruction& reconstruction);

/// True if the poses have parallax and explain the blur of the frames, if there is any.
bool explains_blur(const Attempt& attempt);

/// Whether `a` is the better one of two models of the same matches.
bool fits_better(const Attempt& a, const Attempt& b);

/// Whether `a` is better than `b`, whose matches may be others.
/// @param margin  of explained blur by which `a` must lead
bool is_better(const Attempt& a, const Attempt& b, double margin = 0);

/// Whether no further attempt follows the first `made`, of which `attempt` is the best.
bool is_enough(const Attempt& attempt, size_t made);

/// Least angle between the outermost rays to a point, for points to have depth.
inline constexpr double kLeastParallax_deg = 0.2;

/// "usual: 12 of 12 images, ...", or why the attempt failed.
std::string sentence(const Attempt& attempt);

}  // namespace jade::import
