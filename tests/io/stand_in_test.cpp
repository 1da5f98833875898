// SPDX-License-Identifier: Apache-2.0
#include "jade/io/stand_in.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/io/gzip.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"
#include "support/without_rights.h"

using namespace jade;

TEST_CASE("stand-in: what lies in place of a file is named with its remedy", "[io]") {
  CHECK_THAT(io::stand_in("version https://git-lfs.github.com/spec/v1\noid sha256:aa\n", "a.ply"),
             Catch::Contains("git lfs pull"));
  for (const char* page : {"<!DOCTYPE html><html>", "\n  <HTML lang=en>", "\xEF\xBB\xBF<html>"}) {
    CHECK_THAT(io::stand_in(page, "a.ply"), Catch::Contains("HTML"));
  }
  CHECK_THAT(io::stand_in("", "a.ply"), Catch::Contains("empty"));
  CHECK_THAT(io::stand_in(io::gzip("ply\n"), "a.ply"), Catch::Contains("gunzip -k a.ply.gz"));
  CHECK_THAT(io::stand_in(io::gzip("ply\n"), "a.ply.gz"), Catch::Contains("gunzip -k a.ply.gz"));
  for (const char* other : {"ply\nformat ascii 1.0\n", "version 2\n", "<?xml version='1.0'?>"}) {
    CHECK(io::stand_in(other, "a.ply").empty());
  }
  for (const std::string& text :
       {std::string("\xFF\xFEt\0", 4), std::string("\xFE\xFF\0t", 4), std::string("{\0\n\0", 4)}) {
    CHECK_THAT(io::stand_in(text, "a.json"), Catch::Contains("iconv -f UTF-16 -t UTF-8 a.json"));
  }
  CHECK(io::stand_in("no/such/file").empty());
}

TEST_CASE("stand-in: files of each packer are named with the command that unpacks them", "[io]") {
  const auto found = [](const std::string& head, const char* name) {
    return io::stand_in(head, name);
  };
  CHECK_THAT(found("BZh91AY&SY", "events.txt.bz2"),
             test::naming("bzip2", "bunzip2 -k events.txt.bz2"));
  CHECK_THAT(found(std::string("\xFD"
                               "7zXZ\0",
                               6),
                   "events.txt.xz"),
             test::naming("xz", "unxz -k events.txt.xz"));
  CHECK_THAT(found("\x28\xB5\x2F\xFD..", "events.txt.zst"),
             test::naming("zstd", "unzstd events.txt.zst"));
  CHECK_THAT(found("\x28\xB5\x2F\xFD..", "events.txt"), test::naming("unzstd events.txt.zst"));
  CHECK_THAT(found("7z\xBC\xAF\x27\x1C", "a.7z"), test::naming("7z x a.7z"));
  CHECK_THAT(found("Rar!\x1A\x07", "a.rar"), test::naming("unrar x a.rar"));
  CHECK_THAT(found(std::string(257, 'a') + "ustar", "a.tar"), test::naming("tar xf a.tar"));
  CHECK_THAT(found(io::gzip("tar"), "a.tar.gz"), test::naming("tar xf a.tar.gz"));
}

TEST_CASE("stand-in: readers name what lies in place of a file", "[io]") {
  const test::TempDir dir;
  const auto pointer = [&](const char* name) {
    return dir.write(name, "version https://git-lfs.github.com/spec/v1\noid sha256:aa\nsize 9\n");
  };
  CHECK_THROWS_WITH(io::Hdf5File(pointer("a.h5")), test::naming("a.h5", "HDF5", "git lfs pull"));
  CHECK_THROWS_WITH(io::Npz(pointer("a.npz")), test::naming("a.npz", "git lfs pull"));
  CHECK_THROWS_WITH(io::read_npy(pointer("a.npy")), test::naming("a.npy", "git lfs pull"));
}

TEST_CASE("stand-in: a file without read permission is named as such", "[io]") {
  const test::TempDir dir;
  const test::WithoutRights without(dir.write("a.h5", "x"));
  CHECK_THAT(io::stand_in(dir / "a.h5"), test::naming("Permission denied", "chmod a+r a.h5"));
  CHECK_THROWS_WITH(io::Hdf5File(dir / "a.h5"), test::naming("a.h5", "Permission denied"));
  CHECK_THROWS_WITH(io::Npz(dir / "a.h5"), test::naming("a.h5", "Permission denied"));
  CHECK_THROWS_WITH(io::read_npy(dir / "a.h5"), test::naming("a.h5", "Permission denied"));
  CHECK_THROWS_WITH(read_file(dir / "a.h5"), test::naming("a.h5", "permission denied"));
}
