// SPDX-License-Identifier: Apache-2.0
#include "jade/data/trained_frames.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <map>
#include <torch/types.h>
#include <utility>

#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {
namespace {

std::string sha256_of(const torch::Tensor& image) {
  const torch::Tensor pixels = image.contiguous();
  Sha256 digest;
  digest.update(pixels.const_data_ptr(), pixels.nbytes());
  return digest.hex();
}

/// The names of frames of any kind with the given images, if `trained` lists them.
class Lookup {
 public:
  explicit Lookup(const std::vector<TrainedFrame>& trained) {
    for (const TrainedFrame& frame : trained) known_[frame.name] = frame.sha256;
  }
  bool has(const std::string& name, const torch::Tensor& image) const {
    const auto found = known_.find(name);
    return found != known_.end() && found->second == sha256_of(image);
  }

 private:
  std::map<std::string, std::string> known_;
};

/// An exposure with the image and the place of a sharp view.
Exposure as_exposure(const SharpView& view) {
  Exposure exposure;
  exposure.name = view.name;
  exposure.poses.fill(view.pose);
  exposure.t_start_us = exposure.t_end_us = view.t_us;
  return exposure;
}

}  // namespace

std::vector<TrainedFrame> trained_frames(const Dataset& dataset) {
  std::vector<TrainedFrame> frames(dataset.train.size());
  at::parallel_for(0, int64_t(frames.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const Exposure& exposure = dataset.train[size_t(i)];
      frames[size_t(i)] = {exposure.name, sha256_of(exposure.blurry)};
    }
  });
  return frames;
}

std::vector<TrainedFrame> test_views(const Dataset& dataset) {
  std::vector<TrainedFrame> views;
  for (const SharpView& view : dataset.test) {
    Sha256 digest;
    const torch::Tensor pixels = view.image.contiguous();
    digest.update(pixels.const_data_ptr(), pixels.nbytes());
    const geometry::Pose& pose = view.pose;
    digest.update(pose.rotation.data(), sizeof(pose.rotation));
    digest.update(pose.translation.data(), sizeof(pose.translation));
    views.push_back({view.name, digest.hex()});
  }
  return views;
}

std::string mark_seen(const std::vector<TrainedFrame>& trained, Dataset& dataset) {
  const Lookup lookup(trained);
  const auto is_trained = [&](const Exposure& exposure) {
    return lookup.has(exposure.name, exposure.blurry);
  };
  Dataset as_trained = dataset;
  as_trained.train.clear();
  std::vector<std::string> scored;
  for (const Exposure& exposure : dataset.train) {
    if (is_trained(exposure)) as_trained.train.push_back(exposure);
  }
  const size_t untrained = dataset.train.size() - as_trained.train.size();
  for (const Exposure& exposure : dataset.held_out) {
    if (!is_trained(exposure)) continue;
    as_trained.train.push_back(exposure);
    scored.push_back(exposure.name);
  }
  std::vector<const SharpView*> seen;
  for (const SharpView& view : dataset.test) {
    if (!lookup.has(view.name, view.image)) continue;
    as_trained.train.push_back(as_exposure(view));
    scored.push_back(view.name);
    seen.push_back(&view);
  }
  if (as_trained.train.empty()) {
    return concat(dataset.root.string(),
                  ": expected frames that the run trained on, found none of ", trained.size(),
                  " with the same pixels; 'seen' means the training frames of this "
                  "data set and its settings");
  }
  for (SharpView& view : dataset.test) {
    view.seen =
        std::find(seen.begin(), seen.end(), &view) != seen.end() ? true : is_seen(as_trained, view);
  }
  if (scored.empty() && untrained == 0) return "";
  return concat(dataset.root.string(), ": expected the split with which the run trained, found ",
                scored.size(), scored.size() == 1 ? " view" : " views",
                " to score that it trained on",
                scored.empty() ? "" : " (" + listing(scored, 3) + ")", " and ", untrained,
                untrained == 1 ? " training frame" : " training frames",
                " that it did not; 'seen' means what the run trained on; score with the settings "
                "and lists of the run to compare");
}

}  // namespace jade::data
