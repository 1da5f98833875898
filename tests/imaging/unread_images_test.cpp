// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/unread_images.h"

#include "support/catch.h"

#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("unread images: the most frequent kind is named with what to do", "[imaging]") {
  const test::TempDir dir;
  CHECK(imaging::unread_images(dir.path()).empty());
  CHECK(imaging::unread_images(dir / "missing").empty());
  dir.write("times.csv", "");
  dir.write(".hidden.gif", "");
  CHECK(imaging::unread_images(dir.path()).empty());
  for (const char* name : {"a.gif", "1.HEIC", "2.heic"}) dir.write(name, "");
  CHECK_THAT(imaging::unread_images(dir.path()), test::naming("2 files .heic", "convert", ".png"));
  dir.write("video/a.mp4", "");
  CHECK_THAT(imaging::unread_images(dir / "video"), test::naming("1 file .mp4", "extract"));
}
