// SPDX-License-Identifier: Apache-2.0
#include "jade/io/hdf5.h"

#include <algorithm>
#include <hdf5.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/io/ecf.h"
#include "jade/io/hdf5_chunks.h"
#include "jade/io/hdf5_types.h"
#include "jade/io/stand_in.h"

namespace jade::io {
namespace {

bool is_numeric(const Hdf5Dataset& dataset) { return dataset.integer || dataset.floating; }

// H5Ovisit and its callback's argument changed in HDF5 1.12.
#if H5_VERSION_GE(1, 12, 0)
using ObjectInfo = H5O_info2_t;
constexpr auto visit_objects = H5Ovisit3;
#else
using ObjectInfo = H5O_info_t;
constexpr auto visit_objects = H5Ovisit2;
#endif

herr_t collect_name(hid_t, const char* name, const ObjectInfo* info, void* names) {
  if (info->type == H5O_TYPE_DATASET)
    static_cast<std::vector<std::string>*>(names)->push_back(name);
  return 0;
}

/// Selects values [begin, begin + count) along the only axis longer than one; a scalar is selected
/// whole.
bool select_range(hid_t space, const std::vector<int64_t>& shape, int64_t begin, int64_t count) {
  if (shape.empty()) return true;
  std::vector<hsize_t> start(shape.size(), 0);
  std::vector<hsize_t> extent(shape.size(), 1);
  const auto longest = std::max_element(shape.begin(), shape.end()) - shape.begin();
  start[static_cast<size_t>(longest)] = static_cast<hsize_t>(begin);
  extent[static_cast<size_t>(longest)] = static_cast<hsize_t>(count);
  return H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, extent.data(),
                             nullptr) >= 0;
}

/// A text attribute of a file or a data set; empty if there is none.
std::string text_attribute(hid_t object, const std::string& name) {
  if (H5Aexists(object, name.c_str()) <= 0) return "";
  const Hdf5Id attribute(H5Aopen(object, name.c_str(), H5P_DEFAULT));
  const Hdf5Id type(H5Aget_type(attribute));
  const Hdf5Id space(H5Aget_space(attribute));
  if (!type.valid() || H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(space) != 1)
    return "";
  if (H5Tis_variable_str(type) > 0) {
    char* text = nullptr;
    const Hdf5Id memory(H5Tcopy(H5T_C_S1));
    H5Tset_size(memory, H5T_VARIABLE);
    H5Tset_cset(memory, H5Tget_cset(type));
    if (H5Aread(attribute, memory, &text) < 0 || text == nullptr) return "";
    std::string out = text;
    H5free_memory(text);
    return out;
  }
  constexpr size_t kLongest = 1 << 16;
  const size_t size = H5Tget_size(type);
  if (size > kLongest) return "";
  std::string text(size, '\0');
  if (H5Aread(attribute, type, text.data()) < 0) return "";
  return text.substr(0, text.find('\0'));
}

}  // namespace

void prepare_hdf5() {
  static const herr_t without_end = H5dont_atexit();  // only effective before the first H5open()
  static_cast<void>(without_end);
  H5open();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

struct Hdf5File::Handle {
  Hdf5Id file;
};

Hdf5File::Hdf5File(const std::filesystem::path& path)
    : path_(path), handle_(std::make_unique<Handle>()) {
  prepare_hdf5();
  register_ecf();
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  if (error) throw DataError(concat(path.string(), ": no such file, or it cannot be read"));
  if (size == 0) throw DataError(concat(path.string(), ": the file is empty; copy it again"));
  if (const std::string other = stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": expected an HDF5 file, found ", other));
  if (H5Fis_hdf5(path.c_str()) == 0) {
    throw DataError(concat(path.string(), ": expected an HDF5 file, found another format"));
  }
  const Hdf5Id access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
  H5Pset_driver(access, read_only_driver(), nullptr);
  handle_->file = Hdf5Id(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access));
  if (!handle_->file.valid()) {
    throw DataError(concat(path.string(), ": cannot be opened as HDF5: it is truncated (", size,
                           " bytes), damaged, or still being written; copy it again"));
  }
  std::vector<std::string> names;
  if (visit_objects(handle_->file, H5_INDEX_NAME, H5_ITER_INC, collect_name, &names,
                    H5O_INFO_BASIC) < 0) {
    throw DataError(concat(path.string(), ": its list of data sets is damaged; copy it again"));
  }
  for (const std::string& name : names) {
    Hdf5Dataset dataset;
    if (!describe_dataset(handle_->file, name, path, &dataset)) {
      throw DataError(concat(path.string(), ": data set '", name, "' is damaged; copy it again"));
    }
    datasets_.push_back(std::move(dataset));
  }
}

Hdf5File::~Hdf5File() = default;
Hdf5File::Hdf5File(Hdf5File&&) noexcept = default;
Hdf5File& Hdf5File::operator=(Hdf5File&&) noexcept = default;

bool Hdf5File::has(const std::string& name) const {
  return std::any_of(datasets_.begin(), datasets_.end(),
                     [&](const Hdf5Dataset& dataset) { return dataset.name == name; });
}

const Hdf5Dataset& Hdf5File::dataset(const std::string& name) const {
  for (const Hdf5Dataset& dataset : datasets_) {
    if (dataset.name == name) return dataset;
  }
  std::string found;
  for (const Hdf5Dataset& dataset : datasets_) {
    found += (found.empty() ? "" : ", ") + dataset.name;
  }
  throw DataError(concat(path_.string(), ": expected a data set '", name, "', found ",
                         found.empty() ? "none" : found));
}

int64_t Hdf5File::length(const std::string& name) const {
  const Hdf5Dataset& info = dataset(name);
  int64_t long_axes = 0;
  int64_t count = 1;
  for (const int64_t extent : info.shape) {
    if (extent != 1) {
      ++long_axes;
      count = extent;
    }
  }
  if (!(is_numeric(info) || !info.fields.empty()) || long_axes > 1) {
    throw DataError(concat(
        path_.string(), ": expected '", name, "' to be a list of numbers, found ",
        is_numeric(info) ? "numbers" : "another type", " in ", info.shape.size(), " dimensions"));
  }
  if (count == 0) return 0;
  check_size(info, count);
  return count;
}

/// Checks that the file is large enough for the claimed number of values.
void Hdf5File::check_size(const Hdf5Dataset& info, int64_t count) const {
  const Hdf5Id id(H5Dopen2(handle_->file, info.name.c_str(), H5P_DEFAULT));
  const double possible = static_cast<double>(info.stored_bytes) * largest_compression(id);
  const double claimed = static_cast<double>(count) * static_cast<double>(info.item_size);
  if (count >= 0 && claimed <= possible) return;
  throw DataError(concat(path_.string(), ": '", info.name, "' claims ", count, " values but only ",
                         info.stored_bytes,
                         " bytes of them are in the file; it is truncated or "
                         "was never finished, copy or record it again"));
}

void Hdf5File::read_as(const std::string& name, int64_t begin, int64_t count, int64_t type,
                       void* out) const {
  const int64_t total = length(name);
  if (begin < 0 || count < 0 || begin > total || count > total - begin) {
    throw ContractError(concat(path_.string(), ": values [", begin, ", ", begin + count, ") of '",
                               name, "' asked, which has ", total));
  }
  if (count == 0) return;
  const Hdf5Id id(H5Dopen2(handle_->file, name.c_str(), H5P_DEFAULT));
  const Hdf5Dataset& info = dataset(name);
  if (has_filter(id, kEcfFilter) &&
      (info.item_size != sizeof(EcfEvent) || info.chunk_length > kEcfChunk)) {
    throw DataError(concat(path_.string(), ": expected records of ", sizeof(EcfEvent),
                           " bytes in chunks of at most ", kEcfChunk, " behind '", name,
                           "', which is compressed as ECF, found ", info.item_size, " bytes and ",
                           info.chunk_length, "; the file is damaged, copy or record it again"));
  }
  if (read_deflated(id, begin, count, static_cast<hid_t>(type), out)) return;
  const Hdf5Id file_space(H5Dget_space(id));
  const bool selected = select_range(file_space, info.shape, begin, count);
  read_space(name, id, selected ? hid_t(file_space) : hid_t(-1), count, type, out);
}

void Hdf5File::read_space(const std::string& name, int64_t dataset, int64_t file_space,
                          int64_t count, int64_t type, void* out) const {
  const auto memory_count = static_cast<hsize_t>(count);
  const Hdf5Id memory_space(H5Screate_simple(1, &memory_count, nullptr));
  if (file_space >= 0 &&
      H5Dread(dataset, static_cast<hid_t>(type), memory_space, file_space, H5P_DEFAULT, out) >= 0) {
    return;
  }
  const std::string filter = missing_filter(dataset);
  throw DataError(filter.empty()
                      ? concat(path_.string(), ": '", name,
                               "' cannot be read; the file is truncated or damaged, copy it again")
                      : concat(path_.string(), ": '", name, "' needs HDF5 ", filter,
                               ", which is not installed; install it or store the data with gzip"));
}

void Hdf5File::read_column_as(const std::string& name, size_t axis, int64_t index, int64_t begin,
                              int64_t count, int64_t type, void* out) const {
  const Hdf5Dataset& info = dataset(name);
  if (!is_numeric(info) || info.shape.size() != 2 || axis > 1) {
    throw DataError(concat(path_.string(), ": expected '", name,
                           "' to be a table of numbers, found ", info.shape.size(), " dimensions"));
  }
  const int64_t rows = info.shape[1 - axis];
  if (index < 0 || index >= info.shape[axis] || begin < 0 || count < 0 || begin > rows - count) {
    throw ContractError(concat(path_.string(), ": values [", begin, ", ", begin + count, ") of '",
                               name, "' at ", index, " asked, which has ", rows));
  }
  if (count == 0) return;
  check_size(info, info.shape[0] > INT64_MAX / info.shape[1] ? -1 : info.shape[0] * info.shape[1]);
  const Hdf5Id id(H5Dopen2(handle_->file, name.c_str(), H5P_DEFAULT));
  const Hdf5Id file_space(H5Dget_space(id));
  hsize_t start[2], extent[2];
  start[axis] = static_cast<hsize_t>(index), extent[axis] = 1;
  start[1 - axis] = static_cast<hsize_t>(begin), extent[1 - axis] = static_cast<hsize_t>(count);
  const bool selected =
      H5Sselect_hyperslab(file_space, H5S_SELECT_SET, start, nullptr, extent, nullptr) >= 0;
  read_space(name, id, selected ? hid_t(file_space) : hid_t(-1), count, type, out);
}

void Hdf5File::read_item(const std::string& name, int64_t index, uint16_t* out) const {
  const Hdf5Dataset& info = dataset(name);
  if (!is_numeric(info) || info.shape.size() < 2 || index < 0 || index >= info.shape[0]) {
    throw ContractError(concat(path_.string(), ": item ", index, " of '", name, "' asked"));
  }
  std::vector<hsize_t> start(info.shape.size(), 0), extent(info.shape.begin(), info.shape.end());
  start[0] = static_cast<hsize_t>(index), extent[0] = 1;
  int64_t count = 1;
  for (size_t i = 1; i < info.shape.size(); ++i) count *= info.shape[i];
  const Hdf5Id id(H5Dopen2(handle_->file, name.c_str(), H5P_DEFAULT));
  const Hdf5Id file_space(H5Dget_space(id));
  const bool selected = H5Sselect_hyperslab(file_space, H5S_SELECT_SET, start.data(), nullptr,
                                            extent.data(), nullptr) >= 0;
  read_space(name, id, selected ? hid_t(file_space) : hid_t(-1), count, H5T_NATIVE_UINT16, out);
}

std::vector<uint16_t> Hdf5File::read_pixels(const std::string& name) const {
  const Hdf5Dataset& info = dataset(name);
  if (!is_numeric(info))
    throw ContractError(concat(path_.string(), ": pixels of '", name, "' asked"));
  int64_t count = 1;
  for (const int64_t side : info.shape)
    count = count < 0 || (side > 0 && count > INT64_MAX / side) ? -1 : count * side;
  check_size(info, count);
  std::vector<uint16_t> pixels(static_cast<size_t>(count));
  const Hdf5Id id(H5Dopen2(handle_->file, name.c_str(), H5P_DEFAULT));
  const Hdf5Id file_space(H5Dget_space(id));
  read_space(name, id, file_space, count, H5T_NATIVE_UINT16, pixels.data());
  return pixels;
}

template <class T>
void Hdf5File::read_column(const std::string& name, size_t axis, int64_t index, int64_t begin,
                           int64_t count, T* out) const {
  read_column_as(name, axis, index, begin, count, native_type<T>(), out);
}

template <class T>
void Hdf5File::read_field(const std::string& name, const std::string& field, int64_t begin,
                          int64_t count, T* out) const {
  const auto& fields = dataset(name).fields;
  if (std::find(fields.begin(), fields.end(), field) == fields.end()) {
    throw DataError(concat(path_.string(), ": expected '", name,
                           "' to hold records with a number '", field,
                           "', found none; the file is of another kind"));
  }
  const Hdf5Id record(H5Tcreate(H5T_COMPOUND, sizeof(T)));
  H5Tinsert(record, field.c_str(), 0, native_type<T>());
  read_as(name, begin, count, record, out);
}

std::string Hdf5File::attribute(const std::string& name) const {
  return text_attribute(handle_->file, name);
}

std::string Hdf5File::attribute(const std::string& dataset, const std::string& name) const {
  const Hdf5Id id(H5Dopen2(handle_->file, dataset.c_str(), H5P_DEFAULT));
  return id.valid() ? text_attribute(id, name) : "";
}

std::optional<double> Hdf5File::number(const std::string& dataset, const std::string& name) const {
  const Hdf5Id id(H5Dopen2(handle_->file, dataset.c_str(), H5P_DEFAULT));
  if (!id.valid() || H5Aexists(id, name.c_str()) <= 0) return std::nullopt;
  const Hdf5Id attribute(H5Aopen(id, name.c_str(), H5P_DEFAULT));
  const Hdf5Id type(H5Aget_type(attribute));
  const Hdf5Id space(H5Aget_space(attribute));
  const H5T_class_t kind = H5Tget_class(type);
  double value = 0;
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || H5Sget_simple_extent_npoints(space) != 1 ||
      H5Aread(attribute, H5T_NATIVE_DOUBLE, &value) < 0)
    return std::nullopt;
  return value;
}

template <class T>
void Hdf5File::read(const std::string& name, int64_t begin, int64_t count, T* out) const {
  read_as(name, begin, count, native_type<T>(), out);
}

#define JADE_HDF5_TYPE(T)                                                                         \
  template void Hdf5File::read<T>(const std::string&, int64_t, int64_t, T*) const;                \
  template void Hdf5File::read_field<T>(const std::string&, const std::string&, int64_t, int64_t, \
                                        T*) const;                                                \
  template void Hdf5File::read_column<T>(const std::string&, size_t, int64_t, int64_t, int64_t,   \
                                         T*) const;
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
