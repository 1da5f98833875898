// SPDX-License-Identifier: Apache-2.0
// The memory budget of a run on a GPU, and the expected use of each part.
#pragma once

#include <cstdint>
#include <string>
#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/train/bank.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::train {

/// Bytes that the tensors of a run may take: of memory_gib (which then also limits the allocator),
/// or of what is free. Without limit on the CPU.
int64_t memory_budget(const RunOptions& options, torch::Device device);

/// densify.max_gaussians for a new run on this data set: the option if set, else 500 · √(pixels of
/// the first frame), at least 150,000 (docs/engineering/preset.md), but no more than fit beside the
/// renders of a step.
/// @param budget  of memory_budget
/// @throws DeviceError if even a small scene does not fit. Warns of an option that does not fit.
int64_t max_gaussians(const RunOptions& options, const data::Dataset& dataset, int64_t budget);

/// Bytes; what a step takes is fitted to measurements (docs/results/cost/memory_parts.csv).
struct MemoryPlan {
  ConstantBytes constants;  ///< on the training device, not on the CPU
  int64_t gaussians = 0;    ///< the largest allowed number, and what a step computes of them
  int64_t renders = 0;      ///< what a step computes of pixels

  /// Bytes of a step, Gaussians included.
  int64_t step() const { return gaussians + renders; }
  int64_t total() const {
    return constants.frames + constants.edi + constants.restorations + step();
  }
};

/// Before the constants are computed.
/// @param most_gaussians  of the run
MemoryPlan memory_plan(const RunOptions& options, const data::Dataset& dataset,
                       int64_t most_gaussians);

/// Bytes for the constants of the bank beside such a step, at most kMostConstantBytes.
int64_t constants_budget(const MemoryPlan& plan, int64_t budget);

/// "850 MiB: 12 frames 38, EDI 36, restorations 106, 150,000 Gaussians 395, renders 109".
std::string text_of(const MemoryPlan& plan, int64_t views, int64_t most_gaussians);

/// The largest number of Gaussians in the course of a run.
int64_t most_gaussians(const TrainState& state, const RunOptions& options);

}  // namespace jade::train
