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

/// F of views through the cache on disk. The network is loaded when the first view is not in the
/// cache, so never if all are, or taken from whoever began to. EDI is not cached: to hash its
/// windows takes longer than to compute it.
class ViewRestorer {
 public:
  /// @param efnet  its file is read and checked against its SHA-256 now, its metadata too; without
  ///   value there is no F, and efnet() must not be called.
  /// @param monochrome  the frames are gray, and so is F, see without_tint().
  /// @param early  the network of `efnet` on `device`, if somebody began to load it.
  /// @throws DataError.
  ViewRestorer(const RestorationCacheOptions& cache, std::optional<EfnetOptions> efnet,
               torch::Device device, bool monochrome = false, std::future<Restorer> early = {});
  /// Keeps the cache within its size.
  ~ViewRestorer();

  /// F(B, V) at mid-exposure: blurry [3,H,W], events [T,H,W] as the network takes them, on any
  /// device; result on the device of this object. What the network restored on the CPU for want of
  /// a GPU's memory, in tiles or in fewer images at once than asked for, is not kept.
  torch::Tensor efnet(const torch::Tensor& blurry, const torch::Tensor& events);

  /// F(B, V, t) at several moments of an exposure, [K,3,H,W], kept as one entry.
  /// @throws DataError as check_times.
  torch::Tensor efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                      const std::vector<double>& times);

  /// F from the cache, or undefined.
  torch::Tensor kept_efnet(const torch::Tensor& blurry, const torch::Tensor& events,
                           const std::vector<double>& times);

  /// Metadata of the network's file, without loading it. @throws DataError.
  const RestorerMetadata& metadata() const;
  /// @throws DataError naming the file where it cannot restore these moments.
  void check_times(const std::vector<double>& times) const;

  torch::Device device() const { return device_; }
  /// Whether efnet() may be called.
  bool has_network() const { return options_.has_value(); }
  /// The network, loaded if it was not.
  Restorer& network();
  bool network_is_loaded() const { return network_.has_value(); }
  /// Unloads the network and gives back to the device what it and its libraries worked with.
  void leave();
  const RestorationCache& cache() const { return cache_; }

 private:
  std::string efnet_key(const torch::Tensor& blurry, const torch::Tensor& events,
                        const std::vector<double>& times) const;
  torch::Tensor kept_under(const std::string& key, const torch::Tensor& blurry,
                           const std::vector<double>& times);
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

}  // namespace jade::restore
