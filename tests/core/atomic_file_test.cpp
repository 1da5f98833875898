// SPDX-License-Identifier: Apache-2.0
#include "jade/core/atomic_file.h"

#include "support/catch.h"

#include <fstream>

#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade {
namespace {

TEST_CASE("AtomicFile: without commit the old content stays and no trace is left", "[core]") {
  const test::TempDir dir;
  const auto path = dir.write("file.txt", "old");
  {
    AtomicFile file(path);
    std::ofstream(file.temporary_path()) << "new";
  }
  CHECK(read_file(path) == "old");
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
  write_file(path, "new");
  CHECK(read_file(path) == "new");
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
}

TEST_CASE("files: what cannot be written or read is a DataError that names the path", "[core]") {
  const test::TempDir dir;
  const auto file = dir.write("file.txt", "x");
  CHECK_THROWS_AS(AtomicFile(dir.path() / "missing" / "a.txt"), DataError);
  CHECK_THROWS_WITH(make_writable_folder(file / "sub"), Catch::Contains("file.txt"));
  CHECK_THROWS_WITH(read_file(dir.path()), Catch::Contains(dir.path().string()));
  CHECK_THROWS_AS(write_file("/dev/full/x", "content"), DataError);
}

}  // namespace
}  // namespace jade
