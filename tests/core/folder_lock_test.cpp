// SPDX-License-Identifier: Apache-2.0
#include "jade/core/folder_lock.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade {
namespace {

TEST_CASE("folder lock: held by one at a time, and free again after it", "[core]") {
  const test::TempDir dir;
  CHECK_FALSE(FolderLock::is_held(dir.path()));
  {
    std::optional<FolderLock> first = FolderLock::take(dir.path());
    REQUIRE(first);
    CHECK_FALSE(FolderLock::take(dir.path()));
    CHECK(FolderLock::is_held(dir.path()));
    const std::optional<FolderLock> moved = std::move(first);
    CHECK(FolderLock::is_held(dir.path()));
  }
  CHECK_FALSE(FolderLock::is_held(dir.path()));
  CHECK(FolderLock::take(dir.path()));
}

TEST_CASE("folder lock: a folder that is not there", "[core]") {
  const test::TempDir dir;
  CHECK_FALSE(FolderLock::is_held(dir / "nowhere"));
  CHECK_THROWS_AS(FolderLock::take(dir / "nowhere"), DataError);
}

}  // namespace
}  // namespace jade
