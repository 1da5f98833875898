// SPDX-License-Identifier: Apache-2.0
#include "jade/io/stand_in.h"

#include "support/catch.h"

#include "jade/io/gzip.h"

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
