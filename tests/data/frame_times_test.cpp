// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frame_times.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

using events::TimeUnit;

FrameTimes read(const torch::Tensor& start, const torch::Tensor& end,
                TimeUnit unit = TimeUnit::kAuto) {
  const test::TempDir folder;
  io::write_npz(folder / "t.npz", {{"timestamps_start", start}, {"timestamps_end", end}});
  return read_frame_times(folder / "t.npz", unit);
}

TEST_CASE("frame times: the unit follows from the length of the exposures", "[data]") {
  const torch::Tensor start = torch::tensor({0, 200000, 500000}, torch::kInt64);
  const torch::Tensor end = torch::tensor({100000, 300000, 500000}, torch::kInt64);
  CHECK(read(start, end).unit == TimeUnit::kUs);
  CHECK(read(start, end).frames[1].mid_us() == 250000);
  CHECK(read(start, end).frames[2].sharp());
  const FrameTimes ns = read(start * 1000, end * 1000);
  CHECK(ns.unit == TimeUnit::kNs);
  CHECK(ns.frames[1].end_us == 300000);
  const FrameTimes s = read(start.to(torch::kFloat64) * 1e-6, end.to(torch::kFloat64) * 1e-6);
  CHECK(s.unit == TimeUnit::kS);
  CHECK(s.frames[1].start_us == 200000);
  CHECK(read(start, end, TimeUnit::kNs).frames[1].end_us == 300);
}

TEST_CASE("frame times: nanoseconds since 1970 are recognised by their size", "[data]") {
  // 4 ms in ns would be 4 s in µs.
  const int64_t epoch = 1700000000123456789;
  const torch::Tensor start = torch::tensor(std::vector<int64_t>{epoch, epoch + 50000000});
  const FrameTimes times = read(start, start + 4000000);
  CHECK(times.unit == TimeUnit::kNs);
  CHECK(times.frames[0].start_us == 1700000000123457);
  CHECK(times.frames[1].end_us - times.frames[1].start_us == 4000);
}

TEST_CASE("frame times: implausible times are data errors", "[data]") {
  const torch::Tensor start = torch::tensor({0., 1.}, torch::kFloat64);
  CHECK_THROWS_AS(read(start, torch::tensor({0.5, std::nan("")}, torch::kFloat64)), DataError);
  CHECK_THROWS_AS(read(start, start + 1e15), DataError);
}

TEST_CASE("frame times: milliseconds are read where no other unit is plausible", "[data]") {
  const torch::Tensor start = torch::tensor({1000., 1100., 1200., 1300.}, torch::kFloat64);
  const FrameTimes ms = read(start, start + 40);
  CHECK(ms.unit == TimeUnit::kMs);
  CHECK(ms.frames[1].start_us == 1100000);
  CHECK(read(start.to(torch::kInt64), (start + 3).to(torch::kInt64)).unit == TimeUnit::kMs);
  CHECK(milliseconds_note(ms, TimeUnit::kAuto, "t.npz").find("t.npz") == 0);
  CHECK(milliseconds_note(ms, TimeUnit::kMs, "t.npz").empty());
  CHECK(milliseconds_note(read(start, start + 40, TimeUnit::kUs), TimeUnit::kAuto, "t").empty());
}

TEST_CASE("frame times: float32 numbers that are too coarse are refused by their type", "[data]") {
  const torch::Tensor s = torch::arange(10, torch::kFloat64) * 0.1;
  const auto coarse = [&](double offset, double factor) {
    const torch::Tensor start = ((s + offset) * factor).to(torch::kFloat32);
    return read(start, ((s + offset + 0.04) * factor).to(torch::kFloat32));
  };
  CHECK_THROWS_NAMING(DataError, coarse(1.6e9, 1), "float32", "128", "float64");
  CHECK_THROWS_NAMING(DataError, coarse(1.6e9, 1e6), "float32");
  CHECK_THROWS_NAMING(DataError, coarse(1e5, 1), "float32");
  CHECK(coarse(0, 1).frames[1].start_us == 100000);
  CHECK(coarse(1000, 1).frames[1].end_us == Approx(1000.14e6).epsilon(1e-7));
  CHECK(coarse(10, 1e6).unit == TimeUnit::kUs);
}

TEST_CASE("frame times: equal exposures and many that overlap are refused, a few are reported",
          "[data]") {
  std::vector<FrameTime> times;
  std::vector<std::string> names, lines;
  for (int64_t i = 0; i < 20; ++i) {
    times.push_back({100000 * i, 100000 * i + 40000});
    names.push_back(concat(i, ".png"));
  }
  const auto check = [&] { check_apart(times, names, "t.npz", Warnings(&lines)); };
  times[3].end_us = times[3].start_us;  // Sharp views have no exposure.
  times[4].start_us = times[4].end_us = times[3].start_us;
  times[7].end_us = times[8].start_us + 3000;  // Rounded.
  check();
  CHECK(lines.empty());
  times[9].end_us = times[10].start_us + 20000;
  check();
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("t.npz", "9.png", "10.png", "1 of 18"));
  std::vector<FrameTime> good = times;
  for (FrameTime& time : times) time.end_us += time.sharp() ? 0 : 80000;
  CHECK_THROWS_NAMING(DataError, check(), "t.npz", "overlap", "0.png");
  times = good;
  times[15] = times[2];
  CHECK_THROWS_NAMING(DataError, check(), "t.npz", "2.png", "15.png");
}

TEST_CASE("frame times: those with few digits are a warning", "[data]") {
  std::vector<FrameTime> times;
  std::vector<std::string> names, lines;
  for (int64_t i = 0; i < 20; ++i) {
    const int64_t t = (100000 * i + 2) / 3 / 10000 * 10000;
    times.push_back({t, t + 20000});
    names.push_back(concat(i, ".png"));
  }
  check_apart(times, names, "t.npz", Warnings(&lines));
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("t.npz", "steps of 10 ms", "six decimals"));
}

TEST_CASE("split: both rules of the benchmarks are recognised from exposure times", "[data]") {
  const Warnings none(nullptr);
  std::vector<FrameTime> last(23, FrameTime{0, 100});
  for (size_t i = 18; i < 23; ++i) last[i] = {5, 5};
  const Split at_end = split_frames(last, {}, "t.npz", none);
  CHECK(at_end.rule.find("the last 5") != std::string::npos);
  CHECK(at_end.is_test[18]);
  CHECK_FALSE(at_end.is_test[17]);
  CHECK(split_frames(last, {SplitKind::kLast, 5, 8, ""}, "t.npz", none).is_test == at_end.is_test);

  std::vector<FrameTime> every(34, FrameTime{0, 100});
  for (size_t i = 0; i < 34; i += 8) every[i] = {5, 5};
  const Split eighth = split_frames(every, {}, "t.npz", none);
  CHECK(eighth.rule.find("every 8th") != std::string::npos);
  CHECK(split_frames(every, {SplitKind::kEvery, 5, 8, ""}, "t.npz", none).is_test ==
        eighth.is_test);
  CHECK(split_by_position(34, {}, "s").is_test == eighth.is_test);
}

TEST_CASE("split: a file hold=N says the step of the test views", "[data]") {
  std::vector<std::string> lines;
  const auto rule = [&](const test::TempDir& folder, SplitKind kind) {
    DatasetOptions options;
    options.path = folder.path();
    options.split = kind;
    lines.clear();
    return position_rule(options, Warnings(&lines));
  };
  const test::TempDir folder;
  CHECK(rule(folder, SplitKind::kAuto).every == 8);
  folder.write("hold=6", "");
  CHECK(rule(folder, SplitKind::kEvery).every == 8);
  const Split split = split_by_position(14, rule(folder, SplitKind::kAuto), "s");
  CHECK(lines.empty());
  CHECK(split.rule == "every 6th frame from the first, by hold=6");
  for (size_t i = 0; i < 14; ++i) CHECK(split.is_test[i] == (i % 6 == 0));
  folder.write("hold=7", "");
  CHECK(rule(folder, SplitKind::kAuto).every == 8);
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("hold=6", "hold=7", "every 8th", "dataset.test_every"));
  for (const char* const name : {"hold=0", "hold=1", "hold=", "hold=6.txt", "hold=-2"}) {
    CAPTURE(name);
    const test::TempDir other;
    other.write(name, "");
    CHECK(rule(other, SplitKind::kAuto).every == 8);
    REQUIRE(lines.size() == 1);
    CHECK_THAT(lines[0], test::naming(name, "hold=N"));
  }
}

TEST_CASE("split: blurry frames as test views and none at all are warned of", "[data]") {
  std::vector<std::string> lines;
  const std::vector<FrameTime> blurry(10, FrameTime{0, 100});
  split_frames(blurry, {}, "t.npz", Warnings(&lines));
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], test::naming("dataset.split", "held_out.txt"));
  split_frames(blurry, {SplitKind::kLast, 5, 8, ""}, "t.npz", Warnings(&lines));
  CHECK(lines.size() == 6);
}

TEST_CASE("split: without any exposure, every rule names the arrays to correct", "[data]") {
  const std::vector<FrameTime> sharp(10, FrameTime{7, 7});
  for (const SplitKind kind :
       {SplitKind::kAuto, SplitKind::kLast, SplitKind::kEvery, SplitKind::kNone}) {
    CHECK_THROWS_NAMING(DataError,
                        split_frames(sharp, {kind, 5, 8, ""}, "t.npz", Warnings(nullptr)), "t.npz",
                        "timestamps_start equal to timestamps_end", "10");
  }
}

TEST_CASE("frame times: an exposure that is tiny beside the others is reported", "[data]") {
  std::vector<FrameTime> times;
  for (int64_t i = 0; i < 6; ++i) times.push_back({40000 * i, 40000 * i + 20000});
  times.push_back({300000, 300000});
  const auto told = [&] {
    std::vector<std::string> lines;
    split_frames(times, {}, "timestamps.npz", Warnings(&lines));
    return lines.empty() ? "" : lines[0];
  };
  CHECK(told().empty());
  times[2].end_us = times[2].start_us + 5000;
  CHECK(told().empty());
  times[4].end_us = times[4].start_us + 1;
  CHECK_THAT(told(), test::naming("timestamps.npz", "frame 4 (1 us)", "20000 us"));
}

}  // namespace
}  // namespace jade::data
