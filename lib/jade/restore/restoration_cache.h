// SPDX-License-Identifier: Apache-2.0
// Restorations of views on disk, so that a second run over the same data computes none of them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"

namespace jade::restore {

struct RestorationCacheOptions {
  bool enabled = true;
  std::filesystem::path folder;
  int64_t max_mib = 2048;  ///< of the folder, in MiB; the longest unused results go first. No key
};

template <class V>
void describe(V& v, RestorationCacheOptions& o) {
  v.field("enabled", o.enabled, "keep EFNet results on disk for the next run");
  v.field(
      "folder", o.folder,
      "where, at most 2 GiB; empty: restorations in $JADE_CACHE, else $XDG_CACHE_HOME/jade, else "
      "~/.cache/jade");
  v.fixed("max_mib", o.max_mib);
}

/// SHA-256 over a description of how a restoration is made and all that it is made from.
/// @param recipe  the method, its settings and the hash of its weights, as text.
/// @param inputs  shapes, types and values count; on any device.
std::string restoration_key(const std::string& recipe, const std::vector<torch::Tensor>& inputs);

/// One file per image, named by its key. Files appear whole or not at all, so runs may share a
/// folder and may be killed; one that is damaged is made again with a warning. A folder that cannot
/// be used costs a warning, never the run.
class RestorationCache {
 public:
  /// Makes the folder where it is enabled.
  explicit RestorationCache(const RestorationCacheOptions& options);

  /// Image kept under `key`, on the CPU.
  /// @param key    restoration_key()
  /// @param shape  that the image must have
  std::optional<torch::Tensor> find(const std::string& key, torch::IntArrayRef shape);
  /// Keeps an image [C,H,W] for the next run, and prunes after every eighth of `max_mib`.
  void keep(const std::string& key, const torch::Tensor& image);
  /// find(), else what `compute` returns, which is kept.
  torch::Tensor get(const std::string& key, torch::IntArrayRef shape,
                    const std::function<torch::Tensor()>& compute);

  /// Removes the longest unused entries until `max_mib` holds, and what killed runs left behind.
  void prune() const;

  int64_t hits() const { return hits_; }
  int64_t misses() const { return misses_; }
  /// Empty when off.
  const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path path_of(const std::string& key) const;
  void give_up(const std::string& why);

  std::filesystem::path folder_;
  int64_t max_bytes_ = 0;
  int64_t kept_bytes_ = 0;  ///< since the last time that keep() pruned
  int64_t hits_ = 0, misses_ = 0;
};

}  // namespace jade::restore
