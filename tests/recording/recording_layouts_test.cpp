// SPDX-License-Identifier: Apache-2.0
// Layouts of public data sets in HDF5, written here by their documentation, and Prophesee's DAT.
#include "support/catch.h"

#include <functional>
#include <hdf5.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/hdf5.h"
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
  for (const std::string& note : recording.notes) out += note + "\n";
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
}
