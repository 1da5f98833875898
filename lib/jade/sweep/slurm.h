// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <vector>

#include "jade/sweep/output.h"
#include "jade/sweep/plan.h"

namespace jade::sweep {

struct SlurmOptions {
  std::filesystem::path self;          ///< the sweep program, for --run-task on the nodes
  std::filesystem::path program;       ///< the training program; empty: the one beside `self`
  int jobs = 0;                        ///< tasks at once; 0: no limit
  std::vector<std::string> arguments;  ///< more for sbatch: "--partition=gpu", "--gres=gpu:1", …
  std::string device = "auto";
  bool retry_failed = false;
};

/// Result of a submission.
struct Submission {
  std::string job;    ///< empty: nothing was left to submit
  int submitted = 0;  ///< runs in it
  int queued = 0;     ///< runs that an earlier submission still has
};

/// Submits a job array of what the plan lacks and no earlier submission still has in the queue.
/// Tasks of a node that dies are queued again by Slurm, and go on from their checkpoints.
/// @throws DeviceError when Slurm cannot be asked or refuses.
Submission submit(const Plan& plan, const SweepOutput& output, const SlurmOptions& options);

/// Runs that submissions from this folder still have in Slurm's queue, waiting or running.
/// @throws DeviceError when Slurm cannot be asked.
std::set<std::string> queued_runs(const SweepOutput& output);

/// Waits until Slurm has nothing of the folder left. Shows progress.
/// @throws DeviceError when Slurm cannot be asked, Interrupted on request; the array goes on then.
void wait_for_slurm(const Plan& plan, const SweepOutput& output);

}  // namespace jade::sweep
