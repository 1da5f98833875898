// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/eval/report.h"

namespace jade::eval {

/// Scores the images of `renders` against those of `truth`, paired by name without extension; a
/// render may be a `.npy` (imaging/image_io.h), as may all truths. Only names in `truth` count;
/// warns of other renders, of images that use 10 or 12 of 16 bits, and of gray renders of truths in
/// colour. Ignores pixels where a true image has alpha below half of full, or where `mask` is
/// black; composites renders with alpha over black. Logs how many of both there are.
/// @param mask  an image of the same size for all of them, or empty
/// @throws DataError naming the path: no image in `truth`, one that `renders` lacks, two images of
///   one name in a folder, another size, a true image or a mask of which no pixel counts.
Evaluation compare_folders(const std::filesystem::path& renders, const std::filesystem::path& truth,
                           const Lpips& lpips, const std::filesystem::path& mask = {});

}  // namespace jade::eval
