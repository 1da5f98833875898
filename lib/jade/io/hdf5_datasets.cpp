// SPDX-License-Identifier: Apache-2.0
#include <cstring>
#include <vector>

#include "jade/core/error.h"
#include "jade/io/hdf5_types.h"

namespace jade::io {
namespace {

/// Adds the numeric members of a record.
void add_numeric_fields(hid_t type, Hdf5Dataset* out) {
  const int count = H5Tget_nmembers(type);
  for (int i = 0; i < count; ++i) {
    const H5T_class_t kind = H5Tget_member_class(type, static_cast<unsigned>(i));
    char* const name = H5Tget_member_name(type, static_cast<unsigned>(i));
    if (name == nullptr) continue;
    if (kind == H5T_INTEGER || kind == H5T_ENUM || kind == H5T_FLOAT) {
      out->fields.emplace_back(name);
      out->floating_fields.push_back(kind == H5T_FLOAT);
      const Hdf5Id member(H5Tget_member_type(type, static_cast<unsigned>(i)));
      out->field_sizes.push_back(static_cast<int64_t>(H5Tget_size(member)));
    }
    H5free_memory(name);
  }
}

herr_t note_version(unsigned, const H5E_error2_t* error, void* found) {
  const bool is_version = std::strstr(error->desc, "version number") != nullptr;
  if (is_version) *static_cast<bool*>(found) = true;
  return 0;
}

/// Whether the last call of the library failed at an encoding of a version that it does not know,
/// as later libraries write them. Other calls clear this state.
bool is_unknown_version() {
  bool found = false;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, note_version, &found);
  return found;
}

std::string library_version() {
  unsigned major = 0, minor = 0, release = 0;
  H5get_libversion(&major, &minor, &release);
  return concat(major, ".", minor, ".", release);
}

}  // namespace

bool describe_dataset(hid_t file, const std::string& name, const std::filesystem::path& path,
                      Hdf5Dataset* out) {
  const Hdf5Id dataset(H5Dopen2(file, name.c_str(), H5P_DEFAULT));
  if (!dataset.valid()) {
    if (!is_unknown_version()) return false;
    throw DataError(concat(path.string(), ": expected data sets that HDF5 ", library_version(),
                           " reads, found '", name,
                           "' in a newer encoding; write the file again, with libver='earliest' "
                           "(h5py) or H5F_LIBVER_V110"));
  }
  const Hdf5Id space(H5Dget_space(dataset));
  const Hdf5Id type(H5Dget_type(dataset));
  const Hdf5Id properties(H5Dget_create_plist(dataset));
  if (!space.valid() || !type.valid() || !properties.valid()) return false;
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0 || rank > H5S_MAX_RANK) return false;
  std::vector<hsize_t> shape(static_cast<size_t>(rank));
  if (rank > 0 && H5Sget_simple_extent_dims(space, shape.data(), nullptr) < 0) return false;
  out->name = name;
  out->shape.assign(shape.begin(), shape.end());
  // A null space has rank 0 like a scalar, but contains no value.
  if (H5Sget_simple_extent_type(space) == H5S_NULL) out->shape = {0};
  const H5T_class_t kind = H5Tget_class(type);
  out->integer = kind == H5T_INTEGER || kind == H5T_ENUM;
  out->floating = kind == H5T_FLOAT;
  if (kind == H5T_COMPOUND) add_numeric_fields(type, out);
  out->item_size = static_cast<int64_t>(H5Tget_size(type));
  out->stored_bytes = static_cast<int64_t>(H5Dget_storage_size(dataset));
  if (H5Pget_layout(properties) == H5D_CHUNKED && (rank == 1 || rank == 2)) {
    hsize_t chunk[2] = {0, 0};
    if (H5Pget_chunk(properties, rank, chunk) == rank)
      out->chunk_length = static_cast<int64_t>(chunk[0]);
  }
  return true;
}

std::string missing_filter(hid_t dataset) {
  const Hdf5Id properties(H5Dget_create_plist(dataset));
  const int count = H5Pget_nfilters(properties);
  for (int i = 0; i < count; ++i) {
    unsigned flags = 0;
    unsigned config = 0;
    size_t elements = 0;
    char label[64] = {};
    const H5Z_filter_t filter = H5Pget_filter2(properties, static_cast<unsigned>(i), &flags,
                                               &elements, nullptr, sizeof(label), label, &config);
    if (filter < 0 || H5Zfilter_avail(filter) > 0) continue;
    std::string text = concat("filter ", filter);
    if (filter == 32000) text += " (LZF: apt install hdf5-plugin-lzf)";
    if (filter == 32001) text += " (Blosc: apt install hdf5-filter-plugin-blosc-serial)";
    if (filter == 32015) text += " (Zstandard: apt install hdf5-filter-plugin-zstd)";
    return text;
  }
  return "";
}

bool has_filter(hid_t dataset, H5Z_filter_t wanted) {
  const Hdf5Id properties(H5Dget_create_plist(dataset));
  for (int i = 0; i < H5Pget_nfilters(properties); ++i) {
    size_t elements = 0;
    if (H5Pget_filter2(properties, static_cast<unsigned>(i), nullptr, &elements, nullptr, 0,
                       nullptr, nullptr) == wanted)
      return true;
  }
  return false;
}

double largest_compression(hid_t dataset) {
  const Hdf5Id properties(H5Dget_create_plist(dataset));
  const int count = H5Pget_nfilters(properties);
  if (count <= 0) return 1;
  double largest = 1100;
  for (int i = 0; i < count; ++i) {
    size_t elements = 0;
    const H5Z_filter_t filter = H5Pget_filter2(properties, static_cast<unsigned>(i), nullptr,
                                               &elements, nullptr, 0, nullptr, nullptr);
    if (filter > 32000) largest = 65536;
  }
  return largest;
}

}  // namespace jade::io
