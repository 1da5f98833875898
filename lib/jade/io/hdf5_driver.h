// SPDX-License-Identifier: Apache-2.0
// File access of hdf5.cpp. Private to this folder.
#pragma once

#include <hdf5.h>

namespace jade::io {

/// A read-only HDF5 file driver like the library's own, except that it never reads beyond the end
/// of the file and has no metadata accumulator. In HDF5 1.10 the accumulator dereferences a null
/// pointer for files whose groups name a wrong position of their heap.
/// @return for H5Pset_driver(access, id, nullptr); negative if the library rejects it.
hid_t read_only_driver();

}  // namespace jade::io
