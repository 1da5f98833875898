// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/core/words.h"

namespace jade::recording {

/// Format of a recording on disk.
enum class Format {
  kEvt,
  kDat,
  kRpg,
  kFrameFolder,
  kZip,
  kHdf5,
  kNpz,
  kNpy,
  kText,
  kAedat,
  kRosBag
};

constexpr auto words_of(Format) {
  return std::array{Word{"Prophesee EVT", Format::kEvt},
                    Word{"Prophesee DAT", Format::kDat},
                    Word{"RPG text folder", Format::kRpg},
                    Word{"folder of frames and events", Format::kFrameFolder},
                    Word{"zip of an RPG text folder", Format::kZip},
                    Word{"HDF5", Format::kHdf5},
                    Word{"npz", Format::kNpz},
                    Word{"npy", Format::kNpy},
                    Word{"text", Format::kText},
                    Word{"AEDAT", Format::kAedat},
                    Word{"ROS bag", Format::kRosBag}};
}

/// Looks at the first bytes of a file, or at what lies in a folder. A format is recognised, not
/// checked: reading may still fail.
/// @throws DataError for what is missing, empty or of no format that is read.
Format recognise(const std::filesystem::path& path);

/// True where `path` looks like a recording rather than a data set with poses, a run or a model;
/// never throws.
bool is_recording(const std::filesystem::path& path);

}  // namespace jade::recording
