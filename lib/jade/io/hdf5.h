// SPDX-License-Identifier: Apache-2.0
// Reading and writing one-dimensional arrays of numbers in HDF5 files, such as event recordings.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace jade::io {

/// One array in a file, named by its path inside it without the leading slash ("x", "events/x").
struct Hdf5Dataset {
  std::string name;
  std::vector<int64_t> shape;
  bool integer = false;   ///< Integers, booleans and enumerations of any size and sign.
  bool floating = false;  ///< Neither: text, references, which cannot be read, or records.
  std::vector<std::string> fields;    ///< Names of a record's numbers; read_field reads them.
  std::vector<bool> floating_fields;  ///< Which of these are floats.
  std::vector<int64_t> field_sizes;   ///< Bytes of these.
  int64_t item_size = 0;              ///< Bytes of a stored value.
  /// Values in a chunk of a 1-D array, rows in one of a 2-D array; 0 if stored in one piece.
  int64_t chunk_length = 0;
  int64_t stored_bytes = 0;  ///< Size in the file, after compression.
};

/// An HDF5 file open for reading. Use from one thread at a time. Messages of the HDF5 library are
/// silenced; every failure is a DataError that names the path and the data set.
class Hdf5File {
 public:
  /// @throws DataError if the file is missing, empty, truncated or no HDF5 file.
  explicit Hdf5File(const std::filesystem::path& path);
  ~Hdf5File();
  Hdf5File(Hdf5File&&) noexcept;
  Hdf5File& operator=(Hdf5File&&) noexcept;

  const std::filesystem::path& path() const { return path_; }
  /// All data sets in the file and its groups, sorted by name.
  const std::vector<Hdf5Dataset>& datasets() const { return datasets_; }
  bool has(const std::string& name) const;
  /// @throws DataError if there is no such data set; the message lists those that there are.
  const Hdf5Dataset& dataset(const std::string& name) const;
  /// An attribute of the file that is text; empty if there is none.
  std::string attribute(const std::string& name) const;
  /// An attribute of a data set, likewise.
  std::string attribute(const std::string& dataset, const std::string& name) const;
  /// Length of a one-dimensional data set of numbers or records of numbers; [N,1] and [1,N] count
  /// as such, and a single number without axes as a list of one.
  /// @throws DataError otherwise, or if the file is too small to hold that many values, so that
  ///         the result is safe to allocate.
  int64_t length(const std::string& name) const;

  /// Reads values [begin, begin+count) into `out`, converted to T; values that do not fit are
  /// clamped by HDF5, and floats lose their fraction when T is an integer. Nothing of the size of
  /// the array is allocated. Ranges that start at multiples of chunk_length are fastest.
  /// T: int8, uint8, int16, uint16, int32, uint32, int64, uint64, float, double.
  /// @throws DataError if the data cannot be decoded; a missing filter is named with its package.
  template <class T>
  void read(const std::string& name, int64_t begin, int64_t count, T* out) const;
  /// Reads one field of the records of `name`.
  template <class T>
  void read_field(const std::string& name, const std::string& field, int64_t begin, int64_t count,
                  T* out) const;
  /// Reads all values at place `index` of the first axis of a data set of numbers, as bytes.
  void read_item(const std::string& name, int64_t index, uint8_t* out) const;
  /// Reads values [begin, begin+count) of a two-dimensional data set of numbers along the other
  /// axis at place `index` of `axis` (0 or 1).
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

/// Writes one-dimensional data sets, chunked and compressed with shuffle and gzip. The file gets
/// its name in close(); without it (after an exception, say) nothing is left behind.
class Hdf5Writer {
 public:
  /// @throws DataError if the file cannot be made.
  explicit Hdf5Writer(const std::filesystem::path& path, int gzip_level = 4);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  /// Adds values at the end of the data set `name`, which the first call makes with T as its
  /// stored type, together with the groups of its path. Same types as Hdf5File::read.
  template <class T>
  void append(const std::string& name, const T* values, int64_t count);
  /// Sets an attribute of the file. @throws DataError.
  void attribute(const std::string& name, const std::string& value);
  /// Sets an attribute of a data set that append() has made. @throws DataError.
  void attribute(const std::string& dataset, const std::string& name, const std::string& value);
  /// Finishes the file. @throws DataError if it cannot be written to the end.
  void close();

 private:
  void append_as(const std::string& name, int64_t type, const void* values, int64_t count);
  struct Handle;
  std::filesystem::path path_;
  std::unique_ptr<Handle> handle_;
};

}  // namespace jade::io
