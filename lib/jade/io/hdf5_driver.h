// SPDX-License-Identifier: Apache-2.0
// How hdf5.cpp reads bytes. Not for use outside this folder.
#pragma once

#include <hdf5.h>

namespace jade::io {

/// A read-only HDF5 file driver: like the library's own, but never beyond the end of the file, and
/// without the metadata accumulator, which in HDF5 1.10 follows a null pointer in files whose heaps
/// lie elsewhere than their groups say.
/// @return for H5Pset_driver(access, id, nullptr); negative if the library refuses it.
hid_t read_only_driver();

}  // namespace jade::io
