// SPDX-License-Identifier: Apache-2.0
// A disk cache of restored views, so that a second run on the same data computes none of them.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"

namespace jade::restore {

struct RestorationCacheOptions {
  bool enabled = true;
  std::filesystem::path folder;
  int64_t max_mib = 2048;  ///< size limit of the folder, MiB; removes the least recently used
                           ///< results first. No key
};

template <class V>
void describe(V& v, RestorationCacheOptions& o) {
  v.field("enabled", o.enabled, "keep EFNet results on disk for the next run");
  v.field("folder", o.folder,
          "folder, limited to 2 GiB; empty: restorations in $JADE_CACHE, else "
          "$XDG_CACHE_HOME/jade, else "
          "~/.cache/jade");
  v.fixed("max_mib", o.max_mib);
}

/// SHA-256 over a description of a restoration and all of its inputs.
/// @param recipe  the method, its settings and the hash of its weights, as text.
/// @param inputs  shapes, types and values are hashed; on any device.
std::string restoration_key(const std::string& recipe, const std::vector<torch::Tensor>& inputs);

/// Whether the cache has a file for the key, undamaged or not. Does not create the folder.
bool is_cached(const RestorationCacheOptions& options, const std::string& key);

/// One file per image, named by its key. Files appear completely or not at all, so runs may share a
/// folder and may be killed; a damaged file is recomputed with a warning. A folder that cannot be
/// used causes a warning, not an error.
class RestorationCache {
 public:
  /// Creates the folder if the cache is enabled.
  explicit RestorationCache(const RestorationCacheOptions& options);
  ~RestorationCache();

  /// Image stored under `key`, on the CPU, in the type in which it was stored.
  /// @param key    restoration_key()
  /// @param shape  expected shape of the image
  std::optional<torch::Tensor> find(const std::string& key, torch::IntArrayRef shape);
  /// The image, for any thread: does not wait for one that is being written, does not warn, and is
  /// not counted by hits().
  std::optional<torch::Tensor> peek(const std::string& key, torch::IntArrayRef shape) const;
  /// Stores an image [C,H,W] for the next run, in half precision if it is given so, else as float,
  /// and prunes after every eighth of `max_mib`. The file is written on another thread. What this
  /// object stores in all is limited by `max_mib` too.
  void keep(const std::string& key, const torch::Tensor& image);
  /// Returns find(), else the result of `compute`, which it stores.
  torch::Tensor get(const std::string& key, torch::IntArrayRef shape,
                    const std::function<torch::Tensor()>& compute);

  /// Removes the least recently used entries until `max_mib` holds, and leftovers of killed runs.
  void prune();

  int64_t hits() const { return hits_; }
  /// Whether the next run will find all that this object was asked for.
  bool is_complete() const { return is_on_ && misses_ == kept_; }
  /// Empty if the cache is off.
  std::filesystem::path folder() const { return is_on_ ? folder_ : std::filesystem::path(); }

 private:
  void give_up(const std::string& why);
  /// Waits until the last image is on the disk.
  void finish_writing();

  std::atomic<bool> is_on_{false};
  std::filesystem::path folder_;
  int64_t max_bytes_ = 0;
  int64_t kept_bytes_ = 0;  ///< by this object
  std::string writing_key_;
  std::future<std::string> writing_;  ///< the problem, if any
  int64_t hits_ = 0, misses_ = 0;
  int64_t kept_ = 0;  ///< number of stored images
};

}  // namespace jade::restore
