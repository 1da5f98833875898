// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/restore/restorations.h"
#include "jade/splat/render.h"
#include "jade/train/options.h"
#include "jade/train/visit.h"

namespace jade::train {

/// Constants of one exposure that a step reads, a row of the ViewBank (bank.h). The target, Ψ, K(V)
/// and both restorations belong to one moment of the exposure, the middle or a sampled one.
/// Undefined: the step does not read it.
struct View {
  /// [3,H,W] B, 0 at masked pixels; for a router X_in of Eq. (2), [5,H,W]: B, then Ψ(V).
  torch::Tensor measured;
  torch::Tensor window_mean, window_square;  ///< [3,H,W] of B, for L_blur (imaging/ssim.h)
  /// [1,H,W] float32, 1 if a pixel counts, else 0 (targets are 0 there too); undefined: all pixels
  /// of all views count.
  torch::Tensor mask;
  torch::Tensor reblur_kernel;         ///< [1,H,W] K(V), Eq. (7)
  restore::Restorations restorations;  ///< I_edi and F
  torch::Tensor fixed_target;          ///< [3,H,W] target that does not depend on a router
  splat::CameraBatch cameras;          ///< the K poses
  torch::Tensor u;        ///< [K] float64, their moments: 0 is the exposure's start, 1 its end
  torch::Tensor weights;  ///< [K] weights in the mean of their renders; undefined: 1/K each

  torch::Tensor blurry() const { return measured.narrow(0, 0, 3); }

  /// Calls `visitor(name, tensor)` for every tensor, once.
  template <class Visitor>
  void visit(Visitor&& visitor) {
    visit_each(*this, visitor);
  }
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    visit_each(*this, visitor);
  }

 private:
  template <class Self, class Visitor>
  static void visit_each(Self& self, Visitor& visitor) {
    visit_members<View>(
        visitor, Member{"measured", self.measured}, Member{"window_mean", self.window_mean},
        Member{"window_square", self.window_square}, Member{"mask", self.mask},
        Member{"reblur_kernel", self.reblur_kernel}, Member{"restorations", self.restorations},
        Member{"fixed_target", self.fixed_target}, Member{"cameras", self.cameras},
        Member{"u", self.u}, Member{"weights", self.weights});
  }
};

/// splat.near_plane for a new run on this data set: the option if set, else 0.2 as in the published
/// 3DGS, but at most half the near depth bound, so that small scenes are not cut.
double near_plane(const SplatOptions& options, const data::Dataset& dataset);

/// How a run renders any view, at the full SH degree. A near plane of 0, as in runs of versions
/// without this key, means that of splat/render.h.
splat::RenderOptions render_options(const RunOptions& options);

/// Times of an exposure's nine poses in units of it: [9] float64 from 0 to 1.
torch::Tensor pose_times(torch::Device device);

/// One camera batch for several poses on a device.
splat::CameraBatch camera_batch(const std::vector<geometry::Pose>& camera_from_world,
                                const geometry::Intrinsics& camera, torch::Device device);

}  // namespace jade::train
