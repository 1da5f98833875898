// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_cameras.h"

#include <algorithm>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/geometry/alignment.h"
#include "jade/run/learned_cameras.h"
#include "jade/run/page_scene.h"

namespace jade::run {

LiveCameras::LiveCameras(const data::Dataset& data,
                         std::shared_ptr<const train::ExposurePoses> poses)
    : data_(data), poses_(std::move(poses)), posed_(data) {
  refit(data);
}

std::vector<geometry::Pose> LiveCameras::path(size_t exposure) const {
  const torch::Tensor learned =
      learned_path(*poses_, static_cast<int64_t>(exposure), data_.train[exposure]);
  std::vector<geometry::Pose> poses;
  for (int64_t k = 0; k < learned.size(0); ++k) {
    poses.push_back(geometry::pose_from_tensor(learned[k]));
  }
  return poses;
}

std::vector<geometry::Pose> LiveCameras::middles() const {
  std::vector<geometry::Pose> poses;
  for (size_t i = 0; i < data_.train.size(); ++i) poses.push_back(path(i)[geometry::kMidPose]);
  return poses;
}

void LiveCameras::update(const std::string& camera) {
  const std::optional<CameraOfPage> found = camera_of_page(data_, camera);
  if (!poses_ || !found) return;
  if (found->exposure) {
    const std::vector<geometry::Pose> now = path(found->index);
    std::copy(now.begin(), now.end(), posed_.train[found->index].poses.begin());
  } else {
    const geometry::Similarity drift = geometry::align_cameras(fitted_exposures_, middles());
    posed_.test[found->index].pose = geometry::moved(fitted_tests_[found->index], drift);
  }
}

void LiveCameras::update_all() {
  for (size_t i = 0; i < data_.train.size(); ++i) update(concat("train.", i));
  for (size_t i = 0; i < data_.test.size(); ++i) update(concat("test.", i));
}

void LiveCameras::refit(const data::Dataset& posed) {
  fitted_exposures_.clear();
  fitted_tests_.clear();
  for (const data::Exposure& exposure : posed.train) {
    fitted_exposures_.push_back(exposure.poses[geometry::kMidPose]);
  }
  for (const data::SharpView& view : posed.test) fitted_tests_.push_back(view.pose);
}

}  // namespace jade::run
