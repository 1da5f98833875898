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
  std::vector<std::string> arguments;  ///< additional arguments of sbatch: "--partition=gpu",
                                       ///< "--gres=gpu:1", …
  std::string device = "auto";
  bool retry_failed = false;
};

/// Result of a submission.
struct Submission {
  std::string job;    ///< empty: there was nothing to submit
  int submitted = 0;  ///< runs in it
  int queued = 0;     ///< runs still queued by an earlier submission
};

/// Submits a job array of the runs that are unfinished and not queued by an earlier submission.
/// Slurm requeues tasks of a failed node, which resume from their checkpoints.
/// @throws DeviceError if Slurm does not answer or rejects the job.
Submission submit(const Plan& plan, const SweepOutput& output, const SlurmOptions& options);

/// Runs that submissions from this folder have in Slurm's queue, waiting or running.
/// @throws DeviceError if Slurm does not answer.
std::set<std::string> queued_runs(const SweepOutput& output);

/// Waits until Slurm has no job of the folder. Shows progress.
/// @throws DeviceError if Slurm does not answer, Interrupted on request; the array then continues.
void wait_for_slurm(const Plan& plan, const SweepOutput& output);

}  // namespace jade::sweep
