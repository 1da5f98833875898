// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/view_restorer.h"

#include <torch/types.h>
#include <utility>

#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/version.h"
#include "jade/restore/restorations.h"

namespace jade::restore {
namespace {

/// Key of the note that all views of a data set are in the cache.
std::string note_key(const std::string& sha256, torch::Device device,
                     const std::filesystem::path& data) {
  std::error_code ignored;
  return restoration_key(
      concat("all of ", std::filesystem::weakly_canonical(data, ignored).string(), "; ", sha256,
             "; torch ", torch_version(), "; ", device.type()),
      {});
}

/// An entry of the cache is one image, so the moments are stored in its channels.
std::vector<int64_t> entry_shape(const torch::Tensor& blurry, const std::vector<double>& times) {
  return {3 * static_cast<int64_t>(times.size()), blurry.size(1), blurry.size(2)};
}

torch::Tensor by_moment(const torch::Tensor& entry) {
  return entry.view({-1, 3, entry.size(1), entry.size(2)});
}

}  // namespace

ViewRestorer::ViewRestorer(const RestorationCacheOptions& cache, std::optional<EfnetOptions> efnet,
                           torch::Device device, bool monochrome, std::future<Restorer> early)
    : cache_(cache),
      options_(std::move(efnet)),
      device_(device),
      monochrome_(monochrome),
      early_(std::move(early)) {
  if (!options_) return;
  file_sha256_ = restorer_file_sha256(*options_);
  metadata_ = read_restorer_metadata(restorer_path(*options_));
}

ViewRestorer::~ViewRestorer() { cache_.prune(); }

torch::Tensor ViewRestorer::efnet(const torch::Tensor& blurry, const torch::Tensor& events) {
  return efnet(blurry, events, {0.5})[0];
}

std::string ViewRestorer::efnet_key(const torch::Tensor& blurry, const torch::Tensor& events,
                                    const std::vector<double>& times) const {
  // Devices round differently, and a run must not depend on results that another device cached.
  const std::string recipe =
      concat("efnet ", metadata_.any_time ? 4 : 3, "; ", file_sha256_, "; torch ", torch_version(),
             "; ", device_.type(), monochrome_ ? "; without tint" : "");
  std::vector<torch::Tensor> inputs{blurry, events};
  if (metadata_.any_time || times.size() > 1) {
    inputs.push_back(torch::tensor(times, torch::kFloat64));
  }
  return restoration_key(recipe, inputs);
}

KeptEfnet ViewRestorer::kept_efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                                   const std::vector<double>& times) const {
  check_times(times);
  if (cache_.folder().empty()) return {};
  std::string key = efnet_key(blurry, events, times);
  const auto kept = cache_.peek(key, entry_shape(blurry, times));
  return {std::move(key), kept ? by_moment(*kept) : torch::Tensor()};
}

torch::Tensor ViewRestorer::efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                                  const std::vector<double>& times, std::string key) {
  check_times(times);
  if (key.empty() && !cache_.folder().empty()) key = efnet_key(blurry, events, times);
  if (const auto kept = cache_.find(key, entry_shape(blurry, times))) {
    return by_moment(*kept).to(device_);
  }
  torch::Tensor restored = network().restore(blurry.to(device_), events, times);
  if (monochrome_) restored = without_tint(restored);
  if (times.size() > 1) restored = restored.to(torch::kHalf);
  if (as_asked()) cache_.keep(key, restored.flatten(0, 1));
  return restored;
}

bool ViewRestorer::as_asked() const {
  return network_->device().type() == device_.type() && network_->tile() == 0 &&
         network_->batch() == 0;
}

const RestorerMetadata& ViewRestorer::metadata() const {
  JADE_CHECK(options_.has_value(), "expected a restorer, found none");
  return metadata_;
}

void ViewRestorer::check_times(const std::vector<double>& times) const {
  restore::check_times(restorer_path(*options_), metadata(), times);
}

void ViewRestorer::leave() {
  network_.reset();
  early_ = {};
  trim_device_memory(device_, 0);
}

void ViewRestorer::note_restored(const std::filesystem::path& data) {
  if (!options_ || !cache_.is_complete()) return;
  cache_.keep(note_key(file_sha256_, device_, data), torch::zeros({1, 1, 1}));
}

bool restored_before(const RestorationCacheOptions& cache, const std::string& sha256,
                     torch::Device device, const std::filesystem::path& data) {
  return is_cached(cache, note_key(sha256, device, data));
}

Restorer& ViewRestorer::network() {
  JADE_CHECK(options_.has_value(), "expected a restorer, found none");
  if (!network_) network_.emplace(early_.valid() ? early_.get() : Restorer(*options_, device_));
  return *network_;
}

}  // namespace jade::restore
