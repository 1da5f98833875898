// SPDX-License-Identifier: Apache-2.0
// The header of a .ply and access to its elements. Private to this folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <torch/types.h>
#include <vector>

namespace jade::gaussians {

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;  ///< of the items, for a list
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  ///< for a list only
};

struct PlyElement {
  std::string name;
  int64_t count = 0;
  std::vector<PlyProperty> properties;

  /// Index of a property, or -1.
  int64_t find(const std::string& property) const;
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  std::vector<std::string> comments;
  size_t size = 0;  ///< bytes before the first element
};

/// The header line of a file of Gaussians that says whether they are antialiased.
std::string render_mode_line(bool antialiased);

/// A .ply file in memory.
class PlyFile {
 public:
  /// Reads the file and its header. @throws DataError naming the path.
  explicit PlyFile(const std::filesystem::path& path);

  const std::filesystem::path& path() const { return path_; }
  const PlyHeader& header() const { return header_; }
  const PlyElement& vertices() const { return header_.elements[vertex_]; }
  /// True if the header has render_mode_line(true); the comment may have other words around it.
  bool says_antialiased() const;
  /// A warning if the file has more bytes than its header announces; else empty.
  std::string trailing_warning() const;
  /// The first element of that name, or nullptr.
  const PlyElement* element(const std::string& name) const;

  /// The named vertex properties as [count, names], float32 or float64; all must exist and be
  /// scalars.
  /// @throws DataError if the file ends early.
  torch::Tensor read_vertices(const std::vector<std::string>& names,
                              torch::ScalarType type = torch::kFloat32) const;
  /// Reads properties of any element without lists. float64 represents every 32-bit integer.
  torch::Tensor read(const PlyElement& element, const std::vector<std::string>& names,
                     torch::ScalarType type) const;

 private:
  std::string_view data_of(const PlyElement& element) const;
  std::string_view data_behind(const PlyElement& element, std::string_view data) const;
  template <class T>
  void decode(const PlyElement& element, std::string_view data, const std::vector<int64_t>& column,
              T* out) const;
  template <class T>
  void decode_binary(const PlyElement& element, std::string_view data,
                     const std::vector<int64_t>& column, T* out) const;
  template <class T>
  void decode_ascii(const PlyElement& element, std::string_view data,
                    const std::vector<int64_t>& column, T* out) const;

  std::filesystem::path path_;
  std::string content_;
  PlyHeader header_;
  size_t vertex_ = 0;
};

}  // namespace jade::gaussians
