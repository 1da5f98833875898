// SPDX-License-Identifier: Apache-2.0
// Sharp images with poses in JSON: nerfstudio's transforms.json, and NeRF-synthetic's
// transforms_train.json with transforms_test.json.
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

bool is_transforms(const std::filesystem::path& folder);

/// The folders in which the images lie that its transforms.json names; empty where it has none.
/// @throws DataError for one that cannot be read.
std::vector<std::filesystem::path> named_folders(const std::filesystem::path& folder);

/// Matrices are world_from_camera in OpenGL axes (x right, y up, z backwards). Frames whose image
/// is not there are left out with a warning, as other programs do, unless few remain of a file.
/// @throws DataError naming the file and frame for malformed JSON, missing keys or most images.
Dataset load_transforms(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
