// SPDX-License-Identifier: Apache-2.0
#include "jade/data/unused_parts.h"

#include "support/catch.h"

#include "support/temp_dir.h"

namespace jade::data {
namespace {

std::vector<std::string> told(const UnusedParts& parts) {
  std::vector<std::string> lines;
  parts.warn("scene", "colmap", Warnings(&lines));
  return lines;
}

TEST_CASE("unused parts: files, folders and keys that are there share one warning", "[data]") {
  const test::TempDir folder;
  folder.write("depths/0.png", "x");
  folder.write("sparse/0/depth_params.json", "{}");
  folder.write("poses_bounds_exact.npy", "x");
  std::filesystem::create_directories(folder / "normals");
  UnusedParts parts;
  parts.look_for_files(folder.path(), {{"depths/", "depth maps"},
                                       {"normals/", "maps of normals"},
                                       {"sparse/0/depth_params.json", "scales"},
                                       {"poses_bounds_*.npy", "other poses"},
                                       {"hold=*", "a split"}});
  parts.look_for_keys({"time", "w"}, {{"time", "moment of a frame"}, {"iso", "gain"}});
  const auto lines = told(parts);
  REQUIRE(lines.size() == 1);
  for (const char* name : {"depths/ (depth maps)", "sparse/0/depth_params.json (scales)",
                           "poses_bounds_exact.npy (other poses)", "'time' (moment of a frame)"}) {
    CHECK_THAT(lines[0], Catch::Contains(name));
  }
  for (const char* name : {"normals", "hold", "iso"}) CHECK_THAT(lines[0], !Catch::Contains(name));
}

TEST_CASE("unused parts: formats of frames that were read are not called unread", "[data]") {
  const test::TempDir folder;
  folder.write("images/0.jp2", "x");
  folder.write("images/0.exr", "x");
  const auto lines = [&](const std::vector<std::filesystem::path>& read) {
    return told(unused_in_any_layout(folder.path(), folder / "images", false, read)).at(0);
  };
  CHECK_THAT(lines({}), Catch::Contains("0.jp2") && Catch::Contains("0.exr"));
  CHECK_THAT(lines({folder / "images/0.jp2"}),
             !Catch::Contains("0.jp2") && Catch::Contains("0.exr"));
}

TEST_CASE("unused parts: names are compared without case, Masks/ is masks/", "[data]") {
  const test::TempDir folder;
  const auto lines = [&] {
    return told(unused_in_any_layout(folder.path(), folder / "images", false, {}));
  };
  folder.write("images/0.png", "x");
  folder.write("masks/0.png", "x");
  CHECK(lines().empty());
  std::filesystem::rename(folder / "masks", folder / "Masks");
  folder.write("IMU.csv", "x");
  REQUIRE(lines().size() == 1);
  CHECK_THAT(lines()[0], !Catch::Contains("Masks/") && Catch::Contains("IMU.csv"));
}

TEST_CASE("unused parts: nothing found, nothing said", "[data]") {
  const test::TempDir folder;
  UnusedParts parts;
  parts.look_for_files(folder / "missing", {{"depths/", "depth maps"}});
  parts.look_for_keys({}, {{"time", "moment of a frame"}});
  CHECK(told(parts).empty());
}

}  // namespace
}  // namespace jade::data
