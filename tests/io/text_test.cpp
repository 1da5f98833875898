// SPDX-License-Identifier: Apache-2.0
#include "jade/io/text.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/io/gzip.h"
#include "jade/io/npy.h"
#include "jade/io/zip.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("text: UTF-8 with and without its mark is read, other content is named", "[io]") {
  const test::TempDir dir;
  CHECK(io::read_text(dir.write("plain.txt", "a,1\n")) == "a,1\n");
  CHECK(io::read_text(dir.write("marked.txt",
                                "\xEF\xBB\xBF"
                                "a,1\n")) == "a,1\n");
  CHECK(io::read_text(dir.write("empty.txt", "")).empty());
  for (const std::string& text : {std::string("\xFF\xFE"
                                              "a\0,\0",
                                              6),
                                  std::string("a\0,\0"
                                              "1\0",
                                              6),
                                  std::string("\0a\0,\0"
                                              "1",
                                              6)}) {
    CHECK_THROWS_WITH(io::read_text(dir.write("list.csv", text)),
                      test::naming("list.csv", "UTF-8", "UTF-16", "iconv"));
  }
  CHECK_THROWS_WITH(io::read_text(dir.write("packed.csv", io::gzip("a,1\n"))),
                    test::naming("packed.csv", "gzip"));
  CHECK_THROWS_AS(io::read_text(dir / "missing.csv"), DataError);
}

TEST_CASE("text: arrays and archives in place of a list are named", "[io]") {
  const test::TempDir dir;
  io::write_npy(dir / "a.npy", torch::zeros({4}));
  io::write_npz(dir / "a.npz", {{"t", torch::zeros({4})}});
  io::write_zip(dir / "a.zip", {{"t.txt", "1 2"}});
  for (const char* name : {"a.npy", "a.npz"})
    CHECK_THROWS_NAMING(DataError, io::read_text(dir / name), name, "NumPy", "savetxt");
  CHECK_THROWS_NAMING(DataError, io::read_text(dir / "a.zip"), "a.zip", "zip", "unpack");
}

TEST_CASE("text: the comma of a number becomes a point, no other comma does", "[io]") {
  CHECK(io::with_point("12,5") == "12.5");
  CHECK(io::with_point("-0,25") == "-0.25");
  for (const char* other : {"12.5", "12", "1,2,3", ",5", "5,", "a,5", "1,5 m", "", "-", "--1,5"}) {
    CHECK(io::with_point(other) == other);
  }
}
