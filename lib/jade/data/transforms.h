// SPDX-License-Identifier: Apache-2.0
// Sharp images with poses in JSON: nerfstudio's transforms.json, and NeRF-synthetic's
// transforms_train.json with transforms_test.json.
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"

namespace jade::data {

bool is_transforms(const std::filesystem::path& folder);

/// The folders of the images that a folder's transforms.json names; empty if it has no such file.
/// @throws DataError if the file cannot be read.
std::vector<std::filesystem::path> named_folders(const std::filesystem::path& folder);

/// Matrices are world_from_camera in OpenGL axes (x right, y up, z backwards). Frames without an
/// image file are skipped with a warning, as in other programs, unless few frames remain.
/// @throws DataError naming the file and frame for malformed JSON, missing keys or most images
///   missing.
Dataset load_transforms(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
