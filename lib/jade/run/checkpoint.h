// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/gaussians/ply.h"
#include "jade/geometry/pose.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::run {

/// A checkpoint is a torch archive of named tensors and texts with a SHA-256 over them:
/// checkpoints/step_0025000.pt of a run directory.
std::filesystem::path checkpoint_path(const std::filesystem::path& run, int64_t step);

/// The step in the name of such a file.
int64_t step_of(const std::filesystem::path& checkpoint);

/// Checkpoints of a run directory, newest first.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run);

/// Renames checkpoints of later steps than `step` to left_step_….pt, which list_checkpoints()
/// ignores: call it when a run resumes from an earlier step.
/// @return the number of renamed files
int64_t set_aside_checkpoints(const std::filesystem::path& run, int64_t step);

/// Metadata of a checkpoint.
struct CheckpointInfo {
  std::string config;                 ///< the run's resolved YAML
  std::string fingerprint;            ///< of the data, see data_fingerprint()
  std::string restorer_sha256;        ///< of the restorer's file; empty if the options need none
  geometry::Vector3 origin{0, 0, 0};  ///< data::Dataset::origin
};

/// All entries of a checkpoint by name, on the CPU; texts are byte tensors.
using Checkpoint = std::map<std::string, torch::Tensor>;

/// Copies a state, which may change afterwards.
Checkpoint checkpoint_of(const train::TrainState& state, const CheckpointInfo& info);

/// Writes a checkpoint atomically and removes all but the `keep` newest.
/// @throws DataError if the disk is full or the folder not writable; older checkpoints then stay.
void write_checkpoint(const std::filesystem::path& run, Checkpoint checkpoint, int64_t keep);

/// Reads the metadata and verifies the whole file.
/// @throws CheckpointError naming the path: unreadable, damaged or of another version.
CheckpointInfo read_checkpoint_info(const std::filesystem::path& path);

/// Reads and verifies a checkpoint into `state`, whose modules must have been made from the same
/// options.
/// @throws CheckpointError as read_checkpoint_info(), and if the state does not match.
void load_checkpoint(const std::filesystem::path& path, train::TrainState& state);

/// Reads only the Gaussians with their origin, on the CPU, for export and rendering.
/// @throws CheckpointError.
gaussians::GaussianFile load_checkpoint_scene(const std::filesystem::path& path);

/// Result of `load(path)` for the first undamaged of several checkpoints; warns of damaged ones.
/// @throws CheckpointError of the last one.
template <typename Load>
auto from_newest(const std::vector<std::filesystem::path>& checkpoints, const Load& load) {
  for (size_t i = 0; i + 1 < checkpoints.size(); ++i) {
    try {
      return load(checkpoints[i]);
    } catch (const CheckpointError& damage) {
      log_warn(concat(damage.what(), "; trying ", checkpoints[i + 1].filename().string()));
    }
  }
  return load(checkpoints.back());
}

/// Reads only θ into an allocation made from the options of the run, for restoration without a
/// scene.
/// @throws CheckpointError, also if the checkpoint has another allocation or none.
void load_checkpoint_allocation(const std::filesystem::path& path, router::Allocation& allocation);

/// Reads only learned poses into poses made from the options and the data of the run.
/// @throws CheckpointError, also if the checkpoint has others or none.
void load_checkpoint_poses(const std::filesystem::path& path, train::ExposurePoses& poses);

/// SHA-256 over the training exposures: names, times, poses, intrinsics, pixels and events.
/// @param more  other data that a run trains on, or their digest
std::string data_fingerprint(const data::Dataset& dataset, const std::string& more = "");

}  // namespace jade::run
