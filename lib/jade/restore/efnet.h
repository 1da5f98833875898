// SPDX-License-Identifier: Apache-2.0
// Frozen image restorers in TorchScript. docs/engineering/restorer.md specifies the file.
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
};

template <class V>
void describe(V& v, EfnetOptions& o) {
  v.field("path", o.path,
          "TorchScript file of the restorer (scripts/efnet/export_efnet.py); empty: the one that "
          "ships with the program");
}

/// How to call a network for frames of a given size, so that its memory stays within a budget.
struct RestorerCall {
  int64_t images = 1;  ///< per call, at most
  int64_t tile = 0;    ///< side of the tiles into which a frame is split, px; 0: whole frame
};
RestorerCall restorer_call(torch::Device device, int64_t pixels);

/// The file that the options select: their path, else the one that ships with the program. It may
/// not exist.
std::filesystem::path restorer_path(const EfnetOptions& options);

/// SHA-256 of that file, lower-case hex.
/// @throws DataError if it does not exist or cannot be read.
std::string restorer_file_sha256(const EfnetOptions& options);

/// F: a frozen restorer (eval mode, no gradients).
class Restorer {
 public:
  /// @throws DataError naming the path: not TorchScript, no metadata (with the command that exports
  ///   a file with it), metadata of another version, or weights that do not match the metadata.
  explicit Restorer(const EfnetOptions& options, torch::Device device = torch::kCPU);
  ~Restorer();
  Restorer(Restorer&&) noexcept;
  Restorer& operator=(Restorer&&) noexcept;

  const RestorerMetadata& metadata() const { return metadata_; }
  /// Device of the network: the CPU after a GPU had too little memory.
  torch::Device device() const { return device_; }
  /// Side of the tiles after memory ran short, px; 0: whole frames.
  int64_t tile() const { return tile_; }

  /// Moments per call of the network after memory ran short; 0: all requested.
  int64_t batch() const { return batch_; }

  /// Restores the sharp frame of mid-exposure. If the device has too little memory, continues in
  /// overlapping tiles, and if a GPU has too little even for these, on the CPU, with a warning.
  /// @param blurry [3,H,W] or [N,3,H,W], RGB in [0,1]
  /// @param events  [T,H,W] or [N,T,H,W], signed sums of the events of metadata().windows equal
  ///   half-open windows of the exposure; for version 1 at any positive scale. Ignored by kind
  ///   image.
  /// @return shaped as `blurry`, on its device, float32 in [0,1], without gradient
  /// @throws NumericError if the network returns NaN or Inf, DeviceError if memory is insufficient
  ///   in any case, DataError if the module rejects its input or returns another shape.
  torch::Tensor restore(const torch::Tensor& blurry, const torch::Tensor& events);

  /// Restores the sharp frames of any moments of one exposure, with as many per call of the network
  /// as restorer_call() says, or fewer if the device has too little memory; then as above.
  /// @param blurry  [3,H,W]
  /// @param events  [T,H,W]
  /// @param times   K of them, 0 the start and 1 the end of the exposure, in any order
  /// @return [K,3,H,W]
  /// @throws DataError, before other work, for a moment that the file cannot restore (check_times);
  ///   else as above.
  torch::Tensor restore(const torch::Tensor& blurry, const torch::Tensor& events,
                        const std::vector<double>& times);

  void to(torch::Device device);

  /// Calls the network once on a small black frame, so that the next call does not wait for the
  /// initialisation of libraries. Ignores errors, which the next call will report.
  void warm_up();

 private:
  /// Inputs of the network before padding.
  struct Inputs {
    std::vector<torch::Tensor> maps;  ///< the image and its additional inputs, [N,C,H,W] each
    torch::Tensor times;              ///< [N] if any_time, else undefined
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
  int64_t tile_ = 0;  ///< side of the core of a tile, px; 0: from restorer_call()
  bool told_of_tiles_ = false;
  int64_t batch_ = 0;  ///< images per call; 0: from restorer_call()
};

/// SHA-256 over all parameters, docs/engineering/restorer.md §1.3. Parameters stored as float16 are
/// hashed as float32.
std::string weights_sha256(const torch::jit::Module& module);

/// Converts the six bins to cumulative sums from mid-exposure outwards (SCER): [−(V1+V2+V3),
/// −(V2+V3), −V3, V4, V4+V5, V4+V5+V6].
/// @param voxel  [N,6,H,W]
torch::Tensor scer_from_bins(const torch::Tensor& voxel);

/// Divides each view by its largest magnitude; a view of zeros stays zero. [N,6,H,W].
torch::Tensor normalize_views(const torch::Tensor& events);

/// [N,1,H,W]: 1 where any channel is not zero, then a 3×3 closing (outside the frame is 0 for the
/// dilation and 1 for the erosion).
torch::Tensor event_mask(const torch::Tensor& events);

/// Loads and warms up a restorer on a separate thread, while the caller reads data: a network's
/// first call on a GPU takes a second. get() rethrows the constructor's error.
std::future<Restorer> load_beside(const EfnetOptions& options, torch::Device device);

}  // namespace jade::restore
