// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/data/exposure.h"
#include "jade/train/bank.h"
#include "jade/train/state.h"

namespace jade::run {

/// Writes report.html into a run directory: one self-contained file (curves, pictures side by side,
/// per-view metrics, allocation statistics, timing, the resolved configuration), from the run's
/// files and its final state. Also writes the allocation statistics to allocation.json: {"views":
/// [{"name", "alpha_mean", "alpha_std", "alpha_min", "alpha_max", "alpha_correlation"}], "mean":
/// {the same over all, "alpha_correlation_std"}}. Views with both restorations and a sharp test
/// view at their middle also have "choice_right" and "choice_gain_db" (allocation_choice.h), with
/// means over these views under "mean"; null if there are none.
void write_report(const std::filesystem::path& run, const data::Dataset& dataset,
                  const train::ViewBank& bank, train::TrainState& state,
                  const train::RunOptions& options);

}  // namespace jade::run
