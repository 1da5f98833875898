// SPDX-License-Identifier: Apache-2.0
#include "jade/io/hdf5.h"

#include "support/catch.h"

#include <hdf5.h>
#include <numeric>
#include <string>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

std::vector<int64_t> ramp(int64_t count) {
  std::vector<int64_t> values(static_cast<size_t>(count));
  std::iota(values.begin(), values.end(), 0);
  return values;
}

void write_ramp(const std::filesystem::path& path, int64_t count) {
  const std::vector<int64_t> values = ramp(count);
  Hdf5Writer writer(path);
  writer.append("events/t", values.data(), count);
  writer.close();
}

TEST_CASE("hdf5: values appended in pieces are restored whole and in ranges", "[io]") {
  const test::TempDir folder;
  const std::vector<int64_t> t = ramp(200000);
  const std::vector<float> x(t.begin(), t.end());
  {
    Hdf5Writer writer(folder / "e.h5");
    for (int64_t begin = 0; begin < 200000; begin += 70000) {
      const int64_t count = std::min<int64_t>(70000, 200000 - begin);
      writer.append("events/t", t.data() + begin, count);
      writer.append("events/x", x.data() + begin, count);
    }
    writer.close();
  }
  const Hdf5File file(folder / "e.h5");
  REQUIRE(file.datasets().size() == 2);
  CHECK(file.datasets()[0].name == "events/t");
  CHECK(file.dataset("events/t").integer);
  CHECK(file.dataset("events/x").floating);
  CHECK(file.dataset("events/t").chunk_length > 0);
  REQUIRE(file.length("events/t") == 200000);
  std::vector<int64_t> back(200000);
  file.read("events/t", 0, 200000, back.data());
  CHECK(back == t);
  std::vector<int64_t> part(3);
  file.read("events/t", 131071, 3, part.data());
  CHECK(part == std::vector<int64_t>{131071, 131072, 131073});
}

TEST_CASE("hdf5: values are converted to the type asked for", "[io]") {
  const test::TempDir folder;
  const std::vector<uint16_t> x = {0, 1, 345, 65535};
  const std::vector<double> t = {0.0, 1.75, -2.5, 1e12};
  {
    Hdf5Writer writer(folder / "e.h5");
    writer.append("x", x.data(), 4);
    writer.append("t", t.data(), 4);
    writer.close();
  }
  const Hdf5File file(folder / "e.h5");
  std::vector<float> as_float(4);
  file.read("x", 0, 4, as_float.data());
  CHECK(as_float == std::vector<float>{0, 1, 345, 65535});
  std::vector<int64_t> as_integer(4);
  file.read("t", 0, 4, as_integer.data());
  CHECK(as_integer == std::vector<int64_t>{0, 1, -2, 1000000000000});
}

TEST_CASE("hdf5: an empty data set has length 0", "[io]") {
  const test::TempDir folder;
  write_ramp(folder / "e.h5", 0);
  const Hdf5File file(folder / "e.h5");
  CHECK(file.length("events/t") == 0);
  file.read<int64_t>("events/t", 0, 0, nullptr);
}

TEST_CASE("hdf5: a single number without axes is a list of one, a null space an empty one",
          "[io]") {
  const test::TempDir folder;
  const hid_t raw = H5Fcreate((folder / "e.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const int64_t offset = 57735321581;
  for (const auto& [name, kind] : {std::pair{"t_offset", H5S_SCALAR}, {"nothing", H5S_NULL}}) {
    const hid_t space = H5Screate(kind);
    const hid_t set =
        H5Dcreate2(raw, name, H5T_STD_I64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (kind == H5S_SCALAR) {
      REQUIRE(H5Dwrite(set, H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &offset) >= 0);
    }
    H5Dclose(set);
    H5Sclose(space);
  }
  H5Fclose(raw);
  const Hdf5File file(folder / "e.h5");
  REQUIRE(file.length("t_offset") == 1);
  int64_t back = 0;
  file.read("t_offset", 0, 1, &back);
  CHECK(back == offset);
  CHECK(file.length("nothing") == 0);
}

TEST_CASE("hdf5: missing, empty, foreign and truncated files are data errors with the path",
          "[io]") {
  const test::TempDir folder;
  CHECK_THROWS_WITH(Hdf5File(folder / "none.h5"), Catch::Contains("none.h5"));
  write_file(folder / "empty.h5", "");
  CHECK_THROWS_WITH(Hdf5File(folder / "empty.h5"), Catch::Contains("empty"));
  write_file(folder / "text.h5", "0.001 12 13 1\n");
  CHECK_THROWS_AS(Hdf5File(folder / "text.h5"), DataError);
  write_ramp(folder / "e.h5", 100000);
  const std::string whole = read_file(folder / "e.h5");
  for (const size_t size : {whole.size() - 1, whole.size() / 2, size_t{100}, size_t{8}}) {
    write_file(folder / "cut.h5", whole.substr(0, size));
    CHECK_THROWS_AS(Hdf5File(folder / "cut.h5"), DataError);
  }
}

TEST_CASE("hdf5: an encoding of a later library is named with the library's version", "[io]") {
  const test::TempDir folder;
  const std::vector<uint16_t> values{1, 2, 3};
  Hdf5Writer writer(folder / "e.h5");
  writer.append("events/p", values.data(), 3);
  writer.close();
  // The message of the type: class and version, flags, 2 bytes, bits 0 to 16.
  std::string bytes = read_file(folder / "e.h5");
  const size_t at = bytes.find(std::string("\x10\0\0\0\2\0\0\0\0\0\x10\0", 12));
  REQUIRE(at != std::string::npos);
  bytes[at] = '\xF0';
  write_file(folder / "e.h5", bytes);
  CHECK_THROWS_NAMING(DataError, Hdf5File(folder / "e.h5"), "e.h5", "events/p", "libver",
                      concat("HDF5 ", H5_VERS_MAJOR, "."));
}

TEST_CASE("hdf5: a missing data set is named together with those present", "[io]") {
  const test::TempDir folder;
  write_ramp(folder / "e.h5", 10);
  const Hdf5File file(folder / "e.h5");
  CHECK_FALSE(file.has("events/x"));
  CHECK_THROWS_WITH(file.length("events/x"),
                    Catch::Contains("'events/x'") && Catch::Contains("events/t"));
}

TEST_CASE("hdf5: a writer that is not closed leaves no file and keeps the old one", "[io]") {
  const test::TempDir folder;
  write_ramp(folder / "e.h5", 10);
  {
    Hdf5Writer writer(folder / "e.h5");
    const std::vector<int64_t> values = ramp(5);
    writer.append("events/t", values.data(), 5);
  }
  CHECK(Hdf5File(folder / "e.h5").length("events/t") == 10);
  int64_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    ++files;
  }
  CHECK(files == 1);
  CHECK_THROWS_AS(Hdf5Writer(folder / "none/e.h5"), DataError);
}

TEST_CASE("hdf5: files that once brought libhdf5 down are refused", "[io]") {
  // Both found by fuzzing (scripts/fuzz.sh hdf5): a null pointer inside libhdf5 1.10, and a huge
  // allocation.
  for (const char* name : {"null_pointer.h5", "huge_allocation.h5"}) {
    INFO(name);
    const std::filesystem::path path = std::filesystem::path(JADE_TEST_FOLDER) / "damaged" / name;
    const auto read_all = [&] {
      const Hdf5File file(path);
      for (const Hdf5Dataset& dataset : file.datasets()) {
        const int64_t count = std::min<int64_t>(file.length(dataset.name), 1 << 20);
        std::vector<int64_t> values(static_cast<size_t>(count));
        file.read(dataset.name, 0, count, values.data());
      }
    };
    CHECK_THROWS_AS(read_all(), DataError);
  }
}

}  // namespace
}  // namespace jade::io
