// SPDX-License-Identifier: Apache-2.0
#include "jade/import/exposure_length.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/data/event_consistency.h"

namespace jade::import {
namespace {

constexpr size_t kMostFrames = 16;
constexpr size_t kFewestFrames = 4;
constexpr double kShortest = 0.05;  // of the frame period
/// Initial lengths, as shares of the frame period.
constexpr double kLengths[] = {kShortest, 0.1, 0.18, 0.28, 0.4, 0.55, 0.7, 0.85, 1};
constexpr double kFineStep = 1.12;  // ratio of refined lengths around the best of these
constexpr int kMostSteps = 8;       // of refined lengths to either side
/// Standard deviation besides that of the jackknife: events come some tenths of a millisecond after
/// the light, which the length makes up for (docs/engineering/import.md).
constexpr double kLateness_us = 500, kShapeShare = 0.02;
constexpr double kMostUnexplained = 0.7;
constexpr double kMostError = 0.25;  // relative to the length

using recording::Stamp;

/// Consecutive frames from the middle of the recording, where cameras move most.
std::vector<StampedFrame> middle_frames(const std::vector<StampedFrame>& frames) {
  const size_t count = std::min(frames.size(), kMostFrames);
  const auto begin = frames.begin() + std::ptrdiff_t((frames.size() - count) / 2);
  return {begin, begin + std::ptrdiff_t(count)};
}

/// The agreement of frames and events by length and stamp, each evaluated once.
class LengthSearch {
 public:
  LengthSearch(const std::vector<StampedFrame>& frames, int64_t period_us,
               const events::EventStream& events, const std::vector<Stamp>& stamps)
      : frames_(frames),
        consistency_(images(frames), neighbours(frames, period_us), events,
                     {frames.front().t_us - period_us, frames.back().t_us + period_us}, options()),
        progress_("finding exposure length", int64_t(std::size(kLengths) * stamps.size() + 5), 0,
                  "fits") {
    progress_.show();
  }

  struct Tried {
    data::ConsistencyFit fit;
    Stamp stamp = Stamp::kMiddle;
  };

  /// The best of these stamps at a length.
  const Tried& at(double length_us, const std::vector<Stamp>& stamps) {
    const auto known = tried_.find(length_us);
    if (known != tried_.end()) return known->second;
    Tried best;
    for (const Stamp stamp : stamps) {
      std::vector<events::TimeWindow> windows;
      for (const StampedFrame& frame : frames_) {
        windows.push_back(recording::exposure_at(frame.t_us, std::llround(length_us), stamp));
      }
      data::ConsistencyFit fit = consistency_.fit(windows);
      if (progress_.step()) progress_.show();
      if (fit.solved && (!best.fit.solved || fit.loss < best.fit.loss))
        best = {std::move(fit), stamp};
    }
    return tried_.emplace(length_us, std::move(best)).first->second;
  }

  const std::map<double, Tried>& tried() const { return tried_; }

  /// Best length among the fits that converged.
  double best_length() const {
    double length = 0, loss = INFINITY;
    for (const auto& [each, tried] : tried_) {
      if (tried.fit.solved && tried.fit.loss < loss) loss = tried.fit.loss, length = each;
    }
    return length;
  }

 private:
  static data::ConsistencyOptions options() {
    data::ConsistencyOptions options;
    options.pixels = 2500;
    options.rounds = 6;
    return options;
  }
  static std::vector<torch::Tensor> images(const std::vector<StampedFrame>& frames) {
    std::vector<torch::Tensor> out;
    for (const StampedFrame& frame : frames) out.push_back(frame.image);
    return out;
  }
  static std::vector<bool> neighbours(const std::vector<StampedFrame>& frames, int64_t period_us) {
    std::vector<bool> out;
    for (size_t i = 1; i < frames.size(); ++i) {
      out.push_back(2 * (frames[i].t_us - frames[i - 1].t_us) < 3 * period_us);
    }
    return out;
  }

  const std::vector<StampedFrame>& frames_;
  data::EventConsistency consistency_;
  Progress progress_;
  std::map<double, Tried> tried_;
};

/// Minimum of the parabola through three points of a curve over log length.
double lowest(const double (&lengths)[3], const double (&losses)[3]) {
  const double a = std::log(lengths[0]), b = std::log(lengths[1]), c = std::log(lengths[2]);
  const double left = (losses[1] - losses[0]) / (b - a), right = (losses[2] - losses[1]) / (c - b);
  const double bend = (right - left) / (c - a);
  if (!(bend > 0)) return lengths[1];
  return std::exp(std::clamp(0.5 * (a + b) - left / (2 * bend), a, c));
}

/// Sets the length at the minimum of the refined curve, and its standard error by the jackknife
/// over parts of the image. A minimum at the upper end has an error of a step, one at the lower end
/// of the whole length.
void settle(LengthSearch& search, double start, Stamp stamp, double longest,
            ExposureLength& result) {
  int best = 0;
  const auto length_at = [&](int step) { return start * std::pow(kFineStep, step); };
  const auto loss_at = [&](int step) {
    const double length = length_at(step);
    const bool inside = length <= kFineStep * longest && std::abs(step) <= kMostSteps;
    if (!inside) return double(INFINITY);
    const data::ConsistencyFit& fit = search.at(length, {stamp}).fit;
    return fit.solved ? fit.loss : double(INFINITY);
  };
  for (;;) {
    const int next = loss_at(best - 1) < loss_at(best + 1) ? best - 1 : best + 1;
    if (!(loss_at(next) < loss_at(best))) break;
    best = next;
  }
  const double lengths[3] = {length_at(best - 1), length_at(best), length_at(best + 1)};
  const double all[3] = {loss_at(best - 1), loss_at(best), loss_at(best + 1)};
  if (!std::isfinite(all[0] + all[1] + all[2])) {
    result.length_us = std::llround(std::min(lengths[1], longest));
    result.error_us = best < 0 ? lengths[1] : (kFineStep - 1) * lengths[1];
    return;
  }
  const double length = lowest(lengths, all);
  const auto part_losses = [&](int k) -> const std::vector<double>& {
    return search.at(lengths[k], {stamp}).fit.part_losses;
  };
  const size_t count = part_losses(1).size();
  const auto groups = double(count);
  double squares = 0;
  for (size_t g = 0; g < count; ++g) {
    double rest[3];
    for (int k = 0; k < 3; ++k) rest[k] = (groups * all[k] - part_losses(k)[g]) / (groups - 1);
    squares += std::pow(lowest(lengths, rest) - length, 2);
  }
  result.length_us = std::llround(std::min(length, longest));
  result.error_us =
      std::hypot(std::sqrt((groups - 1) / groups * squares), kLateness_us + kShapeShare * length);
}

std::string doubt_of(const ExposureLength& result, const LengthSearch& search, double best) {
  if (best == 0) return "too few pixels have events and light; does the camera stand still?";
  const data::ConsistencyFit& fit = search.tried().at(best).fit;
  if (fit.unexplained > kMostUnexplained) return "events do not explain how the frames change";
  double worst = fit.loss;
  for (const double loss : result.losses) worst = std::max(worst, loss);
  if (worst - fit.loss < 0.01) {
    return "frames and events agree alike at all lengths; is there motion blur?";
  }
  if (result.error_us > kMostError * double(result.length_us)) {
    return concat("the best, ", readable(double(result.length_us) / 1000, 2), " ms, may be ",
                  readable(result.error_us / 1000, 2), " ms off; is there motion blur?");
  }
  return "";
}

}  // namespace

ExposureLength estimate_exposure_length(const std::vector<StampedFrame>& frames,
                                        const events::EventStream& events,
                                        std::optional<Stamp> stamp) {
  ExposureLength result;
  std::vector<int64_t> stamps_us;
  for (const StampedFrame& frame : frames) stamps_us.push_back(frame.t_us);
  const int64_t period_us = median_step(stamps_us);
  if (frames.size() < kFewestFrames || period_us <= 0 || events.empty()) {
    result.doubt = concat("found ", frames.size(), " frames, ", period_us, " us apart, and ",
                          events.size(), " events");
    return result;
  }
  const std::vector<StampedFrame> some = middle_frames(frames);
  const std::vector<Stamp> stamps =
      stamp ? std::vector<Stamp>{*stamp}
            : std::vector<Stamp>{Stamp::kStart, Stamp::kMiddle, Stamp::kEnd};
  LengthSearch search(some, period_us, events, stamps);
  for (const double share : kLengths) search.at(share * double(period_us), stamps);
  const double best = search.best_length();
  if (best > 0) {
    result.stamp = search.tried().at(best).stamp;
    settle(search, best, result.stamp, double(period_us), result);
  }
  for (const auto& [length, tried] : search.tried()) {
    if (!tried.fit.solved) continue;
    result.lengths_us.push_back(length);
    result.losses.push_back(tried.fit.loss);
  }
  result.doubt = doubt_of(result, search, best);
  return result;
}

}  // namespace jade::import
