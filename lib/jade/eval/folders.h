// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/eval/report.h"

namespace jade::eval {

/// Scores the images of `renders` against those of `truth`, paired by name without extension. Only
/// names in `truth` count.
/// @throws DataError naming the path: no image in `truth`, one that `renders` lacks, another size.
Evaluation compare_folders(const std::filesystem::path& renders, const std::filesystem::path& truth,
                           const Lpips& lpips);

}  // namespace jade::eval
