// SPDX-License-Identifier: Apache-2.0
#include "jade/core/atomic_file.h"

#include "support/catch.h"

#include <fstream>

#include "jade/core/error.h"
#include "support/naming.h"
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

TEST_CASE("AtomicFile: a link stays, and its target is written", "[core]") {
  namespace fs = std::filesystem;
  const test::TempDir dir;
  dir.write("there/file.txt", "old");
  fs::create_symlink("there/file.txt", dir / "link");
  fs::create_symlink(dir / "link", dir / "far");
  fs::create_symlink("there/new.txt", dir / "dangling");
  fs::create_symlink("circle", dir / "circle");
  write_file(dir / "far", "new");
  write_file(dir / "dangling", "made");
  write_file(dir / "circle", "replaced");
  CHECK(fs::is_symlink(dir / "far"));
  CHECK(fs::is_symlink(dir / "link"));
  CHECK(read_file(dir / "there/file.txt") == "new");
  CHECK(fs::is_symlink(dir / "dangling"));
  CHECK(read_file(dir / "there/new.txt") == "made");
  CHECK(read_file(dir / "circle") == "replaced");
}

TEST_CASE("check_link: a link without its target is refused with both names", "[core]") {
  const test::TempDir dir;
  dir.write("file.txt", "old");
  std::filesystem::create_symlink("file.txt", dir / "link");
  std::filesystem::create_symlink("missing.txt", dir / "dangling");
  CHECK_NOTHROW(check_link(dir / "file.txt"));
  CHECK_NOTHROW(check_link(dir / "link"));
  CHECK_NOTHROW(check_link(dir / "none.txt"));
  CHECK_THROWS_NAMING(DataError, check_link(dir / "dangling"), "dangling", "missing.txt");
}

TEST_CASE("AtomicFolder: what is written appears with commit, else nothing is left", "[core]") {
  const test::TempDir dir;
  const auto path = dir.path() / "a" / "b";
  const auto write = [](const AtomicFolder& folder) {
    std::filesystem::create_directory(folder.temporary_path() / "sub");
    write_file(folder.temporary_path() / "sub" / "x", "x");
    write_file(folder.temporary_path() / "y", "y");
  };
  {
    const AtomicFolder folder(path);
    write(folder);
    CHECK_FALSE(std::filesystem::exists(path / "y"));
  }
  CHECK_FALSE(std::filesystem::exists(path));
  std::filesystem::create_directory(path);
  { const AtomicFolder folder(path); }
  CHECK(std::filesystem::is_empty(path));
  {
    AtomicFolder folder(path);
    write(folder);
    folder.commit();
  }
  CHECK(read_file(path / "sub" / "x") == "x");
  CHECK(read_file(path / "y") == "y");
  CHECK(std::distance(std::filesystem::directory_iterator(path), {}) == 2);
  AtomicFolder again(path);
  write(again);
  CHECK_THROWS_NAMING(DataError, again.commit(), "sub");
}

TEST_CASE("files: what cannot be written or read is a DataError that names the path", "[core]") {
  const test::TempDir dir;
  const auto file = dir.write("file.txt", "x");
  CHECK_THROWS_AS(AtomicFile(dir.path() / "missing" / "a.txt"), DataError);
  CHECK_THROWS_WITH(make_writable_folder(file / "sub"), Catch::Contains("file.txt"));
  CHECK_THROWS_WITH(read_file(dir.path()), Catch::Contains(dir.path().string()));
  CHECK_THROWS_WITH(read_file(dir / "none"), Catch::Contains("none: cannot be read: no such file"));
  CHECK_THROWS_AS(write_file("/dev/full/x", "content"), DataError);
}

}  // namespace
}  // namespace jade
