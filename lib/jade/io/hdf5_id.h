// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hdf5.h>
#include <utility>

namespace jade::io {

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

}  // namespace jade::io
