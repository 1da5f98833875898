// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "jade/events/event_stream.h"

namespace jade::data {

/// A convention of events that is the opposite of the frames': an axis or the polarity.
struct EventFlip {
  bool x = false, y = false, polarity = false;

  /// The events with this flip undone. Undoing twice gives the events again.
  /// @param size  of the frames, whose pixels the coordinates are in
  events::EventStream undone(const events::EventStream& events,
                             const events::ImageSize& size) const;
  /// A predicate for messages, such as "lie upside down".
  std::string name() const;
  /// The edit that undoes this flip: "replace y by 179 - y", for example.
  std::string cure(const events::ImageSize& size) const;
};

/// The flips that recordings have been found to have.
inline constexpr EventFlip kEventFlips[] = {
    {false, true, false}, {true, false, false}, {true, true, false}, {false, false, true}};

}  // namespace jade::data
