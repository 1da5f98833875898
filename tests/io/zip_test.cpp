// SPDX-License-Identifier: Apache-2.0
#include "jade/io/zip.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

TEST_CASE("zip: entries are restored in their order, packed or as they are", "[io]") {
  const test::TempDir dir;
  const ZipEntries entries = {{"b.txt", std::string(5000, 'b')}, {"a/c.bin", {"\0\1\2", 3}}};
  write_zip(dir / "packed.zip", entries);
  write_zip(dir / "stored.zip", entries, ZipPacking::kStore);
  for (const char* const name : {"packed.zip", "stored.zip"}) {
    const Zip archive(dir / name);
    CHECK(archive.names() == std::vector<std::string>{"b.txt", "a/c.bin"});
    for (const auto& [entry, content] : entries) CHECK(archive.read(entry) == content);
  }
  CHECK(read_file(dir / "packed.zip").size() < 1000);
  CHECK(read_file(dir / "stored.zip").size() > 5000);
  CHECK_THROWS_WITH(Zip(dir / "packed.zip").read("d"), Catch::Contains("[d]: missing"));
}

TEST_CASE("zip: a packing method that is not read and a password are named", "[io]") {
  const test::TempDir dir;
  write_zip(dir / "a.zip", {{"b.txt", std::string(5000, 'b')}});
  const std::string whole = read_file(dir / "a.zip");
  const size_t central = whole.find("PK\x01\x02");
  REQUIRE(central != std::string::npos);
  // The flags and the method are in the header of the entry and in the directory.
  const auto changed = [&](size_t flags_or_method, char value) {
    std::string bytes = whole;
    bytes[6 + flags_or_method] = bytes[central + 8 + flags_or_method] = value;
    return Zip(dir.write("b.zip", bytes));
  };
  CHECK_THROWS_NAMING(DataError, changed(2, 9).read("b.txt"), "b.zip[b.txt]: expected", "Deflate64",
                      "pack it again");
  CHECK_THROWS_NAMING(DataError, changed(2, 77).read("b.txt"), "number 77");
  CHECK_THROWS_NAMING(DataError, changed(0, 1).read("b.txt"), "b.zip[b.txt]: expected", "password");
  std::string bytes = whole;
  bytes[bytes.find("b.txt") + 8] ^= 0x55;
  CHECK_THROWS_NAMING(DataError, Zip(dir.write("b.zip", bytes)).read("b.txt"), "damaged");
}

}  // namespace
}  // namespace jade::io
