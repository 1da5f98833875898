// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_cameras.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/geometry/alignment.h"
#include "jade/geometry/se3.h"
#include "jade/run/learned_cameras.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// A data set whose poses are learned, by twists that a test sets.
struct LivePoses {
  const test::TinyScene scene;
  data::Dataset data = data::load_dataset(test::tiny_options(scene).dataset);
  std::shared_ptr<train::ExposurePoses> poses;

  LivePoses() {
    train::PoseOptions options;
    options.optimize = train::PosePath::kLinear;
    poses = train::make_exposure_poses(options, data);
  }
  void turn_all(double radians) const {
    const torch::NoGradGuard no_grad;
    torch::Tensor twists = poses->twists();
    twists.zero_();
    twists.select(2, 3).fill_(radians);
  }
};

double apart(const geometry::Pose& a, const geometry::Pose& b) {
  return (geometry::to_tensor(a) - geometry::to_tensor(b)).abs().max().item<double>();
}

}  // namespace

TEST_CASE("live cameras: exposures stand where training has them when they are asked for",
          "[run]") {
  const LivePoses learned;
  run::LiveCameras cameras(learned.data, learned.poses);
  CHECK(cameras.are_learned());
  cameras.update("train.1");
  CHECK(apart(cameras.dataset().train[1].poses[2], learned.data.train[1].poses[2]) < 1e-6);
  learned.turn_all(0.02);
  cameras.update("train.1");
  const torch::Tensor path = run::learned_path(*learned.poses, 1, learned.data.train[1]);
  for (int64_t k = 0; k < 9; ++k) {
    const auto now = cameras.dataset().train[1].poses[static_cast<size_t>(k)];
    CHECK((geometry::to_tensor(now) - path[k]).abs().max().item<double>() < 1e-6);
    CHECK(apart(now, learned.data.train[1].poses[static_cast<size_t>(k)]) > 5e-3);
  }
  CHECK(apart(cameras.dataset().train[0].poses[4], learned.data.train[0].poses[4]) == 0);
  for (const char* none : {"train.9", "test.9", "train.", "train.-1", "train.1x", "", "other.0"}) {
    CHECK_NOTHROW(cameras.update(none));
  }
}

TEST_CASE("live cameras: test views move with the exposures, from where they were fitted last",
          "[run]") {
  const LivePoses learned;
  run::LiveCameras cameras(learned.data, learned.poses);
  learned.turn_all(0.02);
  cameras.update("test.1");
  std::vector<geometry::Pose> before, after;
  for (size_t i = 0; i < learned.data.train.size(); ++i) {
    const auto path =
        run::learned_path(*learned.poses, static_cast<int64_t>(i), learned.data.train[i]);
    before.push_back(learned.data.train[i].poses[geometry::kMidPose]);
    after.push_back(geometry::pose_from_tensor(path[geometry::kMidPose]));
  }
  const geometry::Pose moved =
      geometry::moved(learned.data.test[1].pose, geometry::align_cameras(before, after));
  CHECK(apart(cameras.dataset().test[1].pose, moved) < 1e-6);
  CHECK(apart(moved, learned.data.test[1].pose) > 5e-3);

  // Views stay where they were fitted if the exposures have not moved since.
  data::Dataset fitted = learned.data;
  for (size_t i = 0; i < after.size(); ++i) fitted.train[i].poses[geometry::kMidPose] = after[i];
  fitted.test[1].pose.translation[0] += 0.25;
  cameras.refit(fitted);
  cameras.update("test.1");
  CHECK(apart(cameras.dataset().test[1].pose, fitted.test[1].pose) < 1e-6);
}

TEST_CASE("live cameras: without learned poses they stand where the data have them", "[run]") {
  const LivePoses given;
  run::LiveCameras cameras(given.data, nullptr);
  CHECK_FALSE(cameras.are_learned());
  cameras.update_all();
  CHECK(apart(cameras.dataset().train[2].poses[0], given.data.train[2].poses[0]) == 0);
  CHECK(apart(cameras.dataset().test[0].pose, given.data.test[0].pose) == 0);
}
