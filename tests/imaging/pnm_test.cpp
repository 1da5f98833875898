// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/pnm.h"

#include "support/catch.h"

#include <string>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::imaging {
namespace {

TEST_CASE("pnm: white is the number in the header, in text and in bytes", "[imaging]") {
  const test::TempDir folder;
  const std::string content = GENERATE(
      as<std::string>(), "P2\n2 1 # 3 4\n# more\n127\n127 32\n", "P5 2 1 127\n\x7F\x20",
      std::string("P5\n# comment\n2 1\n1016\n\x03\xF8\x01\x00", 30), "P2 2 1 1016 1016 256 ");
  CAPTURE(content);
  const torch::Tensor image = read_image(folder.write("a.pgm", content));
  REQUIRE(image.sizes() == torch::IntArrayRef({3, 1, 2}));
  for (int64_t c = 0; c < 3; ++c) {
    CHECK(image[c][0][0].item<double>() == Approx(1));
    CHECK(image[c][0][1].item<double>() == Approx(32.0 / 127));
  }
}

TEST_CASE("pnm: colours of a PPM are red, green and blue", "[imaging]") {
  const test::TempDir folder;
  for (const std::string content : {"P6\n1 1\n100\n\x0A\x32\x64", "P3 1 1 100 10 50 100"}) {
    const torch::Tensor image = read_image(folder.write("a.ppm", content)).flatten();
    CHECK(image.allclose(torch::tensor({0.1F, 0.5F, 1.0F})));
  }
}

TEST_CASE("pnm: values above the white level are read as of their type, and named", "[imaging]") {
  const test::TempDir folder;
  std::string fault;
  const auto path = folder.write("a.pgm", "P5 2 1 127\n\xC8\x20");
  const torch::Tensor image = read_image(path, &fault);
  CHECK(image[0][0][0].item<double>() == Approx(200.0 / 255));
  CHECK_THAT(fault, test::naming("a.pgm", "127", "200", "255"));
  CHECK_THROWS_NAMING(DataError, read_image(path), "a.pgm", "127");
  read_image(folder.write("b.pgm", "P5 2 1 255\n\xC8\x20"), &fault);
  CHECK(fault.empty());
  CHECK(read_mask(path).all().item<bool>());
}

TEST_CASE("pnm: a cut file and a header without white are refused", "[imaging]") {
  const test::TempDir folder;
  for (const char* content : {"P5 4 4 255\n123", "P5 4 4 70000\n123456789", "P2 2 1 255 7 x",
                              "P6 1 1 255", "P5 0 4 255\n", "P5 4"}) {
    CAPTURE(content);
    CHECK_THROWS_NAMING(DataError, read_image(folder.write("a.pgm", content)), "a.pgm", "expected",
                        "again");
  }
  CHECK_FALSE(read_pnm(folder.write("b.pgm", "P4 8 1\n\x0F")));
  CHECK(read_image(folder / "b.pgm").sum().item<double>() == Approx(12));
}

TEST_CASE("pnm: faults of several files are one line", "[imaging]") {
  CHECK(fault_of_all({"", ""}).empty());
  CHECK(fault_of_all({"", "a: b"}) == "a: b");
  CHECK_THAT(fault_of_all({"a: b", "", "c: d"}), test::naming("a: b", "1 more"));
}

}  // namespace
}  // namespace jade::imaging
