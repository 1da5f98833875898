// SPDX-License-Identifier: Apache-2.0
// Frames of other sources, and sources of exposures.
#include "support/catch.h"

#include <cstdlib>
#include <functional>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "jade/recording/recording.h"
#include "recording/evt_words.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using namespace jade::test;

namespace {

/// An event camera that recorded the pulses [1000, 1400) and [2000, 2300) on its trigger input.
std::filesystem::path write_triggered(const TempDir& dir) {
  std::string text = evt_header("3.0", "% geometry 640x480\n");
  text += evt3_time(500) + evt3_word(2, 1);
  for (const auto& [t, level] : {std::pair{1000, 1}, {1400, 0}, {2000, 1}, {2300, 0}})
    text += evt3_time(t) + evt3_word(10, level);
  return dir.write("events.raw", text + evt3_time(3000) + evt3_word(2, 2));
}

void write_frames(const std::filesystem::path& folder, int count) {
  for (int i = 0; i < count; ++i)
    imaging::write_image(folder / concat("f", i, ".png"), torch::full({3, 6, 8}, 0.1 * i));
}

/// An uncompressed gray TIFF whose pages have the values 40 and 200.
std::string two_pages(int width, int height) {
  const auto entry = [](int tag, int type, int64_t value) {
    return bytes_of(uint64_t(tag), 2) + bytes_of(uint64_t(type), 2) + bytes_of(1, 4) +
           bytes_of(uint64_t(value), 4);
  };
  const int64_t pixels = int64_t(width) * height, directory = 2 + 9 * 12 + 4;
  std::string out = "II" + bytes_of(42, 2) + bytes_of(8, 4);
  for (const int page : {0, 1}) {
    const auto begin = int64_t(out.size());
    out += bytes_of(9, 2) + entry(256, 4, width) + entry(257, 4, height) + entry(258, 3, 8) +
           entry(259, 3, 1) + entry(262, 3, 1) + entry(273, 4, begin + directory) +
           entry(277, 3, 1) + entry(278, 4, height) + entry(279, 4, pixels);
    out += bytes_of(page == 0 ? uint64_t(begin + directory + pixels) : 0, 4);
    out += std::string(size_t(pixels), page == 0 ? char(40) : char(200));
  }
  return out;
}

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

std::string notes_of(const Recording& recording) {
  std::string out;
  for (const auto* const lines : {&recording.notes, &recording.warnings}) {
    for (const std::string& line : *lines) out += line + "\n";
  }
  return out;
}

/// A program in its own folder that is first on PATH during the object's lifetime.
class FakeProgram {
 public:
  FakeProgram(const TempDir& dir, const std::string& name, const std::string& script)
      : before_(std::getenv("PATH")) {
    const auto path = dir.write("programs/" + name, "#!/bin/sh\n" + script);
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    setenv("PATH", (path.parent_path().string() + ":" + before_).c_str(), 1);
  }
  ~FakeProgram() { setenv("PATH", before_.c_str(), 1); }
  FakeProgram(const FakeProgram&) = delete;
  FakeProgram& operator=(const FakeProgram&) = delete;

 private:
  std::string before_;
};

}  // namespace

TEST_CASE("recording: frames of a folder, exposed while the trigger input was high or low",
          "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  write_frames(dir / "frames", 2);
  ReadOptions options;
  options.frames = dir / "frames";
  const Recording high = read_recording(raw, options);
  REQUIRE(high.frames.size() == 2);
  CHECK(high.frames[0].name == "f0");
  CHECK(high.frames[0].t_start_us == 1000);
  CHECK(high.frames[0].t_end_us == 1400);
  CHECK(high.frames[1].t_start_us == 2000);
  CHECK(high.width == 640);  // of the event camera, not of the other camera
  CHECK_THAT(notes_of(high), test::naming("2 pulses", "0.4 ms"));
  // A window does not change the pairing.
  options.window = events::TimeWindow{1900, 4000};
  const Recording part = read_recording(raw, options);
  REQUIRE(part.frames.size() == 1);
  CHECK(part.frames[0].name == "f1");
  CHECK(part.triggers.rising_us == std::vector<int64_t>{2000});
  CHECK(part.events.size() == 1);
  options.window.reset();
  options.trigger_level = TriggerLevel::kLow;
  write_frames(dir / "frames", 3);
  CHECK_THAT(error_of([&] { read_recording(raw, options); }),
             test::naming("3 frames", "1 pulses of 0.6 ms", "2 rising", "2 falling"));
  std::filesystem::remove(dir / "frames/f1.png");
  std::filesystem::remove(dir / "frames/f2.png");
  const Recording low = read_recording(raw, options);
  REQUIRE(low.frames.size() == 1);
  CHECK(low.frames[0].t_start_us == 1400);
  CHECK(low.frames[0].t_end_us == 2000);
}

TEST_CASE("recording: edges of one kind are stamps, and a given length replaces that of pulses",
          "[recording]") {
  const TempDir dir;
  const auto edges = [&](const char* name, const std::vector<std::pair<int, int>>& all) {
    std::string text = evt_header("3.0", "% geometry 640x480\n") + evt3_time(500) + evt3_word(2, 1);
    for (const auto& [t, level] : all) text += evt3_time(t) + evt3_word(10, level);
    return dir.write(name, text + evt3_time(3900) + evt3_word(2, 2));
  };
  write_frames(dir / "frames", 3);
  ReadOptions options;
  options.frames = dir / "frames";
  const auto rising = edges("rising.raw", {{1000, 1}, {2000, 1}, {3000, 1}});
  const Recording starts = read_recording(rising, options);
  REQUIRE(starts.frames.size() == 3);
  CHECK(starts.frames[1].t_start_us == 2000);
  CHECK(starts.frames[1].t_end_us == 2000);
  CHECK(starts.stamp == Stamp::kStart);
  CHECK_THAT(notes_of(starts), test::naming("3 rising, 0 falling", "3 frames", "start"));
  options.trigger_level = TriggerLevel::kLow;
  CHECK(read_recording(rising, options).stamp == Stamp::kEnd);
  options.trigger_level = TriggerLevel::kHigh;
  options.exposure_ms = 0.4;
  CHECK(read_recording(rising, options).frames[2].t_end_us == 3400);
  // A signal that is low while frames are exposed.
  const auto inverted =
      edges("inverted.raw", {{1000, 0}, {1400, 1}, {2000, 0}, {2400, 1}, {3000, 0}, {3400, 1}});
  CHECK_THAT(notes_of(read_recording(inverted, options)),
             test::naming("3 pulses of 0.4 ms", "--trigger-level low"));
  // A strobe of 0.1 ms with a last pulse that was cut off.
  const auto strobe = edges(
      "strobe.raw", {{1000, 1}, {1100, 0}, {2000, 1}, {2100, 0}, {3000, 1}, {3100, 0}, {3800, 1}});
  const Recording longer = read_recording(strobe, options);
  CHECK(longer.frames[0].t_start_us == 1000);
  CHECK(longer.frames[0].t_end_us == 1400);
  CHECK_THAT(notes_of(longer), test::naming("3 pulses of 0.1 ms", "4 rising"));
  options.exposure_ms = 0;
  const Recording own = read_recording(strobe, options);
  CHECK(own.frames[0].t_end_us == 1100);
  CHECK_THAT(notes_of(own), test::naming("3 pulses", "0.1 ms", "--exposure-ms"));
  // Frames with times of their own that follow the edges have the times of those.
  const std::string rest = "0.001 f0.png\n0.002 f1.png\n";
  dir.write("frames/images.txt", rest + "0.0031 f2.png\n");
  CHECK(read_recording(rising, options).frames[2].t_start_us == 3000);
  dir.write("frames/images.txt", rest + "0.0039 f2.png\n");
  const Recording others = read_recording(rising, options);
  CHECK(others.frames[2].t_start_us == 3900);
  CHECK_THAT(notes_of(others), test::naming("3 rising, 0 falling", "3 frames", "not used"));
  write_frames(dir / "frames", 5);
  dir.write("frames/images.txt",
            "0.001 f0.png\n0.0015 f1.png\n0.002 f2.png\n0.0025 f3.png\n0.003 f4.png\n");
  const Recording unused = read_recording(strobe, options);
  CHECK(unused.frames[1].t_start_us == 1500);
  CHECK_THAT(notes_of(unused),
             test::naming("3 pulses of 0.1 ms", "4 rising", "5 frames", "not used"));
}

TEST_CASE("recording: frames of a folder have the times of a list before those of triggers",
          "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  write_frames(dir / "frames", 2);
  ReadOptions options;
  options.frames = dir / "frames";
  options.frame_times = dir.write("times.csv", "f1.png,900,950\nf0,100,150\n");
  const Recording listed = read_recording(raw, options);
  CHECK(listed.frames[0].name == "f0");
  CHECK(listed.frames[1].t_end_us == 950);
  options.frame_times.clear();
  dir.write("frames/exposures.csv", "f0,10,20\nf1,30,40\n");
  CHECK(read_recording(raw, options).frames[1].t_start_us == 30);
  dir.write("frames/exposures.csv", "name,start_us,end_us,gain\nf0,10,20,1\nf1,30,40,1\n");
  CHECK_THAT(error_of([&] { read_recording(raw, options); }),
             test::naming("three columns", "\"name,start_us\" before \"end_us\""));
  options.frames = dir / "nowhere";
  CHECK_THAT(error_of([&] { read_recording(raw, options); }), test::naming("images", "video"));
  options.frames = dir / "programs";
  std::filesystem::create_directories(options.frames);
  CHECK_THAT(error_of([&] { read_recording(raw, options); }), test::naming("images", "none"));
}

TEST_CASE("recording: a list without names has the times of the frames in their order",
          "[recording]") {
  const TempDir dir;
  dir.write("rpg/events.txt", "0.0001 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "rpg/images", 3);
  const auto second_of = [&](const std::string& list) {
    ReadOptions options;
    options.frame_times = dir.write("list.txt", list);
    const Recording recording = read_recording(dir / "rpg", options);
    REQUIRE(recording.frames.size() == 3);
    return std::pair(recording.frames[1].t_start_us, recording.frames[1].t_end_us);
  };
  const std::pair<int64_t, int64_t> time(1100000, 1100000), exposure(1100000, 1150000);
  CHECK(second_of("1.0\n1.1\n1.2\n") == time);
  CHECK(second_of("t_ns\n1000000000\n1100000000\n1200000000\n") == time);
  CHECK(second_of("# number, time\n1 1.0\n2 1.1\n3 1.2\n") == time);
  // A frame was dropped.
  CHECK(second_of("frame_id timestamp\n0 1.0\n1 1.1\n3 1.2\n") == time);
  CHECK(second_of("0 1700000001.0\n1 1700000001.1\n3 1700000001.2\n") ==
        std::pair<int64_t, int64_t>(1700000001100000, 1700000001100000));
  CHECK(second_of("1000000,1050000\n1100000,1150000\n1200000,1250000\n") == exposure);
  // Rounded to ms, exposures may overlap.
  CHECK(second_of("1000 1034\n1033 1067\n1067 1100\n") ==
        std::pair<int64_t, int64_t>(1033000, 1067000));
  // Lengths are no ends, and starts no numbers.
  CHECK_THROWS_WITH(second_of("1000000,50000\n1100000,50001\n1200000,50002\n"),
                    test::naming("list.txt"));
  CHECK(second_of("f1,1100000,1150000\nf0,1000000,1050000\nf2,1200000,1250000\n") == exposure);
  // TUM and EuRoC name the frame behind its time; others before it, in any order.
  CHECK(second_of("# time file\n1.0 images/f0.png\n1.1 images/f1.png\n1.2 images/f2.png\n") ==
        time);
  CHECK(second_of("#timestamp [ns],filename\n1000000000,f0.png\n1100000000,f1.png\r\n"
                  "1200000000,f2.png\n") == time);
  CHECK(second_of("name;time\nf2;1,2\nf1;1,1\nf0;1,0\n") == time);
  CHECK_THROWS_WITH(second_of("1.0 f0.png\n1.1 f1.png\n"), test::naming("list.txt", "f2.png"));
  CHECK_THROWS_WITH(second_of("1.0 f0.png\n1.1 f0.png\n"), test::naming("list.txt:2", "another"));
  CHECK_THROWS_WITH(second_of("1.0 f0.png\nf1.png\n"),
                    test::naming("list.txt:2", "time", "f1.png"));
  CHECK_THROWS_WITH(second_of("1.0\n1.1\n"), test::naming("list.txt", "2 lines", "3 frames"));
  CHECK_THROWS_WITH(second_of("1000000 1050000 f0.png\n"), test::naming("list.txt:1", "name"));

  // Beside the frames it needs no flag.
  dir.write("rpg/timestamps.txt", "1.0\n1.1\n1.2\n");
  const Recording found = read_recording(dir / "rpg");
  REQUIRE(found.frames.size() == 3);
  CHECK(found.frames[1].t_start_us == 1100000);
}

TEST_CASE("recording: names that are times are read as such, and numbers that count are not",
          "[recording]") {
  const TempDir dir;
  std::string said;
  const auto times_of = [&](const std::vector<std::string>& names) {
    std::filesystem::remove_all(dir / "rpg");
    dir.write("rpg/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    for (const std::string& name : names)
      imaging::write_image(dir / ("rpg/images/" + name), torch::full({3, 6, 8}, 0.5));
    const Recording recording = read_recording(dir / "rpg");
    said = notes_of(recording);
    std::vector<int64_t> out;
    for (const Frame& frame : recording.frames) out.push_back(frame.t_start_us);
    return out;
  };
  const std::vector<int64_t> times{1000000, 1100000, 1200000}, none;
  CHECK(times_of({"1.000000.png", "1.100000.png", "1.200000.png"}) == times);
  CHECK(times_of({"1000000000.png", "1100000000.png", "1200000000.png"}) == times);
  CHECK(times_of({"000001000000.png", "000001100000.png", "000001200000.png"}) == times);
  CHECK(times_of({"1000000.png", "1100000.png", "1200000.png"}) == times);
  CHECK(times_of({"1000000.png", "1100000.png", "1200000.png", "preview.png"}) == times);
  CHECK_THAT(said, test::naming("found other names: preview.png"));
  // Written with as few digits as possible.
  CHECK(times_of({"0.055.png", "0.17.png", "0.4.png"}) ==
        std::vector<int64_t>{55000, 170000, 400000});
  // Since 1970, 3.4 s apart, in s, ms, us and ns.
  const std::vector<int64_t> slow{1305031102000000, 1305031105400000};
  CHECK(times_of({"1305031102.0.png", "1305031105.4.png"}) == slow);
  CHECK(times_of({"1305031102000.png", "1305031105400.png"}) == slow);
  CHECK(times_of({"1305031102000000.png", "1305031105400000.png"}) == slow);
  CHECK(times_of({"1305031102000000000.png", "1305031105400000000.png"}) == slow);

  CHECK(times_of({"000.png", "033.png", "066.png"}) == none);
  CHECK(times_of({"000000000000.png", "000000000001.png", "000000000002.png"}) == none);
  CHECK(times_of({"00000000.png", "00001000.png", "00002000.png"}) == none);
  CHECK(times_of({"1.0000.png", "1.0001.png", "1.0002.png"}) == none);
  CHECK(times_of({"20231114221320055.png", "20231114221320170.png"}) == none);
  CHECK(times_of({"f1000000.png", "f1100000.png", "f1200000.png"}) == none);
  CHECK(times_of({"3.001.png", "3.002.png", "3.003.png"}) == none);
  CHECK(times_of({"20231114221320055123.png", "20231114221321055123.png"}) == none);
  CHECK(times_of({"0.055.png", "0.17.png", "0.4.png", "preview.png"}).size() == 3);
}

TEST_CASE("recording: pages of a TIFF are frames, or named", "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  const auto stack = dir / "stack.tif";
  dir.write("stack.tif", two_pages(8, 6));
  ReadOptions options;
  options.frames = stack;
  const Recording pages = read_recording(raw, options);
  REQUIRE(pages.frames.size() == 2);
  CHECK(pages.frames[0].image.max().item<float>() == Approx(40 / 255.0));
  CHECK(pages.frames[1].image.min().item<float>() == Approx(200 / 255.0));
  CHECK(pages.frames[1].t_start_us == 2000);
  dir.write("exposure_timestamps.txt", "1100 1200\n2100 2200\n");
  CHECK(read_recording(raw, options).frames.at(1).t_start_us == 2100);
  dir.write("frames/stack.tif", two_pages(8, 6));
  options.frames = dir / "frames";
  CHECK_THAT(error_of([&] { read_recording(raw, options); }),
             test::naming("frames/stack.tif", "2 pages", "--frames"));
  write_frames(dir / "frames", 1);
  CHECK_THAT(notes_of(read_recording(raw, options)),
             test::naming("frames/stack.tif", "2 pages", "first page of each file"));
  // Frames that replace the folder's own are read in spite of these.
  dir.write("rec/events.txt", "0.001 0 0 1\n0.003 7 5 0\n");
  dir.write("rec/images/stack.tif", two_pages(8, 6));
  dir.write("rec/images/timestamps.txt", "1500\n2500\n");
  CHECK_THAT(error_of([&] { read_recording(dir / "rec"); }),
             test::naming("images/stack.tif", "--frames"));
  options.frames = dir / "rec/images/stack.tif";
  CHECK(read_recording(dir / "rec", options).frames.at(1).t_start_us == 2500);
}

TEST_CASE("recording: a list with a line too many is not shifted by one", "[recording]") {
  const TempDir dir;
  dir.write("rec/events.txt", "0.0001 0 0 1\n2.5 7 5 0\n");
  for (const char* name : {"000001", "000002", "000003"})
    imaging::write_image(dir / concat("rec/images/", name, ".png"), torch::full({3, 6, 8}, 0.5));
  const auto first_us = [&](const std::string& list) {
    dir.write("rec/timestamps.txt", list);
    return read_recording(dir / "rec").frames.at(0).t_start_us;
  };
  CHECK(first_us("1000000\n1100000\n1200000\n") == 1000000);
  CHECK_THAT(error_of([&] { first_us("1000000\n1100000\n1200000\n1300000\n"); }),
             test::naming("timestamps.txt", "4 lines", "3 frames counted from 1", "--frame-times"));
  CHECK_THAT(error_of([&] { first_us("1000000\n1100000\n"); }),
             test::naming("timestamps.txt", "2 lines", "3 frames", "none for"));
  // The list counts itself.
  CHECK(first_us("0 1000000\n1 1100000\n2 1200000\n3 1300000\n") == 1100000);
  CHECK(first_us("1 1000000\n2 1100000\n3 1200000\n4 1300000\n") == 1000000);
  CHECK(first_us("0 900000\n1 1000000\n2 1100000\n3 1200000\n7 1300000\n") == 1000000);
  // The last frame has the last line.
  std::filesystem::remove(dir / "rec/images/000002.png");
  CHECK(first_us("1000000\n1100000\n1200000\n") == 1000000);
}

TEST_CASE("recording: lists are those of the recording and its camera", "[recording]") {
  const TempDir dir;
  const auto first_us = [&](const std::filesystem::path& folder, const ReadOptions& options = {}) {
    const Recording recording = read_recording(folder, options);
    return recording.frames.empty() ? -1 : recording.frames.front().t_start_us;
  };
  const auto make = [&](const std::string& name) {
    dir.write(name + "/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    write_frames(dir / (name + "/images"), 2);
    return dir / name;
  };
  const auto turn = make("seqs/left_turn");
  dir.write("seqs/timestamps.txt", "1000000\n1100000\n");
  CHECK(first_us(turn) == -1);
  dir.write("seqs/left_turn/timestamps.txt", "1010000\n1110000\n");
  CHECK(first_us(turn) == 1010000);
  const auto bright = make("bright_room");
  dir.write("bright_room/exposure_timestamps_left.txt", "1020000,1030000\n1120000,1130000\n");
  CHECK(first_us(bright) == 1020000);
  // A list that the user gives replaces a broken one.
  dir.write("bright_room/exposures.csv", "nothing\n");
  CHECK_THROWS_AS(first_us(bright), DataError);
  ReadOptions given;
  given.frame_times = dir.write("mine.txt", "1030000\n1130000\n");
  CHECK(first_us(bright, given) == 1030000);

  const auto named = make("named");
  dir.write("named/timestamps.txt", "# of the camera\nname,t\nf1.png,1150000\nf0.png,1050000\n");
  CHECK(first_us(named) == 1050000);
  const auto kitti = make("kitti");
  dir.write("kitti/times.txt", "1.06\n1.16\n");
  CHECK(first_us(kitti) == 1060000);
  const auto counted = make("counted");
  dir.write("counted/images.txt",
            "# id timestamp image_name\n0 1.07 images/f0.png\n1 1.17 images/f1.png\n");
  CHECK(first_us(counted) == 1070000);
  dir.write("counted/images.txt", "1.0 0.0101 images/f0.png\n1.1 0.0102 images/f1.png\n");
  CHECK(first_us(counted) == 1000000);  // times and exposures, not counts
  dir.write("micro/times.txt", "1090000\n1190000\n");
  CHECK(first_us(make("micro")) == 1090000);
  // The list of images still says which there are.
  const auto part = make("part");
  dir.write("part/images.txt", "1.0 images/f1.png\n");
  given.frame_times = dir.write("mine.csv", "f1,1110000,1120000\n");
  CHECK(first_us(part, given) == 1110000);
  const auto colmap = make("colmap");
  dir.write("colmap/images.txt", "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n");
  dir.write("colmap/timestamps.txt", "1080000\n1180000\n");
  CHECK(first_us(colmap) == 1080000);
}

TEST_CASE("recording: the only folder with frames is read, whatever its name", "[recording]") {
  const TempDir dir;
  for (const char* images : {"rgb", "imgs", "cam0/data", "image_0", "left/cam/images"}) {
    const auto folder = dir / concat("of_", std::string(images).substr(0, 3));
    dir.write(folder / "events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    write_frames(folder / images, 2);
    write_frames(folder / "depth", 3);
    write_frames(folder / "masks", 2);
    dir.write(folder / "timestamps.txt", "1000000\n1100000\n");
    const Recording recording = read_recording(folder);
    CAPTURE(images, notes_of(recording));
    REQUIRE(recording.frames.size() == 2);
    CHECK(recording.frames[1].t_start_us == 1100000);
    CHECK_THAT(notes_of(recording), test::naming(images, "read as the frames"));
  }
  // TUM's list has the folder's name.
  std::filesystem::remove(dir / "of_rgb/timestamps.txt");
  dir.write("of_rgb/rgb.txt", "# time file\n1.2 rgb/f0.png\n1.3 rgb/f1.png\n");
  CHECK(read_recording(dir / "of_rgb").frames.at(1).t_start_us == 1300000);
}

TEST_CASE("recording: images that may be no frames are named, not read", "[recording]") {
  const TempDir dir;
  const auto events = [&](const std::string& name) {
    dir.write(name + "/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    return dir / name;
  };
  int number = 0;
  for (const char* images :
       {"results", "plots/a", "disparity/event", "19classes", "event_frames", "labels", "normals",
        "render", "viz", "semantic", "images/right/rectified", "right_images"}) {
    const auto folder = events(concat("rec", number++));
    write_frames(folder / images, 2);
    dir.write(folder / "timestamps.txt", "1000000\n1100000\n");
    const Recording recording = read_recording(folder);
    CAPTURE(images);
    CHECK(recording.frames.empty());
    CHECK(recording.untimed_frames == 0);
    CHECK_THAT(notes_of(recording), test::naming("found none", images, "--frames"));
  }
  // Lists that do not fit, none, or one of another time.
  const auto folder = events("rec");
  write_frames(folder / "out", 2);
  const auto check_named = [&] {
    const Recording recording = read_recording(folder);
    CHECK(recording.frames.empty());
    CHECK_THAT(notes_of(recording), test::naming("found none", "rec/out", "--frames"));
    CHECK_THAT(notes_of(recording), !test::naming("read as the frames"));
  };
  check_named();
  dir.write("rec/timestamps.txt", "1000000\n");
  check_named();
  dir.write("rec/exposures.csv", "g0,1000000,1001000\ng1,1100000,1101000\n");
  check_named();
  dir.write("rec/exposures.csv", "f0,9000000,9001000\nf1,9100000,9101000\n");
  check_named();
  write_frames(dir / "cam", 2);
  dir.write("cam/exposures.csv", "f0,1000000,1001000\nf1,1100000,1101000\n");
  ReadOptions options;
  options.frames = dir / "cam";
  const Recording given = read_recording(folder, options);
  CHECK(given.frames.size() == 2);
  CHECK_THAT(notes_of(given), !test::naming("rec/out"));
  dir.write("rec/exposures.csv", "f0,1000000,1001000\nf1,1100000,1101000\n");
  CHECK(read_recording(folder).frames.size() == 2);
  // The second of two usual folders counts only if its times fit.
  const auto two = events("two");
  write_frames(two / "images_1", 2);
  imaging::write_image(two / "images/1700000000.1.png", torch::full({3, 6, 8}, 0.5));
  imaging::write_image(two / "images/1700000000.2.png", torch::full({3, 6, 8}, 0.5));
  CHECK(read_recording(two).untimed_frames == 2);
}

TEST_CASE("recording: of two folders of frames, or two lists, that with times is read",
          "[recording]") {
  const TempDir dir;
  dir.write("rec/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "rec/images", 2);
  write_frames(dir / "rec/frames", 3);
  CHECK(read_recording(dir / "rec").frames.empty());
  dir.write("rec/frames/timestamps.txt", "1000000\n1100000\n1200000\n");
  const Recording chosen = read_recording(dir / "rec");
  CHECK(chosen.frames.size() == 3);
  CHECK_THAT(notes_of(chosen), test::naming("rec/frames", "not those of images", "--frames"));
  dir.write("rec/images/timestamps.txt", "1000000\n1100000\n");
  CHECK(read_recording(dir / "rec").frames.size() == 2);
  // A folder that the user gives has the lists above it, too.
  std::filesystem::remove(dir / "rec/images/timestamps.txt");
  ReadOptions options;
  options.frames = dir / "rec/images";
  dir.write("rec/images.txt", "1.5 images/f0.png\n1.6 images/f1.png\n");
  CHECK(read_recording(dir / "rec/events.txt", options).frames.at(0).t_start_us == 1500000);
  options.frames = dir / "rec/frames";
  CHECK(read_recording(dir / "rec/events.txt", options).frames.at(0).t_start_us == 1000000);
  // exposures.csv counts, and a list that differs is named.
  dir.write("rec/exposures.csv", "f0,1499000,1501000\nf1,1599000,1601000\n");
  CHECK_THAT(notes_of(read_recording(dir / "rec")), !test::naming("exposures.csv: gives"));
  dir.write("rec/exposures.csv", "f0,1499000,1501000\nf1,1549000,1551000\n");
  const Recording differing = read_recording(dir / "rec");
  CHECK(differing.frames.at(1).t_start_us == 1549000);
  CHECK_THAT(notes_of(differing), test::naming("exposures.csv", "images.txt", "49 ms", "1 of 2"));
}

TEST_CASE("recording: a list of a folder's name does not outrank the usual ones", "[recording]") {
  const TempDir dir;
  const auto rec = dir / "rec";
  dir.write("rec/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(rec / "frames", 2);
  const auto first_us = [&](const std::filesystem::path& path, const ReadOptions& options = {}) {
    const Recording recording = read_recording(path, options);
    CAPTURE(notes_of(recording));
    return recording.frames.empty() ? -1 : recording.frames[0].t_start_us;
  };
  dir.write("rec/timestamps.txt", "1000000\n1100000\n");
  for (const char* list : {"0 frames/f0.png\n0 frames/f1.png\n",
                           "2 frames/f0.png\n2.1 frames/f1.png\n", "2.0 2.1\n2.2 2.3\n"}) {
    dir.write("rec/frames.txt", list);
    CHECK(first_us(rec) == 1000000);
  }
  std::filesystem::remove(rec / "timestamps.txt");
  // Not of all images, or not in their order.
  for (const char* list :
       {"0 frames/f0.png\n0 frames/f1.png\n", "2.1 frames/f0.png\n2 frames/f1.png\n",
        "2 frames/f0.png\n", "2.0 2.1\n2.2 2.3\n"}) {
    dir.write("rec/frames.txt", list);
    CHECK(first_us(rec) == -1);
  }
  // Never the events, nor a list beside the frames.
  for (const std::string name : {"events", "davis"}) {
    dir.write(name + "/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    write_frames(dir / name, 2);
    dir.write(name + "/" + name + ".txt", "0.9 0 0 1\n2.5 7 5 0\n");
    CHECK(read_recording(dir / name).untimed_frames == 2);
  }
}

TEST_CASE("recording: a folder of frames that the user gives has its own lists", "[recording]") {
  const TempDir dir;
  const auto events = dir.write("e/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "rec/images", 2);
  write_frames(dir / "rec/images_right", 2);
  ReadOptions options;
  options.frames = dir / "rec";
  dir.write("rec/images.txt", "1.5 images/f0.png\n1.6 images/f1.png\n");
  CHECK(read_recording(events, options).frames.at(0).t_start_us == 1500000);
  options.frames = dir / "rec/images_right";
  const auto said = [&] { return error_of([&] { read_recording(events, options); }); };
  CHECK_THAT(said(), test::naming("2 frames without times"));
  dir.write("rec/exposures.csv", "f0,1000000,1001000\nf1,1100000,1101000\n");
  CHECK_THAT(said(), test::naming("2 frames without times"));
}

TEST_CASE("recording: a list by another clock than exposures.csv is no fault", "[recording]") {
  const TempDir dir;
  dir.write("rec/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "rec/images", 3);
  dir.write("rec/exposures.csv", "f0,1000000,1001000\nf1,1100000,1101000\nf2,1200000,1201000\n");
  for (const char* start : {"1600000000", "1600000", "1"}) {
    std::string list;
    for (const int i : {0, 1, 2}) list += concat(start, ".", 5 + i, " images/f", i, ".png\n");
    dir.write("rec/images.txt", list);
    CAPTURE(list);
    CHECK_THAT(notes_of(read_recording(dir / "rec")), !test::naming("gives the exposures"));
  }
  dir.write("rec/images.txt", "1 images/f0.png\n1.15 images/f1.png\n1.2 images/f2.png\n");
  CHECK_THAT(notes_of(read_recording(dir / "rec")),
             test::naming("exposures.csv", "images.txt", "49 ms", "1 of 3"));
}

TEST_CASE("recording: what a folder has but is not read is named", "[recording]") {
  const TempDir dir;
  const auto said = [&](const std::string& name) { return notes_of(read_recording(dir / name)); };
  dir.write("two_cameras/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "two_cameras/cam0/data", 2);
  write_frames(dir / "two_cameras/cam1/data", 2);
  CHECK_THAT(said("two_cameras"),
             test::naming("found some in", "two_cameras/cam0/data", "cam1/data", "--frames"));
  write_frames(dir / "two/images", 2);
  dir.write("two/exposures.csv", "f0,1000000,1050000\nf1,1100000,1150000\n");
  dir.write("two/a_events.txt", "0.9 0 0 1\n");
  dir.write("two/b_events.txt", "0.9 0 0 1\n");
  CHECK_THAT(said("two"), test::naming("a_events.txt, b_events.txt", "--frames"));
  dir.write("two/b_events.txt", "Notes about these events.\n");
  CHECK(read_recording(dir / "two").events.size() == 1);
  std::filesystem::create_directory_symlink("loop", dir / "two/loop");
  CHECK(read_recording(dir / "two").frames.size() == 2);
  // Images of the recording's own folder, beside others.
  dir.write("own/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
  write_frames(dir / "own", 3);
  write_frames(dir / "own/preview", 1);
  dir.write("own/timestamps.txt", "1000000\n1100000\n1200000\n");
  CHECK(read_recording(dir / "own").frames.size() == 3);
  imaging::write_image(dir / "two/images/Mask.png", torch::ones({3, 6, 8}));
  CHECK_THAT(said("two"), test::naming("images/Mask.png", "beside their folder"));
  CHECK(read_recording(dir / "two").frames.size() == 2);
}

TEST_CASE("recording: the trigger channel with one pulse per frame is used", "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 640x480\n");
  text += evt3_time(500) + evt3_word(2, 1);
  for (const auto& [t, level] : {std::pair{1000, 1}, {1400, 0}, {2000, 1}, {2300, 0}})
    text += evt3_time(t) + evt3_word(10, level);
  for (int t = 2400; t < 2900; t += 50) text += evt3_time(t) + evt3_word(10, 0x600 | (t / 50) % 2);
  const auto raw = dir.write("clock.raw", text + evt3_time(3000) + evt3_word(2, 2));
  write_frames(dir / "frames", 2);
  ReadOptions options;
  options.frames = dir / "frames";
  const Recording recording = read_recording(raw, options);
  CHECK(recording.frames[1].t_start_us == 2000);
  CHECK(recording.frames[1].t_end_us == 2300);
  CHECK_THAT(notes_of(recording), test::naming("channel 0", "one pulse per frame"));
}

TEST_CASE("recording: frames of a video come through ffmpeg with its times", "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  write_frames(dir / "decoded", 3);
  ReadOptions options;
  options.frames = dir.write("film.mp4", "...");
  options.exposure_ms = 0.5;
  // Mimics ffmpeg 5: pictures into the folder of its last argument, times on its second output.
  const FakeProgram ffmpeg(
      dir, "ffmpeg",
      "for last; do :; done; out=$(dirname \"$last\"); i=0\n"
      "for f in " +
          (dir / "decoded").string() +
          "/*; do\n"
          "  i=$((i+1)); cp $f $out/0000000$i.png\n"
          "  echo \"[Parsed_showinfo_0 @ 0x55] n: $i pts: 5 pts_time:0.03$i dur\" >&2\n"
          "done\n");
  const Recording recording = read_recording(raw, options);
  REQUIRE(recording.frames.size() == 3);
  CHECK(recording.stamp == Stamp::kStart);
  CHECK(recording.frames[0].t_start_us == 31000);
  CHECK(recording.frames[2].t_end_us == 33500);
  CHECK(recording.frames[2].image[0][0][0].item<float>() == Approx(0.2).margin(2e-3));
  CHECK_THAT(notes_of(recording), test::naming("clock", "video"));
  CHECK_THAT(notes_of(recording), test::naming("2 pulses", "3 frames"));
  // Version 4 rounds seconds to six digits; the ticks are exact.
  const FakeProgram rounding(
      dir, "ffmpeg",
      "for last; do :; done; out=$(dirname \"$last\"); i=0\n"
      "echo '[Parsed_showinfo_0 @ 0x55] config in time_base: 1/30000, frame_rate: 30/1' >&2\n"
      "for f in " +
          (dir / "decoded").string() +
          "/*; do\n"
          "  i=$((i+1)); cp $f $out/0000000$i.png\n"
          "  echo \"[Parsed_showinfo_0 @ 0x55] n: $i pts:  3426100$i pts_time:1142.03\" >&2\n"
          "done\n");
  CHECK(read_recording(raw, options).frames[0].t_start_us == 1142033367);
  const FakeProgram broken(dir, "ffmpeg", "echo moov atom not found >&2; exit 1\n");
  CHECK_THAT(
      error_of([&] { read_recording(raw, options); }),
      Catch::Contains("film.mp4: expected a folder of images or a video, and ffmpeg cannot read "
                      "it as one (moov atom not found); convert it"));
  // An option name unknown to this version is not an error of the video.
  const FakeProgram newer(dir, "ffmpeg",
                          "case \"$*\" in *-vsync*) echo Option not found >&2;; "
                          "*) echo Invalid data >&2;; esac; exit 1\n");
  CHECK_THAT(error_of([&] { read_recording(raw, options); }), Catch::Contains("(Invalid data);"));
}

TEST_CASE("recording: frames without padded numbers are in the order of their numbers",
          "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 640x480\n");
  for (int i = 0; i < 11; ++i) {
    text += evt3_time(1000 * i + 1000) + evt3_word(2, 1) + evt3_word(10, 1);
    text += evt3_time(1000 * i + 1400) + evt3_word(10, 0);
  }
  const auto raw = dir.write("events.raw", text);
  write_frames(dir / "frames", 11);
  ReadOptions options;
  options.frames = dir / "frames";
  const Recording recording = read_recording(raw, options);
  REQUIRE(recording.frames.size() == 11);
  CHECK(recording.frames[2].name == "f2");
  CHECK(recording.frames[2].t_start_us == 3000);
  CHECK(recording.frames[10].name == "f10");
  CHECK(recording.frames[10].t_start_us == 11000);
}

TEST_CASE("recording: a real video through the real ffmpeg", "[recording]") {
  const TempDir dir;
  if (std::system("command -v ffmpeg >/dev/null") != 0) {
    WARN("SKIPPED: ffmpeg is not installed");
    SUCCEED();
    return;
  }
  write_frames(dir / "frames", 4);
  for (int i = 0; i < 4; ++i) {  // an encoder wants more than a few pixels
    imaging::write_image(dir / concat("frames/f", i, ".png"), torch::full({3, 32, 48}, 0.2 * i));
  }
  const std::string film = (dir / "film.mkv").string();
  REQUIRE(std::system(concat("ffmpeg -nostdin -loglevel error -framerate 20 -i ",
                             (dir / "frames/f%d.png").string(), " -c:v ffv1 ", film)
                          .c_str()) == 0);
  ReadOptions options;
  options.frames = film;
  options.exposure_ms = 10;
  const Recording recording = read_recording(write_triggered(dir), options);
  REQUIRE(recording.frames.size() == 4);
  for (int i = 0; i < 4; ++i) {
    CHECK(recording.frames[size_t(i)].t_start_us == 50000 * i);
    CHECK(recording.frames[size_t(i)].t_end_us == 50000 * i + 10000);
    CHECK(recording.frames[size_t(i)].image.mean().item<double>() == Approx(0.2 * i).margin(0.01));
  }
}

TEST_CASE("recording: only events near frames are read, on the clock of the events",
          "[recording]") {
  const TempDir dir;
  write_frames(dir / "a/images", 3);
  // Frames at 0, 0.1 and 2 s; events every 10 ms for 4 s.
  dir.write("a/images/exposures.csv",
            "name,start_us,end_us\nf0,0,20000\nf1,100000,120000\nf2,2000000,2020000\n");
  std::string events = "t,x,y,p\n";
  for (int i = 0; i < 400; ++i) events += concat(10000 * i, ",3,4,1\n");
  dir.write("a/events.csv", events);
  ReadOptions options;
  options.time_unit = events::TimeUnit::kUs;
  CHECK(read_recording(dir / "a", options).events.size() == 400);
  options.near_frames_ahead_us = 0;
  const Recording near = read_recording(dir / "a", options);
  // Up to 250 ms after 0.12 s, and from 250 ms before 2 s to as much after 2.02 s.
  CHECK(near.events.size() == 37 + 52);
  CHECK(near.stored_events == 400);
  CHECK(near.stored_us.end_us == 3990001);
  CHECK_THAT(notes_of(near), test::naming("311 of 400 events"));
  options.near_frames_ahead_us = 1000000;
  CHECK(read_recording(dir / "a", options).events.first_us() == 750000);
  options.near_frames_ahead_us = 0;
  options.since_first_frame = events::TimeWindow{90000, 1000000};
  const Recording span = read_recording(dir / "a", options);
  REQUIRE(span.frames.size() == 1);
  CHECK(span.frames[0].name == "f1");
  CHECK(span.events.last_us() == 360000);
}

TEST_CASE("recording: exposures moved by the given offset determine the unit of events",
          "[recording]") {
  const TempDir dir;
  write_frames(dir / "a/images", 3);
  constexpr int64_t kHourUs = 3600000000;
  // An hour apart; without the offset, whole-number exposures would be read as ns.
  const auto write = [&](int64_t events_us, int64_t frames_us) {
    std::string exposures, events;
    for (int i = 0; i < 3; ++i) {
      const int64_t begin_us = frames_us + 1000000 + 5000000 * i;
      exposures += concat("f", i, ",", begin_us, ",", begin_us + 20000, "\n");
    }
    for (int64_t t = 0; t < 15000000; t += 10000) events += concat(events_us + t, ",3,4,1\n");
    dir.write("a/images/exposures.csv", exposures);
    dir.write("a/events.csv", events);
  };
  ReadOptions options;
  write(kHourUs, 0);
  options.near_frames_ahead_us = kHourUs;
  CHECK(read_recording(dir / "a", options).events.first_us() == kHourUs + 750000);
  write(0, kHourUs);
  options.near_frames_ahead_us = -kHourUs;
  CHECK(read_recording(dir / "a", options).events.first_us() == 750000);
}

TEST_CASE("recording: of a Prophesee file only events near frames are kept", "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  write_frames(dir / "frames", 2);
  ReadOptions options;
  options.frames = dir / "frames";
  const Recording all = read_recording(raw, options);
  options.near_frames_ahead_us = 0;
  CHECK(read_recording(raw, options).events.size() == all.events.size());
  options.near_frames_ahead_us = -100000000;
  const Recording none = read_recording(raw, options);
  CHECK(none.events.empty());
  CHECK(none.stored_events == all.events.size());
  CHECK(none.frames.size() == 2);
  CHECK_THAT(notes_of(none), !test::naming("no events"));
}

TEST_CASE("recording: a span of a Prophesee file has its first microsecond and not its last",
          "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 640x480\n");
  for (const int t : {999, 1000, 1500, 2299, 2300}) text += evt3_time(t) + evt3_word(2, 1);
  const auto raw = dir.write("a.raw", text);
  write_frames(dir / "frames", 2);
  dir.write("frames/exposures.csv", "f0,1000,1400\nf1,2000,2300\n");
  ReadOptions options;
  options.frames = dir / "frames";
  const auto read = [&](int64_t begin_us, int64_t end_us) {
    options.window = events::TimeWindow{begin_us, end_us};
    return read_recording(raw, options);
  };
  const Recording both = read(1000, 2300);
  CHECK(both.frames.size() == 2);
  REQUIRE(both.events.size() == 3);
  CHECK(both.events.first_us() == 1000);
  CHECK(both.events.last_us() == 2299);
  // A frame whose exposure extends beyond either end is skipped.
  REQUIRE(read(1001, 2300).frames.size() == 1);
  CHECK(read(1001, 2300).frames[0].name == "f1");
  REQUIRE(read(1000, 2299).frames.size() == 1);
  CHECK(read(1000, 2299).frames[0].name == "f0");
  // Times since the first frame.
  options.window.reset();
  options.since_first_frame = events::TimeWindow{1000, 1300};
  const Recording late = read_recording(raw, options);
  REQUIRE(late.frames.size() == 1);
  CHECK(late.frames[0].name == "f1");
  REQUIRE(late.events.size() == 1);
  CHECK(late.events.first_us() == 2299);
}

TEST_CASE("recording: a look at the first events tells of all", "[recording]") {
  const TempDir dir;
  const auto raw = write_triggered(dir);
  const Recording all = read_recording(raw);
  REQUIRE(all.events.size() == 2);
  ReadOptions options;
  options.most_events = 1;
  const Recording first = read_recording(raw, options);
  CHECK(first.events.t_us().equal(all.events.t_us().narrow(0, 0, 1)));
  CHECK(first.stored_events == all.events.size());
  CHECK(first.stored_us.end_us > all.events.last_us());
  CHECK_THAT(notes_of(first), test::naming("2 events", "first 1"));

  options.most_events = 2;
  io::Hdf5Writer writer(dir / "list.h5");
  for (const char* name : {"x", "y", "p"})
    writer.append(name, std::vector<int64_t>{1, 0, 1, 0}.data(), 4);
  writer.append("t", std::vector<int64_t>{10, 20, 30, 40}.data(), 4);
  writer.close();
  const Recording list = read_recording(dir / "list.h5", options);
  CHECK(list.events.last_us() == 20);
  CHECK(list.stored_events == 4);
  CHECK(list.stored_us.end_us == 41);
  options.window = events::TimeWindow{20, 41};
  CHECK(read_recording(dir / "list.h5", options).events.last_us() == 30);
}

namespace {

/// Frames of noise, exposed for 20 ms every 40 ms from 1 s on, and an event every 100 µs.
struct Noise {
  const TempDir dir;
  std::filesystem::path folder = dir / "a";
  int count = 6;

  Noise() {
    torch::manual_seed(7);
    for (int i = 0; i < count; ++i) write_frame(i, torch::rand({3, 12, 16}));
    write_times(1);
    write_events([](int64_t) { return true; });
  }
  void write_frame(int index, const torch::Tensor& image) const {
    imaging::write_image(folder / concat("images/f", index, ".png"), image);
  }
  void write_times(int64_t per_us) const {
    std::string text;
    for (int64_t i = 0; i < count; ++i) {
      const int64_t t = 1000000 + 40000 * i;
      text += concat("f", i, ",", per_us * t, ",", per_us * (t + 20000), "\n");
    }
    dir.write("a/images/exposures.csv", text);
  }
  /// @param keeps  whether there is an event at this time, in µs
  void write_events(const std::function<bool(int64_t)>& keeps, int width = 16,
                    bool one_polarity = false) const {
    std::string text = "t_us,x,y,p\n";
    for (int64_t i = 0; i < 3000; ++i) {
      const int64_t t = 980000 + 100 * i;
      if (keeps(t))
        text += concat(t, ",", i % width, ",", i / 7 % 12, ",", one_polarity || i % 2 == 0, "\n");
    }
    dir.write("a/events.csv", text);
  }
  std::string notes() const { return notes_of(read_recording(folder)); }
};

}  // namespace

TEST_CASE("recording: exposures in nanoseconds are refused", "[recording]") {
  const Noise noise;
  CHECK(read_recording(noise.folder).frames.size() == 6);
  noise.write_times(1000);
  CHECK_THAT(error_of([&] { noise.notes(); }),
             test::naming("exposures.csv", "20 s", "nanoseconds, divide them by 1000"));
}

TEST_CASE("recording: blank and repeated frames are noted", "[recording]") {
  const Noise noise;
  CHECK_THAT(noise.notes(), !test::naming("expected frames"));
  noise.write_frame(2, torch::zeros({3, 12, 16}));
  noise.write_frame(4, torch::ones({3, 12, 16}));
  std::filesystem::copy_file(noise.folder / "images/f0.png", noise.folder / "images/f1.png",
                             std::filesystem::copy_options::overwrite_existing);
  CHECK_THAT(noise.notes(), test::naming("1 of 6 all black (the first is f2)",
                                         "1 of 6 all white (the first is f4)",
                                         "1 of 6 identical to the frame before (the first is f1)"));
}

TEST_CASE("recording: two frames with one time are refused by name", "[recording]") {
  const Noise noise;
  std::filesystem::remove(noise.folder / "images/exposures.csv");
  const auto write = [&](double step) {
    std::string text;
    for (int i = 0; i < noise.count; ++i)
      text += concat(1 + step * (i == 4 ? 3 : i), " images/f", i, ".png\n");
    noise.dir.write("a/images.txt", text);
  };
  write(0.04);
  CHECK_THAT(error_of([&] { noise.notes(); }), test::naming("f3.png and f4.png", "1120000 us"));
  // A driver that wrote no times is another fault, with its own message.
  std::string zeros;
  for (int i = 0; i < noise.count; ++i) zeros += concat("0 images/f", i, ".png\n");
  noise.dir.write("a/images.txt", zeros);
  CHECK_THAT(noise.notes(), test::naming("stamp of 0"));
}

TEST_CASE("recording: exposures without events between others are noted", "[recording]") {
  const Noise noise;
  CHECK_THAT(noise.notes(), !test::naming("have no events"));
  noise.write_events([](int64_t t) { return t < 1070000 || t > 1145000; });
  CHECK_THAT(noise.notes(), test::naming("2 of 6 exposures have no events (the first is f2)"));
  // A loss within exposures.
  noise.write_events([](int64_t t) { return t < 1085000 || t > 1095000; });
  CHECK_THAT(noise.notes(), test::naming("1 stretch without any", "in f2", "lost packets"));
  // Exposures of sharp frames may fall between two events.
  noise.write_events([](int64_t) { return true; });
  std::string text;
  for (int64_t i = 0; i < noise.count; ++i)
    text += concat("f", i, ",", 1000010 + 40000 * i, ",", 1000011 + 40000 * i, "\n");
  noise.dir.write("a/images/exposures.csv", text);
  CHECK_THAT(noise.notes(), !test::naming("have no events"));
}

TEST_CASE("recording: events of one polarity or of a part of the frames are noted", "[recording]") {
  const Noise noise;
  CHECK_THAT(noise.notes(), !test::naming("polarity"));
  CHECK_THAT(noise.notes(), !test::naming("expected events all over"));
  const auto always = [](int64_t) { return true; };
  noise.write_events(always, 16, true);
  CHECK_THAT(noise.notes(), test::naming("3000 of 3000", "one polarity only"));
  // The last columns have a few events, so that the sensor's size is known.
  noise.write_events(always, 8);
  std::string text = read_file(noise.folder / "events.csv");
  noise.dir.write("a/events.csv", text + "1279999,15,11,1\n");
  CHECK_THAT(noise.notes(), test::naming("16x12", "% of their width"));
}

TEST_CASE("recording: names with blanks in a list of times", "[recording]") {
  const Noise noise;
  std::filesystem::remove(noise.folder / "images/exposures.csv");
  std::string text;
  for (int i = 0; i < noise.count; ++i) {
    std::filesystem::rename(noise.folder / concat("images/f", i, ".png"),
                            noise.folder / concat("images/f ", i, ".png"));
    const char* const quote = i == 1 ? "\"" : "";
    text += concat(1 + 0.04 * i, " ", quote, "images/f ", i, ".png", quote, i == 2 ? " 0 0" : "",
                   i == 3 ? "\r\n" : "\n");
  }
  noise.dir.write("a/images.txt", text);
  const Recording recording = read_recording(noise.folder);
  REQUIRE(recording.frames.size() == 6);
  CHECK(recording.frames[2].name == "f 2");
  CHECK(recording.frames[5].t_start_us == 1200000);
}

TEST_CASE("recording: a list of names with complete paths, or without times", "[recording]") {
  const Noise noise;
  const std::string times = read_file(noise.folder / "images/exposures.csv");
  noise.dir.write("a/images.txt", "images/f0.png\nimages/f1.png\n");
  CHECK(read_recording(noise.folder).frames.at(1).t_start_us == 1040000);
  std::filesystem::remove(noise.folder / "images/exposures.csv");
  CHECK_THAT(error_of([&] { noise.notes(); }), test::naming("images.txt:1", "seconds"));
  for (const std::filesystem::path& place : {noise.folder, std::filesystem::path("/moved/away")}) {
    std::string text;
    for (int i = 0; i < noise.count; ++i)
      text += concat(1 + 0.04 * i, " ", (place / "images/f").string(), i, ".png\n");
    noise.dir.write("a/images.txt", text);
    const Recording recording = read_recording(noise.folder);
    REQUIRE(recording.frames.size() == 6);
    CHECK(recording.frames[5].t_start_us == 1200000);
  }
}

TEST_CASE("recording: events separated by tabs, and names in capitals", "[recording]") {
  const Noise noise;
  const std::string text = read_file(noise.folder / "events.csv");
  std::filesystem::remove(noise.folder / "events.csv");
  for (const char* const name : {"events.tsv", "EVENTS.CSV"}) {
    noise.dir.write(std::string("a/") + name, text);
    CHECK(read_recording(noise.folder).events.size() == 3000);
    std::filesystem::remove(noise.folder / name);
  }
  const TempDir dir;
  std::filesystem::rename(write_triggered(dir), dir / "EVENTS.RAW");
  write_frames(dir / "images", 2);
  CHECK(read_recording(dir.path()).events.size() == 2);
}

TEST_CASE("recording: times of frames and events with few digits are noted", "[recording]") {
  const Noise noise;
  CHECK_THAT(noise.notes(), !test::naming("digits were lost"));
  std::string frames, events = "t_s,x,y,p\n";
  for (int i = 0; i < noise.count; ++i)
    frames += concat("f", i, ",", 1000000 + 10000 * (i * 10 / 3), ",",
                     1020000 + 10000 * (i * 10 / 3), "\n");
  for (int i = 0; i < 6000; ++i)
    events += concat(0.98 + 0.01 * (i / 200), ",", i % 16, ",", i / 7 % 12, ",", i % 2, "\n");
  noise.dir.write("a/images/exposures.csv", frames);
  CHECK_THAT(noise.notes(), test::naming("all of 6 in steps of 10 ms"));
  noise.dir.write("a/events.csv", events);
  CHECK_THAT(noise.notes(), test::naming("events at 30 times", "10 ms apart"));
}

TEST_CASE("recording: names with accents in another form are found and noted", "[recording]") {
  const Noise noise;
  std::string exposures, stamps;
  for (int i = 0; i < noise.count; ++i) {
    std::filesystem::rename(noise.folder / concat("images/f", i, ".png"),
                            noise.folder / concat("images/e\u0301", i, ".png"));
    const int t = 1000000 + 40000 * i;
    exposures += concat("\u00e9", i, ",", t, ",", t + 20000, "\n");
    stamps += concat(1e-6 * t, " images/\u00e9", i, ".png\n");
  }
  noise.dir.write("a/images/exposures.csv", exposures);
  CHECK(read_recording(noise.folder).frames.at(5).t_start_us == 1200000);
  CHECK_THAT(noise.notes(), test::naming("6 names, such as \u00e90", "another form"));
  std::filesystem::remove(noise.folder / "images/exposures.csv");
  noise.dir.write("a/images.txt", stamps);
  CHECK(read_recording(noise.folder).frames.size() == 6);
  CHECK_THAT(noise.notes(), test::naming("6 names, such as images/\u00e90.png"));
}

TEST_CASE("recording: capital endings are read, hidden files are not", "[recording]") {
  const TempDir dir;
  dir.write("rpg/events.txt", "0.0001 0 0 1\n0.001 7 5 0\n");
  for (const char* name : {"a.png", "b.png"}) {
    imaging::write_image(dir / "rpg/images" / name, torch::full({3, 6, 8}, 0.5));
    std::filesystem::rename(
        dir / "rpg/images" / name,
        dir / "rpg/images" / std::filesystem::path(name).replace_extension("PNG"));
  }
  for (const char* hidden : {"._a.PNG", ".DS_Store", "Thumbs.db"})
    dir.write(std::string("rpg/images/") + hidden, "\0\5\x16\7 of macOS or Windows");
  dir.write("rpg/images.txt", "0.0002 images/a.png\n0.0006 images/b.PNG\n");
  const Recording listed = read_recording(dir / "rpg");
  REQUIRE(listed.frames.size() == 2);
  CHECK(listed.frames[0].t_start_us == 200);
  CHECK(listed.warnings.empty());
  dir.write("rpg/exposures.csv", "a.png,100,300\nb,500,700\n");
  CHECK(read_recording(dir / "rpg").frames[0].t_end_us == 300);
  ReadOptions options;
  options.frames = dir / "rpg/images";
  options.frame_times = dir / "rpg/exposures.csv";
  CHECK(read_recording(dir / "rpg/events.txt", options).frames.size() == 2);
}

TEST_CASE("recording: a folder without frames and an archive of frames are named", "[recording]") {
  const TempDir dir;
  dir.write("rec/events.csv", "100 1 2 1\n900 3 4 0\n");
  std::filesystem::create_directories(dir / "rec/images");
  dir.write("rec/images/.DS_Store", "x");
  CHECK_THAT(notes_of(read_recording(dir / "rec")), test::naming("rec/images", "found none"));
  imaging::write_image(dir / "rec/images/cam0/a.png", torch::full({3, 6, 8}, 0.5));
  CHECK_THAT(notes_of(read_recording(dir / "rec")),
             test::naming("rec: ", "found none", "rec/images/cam0", "--frames"));
  ReadOptions options;
  options.frames = dir / "rec/images";
  CHECK_THAT(error_of([&] { read_recording(dir / "rec/events.csv", options); }),
             test::naming("rec/images", "rec/images/cam0", "--frames"));
  options.frames = dir.write("frames.zip", "PK\x03\x04 more");
  CHECK_THAT(error_of([&] { read_recording(dir / "rec/events.csv", options); }),
             test::naming("frames.zip", "zip archive", "unpack"));
  options.frames = dir.write("frames.7z", "7z\xBC\xAF\x27\x1C");
  CHECK_THAT(error_of([&] { read_recording(dir / "rec/events.csv", options); }),
             test::naming("frames.7z", "7z x frames.7z"));
}

TEST_CASE("recording: a folder with frames of a kind that is not read says so", "[recording]") {
  const Noise noise;
  noise.dir.write("b/1.heic", "");
  ReadOptions options;
  options.frames = noise.dir / "b";
  CHECK_THAT(error_of([&] { read_recording(noise.folder, options); }),
             test::naming("found none", "1 file .heic", ".png"));
}

TEST_CASE("recording: frames that are cropped from the sensor are noted with both sizes",
          "[recording]") {
  const Noise noise;
  const auto always = [](int64_t) { return true; };
  CHECK_THAT(noise.notes(), !test::naming("cropped"));
  noise.write_events(always, 20);
  CHECK_THAT(noise.notes(), test::naming("20x12 px", "16x12 px", "cropped or resized"));
}

TEST_CASE("frames: a frame that is damaged in part is read, with a warning", "[recording]") {
  const TempDir dir;
  dir.write("rpg/events.txt", "0.1 0 0 1\n0.5 1 1 0\n");
  dir.write("rpg/images.txt", "0.2 images/a.pgm\n0.3 images/b.pgm\n0.4 images/c.pgm\n");
  dir.write("rpg/images/a.pgm", "P5 2 2 255\nabcd");
  dir.write("rpg/images/b.pgm", "P5 2 2 30\n1234");
  dir.write("rpg/images/c.pgm", "P5 2 2 30\n5678");
  const Recording recording = read_recording(dir / "rpg");
  CHECK(recording.frames.size() == 3);
  REQUIRE(recording.warnings.size() == 1);
  CHECK_THAT(recording.warnings[0], naming("b.pgm: expected", "30", "1 more"));
}

TEST_CASE("frames: --frame-times takes arrays of NumPy", "[recording]") {
  const TempDir dir;
  dir.write("rpg/events.txt", "0.1 0 0 1\n0.5 1 1 0\n");
  write_frames(dir / "rpg/images", 2);
  ReadOptions options;
  options.frame_times = dir / "times.npz";
  const auto i64 = torch::kInt64;
  io::write_npz(options.frame_times, {{"timestamps_start", torch::tensor({100000, 300000}, i64)},
                                      {"timestamps_end", torch::tensor({150000, 340000}, i64)}});
  const Recording recording = read_recording(dir / "rpg", options);
  REQUIRE(recording.frames.size() == 2);
  CHECK(recording.frames[1].t_start_us == 300000);
  CHECK(recording.frames[1].t_end_us == 340000);
  io::write_npz(options.frame_times, {{"t", torch::tensor({100000, 300000}, i64)}});
  CHECK_THAT(error_of([&] { read_recording(dir / "rpg", options); }),
             naming("times.npz", "timestamps"));
  options.frame_times = dir / "times.npy";
  io::write_npy(options.frame_times, torch::tensor({100000, 300000}, i64));
  CHECK_THAT(error_of([&] { read_recording(dir / "rpg", options); }),
             naming("times.npy", "NumPy", "savetxt"));
}

TEST_CASE("recording: a map of DSEC and poses that are not used are noted", "[recording]") {
  const Noise noise;
  CHECK_THAT(noise.notes(), !test::naming("not used"));
  noise.dir.write("a/rectify_map.h5", "");
  noise.dir.write("a/groundtruth.txt", "");
  noise.dir.write("a/poses.txt", "");
  CHECK_THAT(noise.notes(), test::naming("rectify_map.h5: DSEC's map", "--calibration",
                                         "has poses (poses.txt, groundtruth.txt)"));
}
