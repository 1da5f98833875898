// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frame_times.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/npy.h"
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

TEST_CASE("frame times: nanoseconds since 1970 are told by their size", "[data]") {
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

TEST_CASE("split: both rules of the benchmarks are recognised from exposure times", "[data]") {
  const Warnings none(nullptr);
  std::vector<FrameTime> last(23, FrameTime{0, 100});
  for (size_t i = 18; i < 23; ++i) last[i] = {5, 5};
  const Split at_end = split_frames(last, {}, "t.npz", none);
  CHECK(at_end.rule.find("the last 5") != std::string::npos);
  CHECK(at_end.is_test[18]);
  CHECK_FALSE(at_end.is_test[17]);
  CHECK(split_frames(last, {SplitKind::kLast, 5, 8}, "t.npz", none).is_test == at_end.is_test);

  std::vector<FrameTime> every(34, FrameTime{0, 100});
  for (size_t i = 0; i < 34; i += 8) every[i] = {5, 5};
  const Split eighth = split_frames(every, {}, "t.npz", none);
  CHECK(eighth.rule.find("every 8th") != std::string::npos);
  CHECK(split_frames(every, {SplitKind::kEvery, 5, 8}, "t.npz", none).is_test == eighth.is_test);
  CHECK(split_by_position(34, {}, "s").is_test == eighth.is_test);
}

TEST_CASE("split: blurry frames as test views and none at all are warned of", "[data]") {
  std::vector<std::string> lines;
  const std::vector<FrameTime> blurry(10, FrameTime{0, 100});
  split_frames(blurry, {}, "t.npz", Warnings(&lines));
  CHECK(lines.size() == 1);
  split_frames(blurry, {SplitKind::kLast, 5, 8}, "t.npz", Warnings(&lines));
  CHECK(lines.size() == 6);
}

}  // namespace
}  // namespace jade::data
