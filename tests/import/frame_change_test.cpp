// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_change.h"

#include "support/catch.h"

using namespace jade;

namespace {

data::Exposure exposure(int64_t start_us, int64_t end_us) {
  data::Exposure out;
  out.blurry = torch::zeros({3, 2, 3});
  out.t_start_us = start_us, out.t_end_us = end_us;
  return out;
}

}  // namespace

TEST_CASE("frame change: an event counts by what of the exposures it divides", "[import]") {
  const auto a = exposure(100, 200), b = exposure(300, 400);
  CHECK(import::part_after(a, 50) == 1);
  CHECK(import::part_after(a, 150) == 0.5);
  CHECK(import::part_after(a, 250) == 0);
  CHECK(import::part_after(exposure(200, 200), 199) == 1);
  CHECK(import::part_after(exposure(200, 200), 200) == 0);
  // Before both, in the first, between, in the second, after; and outside the image.
  const auto events = events::EventStream::from_lists(
      {1, 1, 2, 0, 0, 9}, {0, 0, 1, 1, 0, 0}, {50, 125, 250, 375, 450, 460}, {1, 1, -1, 1, 1, 1});
  const auto change = import::event_change(a, b, events);
  CHECK(change[0][1].item<float>() == Approx(0.25));
  CHECK(change[1][2].item<float>() == -1);
  CHECK(change[1][0].item<float>() == Approx(0.25));
  CHECK(change.abs().sum().item<float>() == Approx(1.5));
}
