// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <string>

#include "jade/gaussians/init.h"

namespace jade::gaussians {

/// Samples points as random_frusta(), but each at one of kSweptDepths depths, uniform in inverse
/// depth: where the views agree best about its colour, which is their mean. Images are blurred by a
/// few pixels first; masked pixels do not count, and gains are divided out. Depths that agree about
/// as well, as on surfaces without texture, are equally likely; a point that fewer than three views
/// see has a random depth. CPU; the result is the same for any number of threads. Gain:
/// docs/engineering/preset.md, "Start of the scene".
/// @param disagreement  if given, receives the variance of the views at the best depth over that at
///   the median depth, median over the points that have texture; 0 if there are few. About 0.1 for
///   right poses, 0.5 and more for those of another convention.
PointCloud plane_sweep(const InitSources& sources, int64_t count, at::Generator& generator,
                       double* disagreement = nullptr);

constexpr int64_t kSweptDepths = 32;

/// A fault of the poses of views that agree at no depth, by the `disagreement` of a plane_sweep().
/// Empty otherwise.
std::string pose_fault(double disagreement);

/// The fault by a sweep of its own. Empty without depth bounds.
std::string pose_fault(const InitSources& sources);

}  // namespace jade::gaussians
