// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/run/deblurrer.h"
#include "jade/run/view_pictures.h"

namespace jade::run {

/// Restorations of a run for viewers: EDI, EFNet, α and fused images of its exposures. They come
/// from the cache; a missing one is restored at mid-exposure when it is first requested, on a
/// separate thread, one exposure at a time.
class RestoredPictures {
 public:
  /// Logs one line if the restorer or the allocation is unavailable; other layers still work.
  /// @param run      the run's folder
  /// @param options  load_run_options() of it
  /// @param dataset  its data; must outlive this
  /// @param device   to restore on
  RestoredPictures(const std::filesystem::path& run, const train::RunOptions& options,
                   const data::Dataset& dataset, torch::Device device);
  /// Waits for the current exposure.
  ~RestoredPictures();

  /// The layers of an exposure; call from one thread. Layers that are still being computed throw
  /// serve::NotYet when requested.
  std::vector<ViewPicture> of(int64_t index);

 private:
  /// @throws serve::NotYet; rethrows errors of the restoration.
  const Restored& restored(int64_t index);
  Restored restore(int64_t index);

  const data::Dataset& dataset_;
  bool efnet_ = false, alpha_ = false;
  std::mutex one_at_a_time_;
  bool ends_ = false;  ///< guarded by the mutex
  std::optional<Deblurrer> deblurrer_;
  std::map<int64_t, std::shared_future<Restored>> found_;
};

}  // namespace jade::run
