// SPDX-License-Identifier: Apache-2.0
#include "jade/import/capture.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

import::Capture small_capture(){import::Capture capture;
capture.source = "table.zip";
capture.format = "folder of frames and events";
for (int64_t i = 0; i < 3; ++i) {
  const auto image = torch::randint(0, 256, {3, 6, 8}).to(torch::kFloat32) / 255;
  const auto blur_px = 0.5 * static_cast<double>(i);
  capture.shots.push_back({concat("frame_", i), image, 1000 * i, 1000 * i + 700, blur_px});
}
capture.events = events::EventStream::from_lists({1, 2.5f}, {3, 4}, {-5, 900}, {1, -1});
capture.camera = geometry::Intrinsics::centred(7.25, 8, 6);
capture.filter = import::ColorFilter::kGbrg;
capture.event_map = torch::rand({2, 4, 5});
return capture;
}  // namespace

}  // namespace

TEST_CASE("capture: what is kept is restored", "[import]") {
  const test::TempDir dir;
  const import::Capture kept = small_capture();
  import::keep_capture(dir.path(), kept);
  const import::Capture found = import::load_capture(dir.path());
  CHECK(found.source == kept.source);
  CHECK(found.format == kept.format);
  CHECK(found.camera == kept.camera);
  CHECK((found.filter == import::ColorFilter::kGbrg));
  CHECK(torch::equal(found.event_map, kept.event_map));
  REQUIRE(found.shots.size() == 3);
  for (size_t i = 0; i < 3; ++i) {
    CHECK(found.shots[i].name == kept.shots[i].name);
    CHECK(found.shots[i].t_start_us == kept.shots[i].t_start_us);
    CHECK(found.shots[i].t_end_us == kept.shots[i].t_end_us);
    CHECK(found.shots[i].blur_px == kept.shots[i].blur_px);
    CHECK(torch::allclose(found.shots[i].image, kept.shots[i].image, 0, 1e-6));
  }
  CHECK(torch::equal(found.events.x(), kept.events.x()));
  CHECK(torch::equal(found.events.t_us(), kept.events.t_us()));
  CHECK(torch::equal(found.events.polarity(), kept.events.polarity()));
}

TEST_CASE("capture: names that are no UTF-8 are kept as far as they are", "[import]") {
  const test::TempDir dir;
  import::Capture capture = small_capture();
  capture.shots[1].name =
      "Stra\xDF"
      "e";
  import::keep_capture(dir.path(), capture);
  CHECK(import::load_capture(dir.path()).shots[1].name ==
        "Stra\xEF\xBF\xBD"
        "e");
}

TEST_CASE("capture: a damaged list is named", "[import]") {
  const test::TempDir dir;
  import::keep_capture(dir.path(), small_capture());
  write_file(dir / "capture.json", "{\"source\": 3}");
  CHECK_THROWS_NAMING(DataError, import::load_capture(dir.path()), "capture.json");
}
