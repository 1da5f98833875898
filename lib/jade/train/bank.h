// SPDX-License-Identifier: Apache-2.0
// The bank: constants of all exposures, computed once. The training device stores as many kinds of
// them as fit, the CPU the rest, which each step copies as needed.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/losses/objective.h"
#include "jade/restore/efnet.h"
#include "jade/restore/restored_exposure.h"
#include "jade/restore/view_restorer.h"
#include "jade/train/exposure_span.h"
#include "jade/train/options.h"
#include "jade/train/sums_ahead.h"
#include "jade/train/view.h"

namespace jade::train {

/// Upper limit in bytes for frames, EDI factors and restorations of all views on a GPU: the frames
/// of some 60 exposures of 1280x720 in colour.
constexpr int64_t kMostConstantBytes = int64_t{2} << 30;

/// One kind of constants, one tensor per view.
using PerView = std::vector<torch::Tensor>;

/// Bytes on the training device.
struct ConstantBytes {
  int64_t frames = 0;        ///< frames with the window means of SSIM, masks; Ψ for a router
  int64_t edi = 0;           ///< factors of EDI
  int64_t restorations = 0;  ///< targets and the restorations they consist of
};

/// Starts a GPU and loads the kernels that a bank needs, which takes tenths of a second: for
/// another thread, while the data are read.
void load_kernels(torch::Device device);

/// The restoration of all exposures. On a GPU other threads sum the events of the first exposures
/// and look them up in the cache from construction on.
struct Restoring {
  /// @param dataset  must outlive it
  /// @param options  settled
  /// @param early  the network, if its loading has started
  /// @param most_device_bytes  as SumsAhead()
  /// @throws DataError if all poses are to be restored and the restorer supports the middle only
  Restoring(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
            std::future<restore::Restorer> early, int64_t most_device_bytes);

  restore::RestoreOptions how;
  restore::ViewRestorer restorer;
  SumsAhead sums;
};

/// Constants of the training exposures, of K moments each. Views may differ in size.
class ViewBank {
 public:
  ViewBank() = default;
  /// Restores every exposure: voxels, EDI, EFNet, cameras. Shows progress. EFNet is unloaded at the
  /// end.
  /// @param options  settled
  /// @param begun  of the same data set, options and device; null: begins here
  /// @param most_device_bytes  The device stores at most this much, each kind for all views or for
  ///   none: the frames with their window means of SSIM, masks and targets, then EDI factors, then
  ///   F at the restored poses. Frames that a router reads are always on the device.
  /// @throws DataError, NumericError from the restorers; as Restoring().
  ViewBank(const data::Dataset& dataset, const RunOptions& options, torch::Device device,
           std::unique_ptr<Restoring> begun = nullptr,
           int64_t most_device_bytes = kMostConstantBytes);

  int64_t size() const { return static_cast<int64_t>(measured_.size()); }

  /// The view as a step reads it, on the training device, float32. Does not wait for the device.
  /// @param pose  the moment of the target, its restorations, Ψ and K(V); without value: the
  ///   middle. Needs objective.restored_poses other than middle
  View step_view(int64_t view, std::optional<int64_t> pose = {}) const;

  /// R_k, with EDI_k(X) = X ⊙ R_k, at the moments of L_edi gray, L_edi colour and L_sim, for
  /// objective.edi_contrast.
  losses::EdiFactors edi_factors(int64_t view, const std::array<int64_t, 3>& moments) const;
  /// [K,1,H,W], all moments.
  torch::Tensor edi_factors(int64_t view) const;

  /// For pictures and the report: the frame and both restorations at mid-exposure, with a router Ψ
  /// and K(V) too. On the training device if a router reads them, else possibly on the CPU.
  View picture_view(int64_t view) const;
  /// [H,W] events of either polarity, on the CPU.
  torch::Tensor density(int64_t view) const { return density_[static_cast<size_t>(view)]; }
  bool has_efnet() const { return !middle_efnet_.empty(); }

  /// Bytes of the constants on the training device.
  ConstantBytes bytes_on_device() const;

 private:
  /// @param target  the image of objective.target image_folder, else empty
  void add(const data::Exposure& exposure, const ExposureSpan& span, bool masks, bool monochrome,
           const std::filesystem::path& target, const restore::RestoredExposure& restored);
  /// Stores X_in and K(V) of an exposure, for a router and its loss.
  void add_routed(const data::Exposure& exposure, const events::EventVoxel& voxel);
  /// Moves to the device what fits.
  void place(int64_t most_bytes);
  restore::Restorations restorations_at(size_t view, int64_t pose,
                                        const torch::Tensor& blurry) const;
  bool is_routed() const { return options_.objective.target == losses::Target::kRouted; }

  RunOptions options_;
  torch::Device device_ = torch::kCPU;
  // Kinds that no step or picture reads are empty.
  PerView measured_, masks_;  // as in View, Ψ at mid-exposure; [1,H,W], empty: all pixels count
  PerView window_means_, window_squares_;  // [3,H,W], SSIM's of the frames
  PerView fixed_targets_;                  // [3,H,W] at mid-exposure, neither routed nor the frame
  // Maps at several moments; an exposure of zero length has one for all.
  PerView edi_;         // [K,1,H,W] R_k of objective.edi_contrast, float16 where that is not 1
  PerView target_edi_;  // [K,1,H,W] R_k for the thresholds, if a target reads it and edi_ differs
  PerView efnet_;       // [R,3,H,W] F at the restored poses, float16
  PerView psi_, reblur_kernel_;  // [R,2,H,W], [R,1,H,W] at the restored poses, for a router
  // Mid-exposure:
  PerView middle_edi_, middle_efnet_;  // [3,H,W]
  PerView middle_reblur_kernel_, density_;
  std::vector<splat::CameraBatch> cameras_;  // on the device
  torch::Tensor u_, weights_;                // [K], as in View
};

/// SHA-256 of the images of train.target_images for the training exposures; empty if
/// objective.target is another.
/// @throws DataError if an exposure has no image.
std::string target_images_sha256(const data::Dataset& dataset, const RunOptions& options);

/// SHA-256 of the restorer's file; empty if the options need none.
/// @throws ConfigError if EFNet is needed and not named; DataError if its file cannot be read.
std::string restorer_sha256(const RunOptions& options);

}  // namespace jade::train
