// SPDX-License-Identifier: Apache-2.0
#include "jade/import/findings.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/median.h"
#include "jade/core/progress.h"
#include "jade/data/threshold_estimate.h"
#include "jade/events/pixels.h"
#include "jade/imaging/range.h"
#include "jade/import/blur_length.h"
#include "jade/import/clock_offset.h"
#include "jade/import/exposure_length.h"
#include "jade/import/flipped_events.h"
#include "jade/import/frame_gains.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr char kClockFile[] = "clock.json", kSensorFile[] = "sensor.json";
constexpr double kSmallestOffsetMs = 2;
/// Slower motion is dominated by noise.
constexpr double kSlow_px = 2;

double rounded(double value, double unit) { return std::round(value / unit) * unit; }

template <class Read>
auto read_json(const fs::path& file, const Read& read) {
  try {
    return read(Json::parse(read_file(file)));
  } catch (const nlohmann::json::exception& error) {
    throw DataError(concat(file.string(), ": expected what jade_import wrote, found ", error.what(),
                           "; make it again with --from ", file.parent_path().filename().string()));
  }
}

events::EventStream without(const std::vector<HotPixel>& pixels, const Capture& capture) {
  if (pixels.empty()) return capture.events;
  torch::Tensor others = torch::ones({capture.sensor.height, capture.sensor.width}, torch::kBool);
  for (const HotPixel& pixel : pixels) others[pixel.row][pixel.column] = false;
  return capture.events.select(events::kept_by(others, capture.events));
}

/// Frames as seen behind a filter: all channels become that of the pixel.
void filter_frames(ColorFilter filter, Capture& capture) {
  const int64_t height = capture.height(), width = capture.width();
  torch::Tensor channel = torch::empty({1, height, width}, torch::kInt64);
  for (int64_t place = 0; place < 4; ++place) {
    channel.slice(1, place / 2, {}, 2)
        .slice(2, place % 2, {}, 2)
        .fill_(channel_of(filter, place / 2, place % 2));
  }
  for (Shot& shot : capture.shots) {
    shot.image = shot.image.gather(0, channel).expand({3, height, width}).contiguous();
  }
}

/// The filter applies to the frames' own pixels.
ColorFilter filter_of(const Capture& capture) {
  if (capture.sensor.height != capture.height() || capture.sensor.width != capture.width()) {
    return ColorFilter::kNone;
  }
  return find_event_filter(exposures_of(capture), capture.events).filter;
}

void warn_of_mosaics(const Capture& capture) {
  const auto count = std::count_if(capture.shots.begin(), capture.shots.end(),
                                   [](const Shot& shot) { return imaging::is_mosaic(shot.image); });
  if (2 * count < int64_t(capture.shots.size())) return;
  log_warn(concat(capture.source,
                  ": its frames look like the raw mosaic of a colour sensor; make colour frames of "
                  "them and give these with --frames"));
}

std::string said_of(const events::Thresholds& thresholds, const std::string& source) {
  return concat("thresholds ", rounded(thresholds.positive, 1e-3), " and ",
                rounded(thresholds.negative, 1e-3), " (", source, ")");
}

std::vector<double> gains_of(const Capture& capture) {
  std::vector<data::Exposure> exposures;
  for (const Shot& shot : capture.shots) exposures.push_back(exposure_of(shot, capture));
  return estimate_frame_gains(exposures, capture.events);
}

/// Names single frames of another brightness; describes the gains of a camera that adjusts itself.
std::string said_of_gains(const std::vector<double>& gains, const Capture& capture) {
  if (gains.empty()) return "";
  size_t odd = 0;
  std::string names;
  for (size_t i = 0; i < gains.size(); ++i) {
    if (gains[i] == 1) continue;
    names += concat(odd++ == 0 ? "" : ", ", capture.shots[i].name, " ", rounded(gains[i], 0.01));
  }
  if (2 * odd < gains.size()) {
    log_warn(concat(capture.source, ": expected frames of steady brightness, found ", odd, " of ",
                    gains.size(), " unlike the frames beside them (times as bright: ", names,
                    "); if they are damaged, remove them"));
    return "";
  }
  const auto [lowest, highest] = std::minmax_element(gains.begin(), gains.end());
  return concat("gain from ", rounded(*lowest, 0.01), " to ", rounded(*highest, 0.01),
                " as the camera adjusts itself, ");
}

/// Frames with unknown exposures count as instantaneous.
std::string flip_of(const Capture& capture, const events::EventStream& events) {
  std::vector<data::Exposure> exposures;
  for (const Shot& shot : capture.shots) exposures.push_back(exposure_of(shot, capture));
  return find_flip(exposures, events, estimate_clock_offset(exposures, events).correlation);
}

}  // namespace

Capture without_hot_pixels(const Capture& capture) {
  Capture cleaned = capture;
  cleaned.events = without(find_hot_pixels(capture.events, capture.sensor), capture);
  return cleaned;
}

namespace {

/// The fault of clocks that run at different rates; empty otherwise.
std::string drift_of(const std::vector<data::Exposure>& exposures,
                     const events::EventStream& events) {
  const ClockDrift drift = estimate_clock_drift(exposures, events);
  if (!drift.found) return "";
  return concat("expected clocks of frames and events at one rate, found events ahead by ",
                rounded(drift.begin_us / 1000, 0.1), " ms near the beginning and by ",
                rounded(drift.end_us / 1000, 0.1),
                " ms later, so that no single offset fits; divide the times since the first event ",
                "by ", rounded(1 + drift.rate, 1e-5), " and import again");
}

}  // namespace

ClockFinding find_clock(const TimeOptions& options, const Capture& capture, bool frames_apart) {
  if (options.offset_ms != 0) return {options.offset_ms, "as given", {}};
  if (!options.find_offset) return {0, "as given", {}};
  // A single pixel that fires all the time can outweigh all moving ones.
  const std::vector<data::Exposure> exposures = exposures_of(capture);
  const events::EventStream events =
      without(find_hot_pixels(capture.events, capture.sensor), capture);
  const ClockOffset found = estimate_clock_offset(exposures, events);
  const std::string flip = find_flip(exposures, events, found.correlation);
  if (!flip.empty()) {
    if (frames_apart) throw DataError(concat(capture.source, ": ", flip));
    log_warn(concat(capture.source, ": ", flip));
    return {0, "assumed to be one clock, as events are flipped", found.curve};
  }
  const std::string drift = drift_of(exposures, events);
  if (!drift.empty()) {
    const std::string fault = concat(capture.source, ": ", drift);
    if (found.ambiguous() && frames_apart) throw DataError(fault);
    log_warn(fault);
  }
  if (found.ambiguous() && !drift.empty()) {
    return {0, "assumed to be one clock, although the rates differ", found.curve};
  }
  const double reach_ms = ClockOffsetOptions().reach_ms;
  const std::string sought =
      concat("; offsets from ", -reach_ms, " to ", reach_ms, " ms were searched");
  if (found.ambiguous() && frames_apart) {
    throw DataError(concat(capture.source,
                           ": the offset between the clocks of frames and events is not "
                           "certain: ",
                           found.doubt, sought,
                           ": give it with --offset-ms, or --set time.find_offset=false for clocks "
                           "that are one"));
  }
  if (found.ambiguous()) {
    log_warn(concat(capture.source,
                    ": frames and events do not determine the offset between their clocks (",
                    found.doubt, sought,
                    "); assumed to be one clock, give it with --offset-ms if they are "
                    "two"));
    return {0, "assumed to be one clock, as frames and events do not say", found.curve};
  }
  const double offset_ms = found.offset_us / 1000, error_ms = found.error_us / 1000;
  const std::string measured =
      concat(rounded(offset_ms, 0.1), " +- ", rounded(error_ms, 0.1), " ms found, correlation ",
             rounded(found.correlation, 0.01), drift.empty() ? "" : ", although the rates differ");
  if (std::abs(offset_ms) < std::max(kSmallestOffsetMs, 3 * error_ms)) {
    return {0, concat(measured, ", which is one clock"), found.curve};
  }
  return {rounded(offset_ms, 1e-3), measured, found.curve};
}

bool lacks_exposures(const Capture& capture) {
  return std::all_of(capture.shots.begin(), capture.shots.end(),
                     [](const Shot& shot) { return shot.duration_us() == 0; });
}

ExposureFinding find_exposures(const Capture& capture, std::optional<recording::Stamp> stamp) {
  std::vector<StampedFrame> frames;
  for (const Shot& shot : capture.shots) frames.push_back({shot.image, shot.t_start_us});
  const events::EventStream events =
      without(find_hot_pixels(capture.events, capture.sensor), capture);
  const ExposureLength found = estimate_exposure_length(frames, events, stamp);
  if (found.ambiguous()) {
    const std::string flip = flip_of(capture, events);
    if (!flip.empty()) throw DataError(concat(capture.source, ": ", flip));
    throw DataError(concat(capture.source,
                           ": expected exposures with a length, found frames with one time each, "
                           "and frames and events do not tell the length: ",
                           found.doubt, "; give --exposure-ms or a list with --frame-times"));
  }
  ExposureFinding finding{found.length_us,  found.stamp, found.error_us, "",
                          found.lengths_us, found.losses};
  const std::string error =
      found.error_us > 0 ? concat(" +- ", rounded(found.error_us / 1000, 0.1)) : std::string();
  finding.said = concat("exposures of ", rounded(double(found.length_us) / 1000, 0.1), error,
                        " ms found, stamped at their ", word_of(found.stamp));
  std::vector<double> blur;
  for (const StampedFrame& frame : frames) {
    const auto exposure = recording::exposure_at(frame.t_us, found.length_us, found.stamp);
    blur.push_back(blur_px(events, exposure, capture.sensor));
  }
  const double usual = median_of(std::move(blur));
  if (usual < kSlow_px) {
    log_warn(concat(capture.source,
                    ": expected some px of blur to measure the length of exposures by, found ",
                    rounded(usual, 0.1), "; ", rounded(double(found.length_us) / 1000, 0.1), error,
                    " ms is doubtful, give --exposure-ms if the length is known"));
    finding.said += ", doubtful for want of blur";
  }
  return finding;
}

void set_exposures(const ExposureFinding& finding, Capture& capture) {
  if (finding.length_us == 0) return;
  for (Shot& shot : capture.shots) {
    const events::TimeWindow window =
        recording::exposure_at(shot.t_start_us, finding.length_us, finding.stamp);
    shot.t_start_us = window.begin_us, shot.t_end_us = window.end_us;
  }
}

namespace {

/// Whether at least half of an exposure has no events, although the usual rate would give dozens:
/// the recording lost them. Even a static camera has some noise.
bool lacks_events(const events::TimeWindow& exposure, const events::EventStream& events,
                  double usual_rate) {
  constexpr double kFewest = 20;
  const double half_us = 0.5 * double(exposure.duration_us());
  if (usual_rate * half_us < kFewest) return false;
  const events::EventStream own = events.slice(exposure);
  const int64_t* const t = own.t_us().const_data_ptr<int64_t>();
  int64_t before_us = exposure.begin_us;
  for (int64_t i = 0; i < own.size(); before_us = t[i++]) {
    if (double(t[i] - before_us) >= half_us) return true;
  }
  return double(exposure.end_us - before_us) >= half_us;
}

}  // namespace

std::vector<double> find_blur(const Capture& capture) {
  std::vector<double> blur;
  std::vector<int64_t> counts;
  Progress progress("measuring blur", int64_t(capture.shots.size()), 0, "frames");
  for (const Shot& shot : capture.shots) {
    throw_if_interrupted();
    const events::TimeWindow exposure{shot.t_start_us, shot.t_end_us};
    counts.push_back(capture.events.slice(exposure).size());
    blur.push_back(blur_px(capture.events, exposure, capture.sensor));
    if (progress.step()) progress.show(shot.name);
  }
  std::vector<int64_t> ordered = counts;
  std::sort(ordered.begin(), ordered.end());
  const int64_t many = ordered.empty() ? 0 : ordered[3 * ordered.size() / 4] / 2;
  std::vector<double> rates;
  for (size_t i = 0; i < blur.size(); ++i) {
    const int64_t length_us = capture.shots[i].duration_us();
    // If the stream ended early, most exposures have no events.
    if (length_us > 0 && counts[i] > 0) rates.push_back(double(counts[i]) / double(length_us));
  }
  const double usual_rate = median_of(std::move(rates));
  for (size_t i = 0; i < blur.size(); ++i) {
    const Shot& shot = capture.shots[i];
    const bool hidden = counts[i] > many && blur[i] < kSlow_px;
    if (hidden || lacks_events({shot.t_start_us, shot.t_end_us}, capture.events, usual_rate))
      blur[i] = -1;
  }
  return blur;
}

/// Warns if hot pixels have so many of the events that most cannot be defects.
void warn_of_many(const std::vector<HotPixel>& pixels, const Capture& capture) {
  constexpr double kMany = 0.2;  // of all events
  const int64_t all = capture.events.size(), lost = all - without(pixels, capture).size();
  if (double(lost) <= kMany * double(all)) return;
  log_warn(concat(capture.source, ": ", lost, " of ", all, " events come from ", pixels.size(),
                  " hot pixels and are left out; --set sensor.remove_hot_pixels=false keeps them"));
}

SensorFinding find_sensor(const SensorOptions& options, const events::EventOptions& events,
                          const Capture& capture, const Align& align) {
  SensorFinding finding;
  if (options.remove_hot_pixels)
    finding.hot_pixels = find_hot_pixels(capture.events, capture.sensor);
  warn_of_many(finding.hot_pixels, capture);
  finding.said = concat(finding.hot_pixels.size(), " hot pixels removed, ");
  warn_of_mosaics(capture);
  Capture cleaned = capture;
  clean(finding, cleaned);
  if (align) align(cleaned);
  finding.blur_px = find_blur(cleaned);
  const double blur = median_of(finding.blur_px);
  finding.said += blur < 0 ? "blur not known, as events follow no motion, "
                           : concat("median blur ", rounded(blur, 0.1), " px, ");
  finding.filter = filter_of(cleaned);
  if (finding.filter != ColorFilter::kNone) {
    finding.said += concat("events through a ", word_of(finding.filter), " filter, ");
  }
  finding.gains = gains_of(cleaned);
  finding.said += said_of_gains(finding.gains, cleaned);
  finding.thresholds = events.thresholds();
  if (!events.threshold_positive.is_auto() || !options.find_thresholds) {
    finding.said += said_of(finding.thresholds, "given");
    return finding;
  }
  if (finding.filter != ColorFilter::kNone) filter_frames(finding.filter, cleaned);
  const data::ThresholdEstimate estimate =
      data::estimate_thresholds(exposures_of(cleaned), cleaned.events, 0);
  if (estimate.found) {
    finding.thresholds = estimate.thresholds;
    if (events.threshold_negative > 0) finding.thresholds.negative = events.threshold_negative;
  } else {
    log_warn(concat(capture.source,
                    ": frames and events do not tell the contrast thresholds; taken for ",
                    finding.thresholds.positive,
                    ", give them with --threshold-positive and "
                    "--threshold-negative"));
  }
  finding.said +=
      said_of(finding.thresholds,
              estimate.found ? concat("found, +- ", rounded(estimate.standard_error.positive, 1e-3),
                                      " and ", rounded(estimate.standard_error.negative, 1e-3))
                             : "default");
  return finding;
}

void clean(const SensorFinding& finding, Capture& capture) {
  capture.events = without(finding.hot_pixels, capture);
  capture.filter = finding.filter;
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    if (finding.blur_px.size() == capture.shots.size())
      capture.shots[i].blur_px = finding.blur_px[i];
    if (finding.gains.size() == capture.shots.size()) capture.shots[i].gain = finding.gains[i];
  }
}

void keep(const fs::path& folder, const ClockFinding& finding, const ExposureFinding& exposures) {
  const double reach_ms = ClockOffsetOptions().reach_ms;
  Json all{
      {"offset_ms", finding.offset_ms},
      {"said", finding.said},
      {"curve", {{"from_ms", -reach_ms}, {"to_ms", reach_ms}, {"correlation", finding.curve}}}};
  if (exposures.length_us > 0) {
    all["exposure"] = {
        {"length_us", exposures.length_us},
        {"stamp", word_of(exposures.stamp)},
        {"standard_error_us", exposures.error_us},
        {"said", exposures.said},
        {"curve", {{"length_us", exposures.lengths_us}, {"loss", exposures.losses}}}};
  }
  write_file(folder / kClockFile, all.dump(1) + "\n");
}

void keep(const fs::path& folder, const SensorFinding& finding) {
  Json pixels = Json::array();
  for (const HotPixel& p : finding.hot_pixels) {
    pixels.push_back({{"row", p.row},
                      {"column", p.column},
                      {"rate_hz", p.rate_hz},
                      {"neighbours_hz", p.neighbours_hz}});
  }
  const Json all{{"threshold_positive", finding.thresholds.positive},
                 {"threshold_negative", finding.thresholds.negative},
                 {"filter", word_of(finding.filter)},
                 {"said", finding.said},
                 {"blur_px", finding.blur_px},
                 {"gains", finding.gains},
                 {"hot_pixels", std::move(pixels)}};
  write_file(folder / kSensorFile, all.dump(1) + "\n");
}

ClockFinding load_clock(const fs::path& folder) {
  return read_json(folder / kClockFile, [](const Json& json) {
    ClockFinding finding{json.at("offset_ms"), json.at("said"), {}};
    if (json.contains("curve")) json["curve"].at("correlation").get_to(finding.curve);
    return finding;
  });
}

ExposureFinding load_exposures(const fs::path& folder) {
  return read_json(folder / kClockFile, [](const Json& json) {
    ExposureFinding finding;
    if (!json.contains("exposure")) return finding;
    const Json& kept = json["exposure"];
    finding.length_us = kept.at("length_us");
    finding.stamp = value_of<recording::Stamp>(kept.at("stamp").get<std::string>())
                        .value_or(recording::Stamp::kMiddle);
    finding.error_us = kept.at("standard_error_us");
    finding.said = kept.at("said");
    kept.at("curve").at("length_us").get_to(finding.lengths_us);
    kept.at("curve").at("loss").get_to(finding.losses);
    return finding;
  });
}

SensorFinding load_sensor(const fs::path& folder) {
  return read_json(folder / kSensorFile, [](const Json& json) {
    SensorFinding finding;
    finding.thresholds = {json.at("threshold_positive"), json.at("threshold_negative")};
    finding.filter =
        value_of<ColorFilter>(json.at("filter").get<std::string>()).value_or(ColorFilter::kNone);
    finding.said = json.at("said");
    json.at("blur_px").get_to(finding.blur_px);
    if (json.contains("gains")) json["gains"].get_to(finding.gains);
    for (const Json& p : json.at("hot_pixels")) {
      finding.hot_pixels.push_back(
          {p.at("row"), p.at("column"), p.at("rate_hz"), p.at("neighbours_hz")});
    }
    return finding;
  });
}

}  // namespace jade::import
