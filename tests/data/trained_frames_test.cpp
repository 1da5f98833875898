// SPDX-License-Identifier: Apache-2.0
#include "jade/data/trained_frames.h"

#include "support/catch.h"

#include <algorithm>

#include "data/tiny_recording.h"
#include "jade/data/dataset.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

/// Sharp views at places of their own; every fourth is a test view.
Dataset sharp_views(int64_t first_test) {
  Dataset data;
  data.near = 1;
  for (int64_t i = 0; i < 8; ++i) {
    const std::string name = concat("img_", i);
    const geometry::Pose pose = test::steady_pose(1e5 * double(i));
    if (i % 4 == first_test) {
      data.test.push_back({name, test::noise_image(i), pose, {}});
      continue;
    }
    Exposure exposure;
    exposure.name = name;
    exposure.blurry = test::noise_image(i);
    exposure.poses.fill(pose);
    data.train.push_back(exposure);
  }
  for (SharpView& view : data.test) view.seen = is_seen(data, view);
  return data;
}

TEST_CASE("trained frames: views that a run trained on are seen, whatever the split is now",
          "[data]") {
  const std::vector<TrainedFrame> trained = trained_frames(sharp_views(0));
  REQUIRE(trained.size() == 6);
  Dataset same = sharp_views(0);
  CHECK(mark_seen(trained, same).empty());
  CHECK(same.test[0].seen == false);

  Dataset now = sharp_views(1);
  CHECK(now.test[0].seen == false);
  CHECK_THAT(mark_seen(trained, now), test::naming("img_1", "img_5", "2 views", "2 training"));
  CHECK(now.test[0].seen == true);
  CHECK(now.test[1].seen == true);

  // Other frames of the same names are other views.
  Dataset other = sharp_views(1);
  for (SharpView& view : other.test) view.image = 1 - view.image;
  mark_seen(trained, other);
  CHECK(other.test[0].seen == false);
  for (Exposure& exposure : other.train) exposure.blurry = 1 - exposure.blurry;
  other.test[0].seen = true;
  CHECK_THAT(mark_seen(trained, other), test::naming("none of 6"));
  CHECK(other.test[0].seen == true);
}

TEST_CASE("trained frames: held-out exposures that a run trained on are named", "[data]") {
  const test::TempDir folder;
  write_evdeblur(folder / "scene", test::tiny_content());
  DatasetOptions options;
  options.path = folder / "scene";
  const Dataset before = load_dataset(options);
  Dataset now = before;
  now.held_out.push_back(now.train[1]);
  now.train.erase(now.train.begin() + 1);
  for (SharpView& view : now.test) view.seen = is_seen(now, view);
  CHECK(now.test[0].seen == false);
  CHECK_THAT(mark_seen(trained_frames(before), now), test::naming(before.train[1].name, "1 view"));
  CHECK(now.test[0].seen == true);
}

}  // namespace
}  // namespace jade::data
