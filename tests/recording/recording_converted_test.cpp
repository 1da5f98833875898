// SPDX-License-Identifier: Apache-2.0
// Recordings that the Python script converts; tests/scripts/read_recording_test.py tests the
// script.
#include "support/catch.h"

#include <functional>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/recording/recording.h"
#include "recording/evt_words.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using namespace jade::test;

namespace {

/// An interpreter that copies the prepared folder `dir`/made to the folder of its third argument.
std::filesystem::path copying_python(const TempDir& dir) {
  const auto path =
      dir.write("python", "#!/bin/sh\ncp -r " + (dir / "made").string() + " \"$3\"\n");
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

std::string failure(const TempDir& dir, const std::string& script) {
  const auto path = dir.write("python", "#!/bin/sh\n" + script);
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  ReadOptions options;
  options.python = path;
  try {
    read_recording(dir.write("a.aedat4", "#!AER-DAT4.0\r\n"), options);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("recording: what the script made is read with its clock, size and triggers",
          "[recording]") {
  const TempDir dir;
  dir.write("made/events.raw", evt_header("3.0", "% geometry 640x480\n") + evt3_time(50) +
                                   evt3_word(2, 3) + evt3_word(10, 1) + evt3_time(90) +
                                   evt3_word(2, 3));
  dir.write("made/exposures.csv", "name,start_us,end_us\n000000,1060,1060\n");
  dir.write("made/recording.txt",
            "format ROS bag\nstamp start\noffset_us 1000\nnote topics: a b\n");
  imaging::write_image(dir / "made/images/000000.png", torch::full({3, 6, 8}, 0.5));
  ReadOptions options;
  options.python = copying_python(dir);
  const auto bag = dir.write("a.bag", "#ROSBAG V2.0\n");
  const Recording recording = read_recording(bag, options);
  CHECK(recording.format == "ROS bag");
  CHECK(recording.source == bag);
  CHECK(recording.width == 640);
  CHECK(recording.stamp == Stamp::kStart);
  CHECK(recording.events.first_us() == 1050);
  CHECK(recording.triggers.rising_us == std::vector<int64_t>{1050});
  CHECK(recording.stored_us.begin_us >= 1000);
  CHECK(recording.stored_us.end_us > 1090);
  REQUIRE(recording.frames.size() == 1);
  CHECK(recording.frames[0].t_start_us == 1060);
  CHECK(recording.notes[0] == "topics: a b");
  options.exposure_ms = 0.01;
  CHECK(read_recording(bag, options).frames[0].t_end_us == 1070);
  options.window = events::TimeWindow{1080, 2000};
  CHECK(read_recording(bag, options).events.size() == 1);
  CHECK(read_recording(bag, options).frames.empty());
}

TEST_CASE("recording: a look at the first events of a bag has its clock", "[recording]") {
  const TempDir dir;
  dir.write("made/events.raw", evt_header("3.0", "% geometry 640x480\n") + evt3_time(50) +
                                   evt3_word(2, 3) + evt3_time(90) + evt3_word(2, 3));
  dir.write("made/exposures.csv", "name,start_us,end_us\n000000,1060,1060\n");
  dir.write("made/recording.txt", "format ROS bag\noffset_us 1000\n");
  imaging::write_image(dir / "made/images/000000.png", torch::full({3, 6, 8}, 0.5));
  ReadOptions options;
  options.python = copying_python(dir);
  options.most_events = 1;
  const Recording first = read_recording(dir.write("a.bag", "#ROSBAG V2.0\n"), options);
  for (const std::string& note : first.notes) CHECK_THAT(note, !test::naming("outside"));
  CHECK(first.notes.size() > 0);
}

TEST_CASE("recording: a folder that the script made by hand is read the same", "[recording]") {
  const TempDir dir;
  dir.write("made/events.raw", evt_header("3.0", "% geometry 640x480\n") + evt3_time(50) +
                                   evt3_word(2, 3) + evt3_word(10, 1) + evt3_time(90) +
                                   evt3_word(2, 3));
  dir.write("made/exposures.csv", "name,start_us,end_us\n000000,1060,1060\n");
  dir.write("made/triggers.csv", "t_us,rising\n60,0\n");
  dir.write("made/recording.txt",
            "format ROS bag\nstamp start\noffset_us 1000\nwidth 640\nheight 480\nnote said\n"
            "warning 1 events are left out\n");
  imaging::write_image(dir / "made/images/000000.png", torch::full({3, 6, 8}, 0.5));
  const Recording recording = read_recording(dir / "made");
  CHECK(recording.format == "ROS bag");
  CHECK(recording.stamp == Stamp::kStart);
  CHECK(recording.width == 640);
  CHECK(recording.height == 480);
  CHECK(recording.events.first_us() == 1050);
  CHECK(recording.triggers.rising_us == std::vector<int64_t>{1050});
  CHECK(recording.triggers.falling_us == std::vector<int64_t>{1060});
  CHECK(recording.notes[0] == "said");
  CHECK(recording.warnings.at(0) == "1 events are left out");
  // A user's own notes of that name are ignored.
  dir.write("made/recording.txt", "stamp start, offset_us 1000\n");
  CHECK(read_recording(dir / "made").format == "folder of frames and events");
}

TEST_CASE("recording: microseconds since 1970 and edges of a list", "[recording]") {
  const TempDir dir;
  const std::vector<uint16_t> x{1, 2}, y{3, 4};
  const std::vector<int64_t> t{1589163147365215, 1589163147365216};
  const std::vector<int8_t> p{0, 1};
  std::filesystem::create_directories(dir / "made");
  io::Hdf5Writer file(dir / "made/events.h5");
  file.append("x", x.data(), 2);
  file.append("y", y.data(), 2);
  file.append("t", t.data(), 2);
  file.append("p", p.data(), 2);
  file.close();
  dir.write("made/triggers.csv", "t_us,rising\n1589163147365215,1\n1589163147365300,0\n");
  dir.write("made/recording.txt", "format AEDAT4\nwidth 346\nheight 260\n");
  ReadOptions options;
  options.python = copying_python(dir);
  const Recording recording = read_recording(dir.write("a.aedat4", "#!AER-DAT4.0\r\n"), options);
  CHECK(recording.format == "AEDAT4");
  CHECK(recording.width == 346);
  CHECK(recording.events.last_us() == 1589163147365216);
  CHECK(recording.triggers.falling_us == std::vector<int64_t>{1589163147365300});
}

TEST_CASE("recording: a script that fails is one line with the mend", "[recording]") {
  const TempDir dir;
  CHECK(failure(dir, "echo warning >&2; echo 'a.aedat4: is cut short' >&2; exit 3\n") ==
        "a.aedat4: is cut short");
  CHECK_THAT(failure(dir, "echo 'needs aedat: run scripts/setup.sh --import' >&2; exit 4\n"),
             Catch::EndsWith("a.aedat4: needs aedat: run scripts/setup.sh --import"));
  CHECK_THAT(failure(dir, "echo 'Traceback'; echo 'KeyError: 5'; exit 1\n"),
             test::naming("scripts/read_recording.py", "(1)", "KeyError: 5"));
  CHECK_THAT(failure(dir, "exit 3\n"), Catch::Contains("could not say why; is ") &&
                                           Catch::EndsWith("Set TMPDIR to a folder with space"));
  ReadOptions options;
  options.python = dir / "nothing";
  CHECK_THROWS_NAMING(DataError, read_recording(dir / "a.aedat4", options),
                      "scripts/setup.sh --import");
}
