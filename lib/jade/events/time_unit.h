// SPDX-License-Identifier: Apache-2.0
// Units of time stamps: how they are told, and whole microseconds of them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/words.h"
#include "jade/events/event_stream.h"

namespace jade::events {

/// Unit of time stamps.
enum class TimeUnit { kAuto, kUs, kNs, kMs, kS };

constexpr auto words_of(TimeUnit) {
  return std::array{Word{"auto", TimeUnit::kAuto}, Word{"us", TimeUnit::kUs},
                    Word{"ns", TimeUnit::kNs}, Word{"ms", TimeUnit::kMs}, Word{"s", TimeUnit::kS}};
}

/// Whole numbers above this are ns: as such they begin in 1973, as µs they would be of the year
/// 5138.
constexpr double kOnlyNs = 1e17;

/// The unit that a word stands for: "ms", "msec", "Milliseconds". None for other words.
std::optional<TimeUnit> unit_of_word(std::string word);

/// Microseconds in one `unit`: 1e-3, 1, 1e3 or 1e6. @throws ContractError for kAuto.
double us_per_unit(TimeUnit unit);

/// The unit of event times from `first` to `last` as stored in a file: the one in which they cover
/// most of the exposures and, less strongly, in which both spans are alike. So it is found where
/// events cover a fifth of the exposures, or go on for a hundred times as long. Without exposures
/// µs for whole numbers and seconds for numbers with a fraction. Whole numbers above kOnlyNs are
/// ns. They are ms where in these they cover the exposures, and hardly any of them otherwise;
/// without exposures only a name, an attribute or the user says so.
/// None when the recording meets the exposures in no unit.
std::optional<TimeUnit> guess_time_unit(double first, double last, bool has_fraction,
                                        const std::optional<TimeWindow>& exposures);

/// The unit of the times of exposures: that in which the median length of those that have one is
/// between 10 µs and 5 s, tried in the order µs, ns, s; seconds are floating point, and where no
/// exposure has a length floating point is seconds, unless no time has a fraction and they lie more
/// than 1000 apart on average: these are µs. Whole numbers above kOnlyNs are ns. They are ms where
/// three frames or more are ordinary in these, and no camera takes such frames otherwise: shorter
/// than 100 µs at more than 5,000 per second, or longer than 0.5 s at one in 10 s or fewer.
/// @param start,end  [N] of one integer or floating type
/// @param mend  what to do about exposures of no plausible length, for the message
/// @throws DataError beginning with `name` for those.
TimeUnit guess_exposure_unit(const torch::Tensor& start, const torch::Tensor& end,
                             const std::string& name, const std::string& mend);

/// Times of any integer or floating type in `unit`, which is not kAuto, rounded to µs.
/// @throws DataError if they are not one list of finite values.
std::vector<int64_t> times_us(const torch::Tensor& times, TimeUnit unit, const std::string& name);

}  // namespace jade::events
