// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "jade/events/event_stream.h"

namespace jade::data {

/// A convention of events that differs from the frames': axes or the polarity.
struct EventFlip {
  bool x = false, y = false, polarity = false;
  /// On square sensors: x and y are exchanged, after the flips of x and y are undone. Together with
  /// one of these, the events lie turned by 90 degrees.
  bool exchange = false;

  /// The events with this flip undone.
  /// @param size  of the frames, whose pixels the coordinates are in; square for `exchange`
  events::EventStream undone(const events::EventStream& events,
                             const events::ImageSize& size) const;
  /// A predicate for messages, such as "lie upside down".
  std::string name() const;
  /// The edit that undoes this flip: "replace y by 179 - y", for example.
  std::string cure(const events::ImageSize& size) const;
};

/// The flips that recordings with frames of this size can have. Exchanged axes of other than square
/// sensors leave the frame, and are found by that.
std::vector<EventFlip> event_flips(const events::ImageSize& size);

}  // namespace jade::data
