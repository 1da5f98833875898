// SPDX-License-Identifier: Apache-2.0
// NumPy's structured arrays: one tensor per field.
#pragma once

#include <filesystem>
#include <string>

#include "jade/io/npy.h"

namespace jade::io {

/// Reads an array that may contain records: one tensor [N] for each field that is a single number,
/// in the order of the record; other fields are skipped. Plain numbers are one tensor without a
/// name.
/// @throws DataError as read_npy, and for records in more than one dimension, or nested records.
NamedTensors read_npy_fields(const std::filesystem::path& path);

/// Parses bytes in memory; `name` is the path in messages.
NamedTensors parse_npy_fields(const void* bytes, size_t size, const std::string& name);

/// Reads an array of an .npz archive. @throws DataError if there is no such array.
NamedTensors read_npz_fields(const std::filesystem::path& path, const std::string& name);

}  // namespace jade::io
