// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "jade/gaussians/ply.h"
#include "jade/geometry/pose.h"
#include "jade/train/options.h"
#include "jade/train/state.h"

namespace jade::run {

/// A checkpoint is a torch archive of named tensors and texts; it carries a SHA-256 of them all.
/// checkpoints/step_0025000.pt of a run directory.
std::filesystem::path checkpoint_path(const std::filesystem::path& run, int64_t step);

/// The step that the name of such a file tells.
int64_t step_of(const std::filesystem::path& checkpoint);

/// Checkpoints of a run directory, newest first.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run);

/// Renames those of later steps than `step` to left_step_….pt, which list_checkpoints() does not
/// name: a run that goes on from there has left them.
/// @return how many
int64_t set_aside_checkpoints(const std::filesystem::path& run, int64_t step);

/// Metadata of a checkpoint.
struct CheckpointInfo {
  std::string config;           ///< the resolved YAML of the run
  std::string fingerprint;      ///< of the data, see data_fingerprint()
  std::string restorer_sha256;  ///< of the restorer's file; empty where the options need none, and
                                ///< in checkpoints that are older than this entry
  geometry::Vector3 origin{0, 0, 0};  ///< data::Dataset::origin
};

/// Writes the state (whole or not at all) and removes all but the `keep` newest checkpoints.
/// @throws DataError when the disk is full or the folder not writable; nothing is lost then.
void save_checkpoint(const std::filesystem::path& run, const train::TrainState& state,
                     const CheckpointInfo& info, int64_t keep);

/// Reads what stands beside the state and verifies the whole file.
/// @throws CheckpointError naming the path: unreadable, damaged or of another version.
CheckpointInfo read_checkpoint_info(const std::filesystem::path& path);

/// Reads and verifies a checkpoint into `state`, whose modules have been made from the same
/// options.
/// @throws CheckpointError as read_checkpoint_info(), and where the state does not fit.
void load_checkpoint(const std::filesystem::path& path, train::TrainState& state);

/// Only the Gaussians, on the CPU: for export and rendering.
/// @throws CheckpointError.
splat::Gaussians load_checkpoint_gaussians(const std::filesystem::path& path);

/// Gaussians of a checkpoint with their origin.
/// @throws CheckpointError.
gaussians::GaussianFile load_checkpoint_scene(const std::filesystem::path& path);

/// Only θ, into an allocation made from the options of the run: for restoring without a scene.
/// @throws CheckpointError, also where the checkpoint has another allocation or none.
void load_checkpoint_allocation(const std::filesystem::path& path, router::Allocation& allocation);

/// Only learned poses, into poses made from the options and the data of the run.
/// @throws CheckpointError, also where the checkpoint has others or none.
void load_checkpoint_poses(const std::filesystem::path& path, train::ExposurePoses& poses);

/// Contents of a fingerprint: older versions had no intrinsics and only the number of events.
enum class FingerprintOf { kContents, kBefore };

/// SHA-256 over the training exposures: names, times, poses, intrinsics, pixels and events.
std::string data_fingerprint(const data::Dataset& dataset,
                             FingerprintOf what = FingerprintOf::kContents);

/// The options that a checkpoint's YAML holds, settled; keys that it lacks are as printed
/// (train::printed_options).
/// @throws CheckpointError for the YAML of another version.
train::RunOptions saved_options(const std::string& yaml);

/// A run that goes on keeps the calendar with which it began: where `now` takes its shares of
/// another number of steps and does not name one itself, its train.calendar is set to the saved
/// one. True where that changed it.
bool keep_calendar(const train::RunOptions& saved, train::RunOptions& now);

/// Keys whose values differ, as "key: saved -> now" lines; keys that a resumed run may change
/// without becoming another run (train.iterations, the calendar of logs, pictures and checkpoints,
/// device, dataset.path, efnet.path) are in `allowed`, all others in `refused`. What lies at the
/// paths is compared by CheckpointInfo.
struct ConfigDifference {
  std::vector<std::string> allowed, refused;
};
ConfigDifference compare_configs(const std::string& saved_yaml, train::RunOptions now);

}  // namespace jade::run
