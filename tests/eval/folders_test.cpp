// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/folders.h"

#include "support/catch.h"

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::eval {
namespace {

TEST_CASE("compare_folders: pairs by name, and each name in the truth must be there", "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const torch::Tensor image = torch::rand({3, 16, 20});
  imaging::write_image(dir / "truth/a.png", image);
  imaging::write_image(dir / "renders/a.png", (image + 0.1));
  imaging::write_image(dir / "renders/b.png", image);
  const Evaluation evaluation = compare_folders(dir / "renders", dir / "truth", lpips);
  REQUIRE(evaluation.views.size() == 1);
  CHECK(evaluation.views[0].name == "a");
  CHECK(evaluation.mean.psnr < 25);
  imaging::write_image(dir / "arrays/a.npy", image);
  CHECK(compare_folders(dir / "renders", dir / "arrays", lpips).views.at(0).name == "a");
  imaging::write_image(dir / "truth/b.png", torch::rand({3, 16, 21}));
  CHECK_THROWS_WITH(compare_folders(dir / "renders", dir / "truth", lpips),
                    Catch::Contains("expected 21x16"));
  imaging::write_image(dir / "truth/c.png", image);
  CHECK_THROWS_AS(compare_folders(dir / "renders", dir / "truth", lpips), DataError);
}

TEST_CASE("compare_folders: two images of one name are refused, unused renders are named",
          "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const torch::Tensor image = torch::rand({3, 16, 20});
  for (const char* name : {"truth/a.png", "renders/a.png", "renders/a_depth.png"}) {
    imaging::write_image(dir / name, image);
  }
  const auto said = [&] {
    set_log_file(dir / "said.log");
    compare_folders(dir / "renders", dir / "truth", lpips);
    set_log_file({});
    return read_file(dir / "said.log");
  };
  CHECK_THAT(said(), !test::naming("warning"));
  for (const char name : {'b', 'c', 'd', 'e', 'f', 'g'}) {
    imaging::write_image(dir / concat("renders/", name, ".png"), image);
  }
  CHECK_THAT(said(), test::naming("warning", "b.png", "f.png and 1 more"));
  for (const std::string folder : {"truth", "renders"}) {
    imaging::write_image(dir / (folder + "/a.bmp"), image);
    CHECK_THROWS_NAMING(DataError, compare_folders(dir / "renders", dir / "truth", lpips), folder,
                        "a.png", "a.bmp");
    std::filesystem::remove(dir / (folder + "/a.bmp"));
  }
}

TEST_CASE("compare_folders: 12 of 16 bits and gray renders of colours are reported", "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const torch::Tensor image = 0.99 * torch::rand({3, 16, 20});  // a sixteenth is below 4095.5
  imaging::write_image(dir / "truth/a.png", image);
  imaging::write_image(dir / "truth/b.png", image.flip(2));
  const auto said = [&](double factor, bool gray, int bits) {
    for (const char* name : {"renders/a.png", "renders/b.png"}) {
      const torch::Tensor picture = gray ? image.slice(0, 0, 1) : image;
      imaging::write_image(dir / name, picture * factor, {bits});
    }
    std::filesystem::remove(dir / "said.log");
    set_log_file(dir / "said.log");
    compare_folders(dir / "renders", dir / "truth", lpips);
    set_log_file({});
    return read_file(dir / "said.log");
  };
  CHECK(said(1, false, 16).empty());
  CHECK_THAT(said(1.0 / 16, false, 16), test::naming("warning", "renders", "multiply", "by 16"));
  CHECK_THAT(said(1, true, 8), test::naming("warning", "renders", "2 of 2 gray (a, b)"));
  imaging::write_image(dir / "truth/a.png", image.slice(0, 0, 1));
  CHECK_THAT(said(1, true, 8), test::naming("1 of 2 gray (b)"));
}

TEST_CASE("compare_folders: renders may be arrays, unless there is an image of the name",
          "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const torch::Tensor image = (255 * torch::rand({3, 16, 20})).round() / 255;
  imaging::write_image(dir / "truth/a.png", image);
  const auto psnr = [&] {
    return compare_folders(dir / "renders", dir / "truth", lpips).mean.psnr;
  };
  imaging::write_image(dir / "renders/a.npy", image);
  CHECK(psnr() == 100);
  imaging::write_image(dir / "renders/a.npy", 255 * image);
  CHECK_THROWS_NAMING(DataError, psnr(), "a.npy", "from 0 to 1", "divide");
  imaging::write_image(dir / "renders/a.npy", image / torch::zeros({1}));
  CHECK_THROWS_NAMING(DataError, psnr(), "a.npy", "NaN or infinity");
  imaging::write_image(dir / "renders/a.png", 0.5 * image);
  CHECK(psnr() < 30);
}

/// An RGBA picture whose left half is transparent.
void write_half(const std::filesystem::path& path, uint8_t value, uint8_t hidden) {
  cv::Mat image(8, 8, CV_8UC4, cv::Scalar(value, value, value, 255));
  image.colRange(0, 4) = cv::Scalar(hidden, hidden, hidden, 0);
  std::filesystem::create_directories(path.parent_path());
  cv::imwrite(path.string(), image);
}

TEST_CASE("compare_folders: transparent truth does not count, transparent renders are black",
          "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const auto compare = [&] {
    return compare_folders(dir / "renders", dir / "truth", lpips).views[0];
  };
  imaging::write_image(dir / "renders/a.png", torch::full({3, 8, 8}, 0.4));
  write_half(dir / "truth/a.png", 153, 3);
  const Scores first = compare();
  CHECK(first.psnr == Approx(-20 * std::log10(0.2)));
  CHECK(first.excluded == 0.5);
  write_half(dir / "truth/a.png", 153, 250);
  CHECK(compare().psnr == first.psnr);
  CHECK(compare().ssim == first.ssim);

  imaging::write_image(dir / "truth/a.png", torch::full({3, 8, 8}, 0.4));
  write_half(dir / "renders/a.png", 102, 102);
  CHECK(compare().psnr == Approx(-10 * std::log10(0.5 * 0.16)).margin(1e-4));
}

TEST_CASE("compare_folders: a mask of all truths, and broken ones", "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const auto compare = [&] {
    return compare_folders(dir / "renders", dir / "truth", lpips, dir / "m.png").views[0];
  };
  torch::Tensor image = torch::full({3, 8, 8}, 0.4);
  imaging::write_image(dir / "truth/a.png", image);
  image[0][0][0] = 1;
  imaging::write_image(dir / "renders/a.png", image);
  torch::Tensor mask = torch::ones({1, 8, 8});
  mask[0][0][0] = 0;
  imaging::write_image(dir / "m.png", mask);
  CHECK(compare().psnr == 100);
  imaging::write_image(dir / "m.png", torch::zeros({1, 8, 8}));
  CHECK_THROWS_AS(compare(), DataError);
  imaging::write_image(dir / "m.png", torch::ones({1, 8, 9}));
  CHECK_THROWS_WITH(compare(), Catch::Contains("m.png") && Catch::Contains("9x8"));
}

}  // namespace
}  // namespace jade::eval
