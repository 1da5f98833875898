// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/eval/report.h"

namespace jade::eval {

/// Scores the images of `renders` against those of `truth`, paired by name without extension. Only
/// names in `truth` count. Pixels where a truth has alpha below half of full, or where `mask` is
/// black, do not count; renders with alpha are laid over black. The log says how many of both.
/// @param mask  an image of the same size for all of them, or empty
/// @throws DataError naming the path: no image in `truth`, one that `renders` lacks, another size,
///   a truth or a mask of which no pixel counts.
Evaluation compare_folders(const std::filesystem::path& renders, const std::filesystem::path& truth,
                           const Lpips& lpips, const std::filesystem::path& mask = {});

}  // namespace jade::eval
