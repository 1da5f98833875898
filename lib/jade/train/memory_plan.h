// SPDX-License-Identifier: Apache-2.0
// Estimates the use of the training device's memory before the first step.
#pragma once

#include <cstdint>
#include <string>

#include "jade/train/bank.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::train {

/// Bytes. Excludes what the splatting op stores per step, which depends on the scene.
struct MemoryPlan {
  ConstantBytes constants;
  int64_t gaussians = 0;  ///< the largest allowed number, with gradients and both moments of Adam
  int64_t renders = 0;    ///< of one step, with gradients

  int64_t total() const {
    return constants.frames + constants.edi + constants.restorations + gaussians + renders;
  }
};

/// Counts the bank's memory on the training device, not on the CPU.
MemoryPlan memory_plan(const ViewBank& bank, const TrainState& state, const RunOptions& options);

/// "210 MiB: 12 frames 3, EDI 30, restorations 110, 150000 Gaussians 135, renders 40".
std::string text_of(const MemoryPlan& plan, int64_t views, int64_t most_gaussians);

/// The largest number of Gaussians in the course of a run.
int64_t most_gaussians(const TrainState& state, const RunOptions& options);

}  // namespace jade::train
