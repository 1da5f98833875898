// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_flip.h"

#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::data {

events::EventStream EventFlip::undone(const events::EventStream& events,
                                      const events::ImageSize& size) const {
  return {x ? double(size.width - 1) - events.x() : events.x(),
          y ? double(size.height - 1) - events.y() : events.y(), events.t_us(),
          polarity ? -events.polarity() : events.polarity()};
}

std::string EventFlip::name() const {
  if (polarity) return "have reversed polarity";
  if (x && y) return "lie turned by 180 degrees";
  return x ? "lie mirrored left to right" : "lie upside down";
}

std::string EventFlip::cure(const events::ImageSize& size) const {
  if (polarity) return "exchange the polarities";
  return concat("replace ", x ? concat("x by ", size.width - 1, " - x") : "", x && y ? " and " : "",
                y ? concat("y by ", size.height - 1, " - y") : "");
}

}  // namespace jade::data
