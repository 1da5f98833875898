// SPDX-License-Identifier: Apache-2.0
// Reading and writing one-dimensional arrays of numbers in HDF5 files, such as event recordings.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace jade::io {

/// One array in a file, named by its path inside it without the leading slash ("x", "events/x").
struct Hdf5Dataset {
  std::string name;
  std::vector<int64_t> shape;
  bool integer = false;   ///< Integers, booleans and enumerations of any size and sign.
  bool floating = false;  ///< Neither integer nor floating: text and references, which cannot be
                          ///< read, or records.
  std::vector<std::string> fields;    ///< Names of a record's numbers; read_field reads them.
  std::vector<bool> floating_fields;  ///< Whether each of these is a float.
  std::vector<int64_t> field_sizes;   ///< Size of each in bytes.
  int64_t item_size = 0;              ///< Size of a stored value in bytes.
  /// Values per chunk of a 1-D array, rows per chunk of a 2-D array; 0 if contiguous.
  int64_t chunk_length = 0;
  int64_t stored_bytes = 0;  ///< Size in the file, after compression.
};

/// An HDF5 file open for reading. Use from one thread at a time. Messages of the HDF5 library are
/// silenced; every failure is a DataError that names the path and the data set.
class Hdf5File {
 public:
  /// @throws DataError if the file is missing, empty, truncated or not HDF5.
  explicit Hdf5File(const std::filesystem::path& path);
  ~Hdf5File();
  Hdf5File(Hdf5File&&) noexcept;
  Hdf5File& operator=(Hdf5File&&) noexcept;

  const std::filesystem::path& path() const { return path_; }
  /// All data sets in the file and its groups, sorted by name.
  const std::vector<Hdf5Dataset>& datasets() const { return datasets_; }
  bool has(const std::string& name) const;
  /// @throws DataError if there is no such data set; the message lists the existing ones.
  const Hdf5Dataset& dataset(const std::string& name) const;
  /// A text attribute of the file; empty if there is none.
  std::string attribute(const std::string& name) const;
  /// A text attribute of a data set; empty if there is none.
  std::string attribute(const std::string& dataset, const std::string& name) const;
  /// An attribute of a data set that is one number; no value if there is none.
  std::optional<double> number(const std::string& dataset, const std::string& name) const;
  /// Length of a one-dimensional data set of numbers or records of numbers; [N,1], [1,N] and a
  /// scalar count as one-dimensional.
  /// @throws DataError otherwise, or if the file is too small for that many values, so that the
  ///   result is safe to allocate.
  int64_t length(const std::string& name) const;

  /// Reads values [begin, begin+count) into `out`, converted to T; HDF5 clamps values that do not
  /// fit, and truncates floats to integers. Allocates nothing of the size of the array. Ranges that
  /// start at multiples of chunk_length are fastest.
  /// T: int8, uint8, int16, uint16, int32, uint32, int64, uint64, float, double.
  /// @throws DataError if the data cannot be decoded; for a missing filter it names the package.
  template <class T>
  void read(const std::string& name, int64_t begin, int64_t count, T* out) const;
  /// Reads one field of the records of `name`.
  template <class T>
  void read_field(const std::string& name, const std::string& field, int64_t begin, int64_t count,
                  T* out) const;
  /// Reads all values at `index` of the first axis of a data set of numbers, clamped to 16 bits.
  void read_item(const std::string& name, int64_t index, uint16_t* out) const;
  /// All values of a data set of numbers of any shape, clamped to 16 bits.
  /// @throws DataError if the file is too small for that many values.
  std::vector<uint16_t> read_pixels(const std::string& name) const;
  /// Reads values [begin, begin+count) along the other axis of a two-dimensional data set of
  /// numbers at `index` of `axis` (0 or 1).
  template <class T>
  void read_column(const std::string& name, size_t axis, int64_t index, int64_t begin,
                   int64_t count, T* out) const;

 private:
  void read_as(const std::string& name, int64_t begin, int64_t count, int64_t type,
               void* out) const;
  void read_column_as(const std::string& name, size_t axis, int64_t index, int64_t begin,
                      int64_t count, int64_t type, void* out) const;
  void check_size(const Hdf5Dataset& info, int64_t count) const;
  void read_space(const std::string& name, int64_t dataset, int64_t file_space, int64_t count,
                  int64_t type, void* out) const;
  struct Handle;
  std::filesystem::path path_;
  std::unique_ptr<Handle> handle_;
  std::vector<Hdf5Dataset> datasets_;
};

/// Writes one-dimensional data sets, chunked and compressed with shuffle and gzip. close() gives
/// the file its name; without it (for example, after an exception) no file remains.
class Hdf5Writer {
 public:
  /// @throws DataError if the file cannot be created.
  explicit Hdf5Writer(const std::filesystem::path& path, int gzip_level = 4);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  /// Appends values to the data set `name`. The first call creates it with T as its stored type,
  /// and the groups of its path. Supports the types of Hdf5File::read.
  template <class T>
  void append(const std::string& name, const T* values, int64_t count);
  /// Finishes the file. @throws DataError if it cannot be written completely.
  void close();

 private:
  void append_as(const std::string& name, int64_t type, const void* values, int64_t count);
  struct Handle;
  std::filesystem::path path_;
  std::unique_ptr<Handle> handle_;
};

}  // namespace jade::io
