// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <hdf5.h>

namespace jade::io {

/// Reads values [begin, begin + count) of a one-dimensional data set of numbers, as H5Dread does,
/// but inflates its chunks on all threads: HDF5 inflates them one after the other. Takes up to
/// 64 MiB of memory meanwhile.
/// @param type  native type of the values in `out`
/// @return false, with `out` undefined, if H5Dread must read the values or report their damage: the
///   data set is not in chunks of deflated, or shuffled and deflated, numbers no larger than
///   `type`; the values are within two chunks; or a chunk cannot be read
bool read_deflated(hid_t dataset, int64_t begin, int64_t count, hid_t type, void* out);

}  // namespace jade::io
