// SPDX-License-Identifier: Apache-2.0
// Recognises units of time stamps and converts them to whole microseconds.
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

/// Whole numbers above this are ns: as ns they begin in 1973, as µs in the year 5138.
constexpr double kOnlyNs = 1e17;

/// Exposures beside an event sensor are shorter than this.
constexpr double kLongestExposureUs = 1e7;

/// Whether frames of this median exposure and period are too slow for a frame camera beside an
/// event sensor: more than 10 s, or half a second at one frame in 10 s. Times in ns that are read
/// as µs look like this.
bool is_too_slow(double length_us, double period_us);

/// The unit of a word: "ms", "msec", "Milliseconds". No value for other words.
std::optional<TimeUnit> unit_of_word(std::string word);

/// Microseconds in one `unit`: 1e-3, 1, 1e3 or 1e6. @throws ContractError for kAuto.
double us_per_unit(TimeUnit unit);

/// The unit of event times from `first` to `last` as stored in a file: the one in which they cover
/// most of the exposures and, with less weight, in which both spans have similar lengths. It is
/// found if events cover a fifth of the exposures, or last up to a hundred times as long. Without
/// exposures: µs for whole numbers and seconds for numbers with a fraction. Whole numbers above
/// kOnlyNs are ns. Times are ms if in ms they cover the exposures, and hardly any in another unit;
/// without exposures ms needs a name, an attribute or the user's setting.
/// No value if the recording overlaps the exposures in no unit.
std::optional<TimeUnit> guess_time_unit(double first, double last, bool has_fraction,
                                        const std::optional<TimeWindow>& exposures);

/// The unit, other than `unit`, in which events last about as long as the exposures, as they do if
/// only the zeros of the two clocks differ. No value if in `unit` (kAuto: in none) they last
/// between a hundredth and 100 times as long.
std::optional<TimeUnit> unit_by_length(double first, double last, TimeUnit unit,
                                       const TimeWindow& exposures);

/// The unit of event times beside frames that may have another clock: as guess_time_unit() without
/// exposures, unless the events cover the frames in another unit only, in which `count` of them
/// have the rate of a camera, and have another rate in the usual unit.
TimeUnit unit_beside_frames(double first, double last, bool has_fraction, int64_t count,
                            const TimeWindow& frames);

/// The unit of exposure times: the one in which the median non-zero length is between 10 µs and 5
/// s, tried in the order µs, ns, s; µs not if is_too_slow(). Seconds must be floating point. If no
/// exposure has a length, floating point means seconds, unless no time has a fraction and times are
/// more than 1000 apart on average: then µs. Whole numbers above kOnlyNs are ns. Times are ms if
/// three frames or more are ordinary in ms, and implausible otherwise: more than 5,000 per second,
/// or longer than 0.5 s at one in 10 s or fewer.
/// @param start,end  [N] of one integer or floating type
/// @param mend  what to do about exposures of no plausible length, for the message
/// @throws DataError beginning with `name` for those.
TimeUnit guess_exposure_unit(const torch::Tensor& start, const torch::Tensor& end,
                             const std::string& name, const std::string& mend);

/// Converts times of any integer or floating type from `unit`, which is not kAuto, to µs, rounded.
/// @throws DataError unless they are one list of finite values.
std::vector<int64_t> times_us(const torch::Tensor& times, TimeUnit unit, const std::string& name);

}  // namespace jade::events
