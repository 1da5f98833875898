// SPDX-License-Identifier: Apache-2.0
// Frozen image restorers in TorchScript. docs/efnet.md is the contract of the file.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <torch/types.h>

#include "jade/core/fields.h"

namespace torch::jit {
struct Module;
}

namespace jade::models {

struct EfnetOptions {
  std::filesystem::path path;
  std::string sha256;
};

template <class V>
void describe(V& v, EfnetOptions& o) {
  v.field("path", o.path, "TorchScript file of the restorer (scripts/efnet/export_efnet.py)");
  v.field("sha256", o.sha256, "SHA-256 that the file must have (sha256sum); empty: not checked");
}

/// What jade_efnet.json in the file says; the keys of docs/efnet.md §1.1.
struct RestorerMetadata {
  std::string kind;  ///< "efnet" or "image"
  std::string name;
  int64_t width = 0;
  int64_t parameters = 0;
  std::string input;  ///< "scer", "bins" or "none"
  std::string channel_order;
  int64_t padding_multiple = 1;
  int64_t minimum_size = 1;
  bool uses_mask = false;
  std::string weights_sha256;
  std::string source;
};

/// F: a frozen restorer (eval mode, no gradients).
class Restorer {
 public:
  /// @throws DataError naming the path: no TorchScript, no metadata (with the command that exports
  ///   a file with it), metadata of another version, or a SHA-256 that differs from the options'.
  explicit Restorer(const EfnetOptions& options, torch::Device device = torch::kCPU);
  ~Restorer();
  Restorer(Restorer&&) noexcept;
  Restorer& operator=(Restorer&&) noexcept;

  const RestorerMetadata& metadata() const { return metadata_; }
  /// SHA-256 of the whole file, lower-case hex: the restorer's part of a cache key.
  const std::string& file_sha256() const { return file_sha256_; }

  /// The sharp frame of mid-exposure.
  /// @param blurry  [3,H,W] or [N,3,H,W], RGB in [0,1]
  /// @param voxel   [6,H,W] or [N,6,H,W], signed bins, any positive scale; ignored by kind image
  /// @return shaped as `blurry`, on its device, float32 in [0,1], without gradient
  /// @throws NumericError where the network returns NaN or Inf, DeviceError when memory runs out,
  ///   DataError when the module refuses its input or returns another shape.
  torch::Tensor restore(const torch::Tensor& blurry, const torch::Tensor& voxel) const;

  void to(torch::Device device);

 private:
  /// One forward pass on the module's device, padded and cropped.
  torch::Tensor call(const torch::Tensor& image, const torch::Tensor& voxel) const;

  std::filesystem::path path_;
  RestorerMetadata metadata_;
  std::string file_sha256_;
  torch::Device device_;
  std::unique_ptr<torch::jit::Module> module_;
};

/// The six bins as cumulative sums from mid-exposure outwards (SCER):
/// [−(V1+V2+V3), −(V2+V3), −V3, V4, V4+V5, V4+V5+V6].
/// @param voxel  [N,6,H,W]
torch::Tensor scer_from_bins(const torch::Tensor& voxel);

/// Each view divided by its largest magnitude; a view of zeros stays zero. [N,6,H,W].
torch::Tensor normalize_views(const torch::Tensor& events);

/// [N,1,H,W]: 1 where any channel is not zero, then a 3×3 closing (outside the frame counts as 0 in
/// the dilation and as 1 in the erosion).
torch::Tensor event_mask(const torch::Tensor& events);

}  // namespace jade::models
