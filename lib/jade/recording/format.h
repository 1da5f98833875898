// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/core/words.h"

namespace jade::recording {

/// Format of a recording on disk.
enum class Format { kEvt, kDat, kFrameFolder, kZip, kHdf5, kNpz, kNpy, kText, kAedat, kRosBag };

constexpr auto words_of(Format) {
  return std::array{Word{"Prophesee EVT", Format::kEvt},
                    Word{"Prophesee DAT", Format::kDat},
                    Word{"folder of frames and events", Format::kFrameFolder},
                    Word{"zip of frames and events", Format::kZip},
                    Word{"HDF5", Format::kHdf5},
                    Word{"npz", Format::kNpz},
                    Word{"npy", Format::kNpy},
                    Word{"text", Format::kText},
                    Word{"AEDAT", Format::kAedat},
                    Word{"ROS bag", Format::kRosBag}};
}

/// The file of a folder that has only one recording, and no images; other paths as they are.
std::filesystem::path recording_in(const std::filesystem::path& path);

/// Recognises a format from the first bytes of a file, or the content of a folder. Does not
/// validate it: reading may still fail.
/// @throws DataError for paths that are missing, empty or of an unsupported format.
Format recognise(const std::filesystem::path& path);

/// True if `path` looks like a recording rather than a data set with poses, a run or a model; never
/// throws.
bool is_recording(const std::filesystem::path& path);

}  // namespace jade::recording
