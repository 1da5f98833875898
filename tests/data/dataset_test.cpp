// SPDX-License-Identifier: Apache-2.0
// Whether a data set is monochrome, frames that are made gray, and data sets around a path.
#include "jade/data/dataset.h"

#include "support/catch.h"

#include <algorithm>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/error.h"
#include "jade/imaging/color.h"
#include "jade/io/npy.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

EvDeblurContent gray_content() {
  EvDeblurContent content = test::tiny_content();
  const auto gray = [](torch::Tensor& image) { image = image[0].expand({3, -1, -1}).clone(); };
  for (Exposure& exposure : content.train) gray(exposure.blurry);
  for (SharpView& view : content.test) gray(view.image);
  return content;
}

/// A data set written and read again.
struct Loaded {
  test::TempDir folder;
  std::vector<std::string> warnings;

  explicit Loaded(const EvDeblurContent& content) { write_evdeblur(folder / "scene", content); }

  Dataset as(FrameColor color) {
    warnings.clear();
    DatasetOptions options;
    options.path = folder / "scene";
    options.color = color;
    return load_dataset(options, &warnings);
  }
};

bool all_gray(const Dataset& data) {
  bool gray = true;
  for (const Exposure& exposure : data.train) gray = gray && imaging::is_gray(exposure.blurry);
  for (const SharpView& view : data.test) gray = gray && imaging::is_gray(view.image);
  return gray;
}

TEST_CASE("datasets_around: the data sets that a path is in, whether it exists or not", "[data]") {
  const Loaded outer(test::tiny_content());
  const auto scene = std::filesystem::canonical(outer.folder / "scene");
  write_evdeblur(scene / "inner", test::tiny_content());
  CHECK(datasets_around(scene) == std::vector{scene});
  CHECK(datasets_around(scene / "inner/none/such") == std::vector{scene / "inner", scene});
  CHECK(datasets_around(scene / "..").empty());
}

TEST_CASE("colour: R = G = B in every frame is monochrome, and auto leaves the frames alone",
          "[data]") {
  Loaded gray(gray_content());
  const Dataset data = gray.as(FrameColor::kAuto), in_color = gray.as(FrameColor::kColor);
  CHECK(data.monochrome);
  CHECK(all_gray(data));
  CHECK_FALSE(in_color.monochrome);
  CHECK(gray.as(FrameColor::kGray).monochrome);
  CHECK(data.train[2].blurry.equal(in_color.train[2].blurry));
  CHECK(data.train[2].blurry.equal(gray.as(FrameColor::kGray).train[2].blurry));
  CHECK_FALSE(Loaded(test::tiny_content()).as(FrameColor::kAuto).monochrome);
}

TEST_CASE("colour: one coloured pixel of one frame, blurry or sharp, is colour", "[data]") {
  EvDeblurContent blurry = gray_content(), sharp = gray_content();
  blurry.train[3].blurry[2][5][7].neg_().add_(1);
  sharp.test[1].image[1][0][0].neg_().add_(1);
  CHECK_FALSE(Loaded(blurry).as(FrameColor::kAuto).monochrome);
  CHECK_FALSE(Loaded(sharp).as(FrameColor::kAuto).monochrome);
}

TEST_CASE("colour: gray frames among coloured ones are one warning, black ones none", "[data]") {
  EvDeblurContent content = test::tiny_content();
  content.train[0].blurry.zero_();
  Loaded black(content);
  black.as(FrameColor::kAuto);
  CHECK_FALSE(test::mentions(black.warnings, "gray"));
  for (const size_t i : {1U, 3U}) {
    content.train[i].blurry = imaging::as_gray(content.train[i].blurry);
  }
  Loaded mixed(content);
  const Dataset data = mixed.as(FrameColor::kAuto);
  CHECK_FALSE(data.monochrome);
  CHECK(std::count_if(mixed.warnings.begin(), mixed.warnings.end(), [&](const std::string& line) {
          return test::naming("2 of 6", "is " + data.train[1].name, "dataset.color").match(line);
        }) == 1);
  mixed.as(FrameColor::kColor);
  CHECK_FALSE(test::mentions(mixed.warnings, "gray"));
}

TEST_CASE("colour: coloured frames are made gray by the luma on request", "[data]") {
  Loaded coloured(test::tiny_content());
  const Dataset before = coloured.as(FrameColor::kAuto), after = coloured.as(FrameColor::kGray);
  CHECK(after.monochrome);
  CHECK_FALSE(all_gray(before));
  CHECK(all_gray(after));
  REQUIRE(after.test.size() == 2);
  CHECK(after.train[1].blurry[1].equal(imaging::gray(before.train[1].blurry)[0]));
  CHECK(after.test[0].image[2].equal(imaging::gray(before.test[0].image)[0]));
}

TEST_CASE("colour: the colour filter of events is left out for gray frames, with a warning",
          "[data]") {
  Loaded gray(gray_content());
  const auto axes =
      torch::meshgrid({torch::arange(test::kHeight), torch::arange(test::kWidth)}, "ij");
  io::write_npz(gray.folder / "scene/ev_map.npz", {{"inv_mapx", axes[1].to(torch::kFloat32)},
                                                   {"inv_mapy", axes[0].to(torch::kFloat32)}});
  CHECK(gray.as(FrameColor::kColor).event_color.defined());
  CHECK_FALSE(test::mentions(gray.warnings, "colour filter"));
  CHECK_FALSE(gray.as(FrameColor::kAuto).event_color.defined());
  CHECK(test::mentions(gray.warnings, "colour filter"));
}

}  // namespace
}  // namespace jade::data
