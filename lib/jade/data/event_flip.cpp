// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_flip.h"

#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::data {

events::EventStream EventFlip::undone(const events::EventStream& events,
                                      const events::ImageSize& size) const {
  const torch::Tensor across = x ? double(size.width - 1) - events.x() : events.x();
  const torch::Tensor down = y ? double(size.height - 1) - events.y() : events.y();
  return {exchange ? down : across, exchange ? across : down, events.t_us(),
          polarity ? -events.polarity() : events.polarity()};
}

std::string EventFlip::name() const {
  if (polarity) return "have reversed polarity";
  if (exchange && x && y) return "have x and y exchanged and lie turned by 180 degrees";
  if (exchange && (x || y))
    return concat("lie turned by 90 degrees ", x ? "" : "anti", "clockwise");
  if (exchange) return "have x and y exchanged";
  if (x && y) return "lie turned by 180 degrees";
  return x ? "lie mirrored left to right" : "lie upside down";
}

std::string EventFlip::cure(const events::ImageSize& size) const {
  if (polarity) return "exchange the polarities";
  const std::string across = x ? concat(size.width - 1, " - x") : "x";
  const std::string down = y ? concat(size.height - 1, " - y") : "y";
  if (exchange && !x && !y) return "exchange x and y";
  if (exchange) return concat("replace x by ", down, " and y by ", across);
  return concat("replace ", x ? concat("x by ", across) : "", x && y ? " and " : "",
                y ? concat("y by ", down) : "");
}

std::vector<EventFlip> event_flips(const events::ImageSize& size) {
  std::vector<EventFlip> flips{
      {false, true, false}, {true, false, false}, {true, true, false}, {false, false, true}};
  if (size.width != size.height) return flips;
  for (const bool x : {false, true}) {
    for (const bool y : {false, true}) flips.push_back({x, y, false, true});
  }
  return flips;
}

}  // namespace jade::data
