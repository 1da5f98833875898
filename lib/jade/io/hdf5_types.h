// SPDX-License-Identifier: Apache-2.0
// Start of the HDF5 library, and its types of numbers. Private to this folder.
#pragma once

#include <cstdint>
#include <hdf5.h>

namespace jade::io {

/// Must run before any other call. The library prints its error stack to stderr unless disabled per
/// thread. At exit it closes again what a full disk prevented it from closing, which crashes;
/// disable that, because each file's owner closes it.
void prepare_hdf5();

// HDF5's predefined types are macros over variables set at run time, hence functions.
template <class T>
hid_t native_type();
// clang-format off
template <> inline hid_t native_type<int8_t>() { return H5T_NATIVE_INT8; }
template <> inline hid_t native_type<uint8_t>() { return H5T_NATIVE_UINT8; }
template <> inline hid_t native_type<int16_t>() { return H5T_NATIVE_INT16; }
template <> inline hid_t native_type<uint16_t>() { return H5T_NATIVE_UINT16; }
template <> inline hid_t native_type<int32_t>() { return H5T_NATIVE_INT32; }
template <> inline hid_t native_type<uint32_t>() { return H5T_NATIVE_UINT32; }
template <> inline hid_t native_type<int64_t>() { return H5T_NATIVE_INT64; }
template <> inline hid_t native_type<uint64_t>() { return H5T_NATIVE_UINT64; }
template <> inline hid_t native_type<float>() { return H5T_NATIVE_FLOAT; }
template <> inline hid_t native_type<double>() { return H5T_NATIVE_DOUBLE; }
// clang-format on

}  // namespace jade::io
