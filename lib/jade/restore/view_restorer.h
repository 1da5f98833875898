// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <future>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/restore/efnet.h"
#include "jade/restore/restoration_cache.h"

namespace jade::restore {

/// The entry of one exposure in the cache.
struct KeptEfnet {
  std::string key;       ///< of the cache; empty without a cache
  torch::Tensor images;  ///< [K,3,H,W] on the CPU, or undefined
};

/// Restores views by EFNet through the disk cache. Loads the network when the first view is missing
/// in the cache, so never if all are cached, or uses one whose loading has started. EDI is not
/// cached: hashing its windows takes longer than computing it.
class ViewRestorer {
 public:
  /// @param efnet  its file is read at once and checked against its SHA-256 and metadata; without
  ///   value there is no F, and efnet() must not be called.
  /// @param monochrome  the frames are gray, and so is F, see without_tint().
  /// @param early  the network of `efnet` on `device`, if its loading has started.
  /// @throws DataError.
  ViewRestorer(const RestorationCacheOptions& cache, std::optional<EfnetOptions> efnet,
               torch::Device device, bool monochrome = false, std::future<Restorer> early = {});
  /// Prunes the cache.
  ~ViewRestorer();

  /// F(B, V) at mid-exposure: blurry [3,H,W], events [T,H,W] as the network takes them, on any
  /// device; result on the device of this object. Results that the network computed on the CPU, in
  /// tiles or in smaller batches for lack of GPU memory are not cached.
  torch::Tensor efnet(const torch::Tensor& blurry, const torch::Tensor& events);

  /// F(B, V, t) at several moments of an exposure, [K,3,H,W], cached as one entry. Several are in
  /// half precision, as training keeps them; one is in float32.
  /// @param key  KeptEfnet::key of these inputs, if known: it takes long to compute.
  /// @throws DataError as check_times.
  torch::Tensor efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                      const std::vector<double>& times, std::string key = "");

  /// Looks F up in the cache. May be called on any thread.
  KeptEfnet kept_efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                       const std::vector<double>& times) const;

  /// Metadata of the network's file, without loading it. @throws DataError.
  const RestorerMetadata& metadata() const;
  /// @throws DataError naming the file if it cannot restore these moments.
  void check_times(const std::vector<double>& times) const;

  torch::Device device() const { return device_; }
  /// Whether efnet() may be called.
  bool has_network() const { return options_.has_value(); }
  /// The network, loaded on first use.
  Restorer& network();
  bool network_is_loaded() const { return network_.has_value(); }
  /// Unloads the network and frees its memory and that of its libraries on the device.
  void leave();
  /// For restored_before(): notes in the cache that it has all views of this data set, if it has.
  void note_restored(const std::filesystem::path& data);
  const RestorationCache& cache() const { return cache_; }

 private:
  std::string efnet_key(const torch::Tensor& blurry, const torch::Tensor& events,
                        const std::vector<double>& times) const;
  bool as_asked() const;

  RestorationCache cache_;
  std::optional<EfnetOptions> options_;
  torch::Device device_;
  bool monochrome_;
  std::string file_sha256_;
  RestorerMetadata metadata_;
  std::future<Restorer> early_;
  std::optional<Restorer> network_;
};

/// Whether a former run with this restorer left all views of the data set in the cache, so that the
/// network will probably not be needed. Only a hint: data and settings may have changed.
/// @param sha256  of the restorer's file
bool restored_before(const RestorationCacheOptions& cache, const std::string& sha256,
                     torch::Device device, const std::filesystem::path& data);

}  // namespace jade::restore
