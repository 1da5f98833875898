// SPDX-License-Identifier: Apache-2.0
#include "jade/import/blur_length.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <vector>

namespace jade::import {
namespace {

constexpr double kReach_px = 64;
constexpr size_t kMostEvents = 20000;  // per patch
constexpr size_t kMostCoarse = 4000;
constexpr size_t kFewEvents = 30;

/// An event of a patch; time from −½ to ½ over the exposure.
struct PatchEvent {
  float x, y, time;
  bool positive;
};

struct Velocity {
  double x = 0, y = 0;  ///< px per exposure
  double length() const { return std::hypot(x, y); }
};

/// Density of the events of a patch after compensating a velocity.
class Density {
 public:
  Density(const std::vector<PatchEvent>& events, double side_px)
      : events_(events), side_(side_px) {}

  /// Σ n⁺² + n⁻² over cells, with bilinear votes and a binomial filter, so that whole-pixel
  /// coordinates have no advantage at zero velocity.
  /// @param stride  uses every stride-th event
  double operator()(const Velocity& v, double cell_px, size_t stride) {
    const double margin = 0.5 * kReach_px + 4 * cell_px;
    const auto n = int64_t(std::ceil((side_ + 2 * margin) / cell_px));
    for (auto& votes : votes_) votes.assign(size_t(n * n), 0.0f);
    for (size_t i = 0; i < events_.size(); i += stride) {
      const PatchEvent& e = events_[i];
      const double x = (double(e.x) - v.x * double(e.time) + margin) / cell_px;
      const double y = (double(e.y) - v.y * double(e.time) + margin) / cell_px;
      const auto column = int64_t(x), row = int64_t(y);
      if (!(x >= 0 && y >= 0 && column + 1 < n && row + 1 < n)) continue;
      const auto fx = float(x - double(column)), fy = float(y - double(row));
      float* const at = votes_[e.positive ? 0 : 1].data() + row * n + column;
      at[0] += (1 - fx) * (1 - fy), at[1] += fx * (1 - fy);
      at[n] += (1 - fx) * fy, at[n + 1] += fx * fy;
    }
    return squares(votes_[0], n) + squares(votes_[1], n);
  }

 private:
  double squares(const std::vector<float>& votes, int64_t n) {
    rows_.assign(votes.size(), 0.0f);
    for (int64_t i = 1; i + 1 < n * n; ++i) {
      rows_[size_t(i)] =
          0.25f * votes[size_t(i - 1)] + 0.5f * votes[size_t(i)] + 0.25f * votes[size_t(i + 1)];
    }
    double sum = 0;
    for (int64_t i = n; i < n * (n - 1); ++i) {
      const float value =
          0.25f * rows_[size_t(i - n)] + 0.5f * rows_[size_t(i)] + 0.25f * rows_[size_t(i + n)];
      sum += double(value) * double(value);
    }
    return sum;
  }

  const std::vector<PatchEvent>& events_;
  const double side_;
  std::vector<float> votes_[2], rows_;
};

/// A grid of velocities around a centre.
struct Level {
  double cell_px, step_px;
  int reach;  ///< steps in each direction
  size_t most;
};

Velocity densest(Density& density, const Velocity& about, const Level& level, size_t count) {
  const size_t stride = (count + level.most - 1) / level.most;
  Velocity best = about;
  double highest = -1;
  for (int i = -level.reach; i <= level.reach; ++i) {
    for (int j = -level.reach; j <= level.reach; ++j) {
      const Velocity v{about.x + j * level.step_px, about.y + i * level.step_px};
      // A straight edge leaves the velocity along it undetermined: choose the slowest.
      const double value = density(v, level.cell_px, stride) * (1 - 5e-4 * v.length());
      if (value > highest) highest = value, best = v;
    }
  }
  return best;
}

Velocity velocity_of(const std::vector<PatchEvent>& events, double side_px) {
  constexpr Level kLevels[] = {{4, 4, int(kReach_px / 4), kMostCoarse},
                               {2, 2, 2, kMostEvents},
                               {1, 1, 2, kMostEvents},
                               {1, 0.5, 1, kMostEvents},
                               {1, 0.25, 1, kMostEvents}};
  Density density(events, side_px);
  Velocity v;
  for (const Level& level : kLevels) v = densest(density, v, level, events.size());
  // Random events gain density by chance, with a standard deviation of 0.45 count / side: six of
  // these for a thousand velocities, two for the few slow ones.
  const double chance = (v.length() < 4 ? 1 : 3) * double(events.size()) / side_px;
  return density(v, 1, 1) - density({}, 1, 1) > chance ? v : Velocity{};
}

/// The events of the exposure by patch, thinned evenly if there are many.
std::vector<std::vector<PatchEvent>> patches_of(const events::EventStream& events,
                                                const events::TimeWindow& exposure, int64_t side,
                                                int64_t rows, int64_t columns) {
  std::vector<std::vector<PatchEvent>> patches(size_t(rows * columns));
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p = events.polarity().const_data_ptr<int8_t>();
  for (int64_t i = 0; i < events.size(); ++i) {
    const float column = std::floor((x[i] + 0.5f) / float(side));
    const float row = std::floor((y[i] + 0.5f) / float(side));
    if (!(column >= 0 && column < float(columns) && row >= 0 && row < float(rows))) continue;
    const double time = double(t[i] - exposure.begin_us) / double(exposure.duration_us()) - 0.5;
    patches[size_t(int64_t(row) * columns + int64_t(column))].push_back(
        {x[i] - column * float(side), y[i] - row * float(side), float(time), p[i] > 0});
  }
  for (auto& patch : patches) {
    const size_t stride = (patch.size() + kMostEvents - 1) / kMostEvents;
    if (stride < 2) continue;
    size_t kept = 0;
    for (size_t i = 0; i < patch.size(); i += stride) patch[kept++] = patch[i];
    patch.resize(kept);
  }
  return patches;
}

}  // namespace

double blur_px(const events::EventStream& events, const events::TimeWindow& exposure,
               const events::ImageSize& size) {
  if (exposure.duration_us() <= 0) return 0;
  const int64_t side = std::clamp<int64_t>(size.width / 4, 32, 128);
  const int64_t rows = std::max<int64_t>(1, size.height / side);
  const int64_t columns = std::max<int64_t>(1, size.width / side);
  const auto patches = patches_of(events.slice(exposure), exposure, side, rows, columns);
  std::vector<double> lengths(patches.size(), 0.0);
  at::parallel_for(0, int64_t(patches.size()), 1, [&](int64_t begin, int64_t end) {
    for (auto i = size_t(begin); i < size_t(end); ++i) {
      if (patches[i].size() < kFewEvents) continue;
      lengths[i] = velocity_of(patches[i], double(side)).length();
    }
  });
  double sum = 0, weight = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    sum += double(patches[i].size()) * lengths[i];
    weight += double(patches[i].size());
  }
  return weight > 0 ? sum / weight : 0;
}

}  // namespace jade::import
