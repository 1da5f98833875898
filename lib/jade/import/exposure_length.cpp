// SPDX-License-Identifier: Apache-2.0
#include "jade/import/exposure_length.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "jade/core/error.h"
#include "jade/core/progress.h"
#include "jade/data/event_consistency.h"

namespace jade::import {
namespace {

constexpr size_t kMostFrames = 16;
constexpr size_t kFewestFrames = 4;
constexpr double kShortest = 0.05;  // of the frame period
/// Initial lengths, as shares of the frame period.
constexpr double kLengths[] = {kShortest, 0.1, 0.18, 0.28, 0.4, 0.55, 0.7, 0.85, 1};
constexpr double kFineStep = 1.12;  // ratio of refined lengths around the best of these
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

/// Sets the length at the minimum of the curve around `best`, and its standard error by the
/// jackknife over parts of the image.
void settle(const std::map<double, LengthSearch::Tried>& tried, double best,
            ExposureLength& result) {
  const auto at = tried.find(best);
  const auto solved = [](const auto& place) { return place->second.fit.solved; };
  if (at == tried.begin() || std::next(at) == tried.end() || !solved(std::prev(at)) ||
      !solved(std::next(at))) {
    result.length_us = std::llround(best);
    return;
  }
  const auto before = std::prev(at), after = std::next(at);
  const double lengths[3] = {before->first, best, after->first};
  const data::ConsistencyFit* const fits[3] = {&before->second.fit, &at->second.fit,
                                               &after->second.fit};
  const double all[3] = {fits[0]->loss, fits[1]->loss, fits[2]->loss};
  const double length = lowest(lengths, all);
  result.length_us = std::llround(length);
  double squares = 0;
  const auto groups = double(fits[1]->part_losses.size());
  for (size_t g = 0; g < fits[1]->part_losses.size(); ++g) {
    double rest[3];
    for (int k = 0; k < 3; ++k) {
      rest[k] = (groups * fits[k]->loss - fits[k]->part_losses[g]) / (groups - 1);
    }
    squares += std::pow(lowest(lengths, rest) - length, 2);
  }
  result.error_us = std::sqrt((groups - 1) / groups * squares);
}

std::string doubt_of(const ExposureLength& result, const LengthSearch& search, double best) {
  if (best == 0) return "too few pixels have events and light; does the camera stand still?";
  const data::ConsistencyFit& fit = search.tried().at(best).fit;
  if (fit.unexplained > kMostUnexplained) return "events do not explain how the frames change";
  double worst = fit.loss;
  for (const double loss : result.losses) worst = std::max(worst, loss);
  if (worst - fit.loss < 0.01 || result.error_us > kMostError * double(result.length_us)) {
    return "frames and events agree alike at all lengths; is there motion blur?";
  }
  return "";
}

}  // namespace

int64_t frame_period_us(const std::vector<int64_t>& stamps_us) {
  std::vector<int64_t> steps;
  for (size_t i = 1; i < stamps_us.size(); ++i) steps.push_back(stamps_us[i] - stamps_us[i - 1]);
  if (steps.empty()) return 0;
  std::sort(steps.begin(), steps.end());
  return steps[steps.size() / 2];
}

ExposureLength estimate_exposure_length(const std::vector<StampedFrame>& frames,
                                        const events::EventStream& events,
                                        std::optional<Stamp> stamp) {
  ExposureLength result;
  std::vector<int64_t> stamps_us;
  for (const StampedFrame& frame : frames) stamps_us.push_back(frame.t_us);
  const int64_t period_us = frame_period_us(stamps_us);
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
  double best = search.best_length();
  // Refine until the best length has two near neighbours.
  for (int round = 0; best > 0 && round < 6; ++round) {
    const std::vector<Stamp> same{search.tried().at(best).stamp};
    for (const double length : {best / kFineStep, best * kFineStep}) {
      const auto above = search.tried().lower_bound(length / std::sqrt(kFineStep));
      const bool known =
          above != search.tried().end() && above->first < length * std::sqrt(kFineStep);
      if (!known && length >= kShortest * double(period_us) && length < double(period_us)) {
        search.at(length, same);
      }
    }
    const double next = search.best_length();
    if (next == best) break;
    best = next;
  }
  for (const auto& [length, tried] : search.tried()) {
    if (!tried.fit.solved) continue;
    result.lengths_us.push_back(length);
    result.losses.push_back(tried.fit.loss);
  }
  if (best > 0) {
    result.stamp = search.tried().at(best).stamp;
    settle(search.tried(), best, result);
  }
  result.doubt = doubt_of(result, search, best);
  return result;
}

}  // namespace jade::import
