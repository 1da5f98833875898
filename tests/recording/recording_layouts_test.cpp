// SPDX-License-Identifier: Apache-2.0
// Layouts of public data sets in HDF5, written here by their documentation, and Prophesee's DAT.
#include "support/catch.h"

#include <algorithm>
#include <functional>
#include <hdf5.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "jade/recording/format.h"
#include "jade/recording/recording.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using jade::test::TempDir;

namespace {

constexpr int64_t kEventCount = 600;
constexpr int64_t kFirstUs = 1000000;

/// Values of each event.
template <class T, class F>
std::vector<T> list(F value) {
  std::vector<T> out;
  for (int64_t i = 0; i < kEventCount; ++i) out.push_back(T(value(i)));
  return out;
}
int64_t x_of(int64_t i) { return i * 37 % 64; }
int64_t y_of(int64_t i) { return i * 23 % 48; }
int64_t t_of(int64_t i) { return kFirstUs + 50 * i; }
int64_t p_of(int64_t i) { return i * i % 3 == 1; }

/// x, y, t and p as arrays of these types.
template <class Place, class Time>
void append_events(io::Hdf5Writer& file, const std::string& group, int64_t shift_us = 0) {
  const auto x = list<Place>(x_of), y = list<Place>(y_of);
  const auto t = list<Time>([&](int64_t i) { return t_of(i) - shift_us; });
  const auto p = list<uint8_t>(p_of);
  file.append(group + "x", x.data(), kEventCount), file.append(group + "y", y.data(), kEventCount);
  file.append(group + "t", t.data(), kEventCount), file.append(group + "p", p.data(), kEventCount);
}

void write_events(const TempDir& dir) {
  io::Hdf5Writer file(dir / "events.h5");
  append_events<uint16_t, int64_t>(file, "");
  file.close();
}

void check_read(const Recording& recording, double most = 1e-3) {
  const events::EventStream& e = recording.events;
  REQUIRE(e.size() == kEventCount);
  for (const int64_t i : {int64_t(0), int64_t(1), int64_t(100), kEventCount - 1}) {
    CHECK(e.x()[i].item<double>() == double(x_of(i)));
    CHECK(e.y()[i].item<double>() == double(y_of(i)));
    CHECK(std::abs(double(e.t_us()[i].item<int64_t>() - t_of(i))) <= most);
    CHECK(int64_t(e.polarity()[i].item<int8_t>()) == (p_of(i) != 0 ? 1 : -1));
  }
}

std::string layout_notes(const Recording& recording) {
  std::string out;
  for (const auto* const lines : {&recording.notes, &recording.warnings}) {
    for (const std::string& line : *lines) out += line + "\n";
  }
  return out;
}

std::string failure_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

/// A table [N,4] of doubles, or [4,N].
void write_table(hid_t file, const char* name, bool lying, const std::array<int, 4>& order) {
  std::vector<double> values(4 * kEventCount);
  for (int64_t i = 0; i < kEventCount; ++i) {
    const double event[] = {double(x_of(i)), double(y_of(i)), 1e-6 * double(t_of(i)),
                            double(2 * p_of(i) - 1)};
    for (int64_t c = 0; c < 4; ++c)
      values[size_t(lying ? c * kEventCount + i : 4 * i + c)] = event[order[size_t(c)]];
  }
  const hsize_t shape[2] = {hsize_t(lying ? 4 : kEventCount), hsize_t(lying ? kEventCount : 4)};
  const hid_t space = H5Screate_simple(2, shape, nullptr);
  const hid_t links = H5Pcreate(H5P_LINK_CREATE);
  H5Pset_create_intermediate_group(links, 1);
  const hid_t data =
      H5Dcreate2(file, name, H5T_NATIVE_DOUBLE, space, links, H5P_DEFAULT, H5P_DEFAULT);
  H5Dwrite(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Dclose(data), H5Pclose(links), H5Sclose(space);
}

struct EventRow {
  int64_t timestamp;
  uint16_t x, y;
  int16_t polarity;
};

void write_rows(hid_t file, const char* name) {
  const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(EventRow));
  H5Tinsert(type, "timestamp", offsetof(EventRow, timestamp), H5T_NATIVE_INT64);
  H5Tinsert(type, "x", offsetof(EventRow, x), H5T_NATIVE_UINT16);
  H5Tinsert(type, "y", offsetof(EventRow, y), H5T_NATIVE_UINT16);
  H5Tinsert(type, "polarity", offsetof(EventRow, polarity), H5T_NATIVE_INT16);
  std::vector<EventRow> rows;
  for (int64_t i = 0; i < kEventCount; ++i)
    rows.push_back({t_of(i), uint16_t(x_of(i)), uint16_t(y_of(i)), int16_t(p_of(i))});
  const hsize_t count = kEventCount;
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  const hid_t data = H5Dcreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  H5Dwrite(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data());
  H5Dclose(data), H5Sclose(space), H5Tclose(type);
}

hid_t create(const std::filesystem::path& path) {
  return H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
}

/// Eight bytes per event after a header.
std::string dat_file(const std::string& head, bool old, const std::vector<uint32_t>& times) {
  std::string out = head + std::string{12, 8};
  const auto put = [&](uint32_t word) {
    for (int k = 0; k < 4; ++k) out += char(word >> (8 * k) & 0xff);
  };
  for (size_t i = 0; i < times.size(); ++i) {
    const uint32_t x = uint32_t(x_of(int64_t(i))), y = uint32_t(y_of(int64_t(i))),
                   p = uint32_t(p_of(int64_t(i)));
    put(times[i]);
    put(old ? x | y << 9 | p << 17 : x | y << 14 | p << 28);
  }
  return out;
}

}  // namespace

TEST_CASE("layouts: DSEC with its offset, its index and a rectification that is not used",
          "[recording]") {
  const TempDir dir;
  constexpr int64_t kOffset = 900000;
  {
    io::Hdf5Writer file(dir / "events.h5");
    append_events<uint16_t, uint32_t>(file, "events/", kOffset);
    const std::vector<uint64_t> index(31, 7);
    file.append("ms_to_idx", index.data(), 31);
    file.append("t_offset", &kOffset, 1);
    file.close();
  }
  const Recording plain = read_recording(dir / "events.h5");
  check_read(plain);
  CHECK(layout_notes(plain).find("rectify_map") == std::string::npos);
  {
    io::Hdf5Writer file(dir / "both.h5");
    append_events<uint16_t, uint32_t>(file, "events/", 0);
    const float map = 0;
    file.append("rectify_map", &map, 1);
    file.close();
  }
  CHECK_THAT(layout_notes(read_recording(dir / "both.h5")), test::naming("rectify_map"));
}

TEST_CASE("layouts: files of events beside the one that is read are named", "[recording]") {
  const TempDir dir;
  const auto warnings = [&] { return layout_notes(read_recording(dir.path())); };
  dir.write("events.csv", "t,x,y,p\n1000,1,2,1\n2000,3,4,0\n");
  CHECK(warnings().find("expected one file of events") == std::string::npos);
  dir.write("events.raw", "");
  CHECK_THAT(warnings(), test::naming("expected one file of events, found events.raw",
                                      "events.csv, which is read"));
  dir.write("events.txt", "0.001 1 2 1\n0.002 3 4 0\n");
  CHECK_THAT(warnings(), test::naming("found events.csv, events.raw", "events.txt, which is read"));
}

TEST_CASE("layouts: M3ED has two cameras and their sizes, one of which is chosen", "[recording]") {
  const TempDir dir;
  const auto path = dir / "m3ed.h5";
  {
    io::Hdf5Writer file(path);
    for (const std::string side : {"left", "right"}) {
      const std::string group = "prophesee/" + side + "/";
      append_events<uint16_t, int64_t>(file, group, side == "right" ? 7 : 0);
      const std::vector<uint64_t> index(31, 7);
      file.append(group + "ms_map_idx", index.data(), 31);
      const int64_t size[2] = {1280, 720};
      file.append(group + "calib/resolution", size, 2);
    }
    const std::vector<int64_t> ts(4, 5);
    file.append("ovc/ts", ts.data(), 4);
    file.close();
  }
  const Recording left = read_recording(path);
  check_read(left);
  CHECK((left.width == 1280 && left.height == 720));
  CHECK_THAT(layout_notes(left), test::naming("2 streams", "(prophesee/left, prophesee/right)"));
  ReadOptions options;
  for (const char* name : {"prophesee/right", "/prophesee/right/"}) {
    options.events_group = name;
    const Recording right = read_recording(path, options);
    CHECK(right.events.first_us() == kFirstUs - 7);
    CHECK(layout_notes(right).find("streams") == std::string::npos);
  }
  options.events_group = "prophesee";
  CHECK_THAT(failure_of([&] { read_recording(path, options); }),
             test::naming("prophesee,", "prophesee/left, prophesee/right"));
  options.events_group.clear();
  options.topic = "/left/events";
  CHECK_THAT(failure_of([&] { read_recording(path, options); }), test::naming("ROS bag"));
}

TEST_CASE("layouts: EDS and TUM-VIE, arrays of other types with an index", "[recording]") {
  const TempDir dir;
  {
    io::Hdf5Writer eds(dir / "eds.h5");
    append_events<uint16_t, int64_t>(eds, "");
    eds.close();
    io::Hdf5Writer vie(dir / "vie.h5");
    append_events<int32_t, int32_t>(vie, "events/");
    const std::vector<int64_t> index(31, 7);
    vie.append("ms_to_idx", index.data(), 31);
    vie.close();
  }
  for (const char* name : {"eds.h5", "vie.h5"}) check_read(read_recording(dir / name));
}

TEST_CASE("layouts: tables of MVSEC and v2e, in any order, lying or standing", "[recording]") {
  const TempDir dir;
  const auto one = [&](const char* name, bool lying, const std::array<int, 4>& order) {
    const hid_t file = create(dir / "t.h5");
    write_table(file, name, lying, order);
    H5Fclose(file);
    INFO(name);
    check_read(read_recording(dir / "t.h5"));
  };
  one("davis/left/events", false, {0, 1, 2, 3});
  one("events", false, {2, 0, 1, 3});
  one("events", true, {0, 1, 3, 2});
  const hid_t file = create(dir / "mvsec.hdf5");
  write_table(file, "davis/left/events", false, {0, 1, 2, 3});
  write_table(file, "davis/right/events", false, {0, 1, 2, 3});
  H5Fclose(file);
  ReadOptions options;
  options.events_group = "davis/right";  // the only stream in that group
  check_read(read_recording(dir / "mvsec.hdf5", options));
  CHECK_THAT(layout_notes(read_recording(dir / "mvsec.hdf5")),
             Catch::Contains("davis/left/events, davis/right/events"));
  // Long files are read only in part, with the same result.
  options.window = events::TimeWindow{kFirstUs + 5000, kFirstUs + 6000};
  const Recording part = read_recording(dir / "mvsec.hdf5", options);
  CHECK((part.events.size() == 20 && part.stored_events == kEventCount));
}

TEST_CASE("layouts: records in HDF5 with names of their own", "[recording]") {
  const TempDir dir;
  const hid_t file = create(dir / "records.h5");
  write_rows(file, "stream");
  H5Fclose(file);
  check_read(read_recording(dir / "records.h5"));
}

TEST_CASE("layouts: a file without events names what there is", "[recording]") {
  const TempDir dir;
  const hid_t file = create(dir / "poses.h5");
  write_table(file, "pose/quaternions", false, {0, 1, 2, 3});
  write_table(file, "pose/others", false, {0, 1, 2, 3});
  H5Fclose(file);
  CHECK_THAT(failure_of([&] { read_recording(dir / "poses.h5"); }),
             test::naming("poses.h5", "event") && Catch::Contains("pose/quaternions"));
}

TEST_CASE("layouts: Prophesee's DAT of both versions, its size, and its clock that wraps",
          "[recording]") {
  const TempDir dir;
  const std::string head =
      "% Data file containing CD events.\n% Version 2\n% Date 2026-01-01 "
      "12:00:00\n% Height 48\n% Width 64\n";
  const auto times = list<uint32_t>(t_of);
  const auto path = dir.write("a.dat", dat_file(head, false, times));
  CHECK(recognise(path) == Format::kDat);
  const Recording recording = read_recording(path);
  check_read(recording);
  CHECK((recording.width == 64 && recording.height == 48));
  std::string first = head;
  first.replace(first.find("Version 2"), 9, "Version 1");
  check_read(read_recording(dir.write("old.dat", dat_file(first, true, times))));
  const Recording late =
      read_recording(dir.write("wrap.dat", dat_file(head, false, {0xfffffff0U, 0x10U, 0x20U})));
  CHECK(late.events.last_us() - late.events.first_us() == 0x30);
  auto damaged = times;
  damaged[300] += 3600000000U;
  const Recording stray = read_recording(dir.write("stray.dat", dat_file(head, false, damaged)));
  CHECK(stray.events.size() == kEventCount - 1);
  CHECK(stray.events.last_us() == t_of(kEventCount - 1));
  CHECK_THAT(layout_notes(stray), test::naming("1 event", "left out"));
  ReadOptions options;
  options.window = events::TimeWindow{kFirstUs + 5000, kFirstUs + 6000};
  const Recording part = read_recording(path, options);
  CHECK((part.events.size() == 20 && part.stored_events == kEventCount));
  const std::string whole = dat_file(head, false, times);
  CHECK_THAT(layout_notes(read_recording(dir.write("cut.dat", whole.substr(0, whole.size() - 3)))),
             test::naming("5 bytes"));
  CHECK_THAT(failure_of([&] { read_recording(dir.write("bare.dat", head)); }),
             test::naming("bare.dat", "its end"));
  CHECK_THAT(failure_of([&] { read_recording(dir.write("boxes.dat", head + "\x28\x28xx")); }),
             test::naming("type 40"));
}

TEST_CASE("layouts: frames of MVSEC come with the events of their camera", "[recording]") {
  const TempDir dir;
  const hid_t file = create(dir / "mvsec.hdf5");
  for (const std::string side : {"left", "right"}) {
    write_table(file, ("davis/" + side + "/events").c_str(), false, {0, 1, 2, 3});
    const hsize_t shape[3] = {2, 48, 64};
    std::vector<uint8_t> pictures(2 * 48 * 64, side == "left" ? 51 : 102);
    const hid_t space = H5Screate_simple(3, shape, nullptr);
    const hid_t data = H5Dcreate2(file, ("davis/" + side + "/image_raw").c_str(), H5T_NATIVE_UINT8,
                                  space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(data, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, pictures.data());
    const double times[2] = {1.005, 1.02};
    const hsize_t count = 2;
    const hid_t line = H5Screate_simple(1, &count, nullptr);
    const hid_t stamps = H5Dcreate2(file, ("davis/" + side + "/image_raw_ts").c_str(),
                                    H5T_NATIVE_DOUBLE, line, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(stamps, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, times);
    H5Dclose(stamps), H5Sclose(line), H5Dclose(data), H5Sclose(space);
  }
  H5Fclose(file);
  ReadOptions options;
  for (const std::string side : {"left", "right"}) {
    options.events_group = "davis/" + side;
    const Recording recording = read_recording(dir / "mvsec.hdf5", options);
    check_read(recording);
    REQUIRE(recording.frames.size() == 2);
    CHECK(recording.frames[0].t_start_us == 1005000);
    CHECK(recording.frames[0].image[0][5][5].item<float>() ==
          Approx(side == "left" ? 0.2 : 0.4).margin(1e-4));
    CHECK((recording.width == 64 && recording.height == 48));
    CHECK_THAT(layout_notes(recording),
               Catch::Contains(side == "left" ? "davis/right/image_raw" : "davis/left/image_raw"));
  }
  // Some files have whole us in floating point.
  const hid_t again = H5Fopen((dir / "mvsec.hdf5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t stamps = H5Dopen2(again, "davis/right/image_raw_ts", H5P_DEFAULT);
  const double times_us[2] = {1005000, 1020000};
  H5Dwrite(stamps, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, times_us);
  H5Dclose(stamps), H5Fclose(again);
  CHECK(read_recording(dir / "mvsec.hdf5", options).frames[0].t_start_us == 1005000);
}

TEST_CASE("layouts: frames of 16 bits are read, of other values named", "[recording]") {
  const TempDir dir;
  const auto write = [&](const char* name, hid_t type, const std::vector<uint16_t>& pixels) {
    const hid_t file = create(dir / name);
    write_table(file, "davis/left/events", false, {0, 1, 2, 3});
    const hsize_t shape[3] = {2, 48, 64}, count = 2;
    const hid_t space = H5Screate_simple(3, shape, nullptr), line = H5Screate_simple(1, &count, {});
    const hid_t data = H5Dcreate2(file, "davis/left/image_raw", type, space, H5P_DEFAULT,
                                  H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(data, H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, pixels.data());
    const hid_t stamps = H5Dcreate2(file, "davis/left/image_raw_ts", H5T_NATIVE_DOUBLE, line,
                                    H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    const double times[2] = {1.005, 1.02};
    H5Dwrite(stamps, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, times);
    // Pictures of event_utils are data sets of their own.
    const hid_t links = H5Pcreate(H5P_LINK_CREATE);
    H5Pset_create_intermediate_group(links, 1);
    const hid_t one = H5Screate(H5S_SCALAR), flat = H5Screate_simple(2, shape + 1, nullptr);
    const hid_t single =
        H5Dcreate2(file, "images/image000000000", type, flat, links, H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(single, H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, pixels.data());
    const hid_t stamp =
        H5Acreate2(single, "timestamp", H5T_NATIVE_DOUBLE, one, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(stamp, H5T_NATIVE_DOUBLE, times);
    H5Aclose(stamp), H5Dclose(single), H5Sclose(one), H5Sclose(flat), H5Pclose(links);
    H5Dclose(stamps), H5Sclose(line), H5Dclose(data), H5Sclose(space), H5Fclose(file);
  };
  std::vector<uint16_t> pixels(2 * 48 * 64, 50000);
  pixels[0] = 1;
  write("deep.h5", H5T_NATIVE_UINT16, pixels);
  const Recording deep = read_recording(dir / "deep.h5");
  REQUIRE(deep.frames.size() == 2);
  CHECK(deep.frames[0].image[0][5][5].item<double>() == Approx(50000.0 / 65535));
  CHECK(deep.frames[0].image[0][0][0].item<double>() == Approx(1.0 / 65535));
  write("float.h5", H5T_NATIVE_FLOAT, pixels);
  const Recording passed = read_recording(dir / "float.h5");
  CHECK(passed.frames.empty());
  REQUIRE(passed.warnings.size() == 1);
  CHECK_THAT(passed.warnings[0], test::naming("float.h5: davis/left/image_raw", "1 more", "16 bits",
                                              "floats of 32 bits", "--frames"));
  // Depth is no picture. Without stacked pictures, those of event_utils are read.
  const hid_t file = H5Fopen((dir / "deep.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  for (const std::string name : {"image_raw", "image_raw_ts"}) {
    H5Lmove(file, ("davis/left/" + name).c_str(), file, ("davis/left/depth_" + name).c_str(),
            H5P_DEFAULT, H5P_DEFAULT);
  }
  H5Fclose(file);
  const Recording single = read_recording(dir / "deep.h5");
  REQUIRE(single.frames.size() == 1);
  CHECK(single.frames[0].image[0][5][5].item<double>() == Approx(50000.0 / 65535));
}

TEST_CASE("layouts: pictures of event_utils and EFNet come with their times", "[recording]") {
  const TempDir dir;
  const auto write = [&](const std::string& name, std::vector<hsize_t> shape,
                         const std::vector<uint8_t>& bytes, const std::string& type, double stamp,
                         bool exposed) {
    const bool is_new = !std::filesystem::exists(dir / "monash.h5");
    if (is_new) {
      const hid_t file = create(dir / "monash.h5");
      write_table(file, "events", false, {0, 1, 2, 3});
      H5Fclose(file);
    }
    const hid_t file = H5Fopen((dir / "monash.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t links = H5Pcreate(H5P_LINK_CREATE);
    H5Pset_create_intermediate_group(links, 1);
    const hid_t space = H5Screate_simple(int(shape.size()), shape.data(), nullptr);
    const hid_t data =
        H5Dcreate2(file, name.c_str(), H5T_NATIVE_UINT8, space, links, H5P_DEFAULT, H5P_DEFAULT);
    if (!bytes.empty())
      H5Dwrite(data, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
    const hid_t one = H5Screate(H5S_SCALAR);
    const auto put = [&](const char* key, double value) {
      const hid_t attribute =
          H5Acreate2(data, key, H5T_NATIVE_DOUBLE, one, H5P_DEFAULT, H5P_DEFAULT);
      H5Awrite(attribute, H5T_NATIVE_DOUBLE, &value);
      H5Aclose(attribute);
    };
    put("timestamp", stamp);
    if (exposed) put("exposure_start", stamp - 0.004), put("exposure_end", stamp + 0.004);
    const hid_t text = H5Tcopy(H5T_C_S1);
    H5Tset_size(text, type.size() + 1);
    const hid_t attribute = H5Acreate2(data, "type", text, one, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(attribute, text, type.c_str());
    H5Aclose(attribute), H5Tclose(text), H5Sclose(one), H5Dclose(data), H5Sclose(space);
    H5Pclose(links), H5Fclose(file);
  };
  std::vector<uint8_t> bgr;  // [H,W,3]
  for (int i = 0; i < 48 * 64; ++i) bgr.insert(bgr.end(), {51, 102, 204});
  std::vector<uint8_t> planes;  // [3,H,W]
  for (const uint8_t value : {51, 102, 204}) planes.insert(planes.end(), 48 * 64, value);
  write("images/image000000000", {48, 64, 3}, bgr, "color_bgr", 1.005, true);
  write("images/image000000001", {3, 48, 64}, planes, "rgb", 1.02, true);
  write("sharp_images/image000000000", {48, 64, 3}, bgr, "color_bgr", 1.005, false);
  const Recording colour = read_recording(dir / "monash.h5");
  check_read(colour);
  REQUIRE(colour.frames.size() == 2);
  CHECK(colour.frames[0].name == "image000000000");
  CHECK(colour.frames[0].t_start_us == 1001000);
  CHECK(colour.frames[1].t_end_us == 1024000);
  CHECK(colour.frames[0].image[0][5][5].item<float>() == Approx(0.8).margin(1e-4));
  CHECK(colour.frames[1].image[0][5][5].item<float>() == Approx(0.2).margin(1e-4));
  CHECK_THAT(layout_notes(colour), Catch::Contains("1 pictures of sharp_images/"));

  std::filesystem::remove(dir / "monash.h5");
  const std::vector<uint8_t> gray(48 * 64, 102);
  write("images/image000000000", {48, 64}, gray, "greyscale", 1.005, false);
  write("images/image000000001", {48, 64, 1}, gray, "greyscale", 1.02, false);
  const Recording single = read_recording(dir / "monash.h5");
  REQUIRE(single.frames.size() == 2);
  CHECK(single.frames[1].t_start_us == 1020000);
  CHECK(single.frames[1].t_end_us == 1020000);
  CHECK(single.frames[1].image[0][5][5].item<float>() == Approx(0.4).margin(1e-4));
  CHECK((single.width == 64 && single.height == 48));

  // A size that the file cannot hold is not allocated.
  write("images/image000000002", {1 << 20, 1 << 20, 3}, {}, "color_bgr", 1.03, false);
  CHECK_THAT(failure_of([&] { read_recording(dir / "monash.h5"); }),
             test::naming("monash.h5", "image000000002", "claims"));
}

namespace {

void write_pictures(const std::filesystem::path& folder, const std::vector<std::string>& names) {
  for (size_t i = 0; i < names.size(); ++i)
    imaging::write_image(folder / names[i], torch::full({3, 48, 64}, 0.1 + 0.1 * double(i)));
}

void check_span(const Frame& frame, int64_t begin, int64_t end) {
  CHECK(frame.t_start_us == begin);
  CHECK(frame.t_end_us == end);
}

}  // namespace

TEST_CASE("layouts: DSEC's exposures beside its frames, in its folder and as downloaded",
          "[recording]") {
  const TempDir dir;
  std::filesystem::create_directories(dir / "thun/events/left");
  {
    io::Hdf5Writer file(dir / "thun/events/left/events.h5");
    append_events<uint16_t, uint32_t>(file, "events/");
    file.close();
  }
  write_pictures(dir / "thun/images/left/rectified", {"000000.png", "000001.png", "000002.png"});
  const std::string lines =
      "# exposure_start_timestamp_us, exposure_end_timestamp_us\n"
      "1000000, 1004000\n1010000, 1014500\n1020000, 1025000\n";
  dir.write("thun/images/timestamps.txt", "1002000\n1012250\n1022500\n");
  const Recording middles = read_recording(dir / "thun");
  REQUIRE(middles.frames.size() == 3);
  check_span(middles.frames[1], 1012250, 1012250);
  CHECK(middles.stamp == Stamp::kMiddle);
  CHECK_THAT(layout_notes(middles), test::naming("timestamps.txt", "middle"));
  dir.write("thun/images/left/exposure_timestamps.txt", lines);
  const Recording whole = read_recording(dir / "thun");
  check_read(whole);
  REQUIRE(whole.frames.size() == 3);
  check_span(whole.frames[1], 1010000, 1014500);
  CHECK_THAT(layout_notes(whole), test::naming("exposure_timestamps.txt"));

  // The downloads, with the list of the other camera and a part of the frames.
  write_pictures(dir / "images_rectified_left", {"000001.png", "000002.png"});
  dir.write("thun_00_a_image_exposure_timestamps_left.txt", lines);
  dir.write("thun_00_a_image_exposure_timestamps_right.txt", "1,2\n");
  ReadOptions options;
  options.frames = dir / "images_rectified_left";
  const Recording part = read_recording(dir / "thun/events/left/events.h5", options);
  REQUIRE(part.frames.size() == 2);
  check_span(part.frames[0], 1010000, 1014500);
  CHECK_THAT(layout_notes(part), test::naming("3 lines", "2 frames"));
  const auto refused = [&] {
    return failure_of([&] { read_recording(dir / "thun/events/left/events.h5", options); });
  };
  write_pictures(dir / "images_rectified_left", {"000003.png"});
  CHECK(refused().empty());  // as many lines as frames
  write_pictures(dir / "images_rectified_left", {"000004.png"});
  CHECK_THAT(refused(), test::naming("thun_00_a_image_exposure_timestamps_left.txt", "3 lines",
                                     "4 frames", "000003.png"));
  dir.write("thun_00_b_image_exposure_timestamps_left.txt", lines);
  CHECK_THAT(refused(), test::naming("thun_00_a", "thun_00_b"));
  dir.write("image_exposure_timestamps_left.txt", "1000000, 1004000\n1010000\n");
  CHECK_THAT(refused(), test::naming("image_exposure_timestamps_left.txt:2", "2 numbers"));
  dir.write("image_exposure_timestamps_left.txt",
            "1000000, 1004000\n1010000, 1009000\n1020000, 1025000\n1,2\n");
  CHECK_THAT(refused(),
             test::naming("image_exposure_timestamps_left.txt", "000002.png", "1009000"));
}

TEST_CASE("layouts: EDS has times in us and exposures as DSO reads them", "[recording]") {
  const TempDir dir;
  write_events(dir);
  write_pictures(dir / "images",
                 {"frame_0000000000.png", "frame_0000000001.png", "frame_0000000002.png"});
  dir.write("images_timestamps.txt", "1002000\n1012000\n1022000\n");
  const Recording stamps = read_recording(dir.path());
  check_read(stamps);
  REQUIRE(stamps.frames.size() == 3);
  check_span(stamps.frames[1], 1012000, 1012000);
  dir.write("times.txt",
            "0 1.002 4.0 1.5 frame_0000000000.png\n1 1.012 3.0 1.5 frame_0000000001.png\n"
            "2 1.022 4.0 1.5 frame_0000000002.png\n");
  const Recording both = read_recording(dir.path());
  check_span(both.frames[1], 1010500, 1013500);
  CHECK_THAT(layout_notes(both), test::naming("images_timestamps.txt", "times.txt", "middle"));
  ReadOptions options;
  options.stamp = Stamp::kStart;
  check_span(read_recording(dir.path(), options).frames[1], 1012000, 1015000);
  std::filesystem::remove(dir / "images_timestamps.txt");
  check_span(read_recording(dir.path()).frames[2], 1020000, 1024000);
  // Other units are recognised by the period, with a note.
  std::filesystem::remove(dir / "times.txt");
  for (const char* text :
       {"1002000000\n1012000000\n1022000000\n", "1.002\n1.012\n1.022\n", "1002\n1012\n1022\n",
        "0 1.002\n1 1.012\n2 1.022\n", "0;1,002\n1;1,012\n2;1,022\n"}) {
    CAPTURE(text);
    dir.write("images/timestamps.txt", text);
    const Recording other = read_recording(dir.path());
    check_span(other.frames[1], 1012000, 1012000);
    CHECK_THAT(layout_notes(other), test::naming("expected times in us"));
  }
  dir.write("images/timestamps.txt", "1,002\n1,012\n1,022\n");
  CHECK_THAT(failure_of([&] { read_recording(dir.path()); }),
             test::naming("timestamps.txt", "decimal point"));
}

TEST_CASE("layouts: a list of starts and ends is read in the frames' folder and above",
          "[recording]") {
  const TempDir dir;
  write_events(dir);
  write_pictures(dir / "left_camera", {"1.0021.png", "1.0122.png", "1.0221.png"});
  for (const char* place : {"left_camera/timestamp.txt", "timestamp.txt", "timestamps.txt",
                            "left_camera/timestamps.txt"}) {
    CAPTURE(place);
    dir.write(place, "1.000 1.004\n1.0105 1.0135\n1.020 1.024\n");
    const Recording read = read_recording(dir.path());
    REQUIRE(read.frames.size() == 3);
    check_span(read.frames[1], 1010500, 1013500);
    CHECK_THAT(layout_notes(read), test::naming(place, "start and the end", "median length 4000 us",
                                                "two clocks", "# start end"));
    CHECK(std::adjacent_find(read.notes.begin(), read.notes.end()) == read.notes.end());
    ReadOptions options;
    options.frames = dir / "left_camera";
    check_span(read_recording(dir / "events.h5", options).frames.at(1), 1010500, 1013500);
    dir.write(place, "# start end\n1.000 1.004\n1.0105 1.0135\n1.020 1.024\n");
    CHECK_THAT(layout_notes(read_recording(dir.path())), test::naming("exposures of the frames"));
    dir.write(place, "sensor_time,arrival_time\n1.000,1.004\n1.0105,1.0135\n1.020,1.024\n");
    CHECK_THAT(failure_of([&] { read_recording(dir / "events.h5", options); }),
               test::naming(place, "expected one time per frame"));
    dir.write(place, "1.002\n1.012\n1.022\n");
    check_span(read_recording(dir.path()).frames.at(1), 1012000, 1012000);
    dir.write(place, "1.000 1.004\n1.0035 1.0135\n1.020 1.024\n");  // the pairs overlap
    CHECK_THAT(failure_of([&] { read_recording(dir / "events.h5", options); }),
               test::naming(place, "expected one time per frame"));
    std::filesystem::remove(dir / place);
  }
}

TEST_CASE("layouts: a timestamp.txt of something else is passed over", "[recording]") {
  const TempDir dir;
  write_events(dir);
  write_pictures(dir / "images", {"1.002.png", "1.012.png", "1.022.png"});
  for (const char* other : {"1690000000.123\n", "1.0 1.03\n", "1\n2\n3\n4\n",
                            "Recorded 2023-05-01 at 10\n", "1\n2 3\nfour\n"}) {
    CAPTURE(other);
    dir.write("timestamp.txt", other);
    const Recording read = read_recording(dir.path());
    REQUIRE(read.frames.size() == 3);
    check_span(read.frames[1], 1012000, 1012000);
    CHECK_THAT(layout_notes(read),
               test::naming("timestamp.txt", "3 frames", "it is not used", "timestamps.txt"));
  }
  dir.write("timestamp.txt", "1.003\n1.013\n1.023\n");
  check_span(read_recording(dir.path()).frames.at(1), 1013000, 1013000);
  // Every list that was read before comes first.
  for (const char* place : {"timestamps.txt", "times.txt", "frames.csv"}) {
    CAPTURE(place);
    dir.write(place, "1.004\n1.014\n1.024\n");
    const Recording read = read_recording(dir.path());
    check_span(read.frames.at(1), 1014000, 1014000);
    CHECK_THAT(layout_notes(read), test::naming("timestamp.txt: is not used beside", place));
    std::filesystem::remove(dir / place);
  }
}

TEST_CASE("layouts: boxes of five columns are no events", "[recording]") {
  const TempDir dir;
  dir.write("my_events.txt", "1.000 3 4 1\n1.020 5 6 0\n");
  dir.write("events_boxes.txt", "0 12 30 40 1\n1 12 30 40 1\n");
  CHECK(read_recording(dir.path()).stored_events == 2);
}

TEST_CASE("layouts: numbered files are joined only where they are the events", "[recording]") {
  const TempDir dir;
  write_pictures(dir / "images", {"1.002.png"});
  dir.write("exposures.csv", "name,start_us,end_us\n1.002,1000000,1004000\n");
  const auto write = [&](const std::string& name, int64_t begin_us) {
    io::Hdf5Writer file(dir / name);
    append_events<uint16_t, int64_t>(file, "", -begin_us);
    file.close();
  };
  const auto is_refused = [&](const char* name) {
    const Recording read = read_recording(dir.path());
    CHECK(read.stored_events == 0);
    CHECK_THAT(layout_notes(read), test::naming("expected one file of events", name, "--frames"));
  };
  write("dvs_events_front.h5", 0), write("dvs_events_back.h5", 0);
  for (const char* imu : {"imu0.csv", "imu1.csv"}) dir.write(imu, "1,1,2,3\n");
  is_refused("dvs_events_front.h5");
  for (const char* name : {"dvs_events_front.h5", "dvs_events_back.h5"})
    std::filesystem::remove(dir / name);
  write("events_0.h5", 0), write("events_1.h5", 1000000);
  is_refused("events_0.h5");
  std::filesystem::create_directory(dir / "events");
  for (const char* name : {"events_0.h5", "events_1.h5"})
    std::filesystem::rename(dir / name, dir / concat("events/", name));
  CHECK(read_recording(dir.path()).stored_events == 2 * kEventCount);
  std::filesystem::rename(dir / "events/events_1.h5", dir / "events/other_1.h5");
  is_refused("other_1.h5");
}

TEST_CASE("layouts: rpg_vid2e numbers its files of events", "[recording]") {
  const TempDir dir;
  write_pictures(dir / "imgs", {"00000.png", "00001.png", "00002.png"});
  dir.write("timestamps.txt", "1.002\n1.012\n1.022\n");
  std::filesystem::create_directory(dir / "events");
  for (const int64_t chunk : {0, 1}) {
    const auto of = [](int64_t value) { return torch::full({2}, value); };
    const torch::Tensor t =
        torch::tensor({int64_t(1000000000), int64_t(1015000000)}) + chunk * 16000000;
    io::write_npz(dir / concat("events/000000000", chunk, ".npz"),
                  {{"x", of(7)}, {"y", of(5)}, {"t", t}, {"p", of(1)}});
  }
  const Recording read = read_recording(dir.path());
  CHECK(read.stored_events == 4);
  CHECK(read.frames.size() == 3);
  CHECK_THAT(layout_notes(read), test::naming("2 files of events", "one recording"));
}

TEST_CASE("layouts: TUM-VIE has times and exposures of each camera in us", "[recording]") {
  const TempDir dir;
  {
    io::Hdf5Writer file(dir / "mocap-desk-events_left.h5");
    append_events<uint16_t, int64_t>(file, "events/");
    file.close();
  }
  write_pictures(dir / "left_images", {"00000.jpg", "00001.jpg", "00002.jpg"});
  dir.write("left_images/image_timestamps_left.txt",
            "# timestamps [us]\n1002000.25\n1012000.375\n1022000.5\n");
  dir.write("left_images/image_exposures_left.txt", "# exposures [us]\n4000\n3000\n4000\n");
  const Recording left = read_recording(dir.path());
  check_read(left);
  REQUIRE(left.frames.size() == 3);
  check_span(left.frames[1], 1010500, 1013500);
  CHECK_THAT(layout_notes(left), !Catch::Contains("right"));
  write_pictures(dir / "right_images", {"00000.jpg", "00001.jpg", "00002.jpg"});
  CHECK_THAT(layout_notes(read_recording(dir.path())),
             test::naming("the left is read (left_images)", "not the right (right_images)"));
  dir.write("right_images/image_timestamps_right.txt", "1002000\n1012000\n1022000\n");
  dir.write("right_images/image_exposures_right.txt", "2000\n2000\n-2000\n");
  ReadOptions options;
  options.frames = dir / "right_images";
  CHECK_THAT(failure_of([&] { read_recording(dir / "mocap-desk-events_left.h5", options); }),
             test::naming("image_exposures_right.txt", "-2000", "00002.jpg"));
  dir.write("right_images/image_exposures_right.txt", "2000\n2000\n2000\n");
  const Recording right = read_recording(dir / "mocap-desk-events_left.h5", options);
  check_span(right.frames[1], 1011000, 1013000);
  CHECK(right.warnings.empty());
  dir.write("right_images/image_exposures_right.txt", "2.0\n2.0\n2.0\n");
  const Recording in_ms = read_recording(dir / "mocap-desk-events_left.h5", options);
  REQUIRE(in_ms.warnings.size() == 1);
  CHECK_THAT(in_ms.warnings[0],
             test::naming("image_exposures_right.txt", "2 us", "10 ms", "milliseconds"));
}
