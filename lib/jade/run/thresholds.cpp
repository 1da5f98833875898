// SPDX-License-Identifier: Apache-2.0
#include "jade/run/thresholds.h"

#include <cmath>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/version.h"

namespace jade::run {
namespace {

/// Warn about a configured threshold with a larger relative difference from the measured one.
constexpr double kDisagreement = 0.3;
/// A shift of the events by a fifth of an exposure leaves this share of the change unexplained.
constexpr double kMuchUnexplained = 0.12;

double rounded_threshold(double value) { return std::round(value * 1e4) / 1e4; }

/// The frames in the channels of the event pixels. Skips frames of another size than the first.
std::vector<data::Exposure> seen_by_events(const data::Dataset& dataset) {
  std::vector<data::Exposure> seen;
  for (const data::Exposure& exposure : dataset.train) {
    if (exposure.blurry.sizes() != dataset.train.front().blurry.sizes()) continue;
    seen.push_back(exposure);
    if (!dataset.event_color.defined()) continue;
    const torch::Tensor channel = dataset.event_color.to(torch::kFloat32);
    const torch::Tensor one = (exposure.blurry * channel).sum(0, true);
    const torch::Tensor image =
        torch::where(dataset.event_color.any(0, true), one, exposure.blurry.mean(0, true));
    seen.back().blurry = image.expand_as(exposure.blurry).contiguous();
  }
  return seen;
}

/// Converts an estimate to an entry of the cache, and back.
torch::Tensor entry_of(const data::ThresholdEstimate& e) {
  const data::EventFlip flip = e.flip.value_or(data::EventFlip{});
  return torch::tensor(
             {e.thresholds.positive, e.thresholds.negative, e.spread.positive, e.spread.negative,
              double(e.pixels), e.residual, e.unexplained, double(e.found), double(flip.x),
              double(flip.y), double(flip.polarity), double(flip.exchange)},
             torch::kFloat32)
      .reshape({1, 1, -1});
}

data::ThresholdEstimate estimate_from(const torch::Tensor& entry) {
  const auto v = entry.accessor<float, 3>()[0][0];
  data::ThresholdEstimate e;
  e.thresholds = {rounded_threshold(v[0]), rounded_threshold(v[1])};
  e.spread = {v[2], v[3]};
  e.pixels = std::llround(v[4]);
  e.residual = v[5];
  e.unexplained = v[6];
  e.found = v[7] > 0;
  const data::EventFlip flip{v[8] > 0, v[9] > 0, v[10] > 0, v[11] > 0};
  if (flip.x || flip.y || flip.polarity || flip.exchange) e.flip = flip;
  return e;
}

bool disagrees(double configured, double measured) {
  return std::abs(configured - measured) > kDisagreement * measured;
}

std::string percent_explained(const data::ThresholdEstimate& e) {
  return concat(std::lround(100 * (1 - e.unexplained)), " %");
}

}  // namespace

data::ThresholdEstimate measure_thresholds(const data::Dataset& dataset,
                                           const std::string& fingerprint, double log_offset,
                                           const restore::RestorationCacheOptions& cache) {
  const Progress progress("measuring thresholds", 1, 0, "data sets");
  return measure_quietly(dataset, fingerprint, log_offset, cache);
}

data::ThresholdEstimate measure_quietly(const data::Dataset& dataset,
                                        const std::string& fingerprint, double log_offset,
                                        const restore::RestorationCacheOptions& cache_options) {
  if (dataset.events.empty() || dataset.train.empty()) return {};
  restore::RestorationCache cache(cache_options);
  // Another version of the program may measure differently.
  const std::string recipe = concat("thresholds 3; ", version(), " ", git_commit(), "; offset ",
                                    log_offset, "; ", fingerprint);
  const torch::Tensor entry = cache.get(restore::restoration_key(recipe, {}), {1, 1, 12}, [&] {
    return entry_of(data::estimate_thresholds(seen_by_events(dataset), dataset.events, log_offset));
  });
  return estimate_from(entry);
}

std::string flip_warning(const data::Dataset& dataset, const data::ThresholdEstimate& estimate) {
  if (!estimate.flip) return "";
  const torch::Tensor& frame = dataset.train.front().blurry;
  return concat(dataset.root.string(), ": events ", estimate.flip->name(),
                " against the frames: contrast thresholds are found only when that is undone; ",
                estimate.flip->cure({frame.size(-2), frame.size(-1)}));
}

void settle_thresholds(const data::Dataset& dataset, const data::ThresholdEstimate& found,
                       train::RunOptions& options) {
  events::EventOptions& events = options.events;
  const bool automatic = events.threshold_positive.is_auto();
  const events::Thresholds configured = events.thresholds();
  const events::Thresholds& measured = found.thresholds;
  if (found.flip) log_warn(flip_warning(dataset, found));
  if (!automatic) {
    if (found.found && (disagrees(configured.positive, measured.positive) ||
                        disagrees(configured.negative, measured.negative))) {
      log_warn(concat("events.threshold_positive, events.threshold_negative: configured are ",
                      configured.positive, " and ", configured.negative, ", measured are ",
                      measured.positive, " and ", measured.negative, " (they explain ",
                      percent_explained(found), " of the change between frames); the configured ",
                      "ones are used, --set events.threshold_positive=auto --set ",
                      "events.threshold_negative=0 uses the measured ones"));
    }
    return;
  }
  if (found.found) {
    events.threshold_positive = measured.positive;
    if (events.threshold_negative == 0) events.threshold_negative = measured.negative;
    log_info(concat("thresholds  ", events.thresholds().positive, " and ",
                    events.thresholds().negative, ", measured: they explain ",
                    percent_explained(found), " of the change between frames, spread ",
                    rounded_threshold(found.spread.positive), " and ",
                    rounded_threshold(found.spread.negative), " from pixel to pixel",
                    found.unexplained > kMuchUnexplained
                        ? "; jade_inspect says whether the clocks of frames and events differ"
                        : ""));
    return;
  }
  events.threshold_positive = configured.positive;
  if (dataset.events.empty()) {
    log_info(concat("thresholds  ", configured.positive, ": without events none are measured"));
  } else {
    log_warn(concat("events.threshold_positive: frames and events do not tell the contrast ",
                    "thresholds, ", configured.positive, " and ", configured.negative,
                    " are used; set them if the sensor's are known"));
  }
}

}  // namespace jade::run
