// SPDX-License-Identifier: Apache-2.0
#include "jade/io/hdf5_chunks.h"

#include "support/catch.h"

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/hdf5.h"
#include "jade/io/hdf5_types.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kCount = 10000, kChunk = 1024;

/// Data sets of event-like numbers, stored in several ways.
void write_file_of(const fs::path& path) {
  std::mt19937 random(7);
  std::vector<int64_t> t(kCount);
  std::vector<uint16_t> x(kCount);
  std::vector<double> y(kCount);
  for (size_t i = 0; i < t.size(); ++i) {
    t[i] = (i > 0 ? t[i - 1] : -5000) + int64_t(random() % 9);
    x[i] = uint16_t(random() % 1280);
    y[i] = -0.37 * double(random() % 100000);
  }
  const Hdf5Id file(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  const auto add = [&](const char* name, hid_t type, const void* values, bool shuffle, bool check) {
    const hsize_t count = kCount, chunk = kChunk;
    const Hdf5Id space(H5Screate_simple(1, &count, nullptr)), how(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_chunk(how, 1, &chunk);
    if (shuffle) H5Pset_shuffle(how);
    H5Pset_deflate(how, 4);
    if (check) H5Pset_fletcher32(how);
    const Hdf5Id set(H5Dcreate2(file, name, type, space, H5P_DEFAULT, how, H5P_DEFAULT));
    REQUIRE(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
  };
  add("t", H5T_NATIVE_INT64, t.data(), true, false);
  add("x", H5T_NATIVE_UINT16, x.data(), true, false);
  add("y", H5T_NATIVE_DOUBLE, y.data(), false, false);
  add("checked", H5T_NATIVE_INT64, t.data(), true, true);
}

/// The values as the library itself reads them, or none if it cannot.
template <class T>
std::optional<std::vector<T>> read_by_library(const Hdf5Id& set, int64_t begin, int64_t count,
                                              hid_t type) {
  std::vector<T> out(static_cast<size_t>(count));
  const auto start = static_cast<hsize_t>(begin), extent = static_cast<hsize_t>(count);
  const Hdf5Id space(H5Dget_space(set)), memory(H5Screate_simple(1, &extent, nullptr));
  H5Sselect_hyperslab(space, H5S_SELECT_SET, &start, nullptr, &extent, nullptr);
  if (H5Dread(set, type, memory, space, H5P_DEFAULT, out.data()) < 0) return std::nullopt;
  return out;
}

template <class T>
void check_same(const Hdf5Id& file, const char* name, hid_t type, bool is_read) {
  const Hdf5Id set(H5Dopen2(file, name, H5P_DEFAULT));
  for (const auto& [begin, end] : {std::pair<int64_t, int64_t>{0, kCount},
                                   {1, kCount - 1},
                                   {kChunk, 4 * kChunk},
                                   {kChunk - 1, 3 * kChunk + 1}}) {
    CAPTURE(name, begin, end);
    std::vector<T> out(static_cast<size_t>(end - begin));
    REQUIRE(read_deflated(set, begin, end - begin, type, out.data()) == is_read);
    if (is_read) CHECK(out == *read_by_library<T>(set, begin, end - begin, type));
  }
}

Hdf5Id open_quietly(const fs::path& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  return Hdf5Id(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
}

TEST_CASE("hdf5 chunks: values are those that the library reads, as stored and converted", "[io]") {
  const test::TempDir folder;
  write_file_of(folder / "e.h5");
  const Hdf5Id file = open_quietly(folder / "e.h5");
  check_same<int64_t>(file, "t", H5T_NATIVE_INT64, true);
  check_same<double>(file, "t", H5T_NATIVE_DOUBLE, true);
  check_same<uint16_t>(file, "x", H5T_NATIVE_UINT16, true);
  check_same<float>(file, "x", H5T_NATIVE_FLOAT, true);
  check_same<int64_t>(file, "x", H5T_NATIVE_INT64, true);
  check_same<double>(file, "y", H5T_NATIVE_DOUBLE, true);
  check_same<int64_t>(file, "y", H5T_NATIVE_INT64, true);
}

TEST_CASE("hdf5 chunks: other filters, narrower types and few chunks are left to the library",
          "[io]") {
  const test::TempDir folder;
  write_file_of(folder / "e.h5");
  const Hdf5Id file = open_quietly(folder / "e.h5");
  check_same<int64_t>(file, "checked", H5T_NATIVE_INT64, false);
  check_same<int32_t>(file, "t", H5T_NATIVE_INT32, false);
  const Hdf5Id set(H5Dopen2(file, "t", H5P_DEFAULT));
  std::vector<int64_t> out(2 * kChunk);
  CHECK_FALSE(read_deflated(set, 0, 2 * kChunk, H5T_NATIVE_INT64, out.data()));
}

TEST_CASE("hdf5 chunks: a chunk that was never written is left to the library", "[io]") {
  const test::TempDir folder;
  write_file_of(folder / "e.h5");
  {
    const Hdf5Id file(H5Fopen((folder / "e.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT));
    const hsize_t count = kCount, chunk = kChunk;
    const Hdf5Id space(H5Screate_simple(1, &count, nullptr)), how(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_chunk(how, 1, &chunk);
    H5Pset_deflate(how, 4);
    const Hdf5Id set(
        H5Dcreate2(file, "empty", H5T_NATIVE_FLOAT, space, H5P_DEFAULT, how, H5P_DEFAULT));
  }
  check_same<float>(open_quietly(folder / "e.h5"), "empty", H5T_NATIVE_FLOAT, false);
}

TEST_CASE("hdf5 chunks: damage is reported as the library finds it", "[io]") {
  const test::TempDir folder;
  const fs::path path = folder / "e.h5";
  write_file_of(path);
  const std::string whole = read_file(path);
  std::vector<int64_t> values(kCount), out(kCount);
  Hdf5File(path).read("t", 0, kCount, values.data());
  std::mt19937 random(3);
  int64_t refused = 0;
  for (int round = 0; round < 60; ++round) {
    std::string bytes = whole;
    const size_t at = random() % bytes.size();
    bytes[at] = char(bytes[at] ^ (1U << random() % 8));
    write_file(path, bytes);
    const Hdf5Id file = open_quietly(path);
    const Hdf5Id set(H5Dopen2(file, "t", H5P_DEFAULT));
    if (!set.valid()) continue;
    CAPTURE(round, at);
    const auto expected = read_by_library<int64_t>(set, 0, kCount, H5T_NATIVE_INT64);
    if (read_deflated(set, 0, kCount, H5T_NATIVE_INT64, out.data())) {
      // The library returns other values if the size of its chunks is damaged.
      REQUIRE(expected);
      CHECK((out == *expected || out == values));
    }
    if (expected) continue;
    ++refused;
    CHECK_THROWS_WITH(Hdf5File(path).read("t", 0, kCount, out.data()),
                      Catch::Contains("'t' cannot be read; the file is truncated or damaged"));
  }
  CHECK(refused > 0);
}

}  // namespace
}  // namespace jade::io
