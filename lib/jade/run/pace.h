// SPDX-License-Identifier: Apache-2.0
// Chooses steps and moments at the start of a run, so that it ends in time. The run's config.yaml
// stores them; a resumed run keeps them.
#pragma once

#include <cstdint>
#include <future>
#include <set>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/restore/efnet.h"
#include "jade/train/options.h"

namespace jade::run {

/// Settings that the user left to the program.
struct Choices {
  std::set<std::string> named;  ///< keys that the user set; they are not changed
  double minutes = 0;           ///< wanted duration of the run; 0: not given

  bool leave(const std::string& key) const { return named.count(key) == 0; }
};

/// All keys that a run may choose.
const std::vector<std::string>& chosen_keys();

/// Restores the choices of a resumed run: keys that the user did not set get the values in `saved`.
void keep_choices(train::RunOptions saved, const Choices& choices, train::RunOptions& options);

/// The laptop preset, for a run on a CPU without train.iterations: nine moments, 2,000 steps and
/// the density control of short runs, for each key that the user did not set.
/// @return a one-line description; empty if nothing changed
std::string choose_for_cpu(const Choices& choices, train::RunOptions& options);

/// Speed of this machine. 0: not measured.
struct Speed {
  double restore_s = 0;  ///< one moment of one frame by the learned restorer
  double step_s = 0;     ///< a step with the moments of the options
};

/// Number of frames that the learned restorer restores at every moment, and at one.
struct RestoredFrames {
  int64_t moving = 0;
  int64_t still = 0;  ///< of zero duration
};
RestoredFrames restored_frames(const data::Dataset& dataset);

/// Number of frames times moments to restore with these options.
int64_t restored_moments(const RestoredFrames& frames, const train::RunOptions& options);

/// Reduces the restored moments if restoration would take more than a third of the run (and more
/// than 20 s); with choices.minutes chooses as many steps, and as many moments per exposure, as
/// fit. Changes only keys that the user did not set; sets target none if even mid-exposure alone
/// takes too long.
/// @return one line per change
std::vector<std::string> fit_to_speed(const Speed& speed, const RestoredFrames& frames,
                                      const Choices& choices, train::RunOptions& options);

/// Measures what fit_to_speed() needs, calls it, and logs the upcoming work and its duration. On a
/// GPU it measures for choices.minutes only.
/// @param restorer  being loaded or empty; receives the measured network, if any
/// @throws as ViewBank() and train::validate().
void choose_pace(const data::Dataset& dataset, const Choices& choices, torch::Device device,
                 train::RunOptions& options, std::future<restore::Restorer>& restorer);

}  // namespace jade::run
