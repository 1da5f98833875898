// SPDX-License-Identifier: Apache-2.0
#include "jade/io/hdf5.h"

#include <algorithm>
#include <cstring>
#include <hdf5.h>
#include <map>
#include <utility>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/ecf.h"
#include "jade/io/hdf5_chunks.h"
#include "jade/io/hdf5_driver.h"
#include "jade/io/hdf5_id.h"
#include "jade/io/stand_in.h"

namespace jade::io {
namespace {

// HDF5's predefined types are macros over variables set at run time, hence functions.
template <class T>
hid_t native_type();
// clang-format off
template <> hid_t native_type<int8_t>() { return H5T_NATIVE_INT8; }
template <> hid_t native_type<uint8_t>() { return H5T_NATIVE_UINT8; }
template <> hid_t native_type<int16_t>() { return H5T_NATIVE_INT16; }
template <> hid_t native_type<uint16_t>() { return H5T_NATIVE_UINT16; }
template <> hid_t native_type<int32_t>() { return H5T_NATIVE_INT32; }
template <> hid_t native_type<uint32_t>() { return H5T_NATIVE_UINT32; }
template <> hid_t native_type<int64_t>() { return H5T_NATIVE_INT64; }
template <> hid_t native_type<uint64_t>() { return H5T_NATIVE_UINT64; }
template <> hid_t native_type<float>() { return H5T_NATIVE_FLOAT; }
template <> hid_t native_type<double>() { return H5T_NATIVE_DOUBLE; }
// clang-format on

/// Must run before any other call. The library prints its error stack to stderr unless disabled per
/// thread. At exit it closes again what a full disk prevented it from closing, which crashes;
/// disable that, because each file's owner closes it.
void prepare_hdf5() {
  static const herr_t without_end = H5dont_atexit();  // only effective before the first H5open()
  static_cast<void>(without_end);
  H5open();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

bool is_numeric(const Hdf5Dataset& dataset) { return dataset.integer || dataset.floating; }

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

/// False if it is damaged.
/// @throws DataError if its encoding is newer than the library.
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

/// Describes the first filter of a data set that this installation lacks; empty if none.
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

/// Largest possible compression ratio of a data set: deflate reaches 1032, LZF less; only filters
/// from plug-ins may exceed it.
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

bool write_text(hid_t object, const std::string& name, const std::string& value) {
  const Hdf5Id space(H5Screate(H5S_SCALAR));
  const Hdf5Id type(H5Tcopy(H5T_C_S1));
  H5Tset_size(type, value.size() + 1);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const Hdf5Id attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT));
  return attribute.valid() && H5Awrite(attribute, type, value.c_str()) >= 0;
}

}  // namespace

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

void Hdf5File::read_item(const std::string& name, int64_t index, uint8_t* out) const {
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
  read_space(name, id, selected ? hid_t(file_space) : hid_t(-1), count, H5T_NATIVE_UINT8, out);
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

template <class T>
void Hdf5File::read(const std::string& name, int64_t begin, int64_t count, T* out) const {
  read_as(name, begin, count, native_type<T>(), out);
}

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

void Hdf5Writer::attribute(const std::string& name, const std::string& value) {
  if (write_text(handle_->file, name, value)) return;
  throw DataError(concat(path_.string(), ": attribute '", name, "' cannot be written"));
}

void Hdf5Writer::attribute(const std::string& dataset, const std::string& name,
                           const std::string& value) {
  const auto found = handle_->datasets.find(dataset);
  if (found != handle_->datasets.end() && write_text(found->second, name, value)) return;
  throw DataError(
      concat(path_.string(), ": attribute '", name, "' of '", dataset, "' cannot be written"));
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

#define JADE_HDF5_TYPE(T)                                                                         \
  template void Hdf5File::read<T>(const std::string&, int64_t, int64_t, T*) const;                \
  template void Hdf5File::read_field<T>(const std::string&, const std::string&, int64_t, int64_t, \
                                        T*) const;                                                \
  template void Hdf5File::read_column<T>(const std::string&, size_t, int64_t, int64_t, int64_t,   \
                                         T*) const;                                               \
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
