// SPDX-License-Identifier: Apache-2.0
#include "jade/io/npy.h"

#include "support/catch.h"

#include <fstream>
#include <string>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

/// A .npy file as NumPy writes it, with any header and data.
std::string npy_bytes(const std::string& header, const std::string& data) {
  std::string out("\x93NUMPY\x01\x00", 8);
  out += static_cast<char>(header.size() & 0xff);
  out += static_cast<char>(header.size() >> 8);
  return out + header + data;
}

std::string describe(const std::string& descr, const std::string& shape,
                     const std::string& fortran = "False") {
  return "{'descr': '" + descr + "', 'fortran_order': " + fortran + ", 'shape': " + shape + ", }\n";
}

torch::Tensor parse(const std::string& bytes) {
  return parse_npy(bytes.data(), bytes.size(), "a.npy");
}

TEST_CASE("npy: every numeric dtype is restored as written", "[io]") {
  const test::TempDir folder;
  for (const auto dtype : {torch::kBool, torch::kUInt8, torch::kInt8, torch::kInt16, torch::kInt32,
                           torch::kInt64, torch::kFloat16, torch::kFloat32, torch::kFloat64}) {
    const torch::Tensor values = torch::arange(24).reshape({2, 3, 4}).to(dtype);
    write_npy(folder / "a.npy", values);
    const torch::Tensor back = read_npy(folder / "a.npy");
    CHECK(back.scalar_type() == dtype);
    CHECK(torch::equal(back, values));
  }
}

TEST_CASE("npy: scalars, empty arrays and transposed tensors are restored as written", "[io]") {
  const test::TempDir folder;
  const torch::Tensor matrix = torch::arange(6).reshape({2, 3});
  for (const torch::Tensor& values : {torch::tensor(2.5), torch::empty({0}), torch::empty({5, 0}),
                                      torch::arange(1), matrix.t()}) {
    write_npy(folder / "a.npy", values);
    const torch::Tensor back = read_npy(folder / "a.npy");
    CHECK(back.sizes() == values.sizes());
    CHECK(torch::equal(back, values));
  }
}

TEST_CASE("npy: the data start at a multiple of 64 bytes, as NumPy has it", "[io]") {
  const test::TempDir folder;
  write_npy(folder / "a.npy", torch::zeros({7}, torch::kUInt8));
  CHECK((std::filesystem::file_size(folder / "a.npy") - 7) % 64 == 0);
}

TEST_CASE("npy: Fortran order and big-endian values are understood", "[io]") {
  const std::string data("\x00\x01\x00\x02\x00\x03\x00\x04\x00\x05\x00\x06", 12);
  const torch::Tensor c_order = parse(npy_bytes(describe(">i2", "(2, 3)"), data));
  CHECK(torch::equal(c_order, torch::arange(1, 7, torch::kInt16).reshape({2, 3})));
  const torch::Tensor fortran = parse(npy_bytes(describe(">i2", "(2, 3)", "True"), data));
  CHECK(torch::equal(fortran, torch::arange(1, 7, torch::kInt16).reshape({3, 2}).t()));
  CHECK(fortran.is_contiguous());
}

TEST_CASE("npy: unsigned values keep their value in a wider type", "[io]") {
  const torch::Tensor u2 = parse(npy_bytes(describe("<u2", "(1,)"), "\xff\xff"));
  CHECK(u2.scalar_type() == torch::kInt32);
  CHECK(u2.item<int64_t>() == 65535);
  const torch::Tensor u4 = parse(npy_bytes(describe("<u4", "(1,)"), "\xff\xff\xff\xff"));
  CHECK(u4.item<int64_t>() == 4294967295);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<u8", "(1,)"), std::string(8, '\xff'))), DataError);
}

TEST_CASE("npy: damaged files are refused with the path and what is wrong", "[io]") {
  const std::string eight(8, '\0');
  CHECK_THROWS_AS(parse(""), DataError);
  CHECK_THROWS_AS(parse("\x93NUMPY"), DataError);
  CHECK_THROWS_AS(parse("PK\x03\x04 something else"), DataError);
  CHECK_THROWS_AS(parse(npy_bytes("{}", eight)), DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f8", "(2,)"), eight)), DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f4", "(1,)"), eight)), DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f8", "(4611686018427387904, 4)"), eight)), DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f8", "(0, 1099511627776, 1099511627776)"), eight)),
                  DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f8", "(0, 1099511627776, 1099511627776)"), "")),
                  DataError);
  CHECK(parse(npy_bytes(describe("<f8", "(0, 1099511627776)"), "")).size(1) == 1099511627776);
  CHECK_THROWS_AS(parse(npy_bytes(describe("|O", "(1,)"), eight)), DataError);
  CHECK_THROWS_AS(parse(npy_bytes(describe("<f8", "(1"), eight)), DataError);
  CHECK_THROWS_WITH(parse(npy_bytes(describe("<f8", "(2,)"), eight)),
                    Catch::Contains("a.npy") && Catch::Contains("truncated"));
}

TEST_CASE("npy: a missing file and a missing folder are data errors", "[io]") {
  const test::TempDir folder;
  CHECK_THROWS_AS(read_npy(folder / "none.npy"), DataError);
  CHECK_THROWS_AS(write_npy(folder / "none/a.npy", torch::zeros({1})), DataError);
}

TEST_CASE("npz: arrays are restored by name", "[io]") {
  const test::TempDir folder;
  const torch::Tensor times = torch::arange(5) * 1000;
  const torch::Tensor noise = torch::rand({300, 40}, torch::kFloat64);
  write_npz(folder / "a.npz", {{"timestamps", times}, {"noise", noise}});
  const Npz archive(folder / "a.npz");
  CHECK(archive.names() == std::vector<std::string>{"timestamps", "noise"});
  CHECK(torch::equal(archive.read("timestamps"), times));
  CHECK(torch::equal(archive.read("noise"), noise));
  CHECK_THROWS_WITH(archive.read("start"),
                    Catch::Contains("'start'") && Catch::Contains("timestamps, noise"));
}

TEST_CASE("npz: empty, truncated and missing archives are data errors", "[io]") {
  const test::TempDir folder;
  write_file(folder / "empty.npz", "");
  CHECK_THROWS_AS(Npz(folder / "empty.npz"), DataError);
  CHECK_THROWS_AS(Npz(folder / "none.npz"), DataError);
  write_npz(folder / "a.npz", {{"noise", torch::rand({1000})}});
  const std::string whole = read_file(folder / "a.npz");
  write_file(folder / "cut.npz", whole.substr(0, whole.size() / 2));
  CHECK_THROWS_AS(Npz(folder / "cut.npz").read("noise"), DataError);
  std::string flipped = whole;
  flipped[flipped.size() / 2] ^= 0x55;
  write_file(folder / "flipped.npz", flipped);
  CHECK_THROWS_AS(Npz(folder / "flipped.npz").read("noise"), DataError);
}

/// A file of this type and shape as numpy.save writes it.
std::string npy_bytes(const std::string& type, const std::string& shape, const std::string& data) {
  std::string header =
      "{'descr': " + type + ", 'fortran_order': False, 'shape': " + shape + ", }\n";
  std::string out("\x93NUMPY\x01\x00", 8);
  out += char(header.size() & 0xff);
  out += char(header.size() >> 8);
  return out + header + data;
}

TEST_CASE("npy: records come as one list a field, whatever lies between", "[io]") {
  const test::TempDir folder;
  const std::string type =
      "[('x', '<u2'), ('', '|V2'), ('big', '>u4'), ('name', '<U1'), ('pair', '<i2', (2,)), ('t', "
      "'<i8')]";
  std::string data;
  for (int i = 0; i < 3; ++i) {
    data += std::string{char(i + 1), char(0x80)};                   // x
    data += "??";                                                   // padding
    data += std::string{0, 1, 0, char(i)};                          // big
    data += std::string{'a', 0, 0, 0} + std::string{9, 9, 9, 9};    // name, pair
    data += std::string{char(-1 - i), -1, -1, -1, -1, -1, -1, -1};  // t
  }
  write_file(folder / "a.npy", npy_bytes(type, "(3,)", data));
  const NamedTensors fields = read_npy_fields(folder / "a.npy");
  REQUIRE(fields.size() == 3);
  CHECK((fields[0].first == "x" && fields[1].first == "big" && fields[2].first == "t"));
  CHECK(torch::equal(fields[0].second, torch::tensor({32769, 32770, 32771}, torch::kInt32)));
  CHECK(torch::equal(fields[1].second, torch::tensor({65536, 65537, 65538}, torch::kInt64)));
  CHECK(torch::equal(fields[2].second, torch::tensor({-1, -2, -3}, torch::kInt64)));
  CHECK_THROWS_AS(read_npy(folder / "a.npy"), DataError);
  write_npy(folder / "plain.npy", torch::arange(4));
  const NamedTensors plain = read_npy_fields(folder / "plain.npy");
  CHECK((plain.size() == 1 && plain[0].first.empty() && plain[0].second.numel() == 4));
}

TEST_CASE("npy: damaged records are data errors with the path", "[io]") {
  const test::TempDir folder;
  const std::string data(12, '\0');
  for (const auto& [type, shape] : std::vector<std::pair<std::string, std::string>>{
           {"[('x', '<u2'), ('t', '<i8')]", "(2,)"},  // cut short
           {"[('x', '<u2'), ('t', '<i8')", "(1,)"},   // without an end
           {"[('x', '<u4'), ('t', [('a', '<i8')])]", "(1,)"},
           {"[('x', '|O'), ('t', '<i4')]", "(1,)"},
           {"[('x', '|S12')]", "(1,)"},  // no number
           {"[('x', '<i4', (99999999, 99999999))]", "(1,)"},
           {"[('x', '<i4'), ('t', '<i8')]", "(1, 1)"},
           {"[]", "(1,)"}}) {
    INFO(type);
    write_file(folder / "d.npy", npy_bytes(type, shape, data));
    CHECK_THROWS_WITH(read_npy_fields(folder / "d.npy"), Catch::Contains("d.npy"));
  }
}

}  // namespace
}  // namespace jade::io
