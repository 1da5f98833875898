// SPDX-License-Identifier: Apache-2.0
// NumPy's .npy and .npz files as tensors.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <torch/types.h>
#include <utility>
#include <vector>

namespace jade::io {

using NamedTensors = std::vector<std::pair<std::string, torch::Tensor>>;

/// Reads one array: bool, signed and unsigned integers, float16/32/64, either byte order, C or
/// Fortran order (the result is contiguous in C order). uint16 becomes int32, uint32 and uint64
/// become int64, because LibTorch supports few operations on unsigned types.
/// @throws DataError naming the path if the file is missing, truncated or longer than its header
///   says, or contains Python objects, records, or a uint64 above 2^63.
torch::Tensor read_npy(const std::filesystem::path& path);

/// Reads an array from bytes in memory; `name` is the path in messages.
torch::Tensor parse_npy(const void* bytes, size_t size, const std::string& name);

/// Reads an array that may contain records: one tensor [N] for each field that is a single number,
/// in the order of the record; other fields are skipped. Plain numbers are one tensor without a
/// name.
/// @throws DataError as read_npy, and for records in more than one dimension, or nested records.
NamedTensors read_npy_fields(const std::filesystem::path& path);

/// Parses bytes in memory; `name` is the path in messages.
NamedTensors parse_npy_fields(const void* bytes, size_t size, const std::string& name);

/// Writes a tensor of any strides and device as C-ordered .npy (format 1.0), to a temporary name
/// that is then renamed, so that readers never see a partial file.
/// @throws DataError.
void write_npy(const std::filesystem::path& path, const torch::Tensor& tensor);

/// An .npz archive. Entries are decoded on request, so that unsupported entries do no harm unless
/// they are needed.
class Npz {
 public:
  /// @throws DataError if the file is missing or not a zip archive.
  explicit Npz(const std::filesystem::path& path);

  /// Names of the arrays, without ".npy", in archive order.
  const std::vector<std::string>& names() const { return names_; }
  bool has(const std::string& name) const;
  /// @throws DataError as read_npy, and if there is no such array.
  torch::Tensor read(const std::string& name) const;

 private:
  std::filesystem::path path_;
  std::vector<std::string> names_;
};

/// Reads an array of an .npz archive like read_npy_fields(). @throws DataError if there is no such
/// array.
NamedTensors read_npz_fields(const std::filesystem::path& path, const std::string& name);

/// Writes a compressed archive, in the given order. @throws DataError.
void write_npz(const std::filesystem::path& path, const NamedTensors& arrays);

}  // namespace jade::io
