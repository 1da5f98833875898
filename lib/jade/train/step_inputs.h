// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/train/event_windows.h"
#include "jade/train/view.h"
#include "jade/train/view_memory.h"
#include "jade/train/visit.h"

namespace jade::train {

/// Inputs of one step besides the state. Copies share their tensors.
struct StepInputs {
  int64_t step = 1;        ///< counted from 1
  View view;               ///< of this step: at_pose() where objective.restored_poses draws one
  int64_t view_index = 0;  ///< among the training views
  /// [3] int64 on the device: the poses of L_edi gray, L_edi colour and L_sim; [4] with that of
  /// L_tgt where it is sampled.
  torch::Tensor pose_draws;
  /// At the first three of these poses.
  losses::EdiFactors edi_factors;
  EventWindow events;  ///< needed for L_ev only
  /// [2] weights of L_tgt and L_edi; undefined where they do not change.
  torch::Tensor term_weights;
  /// [1] int64 on the device: view_index, for learned poses and for gains only.
  torch::Tensor view_pick;

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
    visit_members<StepInputs>(
        visitor, Member{"step", self.step}, Member{"view", self.view},
        Member{"view_index", self.view_index}, Member{"pose_draws", self.pose_draws},
        Member{"edi_factors", self.edi_factors}, Member{"events", self.events},
        Member{"term_weights", self.term_weights}, Member{"view_pick", self.view_pick});
  }
};

/// Moves EdiFactors of these poses from the view, which is left without the others: a recorded step
/// has its inputs copied, and of nine or more poses it reads three.
/// @param poses   [3] of L_edi gray, L_edi colour and L_sim, among every `stride`-th of the view's
inline void pick_factors(const int64_t* poses, int64_t stride, StepInputs* inputs) {
  View& view = inputs->view;
  const torch::Tensor& all = view.taught_factors.defined() ? view.taught_factors : view.edi_factors;
  const auto at = [&](int64_t term) {
    return fetched(all[stride * poses[term]], view.blurry.device());
  };
  inputs->edi_factors = {at(0), at(1), at(2)};
  view.edi_factors = view.taught_factors = torch::Tensor();
}

}  // namespace jade::train
