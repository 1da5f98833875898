// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/recording.h"

#include "support/catch.h"

#include <algorithm>
#include <functional>
#include <torch/types.h>
#include <zip.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/gzip.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using test::TempDir;

namespace {

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

bool has_note(const Recording& recording, const std::string& text) {
  for (const auto* const lines : {&recording.notes, &recording.warnings}) {
    for (const std::string& line : *lines) {
      if (line.find(text) != std::string::npos) return true;
    }
  }
  return false;
}

constexpr const char* kEvents = "0.000100 0 0 1\n0.000250 7 5 0\n0.000250 3 2 1\n0.001 1 1 0\n";

/// Two gray frames of 8x6 px at 0.2 and 0.6 ms.
void write_rpg_folder(const TempDir& dir, const std::string& name) {
  dir.write(name + "/events.txt", kEvents);
  dir.write(name + "/images.txt", "0.000600 images/b.png\n0.0002 images/a.png\n");
  dir.write(name + "/calib.txt", "6 6 4 3 0 0 0 0 0\n");
  imaging::write_image(dir / (name + "/images/a.png"), torch::full({3, 6, 8}, 0.2));
  imaging::write_image(dir / (name + "/images/b.png"), torch::full({3, 6, 8}, 0.6));
}

void check_rpg(const Recording& recording) {
  CHECK(recording.width == 8);
  CHECK(recording.height == 6);
  REQUIRE(recording.events.size() == 4);
  CHECK(recording.events.t_us().equal(torch::tensor({100, 250, 250, 1000}, torch::kInt64)));
  CHECK(recording.events.polarity().equal(torch::tensor({1, -1, 1, -1}, torch::kInt8)));
  CHECK(recording.events.x()[1].item<float>() == 7);
  REQUIRE(recording.frames.size() == 2);
  CHECK(recording.frames[0].name == "a");
  CHECK(recording.frames[0].image.sizes() == torch::IntArrayRef({3, 6, 8}));
  CHECK(recording.frames[0].image[0][0][0].item<float>() == Approx(0.2).margin(1e-6));
  CHECK(recording.frames[1].name == "b");
  REQUIRE(!recording.calibrations.empty());
  CHECK(recording.calibrations.front().name == "calib.txt");
  CHECK(recording.calibrations.front().text == "6 6 4 3 0 0 0 0 0\n");
}

/// Packs files of a folder, with `prefix` before their names.
void zip_folder(const std::filesystem::path& folder, const std::filesystem::path& path,
                const std::string& prefix) {
  int code = 0;
  zip_t* archive = zip_open(path.c_str(), ZIP_CREATE, &code);
  REQUIRE(archive != nullptr);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    zip_source_t* source = zip_source_file(archive, entry.path().c_str(), 0, -1);
    const auto name = prefix + std::filesystem::relative(entry.path(), folder).string();
    REQUIRE(zip_file_add(archive, name.c_str(), source, 0) >= 0);
  }
  // A foreign archive may contain file names outside its folder.
  zip_source_t* source = zip_source_buffer(archive, "x", 1, 0);
  REQUIRE(zip_file_add(archive, (prefix + "images/../../escaped.png").c_str(), source, 0) >= 0);
  REQUIRE(zip_close(archive) == 0);
}

}  // namespace

TEST_CASE("recording: text folder of RPG, frames in order of time, size from the frames",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const Recording recording = read_recording(dir / "rpg");
  CHECK(recording.source == dir / "rpg");
  CHECK(recording.format == "folder of frames and events");
  check_rpg(recording);
  CHECK(recording.frames[0].t_start_us == 200);
  CHECK(recording.frames[0].t_end_us == 200);
  CHECK(recording.stamp == Stamp::kMiddle);
  CHECK(has_note(recording, "2 of 2 frames carry no length"));
}

TEST_CASE("recording: exposures from a list beside the images, or from their length",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  ReadOptions options;
  options.exposure_ms = 0.1;
  CHECK(read_recording(dir / "rpg", options).frames[0].t_start_us == 150);
  CHECK(read_recording(dir / "rpg", options).frames[0].t_end_us == 250);
  options.stamp = Stamp::kEnd;
  CHECK(read_recording(dir / "rpg", options).frames[1].t_start_us == 500);
  dir.write("rpg/exposures.csv", "name,start_us,end_us\na,120,240\nb.png,510,700\n");
  const Recording listed = read_recording(dir / "rpg", options);
  CHECK(listed.frames[0].t_start_us == 120);
  CHECK(listed.frames[0].t_end_us == 240);
  CHECK(listed.frames[1].t_end_us == 700);
  CHECK_FALSE(has_note(listed, "carry no length"));
  dir.write("mine.csv", "a,0,10\nb,20,30\n");
  options.frame_times = dir / "mine.csv";
  CHECK(read_recording(dir / "rpg", options).frames[1].t_end_us == 30);
  dir.write("mine.csv", "a,0,10\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg", options); }),
             test::naming("b.png", "among 1"));
}

TEST_CASE("recording: of exposures of two cameras, the folder in the name decides", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const auto with_list = [&](const std::string& a, const std::string& b) {
    dir.write("rpg/exposures.csv", a + "/a.png,120,240\n" + a + "/b.png,510,700\n" + b +
                                       "/a.png,130,250\n" + b + "/b.png,520,710\n");
    return read_recording(dir / "rpg");
  };
  for (const char* const folder : {"images", "/elsewhere/rpg/images"}) {
    const Recording first = with_list(folder, "right"), last = with_list("right", folder);
    CHECK(first.frames[0].t_start_us == 120);
    CHECK(first.frames[1].t_end_us == 700);
    CHECK(has_note(first, "2 of 4 exposures name a frame that is not there (right/a.png)"));
    CHECK(last.frames[0].t_start_us == 130);
  }
  CHECK(with_list("images", ".").frames[0].t_start_us == 120);
  CHECK_THAT(message_of([&] { with_list("left", "right"); }),
             test::naming("exposures.csv", "left/b.png", "right/b.png"));
}

TEST_CASE("recording: exposures that overlap or are those of another frame are refused",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const auto with_list = [&](const std::string& list) {
    dir.write("rpg/exposures.csv", list);
    return message_of([&] { read_recording(dir / "rpg"); });
  };
  CHECK(with_list("a,0,102\nb,100,200\n").empty());  // a fiftieth of the period
  CHECK_THAT(with_list("a,0,150\nb,100,250\n"), test::naming("exposures.csv", "a.png", "100 us"));
  CHECK_THAT(with_list("a,100,150\nb,100,150\n"), test::naming("a.png", "b.png", "100 to 150 us"));
}

TEST_CASE("recording: one late frame of many is noted, times in milliseconds are refused",
          "[recording]") {
  const TempDir dir;
  dir.write("rpg/events.txt", "0.000100 0 0 1\n3.000 7 5 0\n");
  const auto write_list = [&](int64_t period_us, int64_t late_us) {
    std::string list;
    for (int64_t i = 0; i < 12; ++i) {
      const std::string name = concat("f", i);
      imaging::write_image(dir / ("rpg/images/" + name + ".png"), torch::full({3, 6, 8}, 0.5));
      const int64_t start_us = period_us * i + (i == 4 ? late_us : 0);
      list += concat(name, ",", start_us, ",", start_us + period_us * 9 / 10, "\n");
    }
    dir.write("rpg/exposures.csv", list);
  };
  write_list(50000, 0);
  CHECK_FALSE(has_note(read_recording(dir / "rpg"), "overlap"));
  write_list(50000, 20000);
  CHECK(has_note(read_recording(dir / "rpg"), "1 of 12 that overlap, as f4.png"));
  write_list(50, 0);
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
             test::naming("12 frames", "550 us", "milliseconds"));
}

TEST_CASE("recording: what is wrong is a warning, what is only to be known a note", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const Recording good = read_recording(dir / "rpg");
  CHECK(good.warnings.empty());
  CHECK_FALSE(good.notes.empty());
  dir.write("rpg/images.txt", "0.0002 images/a.png\n0.0006 images/b.png\n0.0008 images/c.png\n");
  const Recording missing = read_recording(dir / "rpg");
  REQUIRE(missing.warnings.size() == 1);
  CHECK_THAT(missing.warnings[0], test::naming("images.txt", "c.png"));
}

TEST_CASE("recording: images and lines without each other are noted", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write(
      "rpg/images.txt",
      "0.0002 images\\a.png\n0.0006 images/b.png\n0.0007 images/b.png\n0.0008 images/c.png\n");
  dir.write("rpg/exposures.csv", "a,100,200\nb,500,600\nd,700,800\n");
  imaging::write_image(dir / "rpg/images/spare.png", torch::full({3, 6, 8}, 0.6));
  const Recording recording = read_recording(dir / "rpg");
  REQUIRE(recording.frames.size() == 2);
  CHECK(recording.frames[1].t_start_us == 500);
  CHECK(has_note(recording, "1 listed images are not there and are left out (c.png)"));
  CHECK(has_note(recording, "1 images are listed twice"));
  CHECK(has_note(recording, "1 images of the folder are not listed and are left out (spare.png)"));
  CHECK(has_note(recording, "1 of 3 exposures name a frame that is not there (d)"));
  dir.write("rpg/exposures.csv", "0,a,100,200\n1,b,500,600\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
             test::naming("exposures.csv", "a line for a.png", "2 such as '0,a'"));
}

TEST_CASE("recording: listed images are found with and without their folder", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/images.txt", "0.000600 b.png\n0.0002 a.png\n");
  check_rpg(read_recording(dir / "rpg"));
  dir.write("rpg/images/images.txt", "0.000600 images/b.png\n0.0002 images/a.png\n");
  ReadOptions options;
  options.frames = dir / "rpg/images";
  CHECK(read_recording(dir / "rpg", options).frames.size() == 2);
}

TEST_CASE("recording: whole numbers in images.txt are us or ns if they are too far apart for s",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const auto start_with = [&](const std::string& a, const std::string& b) {
    dir.write("rpg/images.txt", a + " images/a.png\n" + b + " images/b.png\n");
    return read_recording(dir / "rpg");
  };
  const Recording in_us = start_with("2000", "52000");
  CHECK(in_us.frames[0].t_start_us == 2000);
  CHECK(in_us.frames[1].t_start_us == 52000);
  CHECK(has_note(in_us, "read as us"));
  const Recording in_ns = start_with("1700000000000000000", "1700000000050000000");
  CHECK(in_ns.frames[1].t_start_us == 1700000000050000);
  CHECK(has_note(in_ns, "read as ns"));
  const Recording in_s = start_with("1", "2");
  CHECK(in_s.frames[1].t_start_us == 2000000);
  CHECK_FALSE(has_note(in_s, "read as"));
  CHECK_THAT(message_of([&] { start_with("1e300", "2e300"); }), test::naming("images.txt"));
}

TEST_CASE("recording: stamps of 0 and files that were not fetched are named", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/images.txt", "0 images/a.png\n0 images/b.png\n");
  CHECK(has_note(read_recording(dir / "rpg"), "2 frames have a stamp of 0"));
  // Lengths about these stamps make the exposures equal.
  dir.write("rpg/exposures.csv", "a,-50,50\nb,-50,50\n");
  CHECK(has_note(read_recording(dir / "rpg"), "2 frames have a stamp of 0"));
  std::filesystem::remove(dir / "rpg/exposures.csv");
  dir.write("a.bag", "version https://git-lfs.github.com/spec/v1\noid sha256:aa\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "a.bag"); }),
             test::naming("a.bag", "git lfs pull"));
  ReadOptions options;
  options.frames_topic = "/image_raw";
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg", options); }),
             test::naming("/image_raw", "--frames-topic"));
}

TEST_CASE("recording: masks lie beside the frames of a folder or an archive", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const Recording recording = read_recording(dir / "rpg");
  CHECK(recording.mask_root == dir / "rpg");
  CHECK(recording.frames[0].path.filename() == "a.png");
  zip_folder(dir / "rpg", dir / "rpg.zip", "");
  CHECK(read_recording(dir / "rpg.zip").mask_root.empty());
  dir.write("rpg/masks/a.png", "a mask");
  zip_folder(dir / "rpg", dir / "masked.zip", "rpg/");
  std::filesystem::path root;
  {
    const Recording masked = read_recording(dir / "masked.zip");
    root = masked.mask_root;
    CHECK(std::filesystem::is_regular_file(root / "masks/a.png"));
    CHECK(masked.frames[0].path.parent_path().parent_path() == root);
  }
  CHECK_FALSE(std::filesystem::exists(root));
}

TEST_CASE("recording: the mark of UTF-8 before text is no part of it", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const std::string mark = "\xEF\xBB\xBF";
  dir.write("rpg/events.txt", mark + kEvents);
  dir.write("rpg/images.txt", mark + "0.0002 images/a.png\n0.000600 images/b.png\n");
  check_rpg(read_recording(dir / "rpg"));
}

TEST_CASE("recording: events that gzip compressed are read, other compressed files named",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  std::filesystem::remove(dir / "rpg/events.txt");
  dir.write("rpg/events.txt.gz", io::gzip(kEvents));
  check_rpg(read_recording(dir / "rpg"));
  CHECK(read_recording(dir / "rpg/events.txt.gz").events.size() == 4);
  const std::string whole = io::gzip(kEvents);
  dir.write("rpg/events.txt.gz", whole.substr(0, whole.size() - 12));
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
             test::naming("events.txt.gz", "damaged"));
  // Frames without events say which file would have them.
  dir.write("frames/images/exposures.csv", "a,0,100\nb,500,600\n");
  for (const char* name : {"a.png", "b.png"})
    std::filesystem::copy_file(dir / "rpg/images" / name, dir / "frames/images" / name);
  dir.write("frames/events.txt.zst", "\x28\xB5\x2F\xFD..");
  const Recording packed = read_recording(dir / "frames");
  CHECK(has_note(packed, "there are no events"));
  CHECK(has_note(packed, "unzstd events.txt.zst"));
}

TEST_CASE("recording: lists with decimal commas are read, in UTF-16 named", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/images.txt", "0,0002 images/a.png\n0,000600 images/b.png\n");
  check_rpg(read_recording(dir / "rpg"));
  dir.write("rpg/images.txt", "0,0002,5 images/a.png\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }), test::naming("images.txt:1"));
  std::string wide;
  for (const char c : std::string("0.0002 images/a.png\n")) wide += std::string{c, '\0'};
  for (const char* mark : {"", "\xFF\xFE"}) {
    dir.write("rpg/images.txt", mark + wide);
    CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
               test::naming("images.txt", "UTF-16", "iconv"));
  }
}

TEST_CASE("recording: a zip of the folder, at its root or within a folder", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  const auto temporary = dir / "temporary";
  std::filesystem::create_directories(temporary);
  setenv("TMPDIR", temporary.c_str(), 1);
  for (const std::string prefix : {"", "recording/"}) {
    zip_folder(dir / "rpg", dir / "rpg.zip", prefix);
    const Recording recording = read_recording(dir / "rpg.zip");
    CHECK(recording.format == "zip of frames and events");
    check_rpg(recording);
    CHECK(std::filesystem::is_empty(temporary));
    std::filesystem::remove(dir / "rpg.zip");
  }
  unsetenv("TMPDIR");
}

TEST_CASE("recording: faults within a zip name the archive, not its temporary files",
          "[recording]") {
  const TempDir dir;
  const auto failure = [&] {
    std::filesystem::remove(dir / "rpg.zip");
    zip_folder(dir / "rpg", dir / "rpg.zip", "");
    return message_of([&] { read_recording(dir / "rpg.zip"); });
  };
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/exposures.csv", "name,start_us,end_us\na,100,300\n");
  CHECK_THAT(failure(), Catch::StartsWith((dir / "rpg.zip/exposures.csv: ").string()));
  std::filesystem::remove(dir / "rpg/exposures.csv");
  dir.write("rpg/images/b.png", "no image");
  CHECK_THAT(failure(), Catch::StartsWith((dir / "rpg.zip/images/b.png: ").string()));
  imaging::write_image(dir / "rpg/images/b.png", torch::full({3, 6, 8}, 0.6));
  dir.write("rpg/events.txt", std::string(kEvents) + "0.002 1 1 7 9 x\n");
  CHECK_THAT(failure(), Catch::StartsWith((dir / "rpg.zip/events.txt").string()));
}

TEST_CASE("recording: of a folder with one recording in it, that is read", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  std::filesystem::create_directories(dir / "folder");
  zip_folder(dir / "rpg", dir / "folder/rpg.zip", "");
  const Recording recording = read_recording(dir / "folder");
  check_rpg(recording);
  CHECK(has_note(recording, "rpg.zip: the only recording"));
  std::filesystem::copy_file(dir / "folder/rpg.zip", dir / "folder/other.zip");
  CHECK_THAT(message_of([&] { read_recording(dir / "folder"); }),
             test::naming("folder", "other.zip, rpg.zip"));
  dir.write("notes/notes.dat", "hello\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "notes"); }),
             test::naming("notes: expected", "give one of", "notes.dat"));
}

TEST_CASE("recording: an empty file of events gives way to another", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  std::filesystem::rename(dir / "rpg/events.txt", dir / "rpg/events.csv");
  for (const char* text : {"", "# t x y p\n", "t,x,y,p\n"}) {
    dir.write("rpg/events.txt", text);
    const Recording recording = read_recording(dir / "rpg");
    check_rpg(recording);
    CHECK(has_note(recording, "found events.txt beside events.csv, which is read"));
  }
  std::filesystem::rename(dir / "rpg/events.csv", dir / "rpg/my_events.csv");
  const Recording other = read_recording(dir / "rpg");
  check_rpg(other);
  CHECK(has_note(other, "found events.txt beside my_events.csv, which is read"));
  std::filesystem::remove(dir / "rpg/my_events.csv");
  CHECK(has_note(read_recording(dir / "rpg"), "there are no events"));
}

TEST_CASE("recording: a zip whose frames are in frames/ or beside the events", "[recording]") {
  const TempDir dir;
  for (const std::string images : {"frames/", "images_1/", "img/", ""}) {
    std::filesystem::remove_all(dir / "rpg");
    dir.write("rpg/events.txt", "0.9 0 0 1\n2.5 7 5 0\n");
    for (const char* name : {"1000000", "1100000"})
      imaging::write_image(dir / ("rpg/" + images + name + ".png"), torch::full({3, 6, 8}, 0.5));
    if (images == "img/")
      dir.write("rpg/images.txt", "0 1.0 img/1000000.png\n1 1.1 img/1100000.png\n");
    zip_folder(dir / "rpg", dir / "rpg.zip", "");
    const Recording recording = read_recording(dir / "rpg.zip");
    CHECK(recording.frames.size() == 2);
    const std::string where = (dir / "rpg.zip").string() + (images.empty() ? ":" : "/");
    CHECK((images == "img/" || has_note(recording, where)));
    std::filesystem::remove(dir / "rpg.zip");
  }
}

TEST_CASE("recording: the EvDeblur layout without poses", "[recording]") {
  const TempDir dir;
  const std::vector<float> x{0, 7, 3}, y{0, 5, 2};
  const std::vector<int64_t> t{2000000000, 2000500000, 3000000000};  // ns
  const std::vector<int8_t> p{1, -1, 1};
  std::filesystem::create_directories(dir / "scene");
  io::Hdf5Writer file(dir / "scene/events.h5");
  file.append("x", x.data(), 3);
  file.append("y", y.data(), 3);
  file.append("t", t.data(), 3);
  file.append("p", p.data(), 3);
  file.close();
  for (const char* name : {"00", "01"})
    imaging::write_image(dir / "scene/images_1" / (std::string(name) + ".png"),
                         torch::full({3, 6, 8}, 0.5));
  io::write_npz(dir / "scene/images_1/timestamps.npz",
                {{"timestamps_start", torch::tensor(std::vector<int64_t>{2000000000, 2600000000})},
                 {"timestamps_end", torch::tensor(std::vector<int64_t>{2020000000, 2600000000})}});
  const Recording recording = read_recording(dir / "scene");
  CHECK(recording.events.t_us().equal(torch::tensor({2000000, 2000500, 3000000}, torch::kInt64)));
  REQUIRE(recording.frames.size() == 2);
  CHECK(recording.frames[0].t_start_us == 2000000);
  CHECK(recording.frames[0].t_end_us == 2020000);
  CHECK(recording.frames[1].t_start_us == 2600000);
  CHECK(recording.width == 8);
  io::write_npz(dir / "scene/images_1/timestamps.npz", {{"timestamps", torch::zeros({3})}});
  CHECK_THAT(message_of([&] { read_recording(dir / "scene"); }),
             test::naming("2 images", "found 3"));
}

TEST_CASE("recording: images.txt of RPG beside a folder of images gives their times",
          "[recording]") {
  const TempDir dir;
  std::filesystem::create_directories(dir / "scene");
  io::write_npz(dir / "scene/events.npz", {{"x", torch::zeros({2})},
                                           {"y", torch::zeros({2})},
                                           {"t", torch::tensor({1000000, 2000000}, torch::kInt64)},
                                           {"p", torch::ones({2}, torch::kInt8)}});
  for (const char* name : {"00", "01"})
    imaging::write_image(dir / "scene/images" / (std::string(name) + ".png"),
                         torch::full({3, 6, 8}, 0.5));
  dir.write("scene/images.txt", "1.25 images/00.png\n1.5 images/01.png\n");
  const Recording recording = read_recording(dir / "scene");
  REQUIRE(recording.frames.size() == 2);
  CHECK(recording.frames[1].t_start_us == 1500000);
  CHECK(has_note(recording, "their time is taken as its middle"));
  CHECK(recording.calibrations.empty());
  dir.write("scene/calib.txt", "6 6 4 3 0 0 0 0 0\n");
  CHECK(read_recording(dir / "scene").calibrations.front().name == "calib.txt");
}

TEST_CASE("recording: files of events alone, and a window of them", "[recording]") {
  const TempDir dir;
  const auto table = torch::tensor({{100., 1., 2., 1.}, {300., 3., 4., 0.}, {500., 5., 6., 1.}});
  io::write_npy(dir / "events.npy", table);
  io::write_npz(dir / "events.npz", {{"events", table}});
  dir.write("events.txt", "100 1 2 1\n300 3 4 0\n500 5 6 1\n");
  for (const char* name : {"events.npy", "events.npz", "events.txt"}) {
    const Recording recording = read_recording(dir / name);
    REQUIRE(recording.events.size() == 3);
    CHECK(recording.events.last_us() == 500);
    CHECK(recording.width == 0);
    CHECK(has_note(recording, "there are no frames"));
    ReadOptions options;
    options.window = events::TimeWindow{300, 500};
    CHECK(read_recording(dir / name, options).events.size() == 1);
  }
}

TEST_CASE("recording: times out of order are sorted, events beside the sensor dropped, both noted",
          "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/events.txt", "0.5 7 5 1\n0.1 0 0 0\n");
  const Recording sorted = read_recording(dir / "rpg");
  CHECK(sorted.events.first_us() == 100000);
  CHECK(has_note(sorted, "have been sorted"));
  CHECK(has_note(sorted, "2 of 2 frames lie outside the time of the events"));
  CHECK(has_note(sorted, "the two clocks may differ"));
  dir.write("rpg/events.txt", "0.1 7 5 1\n0.2 8 0 0\n");
  const Recording beside = read_recording(dir / "rpg");
  CHECK(beside.width == 0);
  CHECK(has_note(beside, "events lie within 9x6 px, frames are 8x6 px"));
  // Rectified ones lie between pixels.
  dir.write("rpg/events.txt", "0.1 7.4 5.3 1\n0.2 inf 0 0\n0.3 nan 0 0\n");
  const Recording rectified = read_recording(dir / "rpg");
  CHECK(rectified.width == 8);
  CHECK(rectified.height == 6);
  CHECK(rectified.events.size() == 1);
}

TEST_CASE("recording: what is missing is noted, what is damaged is an error", "[recording]") {
  const TempDir dir;
  write_rpg_folder(dir, "rpg");
  dir.write("rpg/images.txt", "0.1 images/a.png\nsoon images/b.png\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
             test::naming("images.txt:2", "images/NAME"));
  dir.write("rpg/images.txt", "0.1 ../secret.png\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }), Catch::Contains("images.txt:1"));
  dir.write("rpg/images.txt", "0.1 images/missing.png\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }), test::naming("missing.png"));
  imaging::write_image(dir / "rpg/images/b.png", torch::full({3, 6, 9}, 0.6));
  dir.write("rpg/images.txt", "0.1 images/a.png\n0.2 images/b.png\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }),
             test::naming("b.png", "9x6", "a.png", "8x6"));
  std::filesystem::remove(dir / "rpg/images.txt");
  const Recording unlisted = read_recording(dir / "rpg");
  CHECK(unlisted.frames.empty());
  CHECK(has_note(unlisted, "2 of 2 frames have no time and are left out; give them one"));
  CHECK(unlisted.untimed_frames == 2);
  dir.write("rpg/events.txt", "");
  CHECK(has_note(read_recording(dir / "rpg"), "there are no events"));
  dir.write("rpg/events.txt", "0.1 2 3\n0.1 2 3 1\n0.2 4 x 1\n");
  CHECK_THAT(message_of([&] { read_recording(dir / "rpg"); }), Catch::Contains("events.txt:3"));
}
