// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>

#include "jade/data/exposure.h"
#include "jade/train/bank.h"
#include "jade/train/state.h"

namespace jade::run {

/// The report of a run: report.html, one self-contained file (curves, pictures side by side,
/// per-view metrics, allocation statistics, timing, the resolved configuration), and
/// allocation.json: {"views": [{"name", "alpha_mean", "alpha_std", "alpha_min", "alpha_max",
/// "alpha_correlation"}], "mean": {the same over all, "alpha_correlation_std"}}. Views with both
/// restorations and a sharp test view at their middle also have "choice_right" and "choice_gain_db"
/// (allocation_choice.h), with means over these views under "mean"; null if there are none.
class Report {
 public:
  /// Begins, on other threads, with what scores and fitted poses do not change: packs the scene and
  /// encodes the known pictures.
  Report(const data::Dataset& dataset, const train::ViewBank& bank, train::TrainState& state);
  ~Report();

  /// Writes both files into a run directory, from the run's files and its final state. Once only.
  /// @param posed  the data set of the constructor with the poses to render at
  void write(const std::filesystem::path& run, const data::Dataset& posed,
             const train::ViewBank& bank, train::TrainState& state,
             const train::RunOptions& options);

 private:
  struct Begun;
  std::unique_ptr<Begun> begun_;
};

}  // namespace jade::run
