// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <future>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/imaging/ssim.h"
#include "jade/restore/efnet.h"
#include "jade/restore/restorations.h"
#include "jade/splat/render.h"
#include "jade/train/options.h"
#include "jade/train/visit.h"

namespace jade::train {

/// Restorations at each restored pose for the target, fusion and the routing step, unless
/// objective.restored_poses is middle. Row r is of moment u_k, k = r restored_every(). Undefined if
/// unused; EDI is R_k ⊙ B.
struct PoseRestorations {
  /// [R,3,H,W] float16, as there are many, F(B, V, u_k).
  torch::Tensor efnet;
  torch::Tensor psi;            ///< [R,2,H,W] Ψ(V) about u_k
  torch::Tensor reblur_kernel;  ///< [R,1,H,W] K(V) about u_k

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
    visit_members<PoseRestorations>(visitor, Member{"efnet", self.efnet}, Member{"psi", self.psi},
                                    Member{"reblur_kernel", self.reblur_kernel});
  }
};

/// Constants of one exposure in θ and φ, computed once. What steps read is on the training device
/// as far as it fits (view_memory.h); other parts of Ψ, K(V), density and restorations are on the
/// CPU.
struct View {
  std::string name;
  torch::Tensor blurry;  ///< [3,H,W] B, 0 under the mask
  /// [1,H,W] float32, 1 where a pixel counts and else 0, where targets are 0 too; undefined: all
  /// pixels of all views count.
  torch::Tensor mask;
  /// Window means of B, for L_blur; undefined where B is on the CPU of a run on a GPU.
  imaging::SsimTarget blurry_moments;
  torch::Tensor psi;  ///< [2,H,W] Ψ(V)
  /// [K,1,H,W] R_k: EDI_k(X) = X ⊙ R_k, at the moments u; undefined where L_edi and L_sim read
  /// taught_factors and no target reads EDI at a pose.
  torch::Tensor edi_factors;
  /// [K,1,H,W] float16, as there are many: the same with objective.edi_contrast, for L_edi and
  /// L_sim; where that is 1 it is edi_factors, and undefined.
  torch::Tensor taught_factors;
  torch::Tensor reblur_kernel;         ///< [1,H,W] K(V), Eq. (7)
  torch::Tensor density;               ///< [H,W] events of either polarity
  restore::Restorations restorations;  ///< I_edi and F; F undefined where nothing asks for it
  torch::Tensor fixed_target;       ///< [3,H,W] target that no router decides; undefined if routed
  PoseRestorations restored_poses;  ///< undefined for objective.restored_poses middle
  splat::CameraBatch cameras;       ///< the K poses
  torch::Tensor u;        ///< [K] float64, their moments: 0 is the exposure's start, 1 its end
  torch::Tensor weights;  ///< [K] of the mean of their renders; undefined: 1/K each

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
        visitor, Member{"name", self.name}, Member{"blurry", self.blurry},
        Member{"mask", self.mask}, Member{"blurry_moments", self.blurry_moments},
        Member{"psi", self.psi}, Member{"edi_factors", self.edi_factors},
        Member{"taught_factors", self.taught_factors}, Member{"reblur_kernel", self.reblur_kernel},
        Member{"density", self.density}, Member{"restorations", self.restorations},
        Member{"fixed_target", self.fixed_target}, Member{"restored_poses", self.restored_poses},
        Member{"cameras", self.cameras}, Member{"u", self.u}, Member{"weights", self.weights});
  }
};

/// The view with what its target, fusion and routing step read at pose k in place of mid-exposure:
/// Ψ, K(V), both restorations (EDI is left out where EFNet alone is the target) and the fixed
/// target. What it has of all poses stays behind, so that a recorded step need not copy
/// it. Does not wait for the device.
/// @param view  with_frame(), prepared with these options; objective.restored_poses is not middle
/// @param pose  k, one that is restored
View at_pose(const View& view, int64_t pose, const RunOptions& options);

/// SHA-256 of the restorer's file; empty where the options need none.
/// @throws ConfigError if EFNet is needed and not named; DataError if its file cannot be read or is
/// not the one that efnet.sha256 means.
std::string restorer_sha256(const RunOptions& options);

/// Voxels, EDI, EFNet and cameras of every training exposure. Shows progress; EFNet is loaded for
/// the duration of the call only, or is `early`, which somebody began to load.
/// @throws DataError, NumericError from the restorers; DataError before the first view where every
/// pose is to be restored and the restorer can do the middle only.
std::vector<View> prepare_views(const data::Dataset& dataset, const RunOptions& options,
                                torch::Device device, std::future<restore::Restorer> early = {});

/// splat.near_plane for a run that starts with this data set: what it says, else 0.2 as in the
/// published 3DGS, but at most half the near depth bound, so that small scenes are not cut.
double near_plane(const SplatOptions& options, const data::Dataset& dataset);

/// densify.max_gaussians of a run that starts with this data set: what it says, else 500 per pixel
/// of the side of a square with as many pixels as the first frame, at least 150,000
/// (docs/engineering/preset.md).
int64_t max_gaussians(const gaussians::DensifyOptions& options, const data::Dataset& dataset);

/// How a run draws any view, at the full SH degree. A near plane of 0, as in runs of versions that
/// had no such key, means that of splat/render.h.
splat::RenderOptions render_options(const RunOptions& options);

/// When an exposure has its nine poses, in units of it: [9] float64 from 0 to 1.
torch::Tensor pose_times(torch::Device device);

/// One camera for several poses on a device.
splat::CameraBatch camera_batch(const std::vector<geometry::Pose>& camera_from_world,
                                const geometry::Intrinsics& camera, torch::Device device);

}  // namespace jade::train
