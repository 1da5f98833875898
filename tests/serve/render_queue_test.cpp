// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/render_queue.h"

#include "support/catch.h"

#include <future>
#include <stdexcept>
#include <thread>
#include <vector>

using namespace jade;
using serve::Answer;
using serve::RenderQueue;
using serve::Wanted;

namespace {

constexpr RenderQueue::Seconds kLong{20.0};

std::future<Answer> asking(RenderQueue& queue, const std::string& key, Wanted wanted = {}) {
  return std::async(std::launch::async,
                    [&queue, key, wanted] { return queue.ask(key, wanted, kLong); });
}

Wanted wanted_at(double x) {
  Wanted wanted;
  wanted.pose.translation[0] = x;
  return wanted;
}

serve::Rendered at_step(int64_t step) {
  serve::Rendered rendered;
  rendered.step = step;
  return rendered;
}

}  // namespace

TEST_CASE("queue: who asks is rendered for, the longest waiting first", "[serve]") {
  RenderQueue queue;
  CHECK_FALSE(queue.asked());
  CHECK_FALSE(queue.wait(RenderQueue::Seconds(0.01)));
  auto first = asking(queue, "a", wanted_at(1));
  REQUIRE(queue.wait(kLong));
  CHECK(queue.asked());
  const auto step_of_x = [](const Wanted& wanted) {
    return at_step(static_cast<int64_t>(wanted.pose.translation[0]));
  };
  auto second = asking(queue, "b", wanted_at(2));
  queue.render_one(step_of_x);
  CHECK(first.get().rendered.step == 1);
  REQUIRE(queue.wait(kLong));
  queue.render_one(step_of_x);
  const Answer answer = second.get();
  CHECK(answer.kind == Answer::Kind::kRendered);
  CHECK(answer.rendered.step == 2);
  CHECK_FALSE(queue.asked());
}

TEST_CASE("queue: of one viewer's requests the newest counts", "[serve]") {
  RenderQueue queue;
  auto older = asking(queue, "a", wanted_at(1));
  REQUIRE(queue.wait(kLong));
  auto newer = asking(queue, "a", wanted_at(2));
  CHECK(older.get().kind == Answer::Kind::kTooLate);
  double rendered = 0;
  while (rendered == 0) {
    queue.render_one([&](const Wanted& wanted) {
      rendered = wanted.pose.translation[0];
      return at_step(0);
    });
  }
  CHECK(rendered == 2);
  CHECK(newer.get().kind == Answer::Kind::kRendered);
}

TEST_CASE("queue: who is not rendered for in time, or has left, leaves nothing behind", "[serve]") {
  RenderQueue queue;
  CHECK(queue.ask("a", {}, RenderQueue::Seconds(0.02)).kind == Answer::Kind::kTooLate);
  CHECK_FALSE(queue.asked());
  bool rendered = false;
  queue.render_one([&](const Wanted&) {
    rendered = true;
    return at_step(0);
  });
  CHECK_FALSE(rendered);
  // It gives up while its picture is rendered.
  auto impatient = std::async(std::launch::async,
                              [&] { return queue.ask("a", {}, RenderQueue::Seconds(0.02)); });
  REQUIRE(queue.wait(kLong));
  queue.render_one([&](const Wanted&) {
    impatient.wait();
    return at_step(0);
  });
  CHECK(impatient.get().kind == Answer::Kind::kTooLate);
}

TEST_CASE("queue: only so many wait", "[serve]") {
  RenderQueue queue;
  std::vector<std::future<Answer>> waiting;
  for (size_t i = 0; i < 2 * RenderQueue::kMostWaiting; ++i) {
    waiting.push_back(asking(queue, std::to_string(i)));
  }
  size_t full = 0;
  for (auto& one : waiting) {
    if (full == RenderQueue::kMostWaiting) break;
    if (one.wait_for(std::chrono::seconds(0)) == std::future_status::ready) ++full;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  queue.close();
  size_t refused = 0;
  for (auto& one : waiting) refused += one.get().kind == Answer::Kind::kFull ? 1 : 0;
  CHECK(refused == RenderQueue::kMostWaiting);
}

TEST_CASE("queue: what drawing throws is the answer, and closing answers all", "[serve]") {
  RenderQueue queue;
  auto failed = asking(queue, "a");
  REQUIRE(queue.wait(kLong));
  queue.render_one(
      [](const Wanted&) -> serve::Rendered { throw std::runtime_error("out of memory"); });
  const Answer answer = failed.get();
  CHECK(answer.kind == Answer::Kind::kFailed);
  CHECK(answer.reason == "out of memory");
  auto early = asking(queue, "a");
  REQUIRE(queue.wait(kLong));
  queue.render_one([](const Wanted&) -> serve::Rendered { throw serve::NotYet(); });
  CHECK(early.get().kind == Answer::Kind::kTooLate);
  auto waiting = asking(queue, "a");
  REQUIRE(queue.wait(kLong));
  queue.close();
  CHECK(waiting.get().kind == Answer::Kind::kTooLate);
  CHECK(queue.ask("a", {}, kLong).kind == Answer::Kind::kTooLate);
}

TEST_CASE("queue: counts its viewers, and knows for how long none was there", "[serve]") {
  RenderQueue queue;
  CHECK(queue.viewers() == 0);
  queue.note("a");
  queue.note("b");
  queue.note("a");
  CHECK(queue.viewers() == 2);
  for (int i = 0; i < 1000; ++i) queue.note(std::to_string(i));
  CHECK(queue.viewers() <= 64);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const RenderQueue::Seconds before = queue.silence();
  CHECK(before >= RenderQueue::Seconds(0.3));
  queue.note("a");
  CHECK(queue.silence() < before);
}
