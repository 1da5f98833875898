// SPDX-License-Identifier: Apache-2.0
// Steps and moments of a run, chosen at its start so that it ends in time. config.yaml of the run
// holds them; a run that is resumed keeps them.
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

/// Choices that the user left to the program.
struct Choices {
  std::set<std::string> named;  ///< keys that the user gave; they stay
  double minutes = 0;           ///< that the run is to take; 0: not said

  bool leave(const std::string& key) const { return named.count(key) == 0; }
};

/// Every key that a run may choose.
const std::vector<std::string>& chosen_keys();

/// The choices of a run that goes on: the keys that the user leaves take the values of `saved`.
void keep_choices(train::RunOptions saved, const Choices& choices, train::RunOptions& options);

/// The laptop preset, for a run on a CPU that leaves train.iterations to the program: nine moments,
/// 2,000 steps and the density control of short runs, each where the user leaves its key.
/// @return one line that says so; empty where nothing changed
std::string choose_for_cpu(const Choices& choices, train::RunOptions& options);

/// How fast this machine is. 0: not measured.
struct Speed {
  double restore_s = 0;  ///< one moment of one frame by the learned restorer
  double step_s = 0;     ///< a step with the moments of the options
};

/// How many frames the learned restorer restores at every moment, and how many at one.
struct RestoredFrames {
  int64_t moving = 0;
  int64_t still = 0;  ///< of no duration
};
RestoredFrames restored_frames(const data::Dataset& dataset);

/// Calls of the learned restorer with these options, in moments of frames.
int64_t restored_moments(const RestoredFrames& frames, const train::RunOptions& options);

/// Fewer restored moments where restoration would take more than a third of the run (and more than
/// 20 s), and with choices.minutes as many steps, and as many moments per exposure, as fit. Only
/// keys that the user leaves change; target none where even mid-exposure alone takes too long.
/// @return one line for each change
std::vector<std::string> fit_to_speed(const Speed& speed, const RestoredFrames& frames,
                                      const Choices& choices, train::RunOptions& options);

/// Measures what fit_to_speed() needs, calls it, and says in the log what is coming and how long it
/// takes. On a GPU it measures for choices.minutes only.
/// @param restorer  on its way or empty; holds the network that was measured, if any
/// @throws as ViewBank() and train::validate().
void choose_pace(const data::Dataset& dataset, const Choices& choices, torch::Device device,
                 train::RunOptions& options, std::future<restore::Restorer>& restorer);

}  // namespace jade::run
