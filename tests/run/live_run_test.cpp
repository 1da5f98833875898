// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_run.h"

#include "support/catch.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <future>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <torch/types.h>
#include <vector>

#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"
#include "jade/run/trainer.h"
#include "jade/serve/server.h"
#include "support/tiny_run.h"

using namespace jade;
using serve::Answer;
using serve::Wanted;

namespace {

using Seconds = serve::RenderQueue::Seconds;

/// Requests everything available, as fast as it is rendered, from two viewers.
class Audience {
 public:
  Audience(serve::RenderQueue& queue, const geometry::Pose& pose,
           const geometry::Intrinsics& camera)
      : queue_(queue) {
    for (const std::string name : {"a", "b"}) {
      threads_.emplace_back([this, name, pose, camera] {
        for (int i = 0; going_; ++i) {
          Wanted wanted;
          wanted.kind = static_cast<Wanted::Kind>(i % 4);
          wanted.pose = pose;
          wanted.pose.translation[0] += 0.01 * (i % 7);
          wanted.camera = camera;
          wanted.view = i % 8 < 4 ? "test.0" : "train.0";
          if (wanted.kind == Wanted::Kind::kPicture) wanted.view = "train.0";
          wanted.picture = kPictures[i % 5];
          const Answer answer = queue_.ask(name, wanted, Seconds(1));
          if (answer.rendered.psnr) judged_ += answer.rendered.psnr() > 5 ? 1 : 0;
          seen_ += answer.kind == Answer::Kind::kRendered ? 1 : 0;
          failed_ += answer.kind == Answer::Kind::kFailed ? 1 : 0;
        }
      });
    }
  }
  ~Audience() { leave(); }
  void leave() {
    going_ = false;
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  int seen() const { return seen_; }
  int failed() const { return failed_; }
  int judged() const { return judged_; }

 private:
  static constexpr const char* kPictures[] = {"blurry", "EDI", "α", "fused", "render"};
  serve::RenderQueue& queue_;
  std::atomic<bool> going_{true};
  std::atomic<int> seen_{0}, failed_{0}, judged_{0};
  std::vector<std::thread> threads_;
};

/// A live run of twenty steps in a folder of its own.
struct LiveTraining {
  test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  serve::Server server{{"127.0.0.1", 0}, "--serve"};
  run::LiveRun live{server};
  run::Trainer trainer{options, scene.dir / "run", ""};

  nlohmann::json state() { return nlohmann::json::parse(server.board().json(-1, 0, 0)); }
};

void wait_for(const std::function<bool()>& condition) {
  for (int i = 0; i < 2000 && !condition(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  REQUIRE(condition());
}

}  // namespace

TEST_CASE("live_run: a run gives the same bits with viewers and without", "[run]") {
  if (!serve::can_serve()) return;
  test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.poses.optimize = train::PosePath::kCubic;
  options.poses.test_fit_steps = 5;
  options.train.evaluate_every = 7;
  const auto alone = scene.dir / "alone", watched = scene.dir / "watched";
  run::Trainer(options, alone, "").run();
  serve::Server server({"127.0.0.1", 0}, "--serve");
  run::LiveRun live(server);
  run::Trainer trainer(options, watched, "");
  const train::View view = trainer.bank().step_view(0);
  const auto matrix = view.cameras.camera_from_world[0];
  const auto dataset = data::load_dataset(options.dataset);
  Audience audience(server.queue(), geometry::pose_from_tensor(matrix),
                    dataset.train.front().camera);
  // They have received it before the run continues, even on a slow machine.
  server.queue().set_paused(true);
  auto going_on = std::async(std::launch::async, [&] {
    for (int i = 0; i < 6000 && (audience.seen() < 3 || audience.judged() < 1); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    server.queue().set_paused(false);
  });
  trainer.run(&live);
  going_on.get();
  audience.leave();
  CHECK(audience.seen() >= 3);
  CHECK(audience.judged() >= 1);
  CHECK(audience.failed() == 0);
  CHECK(file_sha256(alone / "point_cloud.ply") == file_sha256(watched / "point_cloud.ply"));
}

TEST_CASE("live_run: frames come from a GPU that trains, and are whole", "[run][cuda]") {
  if (!serve::can_serve()) return;
  test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.device = "cuda";
  options.train.iterations = options.train.calendar = 2000;
  serve::Server server({"127.0.0.1", 0}, "--serve");
  run::LiveRun live(server);
  run::Trainer trainer(options, scene.dir / "run", "");
  const data::Exposure exposure = data::load_dataset(options.dataset).train.front();
  Audience audience(server.queue(), exposure.poses.front(), exposure.camera);
  trainer.run(&live);
  audience.leave();
  CHECK(audience.seen() >= 10);
  CHECK(audience.failed() == 0);

  const run::GaussianSource gaussians = [&] { return trainer.state().gaussians.detached(); };
  const splat::RenderOptions draw = train::render_options(trainer.options());
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const run::LiveScene shown(dataset, draw, gaussians);
  Wanted wanted;
  wanted.pose = exposure.poses.front();
  wanted.camera = exposure.camera;
  const serve::Rendered rendered = shown.draw(wanted, 0);
  REQUIRE(rendered.finish);
  rendered.finish();
  const auto expected = run::render_view(gaussians(), wanted.pose, wanted.camera, draw);
  CHECK(rendered.image.sub(expected.cpu()).abs().max().item<double>() < 1e-5);
}

TEST_CASE("live_run: progress and metrics come as they are logged", "[run]") {
  if (!serve::can_serve()) return;
  LiveTraining training;
  training.trainer.run(&training.live);
  const nlohmann::json state = training.state();
  CHECK(state["phase"] == "finishing");
  CHECK(state["step"] == 20);
  CHECK(state["steps"] == 20);
  CHECK(state["gaussians"] == training.trainer.state().gaussians.size());
  REQUIRE(state["lines"].size() == 4);
  CHECK(state["lines"][3]["step"] == 20);
  CHECK(state["lines"][3].contains("psnr_train"));
}

TEST_CASE("live_run: a viewer can hear of the end; nobody is not waited for", "[run]") {
  if (!serve::can_serve()) return;
  const test::TinyScene scene;
  const auto seconds_to_leave = [&](const std::string& name, bool watched) {
    serve::Server server({"127.0.0.1", 0}, "--serve");
    std::optional<run::LiveRun> live(std::in_place, server);
    run::Trainer trainer(test::routed_options(scene), scene.dir / name, "");
    trainer.run(&*live);
    if (watched) server.queue().note("viewer");
    live->ended();
    const auto start = std::chrono::steady_clock::now();
    live.reset();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  CHECK(seconds_to_leave("alone", false) < 1);
  CHECK(seconds_to_leave("watched", true) > 1);
}

TEST_CASE("live_run: the page learns what an evaluation has found, and where cameras stand now",
          "[run]") {
  if (!serve::can_serve()) return;
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.poses.optimize = train::PosePath::kLinear;
  options.poses.lr = 1e-2;
  options.poses.test_fit_steps = 10;
  options.train.evaluate_every = 10;
  serve::Server server({"127.0.0.1", 0}, "--serve");
  run::LiveRun live(server);
  run::Trainer trainer(options, scene.dir / "run", "");
  const data::Dataset data = data::load_dataset(options.dataset);
  // Pauses after the evaluation at step 10, so that requests see the same step.
  struct Pausing : run::Watcher {
    run::LiveRun& live;
    serve::RenderQueue& queue;
    data::Dataset posed;
    std::optional<double> psnr;
    Pausing(run::LiveRun& to, serve::RenderQueue& at) : live(to), queue(at) {}
    void begin(const run::WatchedRun& run) override { live.begin(run); }
    double after_step() override { return live.after_step(); }
    void on_metrics(const std::string& line) override { live.on_metrics(line); }
    void ended() override { live.ended(); }
    void on_evaluation(const data::Dataset& at, const eval::Evaluation& found) override {
      posed = at;
      psnr = found.views[1].psnr;
      live.on_evaluation(at, found);
      queue.set_paused(true);
    }
  } watcher(live, server.queue());
  auto done = std::async(std::launch::async, [&] { trainer.run(&watcher); });
  const auto state = [&] { return nlohmann::json::parse(server.board().json(-1, 0, 0)); };
  wait_for([&] { return state()["phase"] == "paused"; });
  CHECK(state()["scored"]["step"] == 10);
  CHECK(state()["scored"]["psnr"]["test.1"] == *watcher.psnr);
  const auto stands = [&](const std::string& camera) {
    Wanted wanted;
    wanted.kind = Wanted::Kind::kCamera;
    wanted.view = camera;
    server.queue().note("a");
    const Answer answer = server.queue().ask("a", wanted, Seconds(10));
    REQUIRE(answer.kind == Answer::Kind::kRendered);
    return nlohmann::json::parse(answer.rendered.json)["poses"];
  };
  const auto exposure = stands("train.1"), view = stands("test.1");
  REQUIRE(exposure.size() == 9);
  REQUIRE(view.size() == 1);
  // There is one step between the evaluation and the pause.
  const auto off = [](const nlohmann::json& rows, const geometry::Pose& pose) {
    double most = 0;
    for (size_t r = 0; r < 3; ++r) {
      most = std::max(most, std::abs(rows[4 * r + 3].get<double>() - pose.translation[r]));
    }
    return most;
  };
  CHECK(off(exposure[4], watcher.posed.train[1].poses[4]) < 0.02);
  CHECK(off(exposure[4], data.train[1].poses[4]) > 1e-4);
  CHECK(off(view[0], watcher.posed.test[1].pose) < 0.02);
  server.queue().set_paused(false);
  done.get();
}

TEST_CASE("live_run: a resumed run shows the metrics before it too", "[run]") {
  if (!serve::can_serve()) return;
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  options.train.iterations = options.train.calendar = 10;
  run::Trainer(options, scene.dir / "run", "").run();
  options.train.iterations = 15;
  serve::Server server({"127.0.0.1", 0}, "--serve");
  run::LiveRun live(server);
  run::Trainer(options, scene.dir / "run", "latest").run(&live);
  const auto lines = nlohmann::json::parse(server.board().json(-1, 0, 0))["lines"];
  REQUIRE(lines.size() == 3);
  CHECK(lines[0]["step"] == 5);
}

TEST_CASE("live_run: pauses and goes on; while paused it draws what is asked", "[run]") {
  if (!serve::can_serve()) return;
  LiveTraining training;
  serve::RenderQueue& queue = training.server.queue();
  queue.set_paused(true);
  auto done = std::async(std::launch::async, [&] { training.trainer.run(&training.live); });
  wait_for([&] { return training.state()["phase"] == "paused"; });
  CHECK(training.state()["step"] == 1);
  Wanted picture;
  picture.kind = Wanted::Kind::kPicture;
  picture.view = "train.1";
  picture.picture = "blurry";
  queue.note("a");
  const Answer answer = queue.ask("a", picture, Seconds(10));
  REQUIRE(answer.kind == Answer::Kind::kRendered);
  CHECK(answer.rendered.step == 1);
  CHECK(answer.rendered.image.equal(training.trainer.bank().picture_view(1).blurry()));
  picture.picture = "secret";
  CHECK(queue.ask("a", picture, Seconds(10)).kind == Answer::Kind::kFailed);
  CHECK(training.state()["step"] == 1);
  queue.set_paused(false);
  done.get();
  CHECK(training.state()["step"] == 20);
}

TEST_CASE("live_run: a viewer that pauses and vanishes holds the run up for a while only",
          "[run]") {
  if (!serve::can_serve()) return;
  LiveTraining training;
  run::LiveRun hasty(training.server, std::chrono::milliseconds(200));
  training.server.queue().set_paused(true);
  training.trainer.run(&hasty);
  CHECK(training.state()["step"] == 20);
  CHECK_FALSE(training.server.queue().paused());
}

TEST_CASE("live_run: Ctrl-C ends a paused run as any other", "[run]") {
  if (!serve::can_serve()) return;
  LiveTraining training;
  training.server.queue().set_paused(true);
  auto done = std::async(std::launch::async, [&] { training.trainer.run(&training.live); });
  wait_for([&] { return training.state()["phase"] == "paused"; });
  set_interrupt_requested(true);
  CHECK_THROWS_AS(done.get(), Interrupted);
  set_interrupt_requested(false);
  CHECK(run::list_checkpoints(training.scene.dir / "run").size() == 1);
}
