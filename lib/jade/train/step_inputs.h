// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <torch/types.h>

#include "jade/train/event_windows.h"
#include "jade/train/view.h"
#include "jade/train/visit.h"

namespace jade::train {

/// Inputs of one step besides the state. Copies share their tensors.
struct StepInputs {
  int64_t step = 1;        ///< counted from 1
  View view;               ///< of this step, with its target at the sampled pose, if one is sampled
  int64_t view_index = 0;  ///< index among the training views
  /// [3] int64 on the device: the poses of L_edi gray, L_edi colour and L_sim; [4] with that of
  /// L_tgt if it is sampled.
  torch::Tensor pose_draws;
  /// At the first three of these poses.
  losses::EdiFactors edi_factors;
  EventWindow events;  ///< needed for L_ev only
  /// [2] weights of L_tgt and L_edi; undefined if they are constant.
  torch::Tensor term_weights;
  /// [1] int64 on the device: view_index; only for learned poses and gains.
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

}  // namespace jade::train
