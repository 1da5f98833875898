// SPDX-License-Identifier: Apache-2.0
// Frozen image restorers in TorchScript. docs/engineering/restorer.md is the contract of the file.
#pragma once

#include <filesystem>
#include <future>
#include <memory>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/fields.h"
#include "jade/restore/efnet_metadata.h"

namespace torch::jit {
struct Module;
}

namespace jade::restore {

struct EfnetOptions {
  std::filesystem::path path;
  std::string sha256;
};

template <class V>
void describe(V& v, EfnetOptions& o) {
  v.field("path", o.path,
          "TorchScript file of the restorer (scripts/efnet/export_efnet.py); empty: the one that "
          "comes with the program");
  v.field("sha256", o.sha256, "SHA-256 that the file must have (sha256sum); empty: not checked");
}

/// How a network is called for frames of so many pixels, so that its memory stays within a budget
/// whatever is asked of it at once.
struct RestorerCall {
  int64_t images = 1;  ///< at most, in one call
  int64_t tile = 0;    ///< side of the tiles that a frame is restored in, px; 0: whole
};
RestorerCall restorer_call(torch::Device device, int64_t pixels);

/// The file that the options mean: their path, else the one that ships. It need not be there.
std::filesystem::path restorer_path(const EfnetOptions& options);

/// SHA-256 of that whole file, lower-case hex. @throws DataError if it is not there, cannot be
/// read, or differs from the options'.
std::string checked_file_sha256(const EfnetOptions& options);

/// F: a frozen restorer (eval mode, no gradients).
class Restorer {
 public:
  /// @throws DataError naming the path: no TorchScript, no metadata (with the command that exports
  ///   a file with it), metadata of another version, weights that are not those of the metadata, or
  ///   a SHA-256 that differs from the options'.
  explicit Restorer(const EfnetOptions& options, torch::Device device = torch::kCPU);
  ~Restorer();
  Restorer(Restorer&&) noexcept;
  Restorer& operator=(Restorer&&) noexcept;

  const RestorerMetadata& metadata() const { return metadata_; }
  /// Device of the network: the CPU after a GPU ran out of memory.
  torch::Device device() const { return device_; }
  /// Side of the tiles that it restores, px, since memory ran short; 0: whole frames.
  int64_t tile() const { return tile_; }

  /// Moments restored in one call of the network since memory ran short; 0: as many as asked for.
  int64_t batch() const { return batch_; }

  /// The sharp frame of mid-exposure. When the device has too little memory for the frame, goes on
  /// on the CPU, and when that has too little, in overlapping tiles; says so in a warning.
  /// @param blurry  [3,H,W] or [N,3,H,W], RGB in [0,1]
  /// @param events  [T,H,W] or [N,T,H,W], signed sums of the events of metadata().windows equal
  ///   half-open windows of the exposure; of version 1 at any positive scale. Ignored by kind
  ///   image.
  /// @return shaped as `blurry`, on its device, float32 in [0,1], without gradient
  /// @throws NumericError where the network returns NaN or Inf, DeviceError when memory runs out
  ///   even so, DataError when the module refuses its input or returns another shape.
  torch::Tensor restore(const torch::Tensor& blurry, const torch::Tensor& events);

  /// The sharp frames of any moments of one exposure, as many in one call of the network as
  /// restorer_call() says; fewer where the device has too little memory for them, and then as
  /// above.
  /// @param blurry  [3,H,W]
  /// @param events  [T,H,W]
  /// @param times   K of them, 0 the start and 1 the end of the exposure, in any order
  /// @return [K,3,H,W]
  /// @throws DataError, before anything else, for a moment that the file cannot restore
  ///   (check_times); else as above.
  torch::Tensor restore(const torch::Tensor& blurry, const torch::Tensor& events,
                        const std::vector<double>& times);

  void to(torch::Device device);

  /// Calls the network once, on a small black frame, so that the next call need not wait for the
  /// libraries that it starts. What goes wrong here the next call will tell.
  void warm_up();

 private:
  /// Inputs of the network before padding.
  struct Inputs {
    std::vector<torch::Tensor> maps;  ///< the image and what goes with it, [N,C,H,W] each
    torch::Tensor times;              ///< [N] of any_time, else undefined
  };

  Inputs inputs_of(const torch::Tensor& image, const torch::Tensor& events,
                   const torch::Tensor& times) const;
  torch::Tensor restore_batch(const torch::Tensor& image, const torch::Tensor& events,
                              const torch::Tensor& times);
  torch::Tensor restore_where_it_fits(const Inputs& inputs);
  /// restorer_call(), with smaller parts after memory ran short.
  RestorerCall call_for(const torch::Tensor& image) const;
  torch::Tensor call_in_parts(const Inputs& inputs) const;
  /// One forward pass on the module's device, padded and cropped.
  /// @throws OutOfMemory (efnet.cpp).
  torch::Tensor call(const Inputs& inputs) const;
  torch::Tensor call_in_tiles(const Inputs& inputs, int64_t core) const;

  std::filesystem::path path_;
  RestorerMetadata metadata_;
  torch::Device device_;
  std::unique_ptr<torch::jit::Module> module_;
  int64_t tile_ = 0;  ///< side of the core of a tile, px; 0: as restorer_call() says
  bool told_of_tiles_ = false;
  int64_t batch_ = 0;  ///< images in one call; 0: as restorer_call() says
};

/// SHA-256 over all parameters, docs/engineering/restorer.md §1.3. Stored as float16 or not, they
/// count as float32.
std::string weights_sha256(const torch::jit::Module& module);

/// The six bins as cumulative sums from mid-exposure outwards (SCER):
/// [−(V1+V2+V3), −(V2+V3), −V3, V4, V4+V5, V4+V5+V6].
/// @param voxel  [N,6,H,W]
torch::Tensor scer_from_bins(const torch::Tensor& voxel);

/// Each view divided by its largest magnitude; a view of zeros stays zero. [N,6,H,W].
torch::Tensor normalize_views(const torch::Tensor& events);

/// [N,1,H,W]: 1 where any channel is not zero, then a 3×3 closing (outside the frame counts as 0 in
/// the dilation and as 1 in the erosion).
torch::Tensor event_mask(const torch::Tensor& events);

/// A restorer that loads and warms up on a thread of its own, while its caller reads data: a
/// network's first call on a GPU takes a second. get() throws what the constructor threw.
std::future<Restorer> load_beside(const EfnetOptions& options, torch::Device device);

}  // namespace jade::restore
