// SPDX-License-Identifier: Apache-2.0
#include "jade/import/importer.h"

#include "support/catch.h"

#include <array>
#include <filesystem>
#include <torch/types.h>

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/imaging/image_io.h"
#include "jade/import/capture.h"
#include "jade/simulate/simulator.h"
#include "recording/evt_words.h"
#include "support/naming.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

constexpr int64_t kFrameWidth = 96, kFrameHeight = 72;
constexpr double kFocal = 110, kEventFocal = 140;

simulate::SimulateRun small_run() {
  set_progress_enabled(false);
  simulate::SimulateRun run;
  run.seed = 3;
  simulate::SimulateOptions& o = run.simulate;
  o = simulate::preset_options(simulate::Preset::kCdavis);
  o.world = "clutter";
  o.width = kFrameWidth, o.height = kFrameHeight, o.focal_px = kFocal;
  o.exposures = 5, o.exposure_ms = 40, o.gap_ms = 20, o.motion.blur_px = 5;
  o.test_views = 0, o.seen_test_views = 0;
  o.sampling.samples = 1, o.sampling.sharp_samples = 1;
  return run;
}

/// An event camera at a distance of a hundredth from the frames' camera, rotated, with another
/// resolution.
simulate::SimulateRun rig_run() {
  simulate::SimulateRun run = small_run();
  auto& beside = run.simulate.event_camera;
  beside.centre = {0.01, -0.004, 0}, beside.turn_deg = {1.5, -2, 3};
  beside.width = 130, beside.height = 100, beside.focal_px = kEventFocal;
  return run;
}

/// Events per pixel of the frames, smoothed over three.
torch::Tensor count_map(const events::EventStream& events) {
  const torch::Tensor column = events.x().round().clamp(0, kFrameWidth - 1).to(torch::kInt64);
  const torch::Tensor row = events.y().round().clamp(0, kFrameHeight - 1).to(torch::kInt64);
  const torch::Tensor count = torch::zeros({kFrameHeight * kFrameWidth}, torch::kFloat32);
  count.index_add_(0, row * kFrameWidth + column, torch::ones({events.size()}, torch::kFloat32));
  const torch::Tensor map = count.reshape({1, 1, kFrameHeight, kFrameWidth});
  return at::avg_pool2d(map, {3, 3}, {1, 1})[0][0];
}

/// Correlation of two maps, the second shifted by that many pixels, without their borders.
double correlation(const torch::Tensor& a, const torch::Tensor& b, int64_t down, int64_t right) {
  constexpr int64_t kBorder = 12;
  const auto part = [&](const torch::Tensor& map, int64_t y, int64_t x) {
    const torch::Tensor inner = map.slice(0, kBorder + y, map.size(0) - kBorder + y)
                                    .slice(1, kBorder + x, map.size(1) - kBorder + x);
    return (inner - inner.mean()).flatten();
  };
  const torch::Tensor u = part(a, 0, 0), v = part(b, down, right);
  return (u.dot(v) / (u.norm() * v.norm())).item<double>();
}

jade::import::ImportOptions options_for(const fs::path& recording, const fs::path& colmap) {
  write_file(colmap, "");
  fs::permissions(colmap, fs::perms::owner_all);
  import::ImportOptions options;
  options.recording = recording;
  options.poses.colmap = colmap;
  // Estimating them takes seconds.
  options.events.threshold_positive = options.events.threshold_negative = 0.24;
  return options;
}

}  // namespace

TEST_CASE("importer: events of a second camera come to lie on the frames", "[import]") {
  const test::TempDir dir;
  const simulate::SimulateRun run = rig_run();
  const simulate::SimulateResult rig = simulate::simulate(run);
  simulate::write_recording(rig, run, dir / "rig");
  import::ImportOptions options = options_for(dir / "rig", dir / "colmap");
  options.lens.plane_depth = 2 / (1 / rig.content.near + 1 / rig.content.far);
  import::import_recording(options, dir / "out", {"", "undistort"});
  const fs::path stages = dir / "out/import";
  const import::Capture capture = import::load_capture(stages / "undistort");
  CHECK(capture.camera->fx == Approx(kFocal));
  CHECK(capture.sensor.width == 130);
  CHECK(capture.sensor.height == 100);
  // Compared with the events that the frames' own pixels would have recorded.
  const torch::Tensor moved = count_map(capture.events);
  const torch::Tensor own = count_map(simulate::simulate(small_run()).content.events);
  double best = -1;
  std::array<int64_t, 2> best_at{9, 9};
  for (int64_t down = -4; down <= 4; ++down) {
    for (int64_t right = -4; right <= 4; ++right) {
      const double r = correlation(moved, own, down, right);
      if (r > best) best = r, best_at = {down, right};
    }
  }
  CHECK(best_at == std::array<int64_t, 2>{0, 0});
  CHECK(best > 0.8);
  CHECK_THAT(read_file(stages / "time/stage.txt"), test::naming("0 ms"));
  CHECK_THAT(read_file(stages / "undistort/stage.txt"), Catch::Contains("px far away"));
}

TEST_CASE("importer: two cameras and the depth of their plane belong together", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = rig_run();
  run.simulate.exposures = 4, run.simulate.exposure_ms = 10;
  simulate::write_recording(simulate::simulate(run), run, dir / "rig");
  import::ImportOptions options = options_for(dir / "rig", dir / "colmap");
  const auto import = [&] { import::import_recording(options, dir / "out", {"", "undistort"}); };
  CHECK_THROWS_WITH(import(), Catch::Contains("--plane-depth: ") &&
                                  test::naming("camchain.yaml", "two cameras", "one sensor"));
  options.lens.calibration = dir / "one.txt";
  write_file(dir / "one.txt", "110 110 47.5 35.5 0 0 0 0 0\n");
  options.lens.plane_depth = 2;
  CHECK_THROWS_NAMING(ConfigError, import(), "calibration", "two cameras");
  // A depth in another unit, and a chain with more cameras than the recording.
  const std::string chain = read_file(dir / "rig/camchain.yaml");
  options.lens.calibration = dir.write("four.yaml", chain + "\ncam2:\n  a: 1\ncam3:\n  a: 1\n");
  options.lens.plane_depth = 2e-4;
  set_log_file(dir / "said.log");
  CHECK_THROWS_NAMING(DataError, import(), "--plane-depth 0.0002");
  set_log_file({});
  CHECK_THAT(read_file(dir / "said.log"), test::naming("four.yaml", "cam2", "cam3", "warn"));
  // A calibration for half the size that the events span.
  write_file(dir / "half.yaml",
             std::string(chain).replace(chain.find("[130, 100]"), 10, "[65, 50]"));
  options.lens.plane_depth = 2;
  options.lens.calibration = dir / "half.yaml";
  CHECK_THROWS_NAMING(DataError, import(), "65x50", "events", "130x100");
}

TEST_CASE("importer: two cameras without a calibration are no one sensor", "[import]") {
  const test::TempDir dir;
  std::string events = test::evt_header("3.0", "% geometry 130x100\n"), times;
  for (int i = 0; i < 4; ++i) {
    events += test::evt3_time(1000 * i + 500) + test::evt3_word(2, 3);
    imaging::write_image(dir / concat("frames/f", i, ".png"), torch::full({3, 72, 96}, 0.5));
    times += concat("f", i, ",", 1000 * i, ",", 1000 * i + 900, "\n");
  }
  dir.write("frames/exposures.csv", times);
  import::ImportOptions options = options_for(dir.write("a.raw", events), dir / "colmap");
  options.frames = dir / "frames";
  const auto import = [&] { import::import_recording(options, dir / "out", {"", "time"}); };
  CHECK_THROWS_NAMING(DataError, import(), "130x100", "96x72", "--calibration", "--plane-depth");
  // A calibration of one camera without a size fits both.
  options.lens.calibration = dir.write("one.txt", "110 110 47.5 35.5 0 0 0 0 0\n");
  CHECK_THROWS_NAMING(DataError, import(), "130x100", "96x72");
}

TEST_CASE("importer: cropped frames are named before their calibration", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.exposures = 4, run.simulate.exposure_ms = 10;
  simulate::write_recording(simulate::simulate(run), run, dir / "table");
  for (const auto& file : fs::directory_iterator(dir / "table/images")) {
    const torch::Tensor image = imaging::read_image(file.path());
    imaging::write_image(file.path(), image.slice(1, 0, 60).slice(2, 0, 80).contiguous());
  }
  import::ImportOptions options = options_for(dir / "table", dir / "colmap");
  options.lens.calibration =
      dir.write("camera.yaml",
                "image_width: 96\nimage_height: 72\ndistortion_model: plumb_bob\n"
                "camera_matrix: {rows: 3, cols: 3, data: [110, 0, 48, 0, 110, 36, 0, 0, 1]}\n"
                "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n");
  CHECK_THROWS_NAMING(DataError, import::import_recording(options, dir / "out", {"", "read"}),
                      "80x60", "cropped");
}

TEST_CASE("importer: events of a smaller sensor are named", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.exposures = 4, run.simulate.exposure_ms = 10;
  simulate::write_recording(simulate::simulate(run), run, dir / "table");
  for (const char* of_this_size : {"calibration.yaml", "calib.txt"})
    fs::remove(dir / "table" / of_this_size);
  const import::ImportOptions options = options_for(dir / "table", dir / "colmap");
  const auto said = [&](const char* out) {
    set_log_file(dir / "said.log");
    import::import_recording(options, dir / out, {"", "read"});
    set_log_file({});
    return read_file(dir / "said.log");
  };
  CHECK_THAT(said("same"), !test::naming("all over"));
  for (const auto& file : fs::directory_iterator(dir / "table/images")) {
    const torch::Tensor image = imaging::read_image(file.path());
    imaging::write_image(file.path(),
                         at::upsample_bilinear2d(image.unsqueeze(0), {144, 192}, false)[0]);
  }
  fs::remove(dir / "said.log");
  CHECK_THAT(said("twice"), test::naming("warn", "all over the 192x144 frames", "Scale"));
}

TEST_CASE("importer: half-written frames and events written twice are left out", "[import]") {
  const test::TempDir dir;
  const simulate::SimulateRun run = small_run();
  simulate::SimulateResult made = simulate::simulate(run);
  made.content.train[2].blurry.slice(1, 40).fill_(0.5);
  const events::EventStream& e = made.content.events;
  const int64_t count = e.size();
  const auto twice = [](const torch::Tensor& all) { return all.repeat_interleave(2); };
  made.content.events = {twice(e.x()), twice(e.y()), twice(e.t_us()), twice(e.polarity())};
  simulate::write_recording(made, run, dir / "table");
  set_log_file(dir / "said.log");
  import::import_recording(options_for(dir / "table", dir / "colmap"), dir / "out", {"", "read"});
  set_log_file({});
  const import::Capture capture = import::load_capture(dir / "out/import/read");
  CHECK(capture.shots.size() == 4);
  CHECK(double(capture.events.size()) == Approx(double(count)).epsilon(0.01));
  CHECK_THAT(read_file(dir / "said.log"), test::naming("1 of 5", "repeat the time"));
}

TEST_CASE("importer: events whose coordinates count from 1 are refused", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.exposures = 4;
  simulate::SimulateResult made = simulate::simulate(run);
  const events::EventStream& e = made.content.events;
  made.content.events = {e.x() + 1, e.y() + 1, e.t_us(), e.polarity()};
  simulate::write_recording(made, run, dir / "table");
  CHECK_THROWS_NAMING(DataError,
                      import::import_recording(options_for(dir / "table", dir / "colmap"),
                                               dir / "out", {"", "read"}),
                      "table", "1 to 96", "subtract 1");
}

TEST_CASE("importer: names of test frames are checked as soon as frames are there", "[import]") {
  const test::TempDir dir;
  const simulate::SimulateRun run = small_run();
  simulate::write_recording(simulate::simulate(run), run, dir / "table");
  import::ImportOptions options = options_for(dir / "table", dir / "colmap");
  options.test.names = {"nothing"};
  CHECK_THROWS_NAMING(ConfigError, import::import_recording(options, dir / "out", {"", "read"}),
                      "--test");
}

TEST_CASE("importer: one at a time works on a folder", "[import]") {
  const test::TempDir dir;
  const simulate::SimulateRun run = small_run();
  simulate::write_recording(simulate::simulate(run), run, dir / "table");
  const import::ImportOptions options = options_for(dir / "table", dir / "colmap");
  fs::create_directories(dir / "out/import");
  const auto other = FolderLock::take(dir / "out/import");
  REQUIRE(other);
  CHECK_THROWS_NAMING(DataError, import::import_recording(options, dir / "out", {"", "read"}),
                      "jade_import");
}

TEST_CASE("importer: frames of no length are sharp images", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.test_views = 1;
  simulate::write_recording(simulate::simulate(run), run, dir / "table");
  import::import_recording(options_for(dir / "table", dir / "colmap"), dir / "out",
                           {"", "restore"});
  int64_t images = 0;
  for (const auto& file : fs::directory_iterator(dir / "out/import/restore/images")) {
    images += file.path().extension() == ".png";
  }
  CHECK(images == 5 * 3 + 1);
}

TEST_CASE("importer: exposures without events are named where their length is measured",
          "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.exposures = 8;
  simulate::SimulateResult made = simulate::simulate(run);
  const data::Exposure lost = made.content.train[4];
  const events::EventStream all = made.content.events;
  const torch::Tensor kept =
      all.t_us().lt(lost.t_start_us - 9000).logical_or(all.t_us().gt(lost.t_end_us + 9000));
  made.content.events = {all.x().masked_select(kept), all.y().masked_select(kept),
                         all.t_us().masked_select(kept), all.polarity().masked_select(kept)};
  simulate::write_recording(made, run, dir / "table");
  fs::remove(dir / "table/exposures.csv");
  set_log_file(dir / "said.log");
  import::import_recording(options_for(dir / "table", dir / "colmap"), dir / "out", {"", "time"});
  set_log_file({});
  CHECK_THAT(read_file(dir / "said.log"), test::naming("1 of 8 exposures have no events"));
}

TEST_CASE("importer: a span without frames is named", "[import]") {
  const test::TempDir dir;
  simulate::SimulateRun run = small_run();
  run.simulate.exposures = 4, run.simulate.exposure_ms = 10;
  simulate::write_recording(simulate::simulate(run), run, dir / "short");
  import::ImportOptions options = options_for(dir / "short", dir / "colmap");
  options.time.begin_s = 50;
  CHECK_THROWS_NAMING(DataError, import::import_recording(options, dir / "out", {}),
                      "--begin-s 50");
}

namespace {

/// Four frames of one gray every 20 ms, exposed for 2 ms each.
fs::path write_gray_frames(const test::TempDir& dir, const std::string& name, double gray) {
  std::string times;
  for (int i = 0; i < 4; ++i) {
    imaging::write_image(dir / concat(name, "/f", i, ".png"),
                         torch::full({3, kFrameHeight, kFrameWidth}, gray));
    times += concat("f", i, ",", 20000 * i, ",", 20000 * i + 2000, "\n");
  }
  dir.write(name + "/exposures.csv", times);
  return dir / name;
}

/// Events during these exposures, by a clock that is `ahead` of theirs.
fs::path write_late_events(const test::TempDir& dir, int64_t ahead_us) {
  std::string events =
      test::evt_header("3.0", concat("% geometry ", kFrameWidth, "x", kFrameHeight, "\n"));
  for (int i = 0; i < 4; ++i) {
    events += test::evt3_time(20000 * i + 1000 + ahead_us) + test::evt3_word(0, 30) +
              test::evt3_word(2, 40 + i);
  }
  return dir.write("a.raw", events);
}

}  // namespace

TEST_CASE("importer: an offset takes the events back by what their clock is ahead", "[import]") {
  const test::TempDir dir;
  import::ImportOptions options = options_for(write_late_events(dir, 5000), dir / "colmap");
  options.frames = write_gray_frames(dir, "frames", 0.5);
  options.lens.calibration = dir.write("one.txt", "110 110 47.5 35.5 0 0 0 0 0\n");
  options.time.offset_ms = 5;
  import::import_recording(options, dir / "out", {"", "undistort"});
  CHECK_THAT(read_file(dir / "out/import/time/stage.txt"), test::naming("5 ms", "4 of 4"));
  const auto events = import::load_capture(dir / "out/import/undistort").events;
  REQUIRE(events.size() == 4);
  CHECK(events.first_us() == 1000);
  CHECK(events.last_us() == 61000);
}

TEST_CASE("importer: times of frames in a wrong unit are no offset", "[import]") {
  const test::TempDir dir;
  import::ImportOptions options = options_for(write_late_events(dir, 5000), dir / "colmap");
  options.frames = write_gray_frames(dir, "frames", 0.5);
  fs::remove(dir / "frames/exposures.csv");
  const auto import = [&] { import::import_recording(options, dir / "out", {"", "read"}); };
  // Milliseconds, which are read as seconds.
  dir.write("frames/images.txt", "20.5 f0.png\n40.5 f1.png\n60.5 f2.png\n80.5 f3.png\n");
  CHECK_THROWS_NAMING(DataError, import(), "1000 times as long", "seconds");
  dir.write("frames/images.txt", "20.02 f0.png\n20.04 f1.png\n20.06 f2.png\n20.08 f3.png\n");
  CHECK_THROWS_NAMING(DataError, import(), "--offset-ms");
}

TEST_CASE("importer: an offset may lie between a device's clock and one from 1970", "[import]") {
  import::ImportOptions options;
  config::read_text("time: {offset_ms: -1.7e12}", "a.yaml", fields_of(options));
  CHECK(options.time.offset_ms == -1.7e12);
}

TEST_CASE("importer: frames that changed behind a link are read again", "[import]") {
  const test::TempDir dir;
  const fs::path frames = write_gray_frames(dir, "elsewhere", 0.8);
  fs::create_directories(dir / "scene");
  fs::rename(write_late_events(dir, 0), dir / "scene/events.raw");
  fs::create_directory_symlink(frames, dir / "scene/images");
  fs::create_directory_symlink(dir / "scene", frames / "back");  // a cycle of links
  const import::ImportOptions options = options_for(dir / "scene", dir / "colmap");
  const auto gray = [&] {
    import::import_recording(options, dir / "out", {"", "read"});
    return import::load_capture(dir / "out/import/read").shots[0].image.mean().item<double>();
  };
  CHECK(gray() == Approx(0.8).margin(0.01));
  write_gray_frames(dir, "elsewhere", 0.4);
  CHECK(gray() == Approx(0.4).margin(0.01));
}

TEST_CASE("importer: a list above the frames that changed is read again", "[import]") {
  const test::TempDir dir;
  import::ImportOptions options = options_for(write_late_events(dir, 0), dir / "colmap");
  options.frames = write_gray_frames(dir, "rec/images", 0.5);
  fs::remove(options.frames / "exposures.csv");
  const auto first_us = [&](const std::string& list) {
    dir.write("rec/timestamps.txt", list);
    import::import_recording(options, dir / "out", {"", "read"});
    return import::load_capture(dir / "out/import/read").shots[0].t_start_us;
  };
  CHECK(first_us("20000\n40000\n60000\n80000\n") == 20000);
  CHECK(first_us("21000\n41000\n61000\n81000\n") == 21000);
}

TEST_CASE("importer: masks that lie with the frames are taken along", "[import]") {
  const test::TempDir dir;
  write_gray_frames(dir, "scene/images", 0.8);
  fs::rename(write_late_events(dir, 0), dir / "scene/events.raw");
  const import::ImportOptions options = options_for(dir / "scene", dir / "colmap");
  const auto read = [&] {
    import::import_recording(options, dir / "out", {"", "read"});
    return import::load_capture(dir / "out/import/read");
  };
  const import::Capture without = read();
  CHECK_FALSE(without.mask.defined());
  torch::Tensor mask = torch::ones({1, kFrameHeight, kFrameWidth});
  mask.slice(2, 0, 10).fill_(0);
  imaging::write_image(dir / "scene/mask.png", mask);
  CHECK(read().mask.equal(mask.to(torch::kBool)));
  mask.slice(1, 0, 10).fill_(0);
  imaging::write_image(dir / "scene/masks/f1.png", mask);
  const import::Capture with = read();
  CHECK(with.mask.sum().item<int64_t>() == kFrameHeight * (kFrameWidth - 10));
  CHECK(with.shots[1].mask.equal(mask.to(torch::kBool)));
  CHECK_FALSE(with.shots[0].mask.defined());
}

TEST_CASE("importer: other frames and another restorer are taken, and the stages behind them",
          "[import]") {
  const test::TempDir dir;
  import::ImportOptions options = options_for(write_late_events(dir, 0), dir / "colmap");
  options.time.find_offset = false;
  options.latents.kind = import::LatentKind::kMean;
  options.latents.upscale = 1;
  const auto restorer = [&](const std::string& name, const std::string& factor) {
    return test::save_restorer(dir / name, "  return " + factor + " * image\n");
  };
  /// The mean of the frames that were read, and of the restored images.
  const auto means = [&] {
    import::import_recording(options, dir / "out", {"", "restore"});
    const fs::path stages = dir / "out/import";
    double restored = 0, count = 0;
    for (const auto& file : fs::directory_iterator(stages / "restore/images")) {
      if (file.path().extension() != ".png") continue;
      restored += imaging::read_image(file.path()).mean().item<double>(), ++count;
    }
    const auto frames = import::load_capture(stages / "read").shots;
    return std::array{frames[0].image.mean().item<double>(), restored / count};
  };
  options.frames = write_gray_frames(dir, "bright", 0.8);
  options.efnet.path = restorer("whole.pt", "1.0");
  const auto first = means();
  CHECK(first[0] == Approx(0.8).margin(0.01));
  CHECK(first[1] == Approx(0.8).margin(0.01));
  options.efnet.path = restorer("half.pt", "0.5");
  CHECK(means()[1] == Approx(0.6).margin(0.01));  // the mean of EDI and the restorer
  options.frames = write_gray_frames(dir, "dark", 0.4);
  const auto last = means();
  CHECK(last[0] == Approx(0.4).margin(0.01));
  CHECK(last[1] == Approx(0.3).margin(0.01));
}
