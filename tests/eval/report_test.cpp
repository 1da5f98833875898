// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/report.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>
#include <torch/types.h>

using namespace jade;

TEST_CASE("evaluation: JSON holds every view, the mean and null for metrics without their network",
          "[eval]") {
  const auto truth = torch::rand({3, 24, 30});
  const auto evaluation = eval::evaluation_of(
      {eval::score("a", (truth + 0.1).clamp(0, 1), truth), eval::score("b", truth, truth)});
  const auto json = nlohmann::json::parse(eval::to_json(evaluation));
  CHECK(json["views"].size() == 2);
  CHECK(json["mean"]["psnr"] == Approx((evaluation.views[0].psnr + 100) / 2));
  CHECK(json["mean"]["lpips_alex01"].is_null());
  const std::string latin =
      eval::to_json(eval::evaluation_of({eval::score("caf\xe9", truth, truth)}));
  CHECK(nlohmann::json::parse(latin)["views"][0]["name"] == "caf\xef\xbf\xbd");
}

TEST_CASE("evaluation: the table says how to get LPIPS wherever it shows '-'", "[eval]") {
  const auto table = [](std::optional<double> alex, std::optional<double> vgg) {
    return eval::to_table(eval::evaluation_of({{"a", 30, 30, 0.9, alex, vgg}}));
  };
  const auto hint = Catch::Contains("scripts/setup.sh --metrics");
  CHECK_THAT(table({}, {}), hint);
  CHECK_THAT(table(0.1, {}), hint);
  CHECK_THAT(table(0.1, 0.2), !hint);
}

TEST_CASE("evaluation: views that training has seen have a mean of their own", "[eval]") {
  std::vector<eval::Scores> views(4);
  const std::optional<bool> marks[] = {true, false, false, std::nullopt};
  for (size_t i = 0; i < 4; ++i) {
    views[i].name = std::string(1, static_cast<char>('a' + i));
    views[i].psnr = 20 + 2.0 * static_cast<double>(i);
    views[i].ssim = 0.5 + 0.1 * static_cast<double>(i);
    views[i].seen = marks[i];
  }
  views[1].lpips_vgg = 0.3, views[2].lpips_vgg = 0.5;
  const eval::Evaluation evaluation = eval::evaluation_of(views);
  const auto json = nlohmann::json::parse(eval::to_json(evaluation));
  CHECK(json["views"][0]["seen"] == true);
  CHECK(json["views"][1]["seen"] == false);
  CHECK(json["views"][3]["seen"].is_null());
  CHECK(json["mean"]["psnr"] == Approx(23));
  CHECK(json["mean_seen"]["psnr"] == Approx(20));
  CHECK(json["mean_seen"]["lpips_vgg"].is_null());
  CHECK(json["mean_unseen"]["psnr"] == Approx(23));
  CHECK(json["mean_unseen"]["ssim"] == Approx(0.65));
  CHECK(json["mean_unseen"]["lpips_vgg"] == Approx(0.4));
  for (const char* mean : {"mean_seen", "mean_unseen"}) {
    for (const auto& [key, value] : json["mean"].items()) CHECK(json[mean].contains(key));
    CHECK(json[mean].size() == json["mean"].size());
  }
  const std::string table = eval::to_table(evaluation);
  INFO(table);
  for (const char* line :
       {"a (seen) ", "b (unseen) ", "\nd  ", "mean of seen ", "mean of unseen "}) {
    CHECK_THAT(table, Catch::Contains(line));
  }
  for (eval::Scores& view : views) view.seen.reset();
  const auto unknown = nlohmann::json::parse(eval::to_json(eval::evaluation_of(views)));
  CHECK((unknown["mean_seen"].is_null() && unknown["mean_unseen"].is_null()));
  CHECK_THAT(eval::to_table(eval::evaluation_of(views)), !Catch::Contains("seen"));
}

TEST_CASE("evaluation: held-out exposures have a mean of their own, with and without sharp views",
          "[eval]") {
  const auto truth = torch::rand({3, 24, 30});
  const std::vector<eval::ReblurScore> held{{"03", 30}, {"11", 33}};
  const auto alone = eval::evaluation_of({}, held);
  auto json = nlohmann::json::parse(eval::to_json(alone));
  CHECK(json["held_out"][1]["name"] == "11");
  CHECK(json["held_out"][1]["psnr_reblur"] == Approx(33));
  CHECK(json["mean"]["psnr_reblur"] == Approx(31.5));
  CHECK(json["mean"]["psnr"].is_null());
  CHECK_THAT(eval::to_table(alone), Catch::Contains("31.500") && !Catch::Contains("ssim"));
  const auto both = eval::evaluation_of({eval::score("a", truth, truth)}, held);
  json = nlohmann::json::parse(eval::to_json(both));
  CHECK(json["mean"]["psnr"] == Approx(100));
  CHECK(json["mean"]["psnr_reblur"] == Approx(31.5));
  CHECK(json["views"][0]["psnr_reblur"].is_null());
  CHECK_THAT(eval::to_table(both), Catch::Contains("31.500") && Catch::Contains("100.000"));
  json =
      nlohmann::json::parse(eval::to_json(eval::evaluation_of({eval::score("a", truth, truth)})));
  CHECK(json["mean"]["psnr_reblur"].is_null());
  CHECK(json["held_out"].empty());
}
