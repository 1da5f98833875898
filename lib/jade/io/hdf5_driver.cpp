// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "jade/io/hdf5_types.h"
#if H5_VERSION_GE(1, 14, 0)
#include <H5FDdevelop.h>
#endif

namespace jade::io {
namespace {

/// The library uses the base class and passes it to the functions below.
struct ReadOnlyFile : H5FD_t {
  int handle = -1;
  haddr_t end = 0;        ///< of the file
  haddr_t allocated = 0;  ///< end of the allocated address space, for the library's bookkeeping
};

ReadOnlyFile* mine(H5FD_t* file) { return static_cast<ReadOnlyFile*>(file); }

H5FD_t* open_file(const char* name, unsigned flags, hid_t, haddr_t) {
  if ((flags & H5F_ACC_RDWR) != 0) return nullptr;
  const int handle = open(name, O_RDONLY | O_CLOEXEC);
  struct stat status {};
  if (handle < 0 || fstat(handle, &status) != 0) {
    if (handle >= 0) close(handle);
    return nullptr;
  }
  auto* file = new ReadOnlyFile();
  file->handle = handle;
  file->end = static_cast<haddr_t>(status.st_size);
  return file;
}

herr_t close_file(H5FD_t* file) {
  close(mine(file)->handle);
  delete mine(file);
  return 0;
}

herr_t features(const H5FD_t*, unsigned long* flags) {  // NOLINT(google-runtime-int)
  if (flags != nullptr) *flags = H5FD_FEAT_DATA_SIEVE;
  return 0;
}

haddr_t get_allocated(const H5FD_t* file, H5FD_mem_t) {
  return static_cast<const ReadOnlyFile*>(file)->allocated;
}

herr_t set_allocated(H5FD_t* file, H5FD_mem_t, haddr_t address) {
  mine(file)->allocated = address;
  return 0;
}

haddr_t get_end(const H5FD_t* file, H5FD_mem_t) {
  return static_cast<const ReadOnlyFile*>(file)->end;
}

herr_t read_bytes(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t address, size_t size, void* buffer) {
  const ReadOnlyFile& from = *mine(file);
  if (address > from.end || size > from.end - address) return -1;
  auto* out = static_cast<char*>(buffer);
  while (size > 0) {
    const ssize_t count = pread(from.handle, out, size, static_cast<off_t>(address));
    if (count <= 0) return -1;
    out += count;
    address += static_cast<haddr_t>(count);
    size -= static_cast<size_t>(count);
  }
  return 0;
}

herr_t write_bytes(H5FD_t*, H5FD_mem_t, hid_t, haddr_t, size_t, const void*) { return -1; }

hid_t register_driver() {
  H5FD_class_t driver{};
#if H5_VERSION_GE(1, 14, 0)
  driver.version = H5FD_CLASS_VERSION;
  driver.value = static_cast<H5FD_class_value_t>(600);
#endif
  driver.name = "jade_read_only";
  driver.maxaddr = INT64_MAX;
  driver.fc_degree = H5F_CLOSE_STRONG;
  driver.open = open_file;
  driver.close = close_file;
  driver.query = features;
  driver.get_eoa = get_allocated;
  driver.set_eoa = set_allocated;
  driver.get_eof = get_end;
  driver.read = read_bytes;
  driver.write = write_bytes;
  constexpr H5FD_mem_t kMap[H5FD_MEM_NTYPES] = H5FD_FLMAP_DICHOTOMY;
  for (int i = 0; i < H5FD_MEM_NTYPES; ++i) driver.fl_map[i] = kMap[i];
  return H5FDregister(&driver);
}

}  // namespace

hid_t read_only_driver() {
  static const hid_t id = register_driver();
  return id;
}

}  // namespace jade::io
