// SPDX-License-Identifier: Apache-2.0
// Identifiers, types of numbers, data sets and file access of the HDF5 library. Private to this
// folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <hdf5.h>
#include <string>
#include <utility>

#include "jade/io/hdf5.h"

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

/// Owns one HDF5 identifier of any kind.
class Hdf5Id {
 public:
  explicit Hdf5Id(hid_t id = -1) : id_(id) {}
  ~Hdf5Id() { reset(); }
  Hdf5Id(Hdf5Id&& other) noexcept : id_(std::exchange(other.id_, -1)) {}
  Hdf5Id& operator=(Hdf5Id&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  operator hid_t() const { return id_; }  // NOLINT(google-explicit-constructor)
  bool valid() const { return id_ >= 0; }
  /// Closes it immediately; false if pending data could not be written.
  bool reset() {
    const hid_t id = std::exchange(id_, -1);
    return id < 0 || H5Idec_ref(id) >= 0;
  }

 private:
  hid_t id_;
};

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

/// A read-only HDF5 file driver like the library's own, except that it never reads beyond the end
/// of the file and has no metadata accumulator. In HDF5 1.10 the accumulator dereferences a null
/// pointer for files whose groups name a wrong position of their heap.
/// @return for H5Pset_driver(access, id, nullptr); negative if the library rejects it.
hid_t read_only_driver();

}  // namespace jade::io
