// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/stage.h"

#include "support/catch.h"

#include <future>
#include <stdexcept>
#include <thread>
#include <vector>

using namespace jade;
using serve::Answer;
using serve::Stage;
using serve::Wanted;

namespace {

constexpr Stage::Seconds kLong{20.0};

std::future<Answer> asking(Stage& stage, const std::string& key, Wanted wanted = {}) {
  return std::async(std::launch::async,
                    [&stage, key, wanted] { return stage.ask(key, wanted, kLong); });
}

Wanted wanted_at(double x) {
  Wanted wanted;
  wanted.pose.translation[0] = x;
  return wanted;
}

serve::Drawn at_step(int64_t step) {
  serve::Drawn drawn;
  drawn.step = step;
  return drawn;
}

}  // namespace

TEST_CASE("stage: who asks is drawn for, the longest waiting first", "[serve]") {
  Stage stage;
  CHECK_FALSE(stage.asked());
  CHECK_FALSE(stage.wait(Stage::Seconds(0.01)));
  auto first = asking(stage, "a", wanted_at(1));
  REQUIRE(stage.wait(kLong));
  CHECK(stage.asked());
  const auto step_of_x = [](const Wanted& wanted) {
    return at_step(static_cast<int64_t>(wanted.pose.translation[0]));
  };
  auto second = asking(stage, "b", wanted_at(2));
  stage.draw_one(step_of_x);
  CHECK(first.get().drawn.step == 1);
  REQUIRE(stage.wait(kLong));
  stage.draw_one(step_of_x);
  const Answer answer = second.get();
  CHECK(answer.kind == Answer::Kind::kDrawn);
  CHECK(answer.drawn.step == 2);
  CHECK_FALSE(stage.asked());
}

TEST_CASE("stage: of one viewer's requests the newest counts", "[serve]") {
  Stage stage;
  auto older = asking(stage, "a", wanted_at(1));
  REQUIRE(stage.wait(kLong));
  auto newer = asking(stage, "a", wanted_at(2));
  CHECK(older.get().kind == Answer::Kind::kTooLate);
  double drawn = 0;
  while (drawn == 0) {
    stage.draw_one([&](const Wanted& wanted) {
      drawn = wanted.pose.translation[0];
      return at_step(0);
    });
  }
  CHECK(drawn == 2);
  CHECK(newer.get().kind == Answer::Kind::kDrawn);
}

TEST_CASE("stage: who is not drawn for in time, or has left, leaves nothing behind", "[serve]") {
  Stage stage;
  CHECK(stage.ask("a", {}, Stage::Seconds(0.02)).kind == Answer::Kind::kTooLate);
  CHECK_FALSE(stage.asked());
  bool drawn = false;
  stage.draw_one([&](const Wanted&) {
    drawn = true;
    return at_step(0);
  });
  CHECK_FALSE(drawn);
  // It stops waiting while its picture is drawn.
  auto impatient =
      std::async(std::launch::async, [&] { return stage.ask("a", {}, Stage::Seconds(0.02)); });
  REQUIRE(stage.wait(kLong));
  stage.draw_one([&](const Wanted&) {
    impatient.wait();
    return at_step(0);
  });
  CHECK(impatient.get().kind == Answer::Kind::kTooLate);
}

TEST_CASE("stage: only so many wait", "[serve]") {
  Stage stage;
  std::vector<std::future<Answer>> waiting;
  for (size_t i = 0; i < 2 * Stage::kMostWaiting; ++i) {
    waiting.push_back(asking(stage, std::to_string(i)));
  }
  size_t full = 0;
  for (auto& one : waiting) {
    if (full == Stage::kMostWaiting) break;
    if (one.wait_for(std::chrono::seconds(0)) == std::future_status::ready) ++full;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  stage.close();
  size_t refused = 0;
  for (auto& one : waiting) refused += one.get().kind == Answer::Kind::kFull ? 1 : 0;
  CHECK(refused == Stage::kMostWaiting);
}

TEST_CASE("stage: what drawing throws is the answer, and closing answers all", "[serve]") {
  Stage stage;
  auto failed = asking(stage, "a");
  REQUIRE(stage.wait(kLong));
  stage.draw_one([](const Wanted&) -> serve::Drawn { throw std::runtime_error("out of memory"); });
  const Answer answer = failed.get();
  CHECK(answer.kind == Answer::Kind::kFailed);
  CHECK(answer.reason == "out of memory");
  auto early = asking(stage, "a");
  REQUIRE(stage.wait(kLong));
  stage.draw_one([](const Wanted&) -> serve::Drawn { throw serve::NotYet(); });
  CHECK(early.get().kind == Answer::Kind::kTooLate);
  auto waiting = asking(stage, "a");
  REQUIRE(stage.wait(kLong));
  stage.close();
  CHECK(waiting.get().kind == Answer::Kind::kTooLate);
  CHECK(stage.ask("a", {}, kLong).kind == Answer::Kind::kTooLate);
}

TEST_CASE("stage: counts its viewers, and knows for how long none was there", "[serve]") {
  Stage stage;
  CHECK(stage.viewers() == 0);
  stage.note("a");
  stage.note("b");
  stage.note("a");
  CHECK(stage.viewers() == 2);
  for (int i = 0; i < 1000; ++i) stage.note(std::to_string(i));
  CHECK(stage.viewers() <= 64);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const Stage::Seconds before = stage.silence();
  CHECK(before >= Stage::Seconds(0.3));
  stage.note("a");
  CHECK(stage.silence() < before);
}
