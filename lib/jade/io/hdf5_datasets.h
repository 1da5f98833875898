// SPDX-License-Identifier: Apache-2.0
// Shapes, types and filters of the data sets in an HDF5 file. Private to this folder.
#pragma once

#include <filesystem>
#include <hdf5.h>
#include <string>

#include "jade/io/hdf5.h"

namespace jade::io {

/// Describes a data set. False if it is damaged.
/// @throws DataError if its encoding is newer than the library.
bool describe_dataset(hid_t file, const std::string& name, const std::filesystem::path& path,
                      Hdf5Dataset* out);

/// Describes the first filter of a data set that this installation lacks; empty if none.
std::string missing_filter(hid_t dataset);

bool has_filter(hid_t dataset, H5Z_filter_t wanted);

/// Largest possible compression ratio of a data set: deflate reaches 1032, LZF less; only filters
/// from plug-ins may exceed it.
double largest_compression(hid_t dataset);

}  // namespace jade::io
