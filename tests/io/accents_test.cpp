// SPDX-License-Identifier: Apache-2.0
#include "jade/io/accents.h"

#include "support/catch.h"

#include "support/temp_dir.h"

namespace jade::io {
namespace {

TEST_CASE("accents: composed and decomposed letters are equal, other letters are not", "[io]") {
  CHECK(same_but_accents("caf\u00e9_1.png", "cafe\u0301_1.png"));
  CHECK(same_but_accents("cafe\u0301_1.png", "caf\u00e9_1.png"));
  CHECK(same_but_accents("\u1ebf\u0439", "e\u0302\u0301\u0438\u0306"));  // Vietnamese, Cyrillic
  CHECK(same_but_accents("\ud55c\uae00", "\u1112\u1161\u11ab\u1100\u1173\u11af"));  // Hangul
  CHECK(same_but_accents("\u304c1", "\u304b\u30991"));                              // Kana
  CHECK_FALSE(same_but_accents("caf\u00e9", "cafo\u0301"));
  CHECK_FALSE(same_but_accents("caf\u00e9", "cafe"));
  CHECK_FALSE(same_but_accents("caf\u00e9", "cafe\u0300"));  // another mark
  CHECK(same_but_accents("\u00e7\u0119", "c\u0327e\u0328"));
  CHECK_FALSE(same_but_accents("\ud55c", "\u1112\u1161"));
  CHECK_FALSE(same_but_accents("a1", "a2"));
  CHECK_FALSE(same_but_accents("caf\u00e9", "cafe\u0301x"));
}

TEST_CASE("accents: the file of another spelling is found, also in such a folder", "[io]") {
  const test::TempDir dir;
  dir.write("sce\u0300ne/e\u0301_1.png", "");
  CHECK(respelled(dir / "sc\u00e8ne/\u00e9_1.png") == dir / "sce\u0300ne/e\u0301_1.png");
  CHECK(respelled(dir / "sc\u00e8ne/\u00e9_2.png").empty());
  CHECK(respelled(dir / "plain.png").empty());
  dir.write("sce\u0300ne/e\u0300_1.png", "");  // another letter, not a second spelling
  CHECK(respelled(dir / "sc\u00e8ne/\u00e9_1.png") == dir / "sce\u0300ne/e\u0301_1.png");
}

}  // namespace
}  // namespace jade::io
