// SPDX-License-Identifier: Apache-2.0
#include "jade/io/zip.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
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

}  // namespace
}  // namespace jade::io
