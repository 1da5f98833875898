// SPDX-License-Identifier: Apache-2.0
#include "jade/import/clock_offset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/events/pixels.h"
#include "jade/imaging/color.h"
#include "jade/import/frame_change.h"

namespace jade::import {
namespace {

constexpr double kDarkest = 0.03, kBrightest = 0.97, kLogFloor = 0.02;
constexpr int64_t kPatchesAcross = 120;
constexpr int64_t kMostBins = 512;
constexpr int64_t kGroups = 4;  // groups of patches per pair, for the jackknife
constexpr double kLeastCorrelation = 0.2;
constexpr double kRivalShare = 0.9;
constexpr double kLargestError_us = 3000;
/// Standard deviations that all parts of the frames share: of the pixels' latency, and of the lags'
/// correction, as a share of them (docs/engineering/import.md).
constexpr double kLatency_us = 300, kLagShare = 0.1;

/// Mean of the frame over patches of n x n pixels.
torch::Tensor patches(const torch::Tensor& frame, int64_t n) {
  const int64_t rows = frame.size(-2) / n, columns = frame.size(-1) / n;
  const torch::Tensor gray = imaging::gray(frame).reshape({frame.size(-2), frame.size(-1)});
  return gray.slice(0, 0, rows * n)
      .slice(1, 0, columns * n)
      .reshape({rows, n, columns, n})
      .mean({1, 3})
      .to(torch::kFloat64);
}

/// Estimates when the changes behind the events happened. A pixel fires once a change reaches its
/// threshold, so during a change its events lag by half the time since the previous one; after a
/// change of sign most of that time passed before the change began. Uncorrected, events would lag
/// by 3 to 12 ms.
class ChangeLags {
 public:
  explicit ChangeLags(const events::ImageSize& size)
      : size_(size),
        last_us_(size_t(size.height * size.width), kNever),
        polarity_(last_us_.size(), 0) {}

  /// The lag of an event, µs. Call in order of time. NaN for events outside the sensor.
  double operator()(float x, float y, int64_t t_us, int8_t polarity) {
    const int64_t at = events::pixel_of(x, y, size_);
    if (at < 0) return std::numeric_limits<double>::quiet_NaN();
    const auto pixel = size_t(at);
    const double waited = std::min(double(t_us) - last_us_[pixel], kLongestWait_us);
    const double lag = polarity == polarity_[pixel] ? 0.5 : 0.125;
    last_us_[pixel] = double(t_us), polarity_[pixel] = polarity;
    return lag * waited;
  }

 private:
  static constexpr double kNever = -1e18, kLongestWait_us = 100000;
  events::ImageSize size_;
  std::vector<double> last_us_;
  std::vector<int8_t> polarity_;
};

/// Time spans in which events are summed.
struct Bins {
  int64_t begin_us = 0, count = 0;
  double width_us = 0;
};

/// Signed events of each span of time and patch of n x n pixels.
struct Binned {
  torch::Tensor sums;             ///< [bins, patches] float32
  double lags_us = 0, count = 0;  ///< sum of the events' lags, and their number
};

Binned binned(const events::EventStream& events, const Bins& bins, int64_t n,
              const events::ImageSize& size) {
  const int64_t rows = size.height / n, columns = size.width / n;
  Binned out{torch::zeros({bins.count, rows * columns}, torch::kFloat32)};
  float* const sums = out.sums.data_ptr<float>();
  const float *x = events.x().const_data_ptr<float>(), *y = events.y().const_data_ptr<float>();
  const int64_t* t = events.t_us().const_data_ptr<int64_t>();
  const int8_t* p = events.polarity().const_data_ptr<int8_t>();
  ChangeLags lag_of(size);
  for (int64_t i = 0; i < events.size(); ++i) {
    const double lag_us = lag_of(x[i], y[i], t[i], p[i]);
    const double bin = std::floor((double(t[i] - bins.begin_us) - lag_us) / bins.width_us);
    if (!(bin >= 0 && bin < double(bins.count))) continue;
    const int64_t column = int64_t(x[i] + 0.5f) / n, row = int64_t(y[i] + 0.5f) / n;
    if (column >= columns || row >= rows) continue;
    sums[int64_t(bin) * rows * columns + row * columns + column] += float(p[i]);
    out.lags_us += lag_us, ++out.count;
  }
  return out;
}

/// Sums over patches at every offset, for one group; the correlation of any union of groups follows
/// from them.
struct Moments {
  double frame = 0;                  ///< Σ d²
  double lags_us = 0, count = 0;     ///< as in Binned
  std::vector<double> cross, event;  ///< Σ d e, Σ e²

  explicit Moments(size_t offsets = 0) : cross(offsets, 0), event(offsets, 0) {}
  void add(const Moments& other, double sign) {
    frame += sign * other.frame, lags_us += sign * other.lags_us, count += sign * other.count;
    for (size_t i = 0; i < cross.size(); ++i) {
      cross[i] += sign * other.cross[i], event[i] += sign * other.event[i];
    }
  }
  std::vector<double> correlation() const {
    std::vector<double> out;
    for (size_t i = 0; i < cross.size(); ++i) {
      const double scale = std::sqrt(frame * event[i]);
      out.push_back(scale > 0 ? cross[i] / scale : 0);
    }
    return out;
  }
};

std::vector<double> offsets_us(const ClockOffsetOptions& options) {
  const auto steps = int64_t(std::llround(options.reach_ms / options.step_ms));
  std::vector<double> out;
  for (int64_t i = -steps; i <= steps; ++i) out.push_back(1e3 * options.step_ms * double(i));
  return out;
}

/// Moments of one pair of frames, one group per quarter of the patches; empty if nothing is usable.
std::vector<Moments> pair_moments(const data::Exposure& a, const data::Exposure& b,
                                  const events::EventStream& events,
                                  const std::vector<double>& offsets, double step_us) {
  const events::ImageSize size{a.blurry.size(-2), a.blurry.size(-1)};
  const int64_t n = std::max<int64_t>(1, size.width / kPatchesAcross);
  const torch::Tensor before = patches(a.blurry, n), after = patches(b.blurry, n);
  const torch::Tensor usable =
      (before > kDarkest) & (before < kBrightest) & (after > kDarkest) & (after < kBrightest);
  const torch::Tensor index = usable.flatten().nonzero().flatten();
  const auto begin_us = a.t_start_us + int64_t(offsets.front());
  const auto end_us = b.t_end_us + int64_t(offsets.back());
  Bins bins{begin_us, 0, std::max(step_us, double(end_us - begin_us) / double(kMostBins))};
  bins.count = int64_t(std::ceil(double(end_us - begin_us) / bins.width_us));
  const events::EventStream near = events.slice(begin_us, end_us);
  if (index.numel() < 16 * kGroups || near.empty()) return {};
  torch::Tensor weights = torch::empty({int64_t(offsets.size()), bins.count}, torch::kFloat32);
  auto weight = weights.accessor<float, 2>();
  for (size_t i = 0; i < offsets.size(); ++i) {
    for (int64_t k = 0; k < bins.count; ++k) {
      const double t = double(begin_us) + (double(k) + 0.5) * bins.width_us - offsets[i];
      weight[int64_t(i)][k] = float(part_after(b, t) - part_after(a, t));
    }
  }
  const Binned found = binned(near, bins, n, size);
  torch::Tensor e = weights.matmul(found.sums.index_select(1, index)).to(torch::kFloat64);
  torch::Tensor d =
      ((after + kLogFloor).log() - (before + kLogFloor).log()).flatten().index_select(0, index);
  // Remove a change common to all patches, caused by the light or the shutter.
  e = e - e.mean(1, true);
  d = d - d.mean();
  std::vector<Moments> groups;
  for (int64_t g = 0; g < kGroups; ++g) {
    // Whole bands of the image, because neighbours have correlated errors.
    const int64_t from = index.numel() * g / kGroups, to = index.numel() * (g + 1) / kGroups;
    const torch::Tensor ge = e.slice(1, from, to), gd = d.slice(0, from, to);
    const torch::Tensor cross = ge.matmul(gd), event = ge.square().sum(1);
    Moments moments(offsets.size());
    moments.frame = gd.square().sum().item<double>();
    moments.lags_us = found.lags_us / double(kGroups),
    moments.count = found.count / double(kGroups);
    std::copy_n(cross.const_data_ptr<double>(), offsets.size(), moments.cross.begin());
    std::copy_n(event.const_data_ptr<double>(), offsets.size(), moments.event.begin());
    groups.push_back(std::move(moments));
  }
  return groups;
}

size_t highest(const std::vector<double>& curve) {
  return size_t(std::max_element(curve.begin(), curve.end()) - curve.begin());
}

/// Position of the peak in steps of the curve, by the parabola through its three highest points.
double refined(const std::vector<double>& curve, size_t peak) {
  if (peak == 0 || peak + 1 == curve.size()) return double(peak);
  const double left = curve[peak - 1], right = curve[peak + 1],
               bend = left + right - 2 * curve[peak];
  return double(peak) + (bend < 0 ? 0.5 * (left - right) / bend : 0);
}

/// The next local peak that a valley separates from the first.
double second_peak(const std::vector<double>& curve, size_t peak) {
  double best = 0;
  for (size_t i = 0; i < curve.size(); ++i) {
    const bool local =
        (i == 0 || curve[i] >= curve[i - 1]) && (i + 1 == curve.size() || curve[i] >= curve[i + 1]);
    if (local && i != peak) best = std::max(best, curve[i]);
  }
  return best;
}

/// Over long gaps noise dominates; rounded times may overlap a little.
bool are_neighbours(const data::Exposure& a, const data::Exposure& b) {
  const int64_t gap = b.t_start_us - a.t_end_us;
  return gap >= -a.duration_us() / 20 && gap <= std::max<int64_t>(3 * a.duration_us(), 200000);
}

/// Consecutive frames, evenly chosen.
std::vector<size_t> chosen_pairs(const std::vector<data::Exposure>& exposures, int64_t most) {
  std::vector<size_t> all, some;
  for (size_t i = 0; i + 1 < exposures.size(); ++i) {
    if (are_neighbours(exposures[i], exposures[i + 1])) all.push_back(i);
  }
  const size_t count = std::min(all.size(), size_t(std::max<int64_t>(most, 1)));
  for (size_t k = 0; k < count; ++k) some.push_back(all[k * all.size() / count]);
  return some;
}

std::string doubt_of(const ClockOffset& result, size_t peak) {
  if (result.pairs == 0)
    return "no two neighbouring frames have events around them and are neither too dark nor too "
           "bright; do the clocks overlap?";
  if (result.correlation < kLeastCorrelation) {
    return "frames and events do not change together; does the camera stand still?";
  }
  if (peak == 0 || peak + 1 == result.curve.size()) {
    return "the best offset lies at the end of the range";
  }
  if (result.second > kRivalShare * result.correlation) {
    return "another offset explains the frames nearly as well; the texture repeats itself";
  }
  if (result.error_us > kLargestError_us) return "parts of the frames disagree";
  return "";
}

/// The offset by the moments of some pairs, as pair_moments().
ClockOffset offset_by(const std::vector<std::vector<Moments>>& pairs,
                      const std::vector<double>& offsets, double step_us) {
  ClockOffset result;
  std::vector<Moments> groups;
  Moments total(offsets.size());
  for (const std::vector<Moments>& found : pairs) {
    if (!found.empty()) ++result.pairs;
    for (const Moments& group : found) {
      total.add(group, 1);
      groups.push_back(group);
    }
  }
  result.curve = total.correlation();
  const size_t peak = highest(result.curve);
  result.offset_us = offsets.front() + step_us * refined(result.curve, peak);
  result.correlation = result.curve[peak];
  result.second = std::max(0.0, second_peak(result.curve, peak));
  double squares = 0;
  for (const Moments& group : groups) {
    Moments rest = total;
    rest.add(group, -1);
    const std::vector<double> curve = rest.correlation();
    const double place = offsets.front() + step_us * refined(curve, highest(curve));
    squares += (place - result.offset_us) * (place - result.offset_us);
  }
  if (!groups.empty()) {
    const auto count = double(groups.size());
    result.scatter_us = std::sqrt((count - 1) / count * squares);
    const double lag_us = total.count > 0 ? total.lags_us / total.count : 0;
    result.error_us = std::hypot(result.scatter_us, kLatency_us, kLagShare * lag_us);
  }
  result.doubt = doubt_of(result, peak);
  return result;
}

}  // namespace

ClockOffset estimate_clock_offset(const std::vector<data::Exposure>& exposures,
                                  const events::EventStream& events,
                                  const ClockOffsetOptions& options) {
  const torch::NoGradGuard no_grad;
  JADE_CHECK(options.step_ms > 0 && options.reach_ms >= options.step_ms,
             "expected steps above 0 and within the reach, found ", options.step_ms, " and ",
             options.reach_ms, " ms");
  const std::vector<double> offsets = offsets_us(options);
  const double step_us = 1e3 * options.step_ms;
  std::vector<std::vector<Moments>> pairs;
  for (const size_t i : chosen_pairs(exposures, options.pairs))
    pairs.push_back(pair_moments(exposures[i], exposures[i + 1], events, offsets, step_us));
  return offset_by(pairs, offsets, step_us);
}

namespace {

constexpr size_t kParts = 8;
constexpr size_t kFewestParts = 3;

/// Offset of a part of the recording.
struct PartOffset {
  double t_us = 0, offset_us = 0, scatter_us = 0;
};

/// Estimates the offsets of parts; parts that overlap share their pairs of frames.
class Parts {
 public:
  Parts(const std::vector<data::Exposure>& exposures, const events::EventStream& events,
        const ClockOffsetOptions& options)
      : exposures_(exposures),
        events_(events),
        pairs_(size_t(options.pairs)),
        offsets_(offsets_us(options)),
        step_us_(1e3 * options.step_ms) {}

  /// Offsets of kParts parts that begin every `step` exposures; without those in doubt.
  std::vector<PartOffset> every(double step) {
    std::vector<PartOffset> out;
    for (size_t part = 0; part < kParts; ++part) {
      const auto begin = size_t(double(part) * step);
      if (part > 0 && begin == size_t(double(part - 1) * step)) continue;
      const size_t end = std::min(exposures_.size(), begin + pairs_ + 1);
      if (begin + 1 >= end) break;
      std::vector<std::vector<Moments>> pairs;
      for (size_t i = begin; i + 1 < end; ++i) pairs.push_back(moments(i));
      const ClockOffset found = offset_by(pairs, offsets_, step_us_);
      if (found.ambiguous()) continue;
      const double t_us =
          0.5 * (double(exposures_[begin].t_start_us) + double(exposures_[end - 1].t_end_us));
      out.push_back({t_us, found.offset_us, found.scatter_us});
    }
    return out;
  }

 private:
  const std::vector<Moments>& moments(size_t i) {
    const auto [at, added] = known_.emplace(i, std::vector<Moments>());
    const data::Exposure &a = exposures_[i], &b = exposures_[i + 1];
    if (added && are_neighbours(a, b)) at->second = pair_moments(a, b, events_, offsets_, step_us_);
    return at->second;
  }

  const std::vector<data::Exposure>& exposures_;
  const events::EventStream& events_;
  size_t pairs_;
  std::vector<double> offsets_;
  double step_us_;
  std::map<size_t, std::vector<Moments>> known_;
};

/// The line through the offsets, by least squares.
ClockDrift line_through(const std::vector<PartOffset>& parts) {
  constexpr double kLeastUs = 3000, kSigmas = 5;
  const auto count = double(parts.size());
  double t = 0, offset = 0;
  for (const PartOffset& part : parts) t += part.t_us / count, offset += part.offset_us / count;
  double tt = 0, to = 0, squares = 0;
  for (const PartOffset& part : parts) {
    tt += (part.t_us - t) * (part.t_us - t);
    to += (part.t_us - t) * (part.offset_us - offset);
  }
  ClockDrift drift;
  drift.rate = tt > 0 ? to / tt : 0;
  drift.begin_us = offset + drift.rate * (parts.front().t_us - t);
  drift.end_us = offset + drift.rate * (parts.back().t_us - t);
  for (const PartOffset& part : parts) {
    const double rest = part.offset_us - offset - drift.rate * (part.t_us - t);
    squares += rest * rest + part.scatter_us * part.scatter_us / count;
  }
  const double rate_error = tt > 0 ? std::sqrt(squares / (count - 2) / tt) : 0;
  const double error_us = rate_error * (parts.back().t_us - parts.front().t_us);
  const double change_us = std::abs(drift.end_us - drift.begin_us);
  drift.found = change_us > std::max(kLeastUs, kSigmas * error_us);
  return drift;
}

}  // namespace

ClockDrift estimate_clock_drift(const std::vector<data::Exposure>& exposures,
                                const events::EventStream& events,
                                const ClockOffsetOptions& options) {
  const torch::NoGradGuard no_grad;
  const auto pairs = size_t(options.pairs);
  if (exposures.size() < pairs + kFewestParts) return {};
  const double whole = double(exposures.size() - pairs - 1) / double(kParts - 1);
  Parts estimate(exposures, events, options);
  std::vector<PartOffset> parts = estimate.every(whole);
  if (parts.size() < kFewestParts && whole > double(pairs)) parts = estimate.every(double(pairs));
  return parts.size() < kFewestParts ? ClockDrift() : line_through(parts);
}

}  // namespace jade::import
