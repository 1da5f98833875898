// SPDX-License-Identifier: Apache-2.0
#include "jade/import/frame_masks.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

constexpr int64_t kMaskWidth = 12, kMaskHeight = 9;

/// A recording of three frames, a to c, in a folder images.
recording::Recording masked_recording(const test::TempDir& dir) {
  recording::Recording recording;
  recording.mask_root = dir.path();
  std::filesystem::create_directories(dir / "images");
  for (const std::string name : {"a", "b", "c"}) {
    const auto path = dir / ("images/" + name + ".png");
    const torch::Tensor image = torch::full({3, kMaskHeight, kMaskWidth}, 0.4);
    imaging::write_image(path, image);
    recording.frames.push_back({name, image, 0, 0, path});
  }
  return recording;
}

}  // namespace

TEST_CASE("frame masks: of some frames, and a warning for those without one", "[import]") {
  const test::TempDir dir;
  recording::Recording recording = masked_recording(dir);
  std::vector<std::string> warnings;
  for (const torch::Tensor& mask : import::masks_of(recording, warnings))
    CHECK_FALSE(mask.defined());
  CHECK(warnings.empty());
  torch::Tensor mask = torch::ones({1, kMaskHeight, kMaskWidth});
  mask.slice(2, 0, 4).fill_(0);
  imaging::write_image(dir / "masks/b.png", mask);
  const auto masks = import::masks_of(recording, warnings);
  REQUIRE(masks.size() == 3);
  CHECK(masks[1].equal(mask.to(torch::kBool)));
  CHECK_FALSE(masks[0].defined());
  REQUIRE(warnings.size() == 1);
  CHECK_THAT(warnings[0], test::naming("masks", "2 of 3", "a.png, c.png"));
  recording.mask_root.clear();
  CHECK(import::masks_of(recording, warnings).empty());
}

TEST_CASE("frame masks: one of another size is refused by name", "[import]") {
  const test::TempDir dir;
  recording::Recording recording = masked_recording(dir);
  std::vector<std::string> warnings;
  imaging::write_image(dir / "masks/b.png", torch::ones({1, kMaskHeight, kMaskWidth + 1}));
  CHECK_THROWS_NAMING(DataError, import::masks_of(recording, warnings), "b.png", "13x9", "12x9");
  // Messages name the archive instead of the temporary folder.
  recording.keep = std::make_shared<int>(0);
  recording.source = "table.zip";
  CHECK_THROWS_NAMING(DataError, import::masks_of(recording, warnings), "table.zip/masks/b.png");
}
