// SPDX-License-Identifier: Apache-2.0
// Faults of whole streams of events and of lists of exposures, as one line for the user.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::events {

/// An exposure, with the name of its frame.
struct NamedWindow {
  std::string name;
  TimeWindow window;
};

/// A fault of streams with hardly any events of one polarity: in the view of a moving camera,
/// pixels get darker about as often as brighter. Empty otherwise.
std::string polarity_fault(const EventStream& events);

/// Leaves out a few events at either end that a pause longer than all the rest, and than 10 s,
/// parts from it, and returns a warning; empty if there are none.
std::string drop_strays(EventStream& events);

/// A fault of event times that lost digits: many events share each of the distinct times, half of
/// which or more are 0.5 ms or more apart. Empty otherwise.
std::string resolution_fault(const EventStream& events);

/// A fault of frame times that lost digits: those of a steady camera whose times from frame to
/// frame differ, and are all multiples of 1 ms or more and of more than a twentieth of the exposure
/// (of the period without exposures). Empty otherwise.
std::string resolution_fault(std::vector<TimeWindow> exposures);

/// Times without a single event, of 1 ms and more, between times at which they came so densely that
/// dozens were to be expected: lost packets, or a camera that stops abruptly. Pauses at whose ends
/// the events get rarer, and streams of few events, have none.
std::vector<TimeWindow> silences(const EventStream& events);

/// A fault of exposures in which silences() take 5 % of one or 2 % of all. Empty otherwise.
std::string silence_fault(const std::vector<NamedWindow>& exposures,
                          const std::vector<TimeWindow>& silences);

/// A fault of places that are no pixels of an image: between 0 and 1, or a quarter of them below 0.
/// Empty otherwise, and for fewer than 1000 events.
std::string place_fault(const EventStream& events);

/// A fault of coordinates that count from 1: no event in the first column and row of a sensor of
/// this size, and some just beyond the last ones. Empty otherwise.
std::string one_based_fault(const EventStream& events, const ImageSize& size);

struct DistinctEvents {
  EventStream events;
  int64_t copies = 0;  ///< number of removed events
  std::string fault;   ///< of copies, removed or not; empty if there are hardly any
};

/// Removes events that repeat another one (time, place and polarity) from parts of a stream that
/// hold nearly every event twice or more, as files that were joined or written twice do. Single
/// repetitions stay, because with rounded times a pixel may fire twice at once; more than 5 % are a
/// fault. Streams of fewer than 1000 events stay. CPU streams only.
DistinctEvents without_copies(const EventStream& events);

/// Median time from the begin of an exposure to that of the next. Two or more, in any order.
int64_t frame_period_us(const std::vector<NamedWindow>& exposures);

/// A fault of exposures that one sensor cannot have taken: some overlap the next by more than 5 %
/// of the frame period, which rounding cannot explain. Empty otherwise.
/// @param path  of the times, for messages
/// @throws DataError if two are the same, or if more than a tenth of them overlap.
std::string overlap_fault(const std::string& path, std::vector<NamedWindow> exposures);

/// Follows event times in the order of a file, and finds where they go back.
class ClockOrder {
 public:
  void add(int64_t t_us);

  bool sorted() const { return backwards_ == 0; }

  /// A fault of unsorted times, which the caller sorts. If they go back by more than 10 ms and stay
  /// there, names the largest such step; single damaged times are no such step. Empty for sorted
  /// times.
  std::string fault() const;

 private:
  struct Step {
    int64_t index = 0, from_us = 0, to_us = 0;
    double back_us() const { return double(from_us) - double(to_us); }
  };
  void keep(const Step& step);

  int64_t count_ = 0, backwards_ = 0, jumps_ = 0, before_us_ = 0;
  double ahead_us_ = 0;   ///< length of the last step, negative backwards
  bool is_open_ = false;  ///< whether the last step is `open_`, which the next may undo
  Step open_, largest_;
};

}  // namespace jade::events
