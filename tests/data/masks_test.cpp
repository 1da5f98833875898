// SPDX-License-Identifier: Apache-2.0
#include "jade/data/masks.h"

#include "support/catch.h"

#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/error.h"
#include "jade/data/evdeblur_writer.h"
#include "jade/data/truths.h"
#include "jade/imaging/image_io.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// 1 where pixels count: all but the two columns on the left.
torch::Tensor without_left(int64_t height = test::kHeight, int64_t width = test::kWidth) {
  torch::Tensor mask = torch::ones({1, height, width});
  mask.slice(2, 0, 2).zero_();
  return mask;
}

/// The tiny recording, whose frames images_1/00.png to 05.png have masks of any kind.
struct MaskedScene {
  test::TempDir folder;
  DatasetOptions options;
  std::vector<std::string> warnings;

  explicit MaskedScene(const EvDeblurContent& content = test::tiny_content()) {
    write_evdeblur(folder / "scene", content);
    options.path = folder / "scene";
  }
  fs::path file(const std::string& name) const { return folder / ("scene/" + name); }
  void put(const std::string& name, const torch::Tensor& mask) const {
    imaging::write_image(file(name), mask);
  }
  Dataset load() {
    warnings.clear();
    return load_dataset(options, &warnings);
  }
};

bool is_excluded(const torch::Tensor& mask, const torch::Tensor& expected) {
  return mask.defined() && mask.equal(expected.to(torch::kBool));
}

TEST_CASE("masks: without any, frames have none and keep their bits", "[data]") {
  MaskedScene scene;
  const Dataset before = scene.load();
  CHECK_FALSE(before.train[0].mask.defined());
  CHECK_FALSE(before.test[0].mask.defined());
  CHECK(summarize_masks(before).frames == 0);
  scene.put("mask.png", torch::ones({1, test::kHeight, test::kWidth}));
  const Dataset all_count = scene.load();
  CHECK_FALSE(all_count.train[0].mask.defined());
  CHECK(all_count.train[0].blurry.equal(before.train[0].blurry));
  CHECK(all_count.events.size() == before.events.size());
}

TEST_CASE("masks: a folder masks/ with any of the usual names", "[data]") {
  const std::string name = GENERATE("masks/00.png", "masks/00.png.png", "masks/00.jpg.png",
                                    "masks_1/00.png", "masks/images_1/00.png", "Masks/00.png");
  CAPTURE(name);
  MaskedScene scene;
  scene.put(name, without_left());
  const Dataset data = scene.load();
  CHECK(is_excluded(data.train[0].mask, without_left()));
  CHECK_FALSE(data.train[1].mask.defined());
  CHECK(data.train[0].blurry.slice(2, 0, 2).abs().max().item<float>() == 0);
  CHECK(data.train[0].blurry.slice(2, 2).min().item<float>() < 1);
  CHECK(test::mentions(scene.warnings, "no mask for 5 of 6 frames"));
}

TEST_CASE("masks: a name with its accents in another form", "[data]") {
  MaskedScene scene;
  fs::rename(scene.file("images_1/05.png"), scene.file("images_1/e\u0301.png"));
  scene.put("masks/\u00e9.png", without_left());
  CHECK(is_excluded(scene.load().test.back().mask, without_left()));
}

TEST_CASE("masks: an empty folder does not hide one in another case", "[data]") {
  MaskedScene scene;
  scene.put("Masks/00.png", without_left());
  fs::create_directory(scene.file("masks"));
  CHECK(is_excluded(scene.load().train[0].mask, without_left()));
}

TEST_CASE("masks: the mask of all frames in any case", "[data]") {
  const std::string name = GENERATE("Mask.png", "MASK.PNG");
  MaskedScene scene;
  scene.put(name, without_left());
  CHECK(is_excluded(scene.load().train[1].mask, without_left()));
}

TEST_CASE("masks: frames in nested folders have theirs in the same folders below masks/",
          "[data]") {
  const std::string place = GENERATE("masks/rig1/cam0/", "masks/images_1/rig1/cam0/",
                                     "images_1/masks/rig1/cam0/", "images_1/rig1/masks/cam0/");
  CAPTURE(place);
  MaskedScene scene;
  const fs::path frame = scene.file("images_1/rig1/cam0/07.png");
  scene.put("images_1/rig1/cam0/07.png", torch::ones({3, test::kHeight, test::kWidth}));
  scene.put(place + "07.png", without_left());
  const std::vector<torch::Tensor> images{torch::ones({3, test::kHeight, test::kWidth})};
  const auto masks =
      read_masks({frame}, images, MaskSources(scene.options), Warnings(&scene.warnings));
  CHECK(is_excluded(masks[0], without_left()));
  CHECK(scene.warnings.empty());
  fs::rename(scene.file(place + "07.png"), scene.file(place + "08.png"));
  read_masks({frame}, images, MaskSources(scene.options), Warnings(&scene.warnings));
  CHECK(test::mentions(scene.warnings, "no mask for 1 of 1 frames"));
}

TEST_CASE("masks: one of all frames, by key and by name, and both must agree", "[data]") {
  MaskedScene scene;
  scene.put("mask.png", without_left());
  const Dataset data = scene.load();
  for (const Exposure& exposure : data.train) CHECK(is_excluded(exposure.mask, without_left()));
  for (const SharpView& view : data.test) {
    CHECK(is_excluded(view.mask, without_left()));
    CHECK(view.image.slice(2, 0, 2).abs().max().item<float>() == 0);
  }
  CHECK(summarize_masks(data).frames == 6);
  CHECK(summarize_masks(data).excluded == Approx(2.0 / test::kWidth));
  CHECK(truth_of(data, data.train[0])->mask.equal(data.train[0].mask));
  CHECK(truth_of(data, data.train[0])->image.slice(2, 0, 2).abs().max().item<float>() == 0);

  torch::Tensor top = torch::ones({1, test::kHeight, test::kWidth});
  top.slice(1, 0, 3).zero_();
  scene.options.mask = scene.folder / "top.png";
  imaging::write_image(scene.options.mask, top);
  CHECK(is_excluded(scene.load().train[2].mask, top * without_left()));
}

TEST_CASE("masks: what lies under them changes nothing, be it colours or events", "[data]") {
  EvDeblurContent content = test::tiny_content();
  const MaskedScene one(content);
  for (Exposure& exposure : content.train) exposure.blurry.slice(2, 0, 2).fill_(0.6);
  for (SharpView& view : content.test) view.image.slice(2, 0, 2).fill_(0.2);
  const torch::Tensor keep = (content.events.x() >= 2).nonzero().flatten();
  const events::EventStream& e = content.events;
  content.events = {e.x().index_select(0, keep), e.y().index_select(0, keep),
                    e.t_us().index_select(0, keep), e.polarity().index_select(0, keep)};
  const MaskedScene other(content);
  std::vector<Dataset> data;
  for (const MaskedScene* scene : {&one, &other}) {
    scene->put("mask.png", without_left());
    data.push_back(load_dataset(scene->options));
  }
  REQUIRE(data[0].train.size() == 4);
  for (size_t i = 0; i < 4; ++i) {
    CHECK(data[0].train[i].blurry.equal(data[1].train[i].blurry));
    CHECK(data[0].train[i].events.x().equal(data[1].train[i].events.x()));
    CHECK(data[0].train[i].events.t_us().equal(data[1].train[i].events.t_us()));
  }
  CHECK(data[0].test[1].image.equal(data[1].test[1].image));
  CHECK(data[0].events.t_us().equal(data[1].events.t_us()));
  CHECK(data[0].events.size() == keep.numel());
}

TEST_CASE("masks: events go by the mask of the exposure nearest in time", "[data]") {
  Dataset data;
  for (const int64_t start : {100, 300}) {
    Exposure exposure;
    exposure.name = concat(start);
    exposure.t_start_us = start;
    exposure.t_end_us = start + 100;
    exposure.blurry = torch::ones({3, 2, 3});
    data.train.push_back(exposure);
  }
  data.train[0].mask = torch::tensor({0, 1, 1, 1, 1, 1}).view({1, 2, 3}).to(torch::kBool);
  data.events = events::EventStream::from_lists({0, 0.4F, 0.6F, -0.6F, 0, 0}, {0, 0, 0, 0, 0, 0},
                                                {50, 120, 130, 140, 249, 250}, {1, 1, 1, 1, 1, 1});
  apply_masks(data);
  CHECK(data.events.t_us().equal(torch::tensor({130, 140, 250}, torch::kInt64)));
  CHECK(data.train[0].events.size() == 2);
  CHECK(data.train[1].events.empty());
  CHECK(data.train[0].blurry.sum().item<float>() == 15);
}

TEST_CASE("masks: broken ones are refused by name", "[data]") {
  MaskedScene scene;
  SECTION("another size") {
    scene.put("masks/02.png", without_left(5, 7));
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("masks/02.png") && Catch::Contains("21x13") &&
                                        Catch::Contains("7x5"));
  }
  SECTION("one of all frames of another size") {
    scene.put("mask.png", without_left(5, 7));
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("mask.png") && Catch::Contains("7x5"));
  }
  SECTION("all black") {
    scene.put("mask.png", torch::zeros({1, test::kHeight, test::kWidth}));
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("mask.png"));
  }
  SECTION("nothing is left together") {
    scene.put("mask.png", without_left());
    scene.put("masks/01.png", 1 - without_left());
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("01.png"));
  }
  SECTION("not an image") {
    scene.folder.write("scene/masks/00.png", "no image");
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("masks/00.png"));
  }
  SECTION("missing") {
    scene.options.mask = scene.folder / "none.png";
    CHECK_THROWS_WITH(scene.load(), Catch::Contains("none.png"));
  }
  CHECK_THROWS_AS(scene.load(), DataError);
}

}  // namespace
}  // namespace jade::data
