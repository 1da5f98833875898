// SPDX-License-Identifier: Apache-2.0
#include "jade/data/event_flip.h"

#include "support/catch.h"

#include <algorithm>
#include <set>
#include <torch/types.h>
#include <utility>
#include <vector>

namespace jade::data {
namespace {

/// The place of an event at (2, 0) of a frame of 10x10 without the flip.
std::pair<int, int> place_of(const EventFlip& flip) {
  const auto events = flip.undone(events::EventStream::from_lists({2}, {0}, {7}, {1}), {10, 10});
  return {events.x().item<int>(), events.y().item<int>()};
}

TEST_CASE("flips: each one is undone, also by its cure", "[data]") {
  using Place = std::pair<int, int>;
  CHECK(place_of({false, true, false}) == Place{2, 9});
  CHECK(place_of({true, true, false}) == Place{7, 9});
  CHECK(place_of({false, false, false, true}) == Place{0, 2});
  // The event at the top belongs at the left of a frame without the turn.
  CHECK(place_of({true, false, false, true}) == Place{0, 7});
  CHECK_THAT(EventFlip({true, false, false, true}).name(), Catch::EndsWith("degrees clockwise"));
  CHECK(EventFlip({true, false, false, true}).cure({10, 10}) == "replace x by y and y by 9 - x");
  CHECK(place_of({false, true, false, true}) == Place{9, 2});
  CHECK(EventFlip({false, true, false, true}).cure({10, 10}) == "replace x by 9 - y and y by x");
  CHECK(place_of({true, true, false, true}) == Place{9, 7});
}

TEST_CASE("flips: a square sensor can have each symmetry once, another one no exchange", "[data]") {
  const auto of_polarity = [](const EventFlip& flip) { return flip.polarity; };
  std::set<std::pair<int, int>> places{{2, 0}};
  for (const EventFlip& flip : event_flips({10, 10})) places.insert(place_of(flip));
  CHECK(places.size() == 8);
  CHECK(event_flips({10, 10}).size() == 8);
  const std::vector<EventFlip> others = event_flips({10, 12});
  CHECK(others.size() == 4);
  CHECK(std::count_if(others.begin(), others.end(), of_polarity) == 1);
}

}  // namespace
}  // namespace jade::data
