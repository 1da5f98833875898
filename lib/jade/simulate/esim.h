// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "jade/events/event_stream.h"
#include "jade/simulate/options.h"
#include "jade/world/noise.h"

namespace jade::simulate {

/// An event camera simulated from pictures (ESIM, Rebecq et al. 2018). Between two pictures the log
/// intensity L of a pixel is linear in time; an event of polarity s is sent whenever L reaches ref
/// + sΘ, and ref moves there, even if the refractory period suppresses the event. Additional
/// effects: thresholds that vary from pixel to pixel, a first-order low-pass, a leak that lowers
/// ref, random (shot) events that reset ref to the current L, instants at which all pixels fire and
/// reset, hot pixels, columns without events, and a latency that increases in the dark. The events
/// depend only on the seed and the pictures, not on the number of threads.
class EventSensor {
 public:
  EventSensor(const EventSensorOptions& options, int64_t width, int64_t height, uint64_t seed);

  /// Feeds the intensities [H·W] at `t_us`, later than the last; the first call only initialises.
  /// @throws ContractError for a wrong size or a time that does not increase.
  void feed(const std::vector<float>& intensity, int64_t t_us);

  int64_t event_count() const { return static_cast<int64_t>(t_us_.size()); }
  /// Returns and removes all events so far, sorted by time (ties in the order of processing, by row
  /// band and pixel).
  events::EventStream take();

  double threshold_positive(int64_t pixel) const { return on_[static_cast<size_t>(pixel)]; }
  double threshold_negative(int64_t pixel) const { return off_[static_cast<size_t>(pixel)]; }

 private:
  struct Event {
    int64_t t_us;
    int32_t pixel;
    int8_t polarity;
  };
  struct Span {
    double begin_us, end_us;
  };
  /// Burst times since the last call.
  std::vector<double> bursts_until(double end_us);
  void advance_pixel(size_t pixel, float target, float intensity, const Span& span,
                     std::vector<Event>& out);
  /// Advances a pixel through bursts.
  void advance_through(const std::vector<double>& bursts, size_t pixel, float target,
                       float intensity, Span span, std::vector<Event>& out);
  void send(size_t pixel, double t_us, float intensity, int8_t polarity, std::vector<Event>& out);
  double latency_us(float intensity) const;
  float low_pass(size_t pixel, float input, float intensity, double duration_us);
  void sort_by_time();
  void append(std::vector<std::vector<Event>>& bands);

  EventSensorOptions options_;
  int64_t width_, height_;
  bool started_ = false;
  int64_t now_us_ = 0;
  // Per pixel.
  std::vector<float> input_;       // log intensity before the low-pass
  std::vector<float> level_;       // after it
  std::vector<double> reference_;  // minus the leak since the start, which grows with time
  std::vector<float> on_, off_;
  std::vector<float> hazard_;  // expected number of events until the next random event
  std::vector<double> last_us_;
  std::vector<world::Draw> draw_;
  std::vector<uint8_t> hot_;
  std::vector<uint8_t> dead_;       // per column; empty: none
  std::vector<int64_t> latest_us_;  // time of the last event; empty: no latency
  world::Draw burst_draw_;
  double next_burst_us_ = 0;
  // Events so far.
  std::vector<float> x_, y_;
  std::vector<int64_t> t_us_;
  std::vector<int8_t> polarity_;
};

}  // namespace jade::simulate
