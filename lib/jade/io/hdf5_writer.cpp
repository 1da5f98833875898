// SPDX-License-Identifier: Apache-2.0
#include <hdf5.h>
#include <map>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/hdf5_types.h"

namespace jade::io {

struct Hdf5Writer::Handle {
  Handle(const std::filesystem::path& path, int level) : target(path), gzip_level(level) {}
  AtomicFile target;
  int gzip_level = 4;
  // Order matters: data sets close first, then the file, then its name is removed.
  Hdf5Id file;
  std::map<std::string, Hdf5Id> datasets;
};

Hdf5Writer::Hdf5Writer(const std::filesystem::path& path, int gzip_level)
    : path_(path), handle_(std::make_unique<Handle>(path, gzip_level)) {
  prepare_hdf5();
  handle_->file = Hdf5Id(
      H5Fcreate(handle_->target.temporary_path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  if (!handle_->file.valid()) {
    throw DataError(concat(path.string(),
                           ": cannot be made; check that the folder exists and can "
                           "be written"));
  }
}

Hdf5Writer::~Hdf5Writer() = default;

void Hdf5Writer::append_as(const std::string& name, int64_t type, const void* values,
                           int64_t count) {
  const auto failed = [&] {
    return DataError(concat(path_.string(), ": '", name,
                            "' cannot be written; check the free space of the disk"));
  };
  Hdf5Id& dataset = handle_->datasets[name];
  if (!dataset.valid()) {
    constexpr hsize_t kChunk = 1 << 16;
    const hsize_t empty = 0;
    const hsize_t unlimited = H5S_UNLIMITED;
    const Hdf5Id space(H5Screate_simple(1, &empty, &unlimited));
    const Hdf5Id properties(H5Pcreate(H5P_DATASET_CREATE));
    const Hdf5Id links(H5Pcreate(H5P_LINK_CREATE));
    H5Pset_chunk(properties, 1, &kChunk);
    H5Pset_shuffle(properties);
    if (handle_->gzip_level > 0) {
      H5Pset_deflate(properties, static_cast<unsigned>(handle_->gzip_level));
    }
    H5Pset_create_intermediate_group(links, 1);
    dataset = Hdf5Id(H5Dcreate2(handle_->file, name.c_str(), static_cast<hid_t>(type), space, links,
                                properties, H5P_DEFAULT));
    if (!dataset.valid()) throw failed();
  }
  if (count == 0) return;
  hsize_t start = 0;
  {
    const Hdf5Id space(H5Dget_space(dataset));
    if (H5Sget_simple_extent_dims(space, &start, nullptr) != 1) throw failed();
  }
  const auto added = static_cast<hsize_t>(count);
  const hsize_t total = start + added;
  if (H5Dset_extent(dataset, &total) < 0) throw failed();
  const Hdf5Id file_space(H5Dget_space(dataset));
  const Hdf5Id memory_space(H5Screate_simple(1, &added, nullptr));
  if (H5Sselect_hyperslab(file_space, H5S_SELECT_SET, &start, nullptr, &added, nullptr) < 0 ||
      H5Dwrite(dataset, static_cast<hid_t>(type), memory_space, file_space, H5P_DEFAULT, values) <
          0) {
    throw failed();
  }
}

template <class T>
void Hdf5Writer::append(const std::string& name, const T* values, int64_t count) {
  append_as(name, native_type<T>(), values, count);
}

void Hdf5Writer::close() {
  bool written = H5Fflush(handle_->file, H5F_SCOPE_GLOBAL) >= 0;
  for (auto& [name, dataset] : handle_->datasets) written = dataset.reset() && written;
  written = handle_->file.reset() && written;
  if (!written) {
    throw DataError(
        concat(path_.string(), ": cannot be written; check the free space of the disk"));
  }
  handle_->target.commit();
}

#define JADE_HDF5_TYPE(T) \
  template void Hdf5Writer::append<T>(const std::string&, const T*, int64_t);
JADE_HDF5_TYPE(int8_t)
JADE_HDF5_TYPE(uint8_t)
JADE_HDF5_TYPE(int16_t)
JADE_HDF5_TYPE(uint16_t)
JADE_HDF5_TYPE(int32_t)
JADE_HDF5_TYPE(uint32_t)
JADE_HDF5_TYPE(int64_t)
JADE_HDF5_TYPE(uint64_t)
JADE_HDF5_TYPE(float)
JADE_HDF5_TYPE(double)
#undef JADE_HDF5_TYPE

}  // namespace jade::io
