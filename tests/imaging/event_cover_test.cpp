// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/event_cover.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/naming.h"

using namespace jade;

namespace {

constexpr int64_t kWidth = 64, kHeight = 48;

/// Events spread over columns [left, right) and rows [top, bottom).
events::EventStream events_in(int64_t left, int64_t right, int64_t top, int64_t bottom,
                              int64_t count = 3000) {
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int64_t i = 0; i < count; ++i) {
    x.push_back(float(left + i * 7919 % (right - left)));
    y.push_back(float(top + i * 7907 / 13 % (bottom - top)));
    t.push_back(i);
    p.push_back(i % 2 == 0 ? -1 : 1);
  }
  // A hot pixel in a corner.
  for (size_t i = 0; i < 20; ++i) x[i] = float(kWidth - 1), y[i] = 0;
  return events::EventStream::from_lists(x, y, t, p);
}

}  // namespace

TEST_CASE("event cover: events in a part of a textured frame are reported", "[imaging]") {
  torch::manual_seed(3);
  const torch::Tensor image = torch::rand({3, kHeight, kWidth});
  CHECK(imaging::cover_fault(events_in(0, kWidth, 0, kHeight), image).empty());
  CHECK(imaging::cover_fault(events_in(8, 56, 0, 36), image).empty());
  CHECK_THAT(imaging::cover_fault(events_in(0, 32, 0, kHeight), image),
             test::naming("64x48", "50 % of their width", "3000 within"));
  CHECK_THAT(imaging::cover_fault(events_in(0, kWidth, 24, kHeight), image),
             test::naming("% of their height"));
  CHECK(imaging::cover_fault(events_in(0, 32, 0, 24, 900), image).empty());
  CHECK(imaging::cover_fault({}, image).empty());
}

TEST_CASE("event cover: no events are expected where the frame has no detail", "[imaging]") {
  torch::manual_seed(3);
  torch::Tensor image = torch::ones({3, kHeight, kWidth});
  image.narrow(2, 0, 32).uniform_();
  CHECK(imaging::cover_fault(events_in(0, 32, 0, kHeight), image).empty());
}
