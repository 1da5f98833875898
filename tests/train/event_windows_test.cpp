// SPDX-License-Identifier: Apache-2.0
#include "jade/train/event_windows.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/data/dataset.h"
#include "jade/events/counts.h"
#include "support/poses.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

struct ShortScene : test::TinyScene {
  data::Dataset dataset() const { return data::load_dataset(test::tiny_options(*this).dataset); }
};

}  // namespace

TEST_CASE("event windows: lie in the exposure, repeat with the seed, and count its events",
          "[train]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  options.event_pixels = 50;
  const train::EventWindows windows(dataset, options, 7, torch::kCPU),
      same(dataset, options, 7, torch::kCPU);
  const int64_t height = dataset.train[1].camera.height, width = dataset.train[1].camera.width;
  bool moved = false;
  for (int64_t step = 1; step <= 20; ++step) {
    const train::EventWindow window = windows.at(step, 1), again = same.at(step, 1);
    CHECK(window.counts.equal(again.counts));
    CHECK(window.pixels.equal(again.pixels));
    CHECK(window.counts.sizes() == torch::IntArrayRef({height, width}));
    CHECK(window.pixels.numel() == 50);
    CHECK(std::get<0>(at::_unique(window.pixels)).numel() == 50);
    CHECK(window.pixels.max().item<int64_t>() < height * width);
    const torch::Tensor& cameras = window.cameras.camera_from_world;
    moved = moved || test::largest(cameras[0] - cameras[1]) > 1e-6;
    const events::ImageSize size{height, width};
    const double all = events::event_density(dataset.train[1].events, size).sum().item<double>();
    CHECK(window.counts.abs().sum().item<double>() <= all);
  }
  CHECK(moved);
  CHECK_FALSE(windows.at(1, 1).pixels.equal(windows.at(2, 1).pixels));
}

TEST_CASE("event windows: a window of the whole exposure counts all its events", "[train]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  options.event_window_share = 1;
  const train::EventWindows windows(dataset, options, 7, torch::kCPU);
  const train::EventWindow window = windows.at(1, 0);
  const data::Exposure& exposure = dataset.train[0];
  CHECK(window.counts.equal(
      events::signed_count(exposure.events, {exposure.camera.height, exposure.camera.width})));
  CHECK(test::largest(window.cameras.camera_from_world[0] - test::pose_of(exposure, 0)) < 1e-6);
  CHECK(test::largest(window.cameras.camera_from_world[1] - test::pose_of(exposure, 8)) < 1e-6);
  CHECK(window.u.equal(torch::tensor({0.0, 1.0}, torch::kFloat64)));
}

TEST_CASE("event windows: their times are those of their cameras, in units of the exposure",
          "[train]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  const train::EventWindows windows(dataset, options, 7, torch::kCPU);
  // The camera moves along x at one speed.
  const double first = dataset.train[2].poses[0].translation[0],
               last = dataset.train[2].poses[8].translation[0];
  for (int64_t step = 1; step <= 5; ++step) {
    const train::EventWindow window = windows.at(step, 2);
    for (int64_t end = 0; end < 2; ++end) {
      const double u = window.u[end].item<double>();
      CHECK(window.cameras.camera_from_world[end][0][3].item<double>() ==
            Approx(first + u * (last - first)).margin(1e-6));
    }
    CHECK((window.u[1] - window.u[0]).item<double>() == Approx(0.125).margin(1e-9));
  }
  options.event_window_share = 1;
  data::Dataset uneven = scene.dataset();
  uneven.train[2].t_end_us -= uneven.train[2].duration_us() / 2;
  const train::EventWindow beyond = train::EventWindows(uneven, options, 7, torch::kCPU).at(1, 2);
  CHECK(beyond.u.equal(torch::tensor({0.0, 1.0}, torch::kFloat64)));
  const data::Exposure& half = uneven.train[2];
  const events::EventStream& stream = uneven.events;
  const auto counted = [&](int64_t end_us) {
    return events::signed_count(
        stream.range(stream.count_before(half.t_start_us), stream.count_before(end_us)),
        {half.camera.height, half.camera.width});
  };
  CHECK(beyond.counts.equal(counted(half.t_end_us)));
  CHECK_FALSE(beyond.counts.equal(counted(dataset.train[2].t_end_us)));
}

TEST_CASE("event windows: a GPU is given the CPU's windows to the bit", "[train][cuda]") {
  const ShortScene scene;
  const data::Dataset dataset = scene.dataset();
  losses::ObjectiveOptions options;
  const train::EventWindows here(dataset, options, 7, torch::kCPU),
      there(dataset, options, 7, torch::kCUDA);
  for (int64_t step = 1; step <= 8; ++step) {
    const train::EventWindow a = here.at(step, step % 3), b = there.at(step, step % 3);
    CHECK(b.counts.is_cuda());
    CHECK(b.counts.cpu().equal(a.counts));
    CHECK(b.pixels.cpu().equal(a.pixels));
    CHECK(b.u.cpu().equal(a.u));
    CHECK(b.cameras.camera_from_world.cpu().equal(a.cameras.camera_from_world));
    CHECK(b.cameras.intrinsics.cpu().equal(a.cameras.intrinsics));
  }
}
