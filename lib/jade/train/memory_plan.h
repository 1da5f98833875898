// SPDX-License-Identifier: Apache-2.0
// Who takes how much of the training device's memory, before the first step.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "jade/train/options.h"
#include "jade/train/state.h"
#include "jade/train/view.h"

namespace jade::train {

/// Bytes. What the splatting op keeps of a step depends on the scene and is not in it.
struct MemoryPlan {
  int64_t frames = 0;        ///< blurry frames with the window means of SSIM
  int64_t edi = 0;           ///< factors of EDI
  int64_t restorations = 0;  ///< targets and what they are made of
  int64_t gaussians = 0;     ///< as many as there may be, with gradients and both moments of Adam
  int64_t renders = 0;       ///< of one step, with gradients

  int64_t total() const { return frames + edi + restorations + gaussians + renders; }
};

/// @param views  on the training device; what they share counts once, what is elsewhere does not
MemoryPlan memory_plan(const std::vector<View>& views, const TrainState& state,
                       const RunOptions& options);

/// "210 MiB: 12 frames 3, EDI 30, restorations 110, 150000 Gaussians 135, renders 40".
std::string text_of(const MemoryPlan& plan, size_t views, int64_t most_gaussians);

/// How many Gaussians there may be in the course of a run.
int64_t most_gaussians(const TrainState& state, const RunOptions& options);

}  // namespace jade::train
