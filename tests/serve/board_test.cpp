// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/board.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

using namespace jade;
using nlohmann::json;

TEST_CASE("board: a viewer gets what it has not got", "[serve]") {
  serve::Board board;
  board.set({7, 20, 300, "training"});
  board.add(R"({"step":1})");
  board.add(R"({"step":2})");
  const json all = json::parse(board.json(-1, -1, 2));
  CHECK(all["id"] == board.id());
  CHECK(all["step"] == 7);
  CHECK(all["steps"] == 20);
  CHECK(all["gaussians"] == 300);
  CHECK(all["phase"] == "training");
  CHECK(all["viewers"] == 2);
  CHECK(all["lines"].size() == 2);
  CHECK(all["scored"]["psnr"].empty());
  board.set(serve::Scored{5, {{"test.0", 27.5}}});
  CHECK(json::parse(board.json(-1, -1, 2))["scored"] ==
        json::parse(R"({"step":5,"psnr":{"test.0":27.5}})"));
  board.add(R"({"step":3})");
  const json rest = json::parse(board.json(all["generation"], all["count"], 2));
  CHECK(rest["lines"] == json::parse(R"([{"step":3}])"));
  CHECK(rest["count"] == 3);
  CHECK(json::parse(board.json(rest["generation"], rest["count"], 2))["lines"].empty());
  CHECK(json::parse(board.json(rest["generation"], 1000, 2))["lines"].empty());
}

TEST_CASE("board: a long run's lines are thinned out, the newest kept, and all sent again",
          "[serve]") {
  serve::Board board;
  json before = json::parse(board.json(0, 0, 0));
  int step = 0;
  while (step < 10 * static_cast<int>(serve::Board::kMostLines)) {
    board.add(json{{"step", ++step}}.dump());
    const json now = json::parse(board.json(before["generation"], before["count"], 0));
    REQUIRE(now["count"] < serve::Board::kMostLines);
    REQUIRE(now["lines"].back()["step"] == step);
    if (now["generation"] != before["generation"]) {
      CHECK(now["lines"].size() == now["count"]);
      for (size_t i = 1; i < now["lines"].size(); ++i) {
        REQUIRE(now["lines"][i]["step"] > now["lines"][i - 1]["step"]);
      }
    }
    before = now;
  }
  CHECK(before["generation"] > 5);
}
