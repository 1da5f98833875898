// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/comparison.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

namespace jade::eval {
namespace {

Scores scores(const char* name, double psnr, std::optional<double> lpips = std::nullopt) {
  Scores s;
  s.name = name;
  s.psnr = psnr;
  s.ssim = psnr / 100;
  s.lpips_alex01 = s.lpips_vgg = lpips;
  return s;
}

const std::vector<ComparedView> kViews = {
    {"000", "sharp/000", {scores("blurry", 20), scores("mean", 27), scores("edi", 30)}},
    {"001", "sharp/001", {scores("blurry", 22), scores("mean", 29), scores("edi", 26)}}};

TEST_CASE("comparison: JSON has each view, and the means of each candidate", "[eval]") {
  const auto json = nlohmann::json::parse(to_json("edi", kViews));
  CHECK(json["method"] == "edi");
  CHECK(json["views"][1]["name"] == "001");
  CHECK(json["views"][1]["truth"] == "sharp/001");
  CHECK(json["views"][1]["psnr"] == 26);
  CHECK(json["mean"]["psnr_blurry"] == 21);
  CHECK(json["mean"]["psnr"] == 28);
  CHECK(json["mean"]["candidates"]["mean"]["psnr"] == 28);
  CHECK(json["mean"]["candidates"]["edi"]["lpips_vgg"].is_null());
  CHECK(nlohmann::json::parse(to_json("edi", {}))["mean"].is_null());
  std::vector<ComparedView> latin = kViews;
  latin[0].exposure = "caf\xe9";  // not UTF-8
  CHECK(nlohmann::json::parse(to_json("edi", latin))["views"][0]["name"] == "caf\xef\xbf\xbd");
}

TEST_CASE("comparison: the table has a column per candidate and the gain over the blurry frame",
          "[eval]") {
  const std::string table = to_table(kViews);
  INFO(table);
  CHECK_THAT(table, Catch::Contains("exposure  truth      PSNR   blurry     mean      edi\n"));
  CHECK_THAT(table, Catch::Contains("001       sharp/001          22.00    29.00    26.00\n"));
  CHECK_THAT(table, Catch::Contains("edi         28.00    +7.00   0.2800          -          -\n"));
  CHECK_THAT(table, Catch::Contains(lpips_absent()));
  CHECK_THAT(to_table(std::vector<ComparedView>{{"000", "t", {scores("blurry", 20, 0.25)}}}),
             Catch::Contains("0.2500     0.2500") && !Catch::Contains(lpips_absent()));
  CHECK_THAT(to_table(std::vector<ComparedView>{}), Catch::Contains("nothing to score"));
}

}  // namespace
}  // namespace jade::eval
