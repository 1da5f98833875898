// SPDX-License-Identifier: Apache-2.0
#include "jade/events/event_files.h"

#include "support/catch.h"

#include <cmath>
#include <fstream>
#include <functional>
#include <hdf5.h>
#include <iomanip>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/gzip.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade::events;
using jade::test::TempDir;

namespace {

const std::vector<float> kX{1.5f, 2, 3, 0}, kY{0, 1, 2.25f, 7};
const std::vector<int64_t> kT{100, 250, 250, 999};

template <class X, class T>
void write_h5(const std::filesystem::path& path, const std::vector<X>& x, const std::vector<X>& y,
              const std::vector<T>& t, const std::vector<int8_t>& p,
              const std::string& group = "") {
  jade::io::Hdf5Writer file(path);
  file.append(group + "x", x.data(), int64_t(x.size()));
  file.append(group + "y", y.data(), int64_t(y.size()));
  file.append(group + "t", t.data(), int64_t(t.size()));
  file.append(group + "p", p.data(), int64_t(p.size()));
  file.close();
}

void set_attribute(const std::filesystem::path& path, const char* dataset, const char* name,
                   const std::string& value) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, value.size() + 1);
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t attribute =
      H5Acreate_by_name(file, dataset, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  CHECK(H5Awrite(attribute, type, value.c_str()) >= 0);
  H5Aclose(attribute);
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(file);
}

void check_events(const EventStream& events) {
  REQUIRE(events.size() == 4);
  for (int64_t i = 0; i < 4; ++i) {
    CHECK(events.x()[i].item<float>() == kX[size_t(i)]);
    CHECK(events.y()[i].item<float>() == kY[size_t(i)]);
    CHECK(events.t_us()[i].item<int64_t>() == kT[size_t(i)]);
    CHECK(int(events.polarity()[i].item<int8_t>()) == (i == 1 ? -1 : 1));
  }
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const jade::DataError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("event files: HDF5 with either polarity coding, types and groups", "[events]") {
  const TempDir dir;
  write_h5<float, int64_t>(dir / "a.h5", kX, kY, kT, {1, 0, 1, 1});
  check_events(read_events(dir / "a.h5").events);
  write_h5<double, uint32_t>(dir / "b.h5", {1.5, 2, 3, 0}, {0, 1, 2.25, 7}, {100, 250, 250, 999},
                             {1, -1, 1, 1}, "events/");
  check_events(read_events(dir / "b.h5").events);
  write_h5<float, double>(dir / "c.hdf5", kX, kY, {100e-6, 250e-6, 250e-6, 999e-6}, {1, 0, 1, 1});
  const auto seconds = read_events(dir / "c.hdf5");
  CHECK(seconds.time_unit == TimeUnit::kS);
  check_events(seconds.events);
}

TEST_CASE("event files: npy, npz and text hold the same events", "[events]") {
  const TempDir dir;
  const auto x = torch::tensor({1.5, 2.0, 3.0, 0.0}), y = torch::tensor({0.0, 1.0, 2.25, 7.0});
  const auto t = torch::tensor({100, 250, 250, 999}, torch::kInt64);
  const auto p = torch::tensor({1, 0, 1, 1}, torch::kInt8);
  jade::io::write_npz(dir / "a.npz", {{"x", x}, {"y", y}, {"t", t}, {"p", p}});
  check_events(read_events(dir / "a.npz").events);
  const auto as = [](const torch::Tensor& v) { return v.to(torch::kFloat64); };
  jade::io::write_npy(dir / "txyp.npy", torch::stack({as(t), as(x), as(y), as(p)}, 1));
  check_events(read_events(dir / "txyp.npy").events);
  jade::io::write_npy(dir / "xytp.npy", torch::stack({as(x), as(y), as(t), as(p)}, 1));
  check_events(read_events(dir / "xytp.npy").events);
  std::ofstream(dir / "a.txt")
      << "346 260\n# t x y p\n100 1.5 0 1\n250 2 1 0\r\n250 3 2.25 1\n\n999 0 7 1";
  check_events(read_events(dir / "a.txt").events);
  std::ofstream(dir / "s.csv")
      << "t,x,y,p\n0.000100,1.5,0,1\n0.00025,2,1,-1\n0.00025,3,2.25,1\n0.000999,0,7,+1\n";
  check_events(read_events(dir / "s.csv").events);
}

TEST_CASE("event files: of a table, time is the column that never decreases", "[events]") {
  const TempDir dir;
  const auto x = torch::tensor({1.5, 2.0, 3.0, 0.0}, torch::kFloat64);
  const auto y = torch::tensor({0.0, 1.0, 2.25, 7.0}, torch::kFloat64);
  const auto s = torch::tensor({0.0001, 0.00025, 0.00025, 0.000999}, torch::kFloat64);
  const auto p = torch::tensor({1, 0, 1, 1}, torch::kFloat64);
  jade::io::write_npy(dir / "xytp.npy", torch::stack({x, y, s, p}, 1));
  check_events(read_events(dir / "xytp.npy").events);
  jade::io::write_npy(dir / "txyp.npy", torch::stack({s, x, y.flip(0), p}, 1));
  CHECK(read_events(dir / "txyp.npy").events.last_us() == 999);
  // Neither decreases never: the larger is the time.
  jade::io::write_npy(dir / "unsorted.npy", torch::stack({x, y, (s * 1e6).round().flip(0), p}, 1));
  CHECK(read_events(dir / "unsorted.npy").events.last_us() == 999);
}

TEST_CASE("event files: text has its columns as it names them, else as they look", "[events]") {
  const TempDir dir;
  const std::string xytp = "1.5,0,100,1\n2,1,250,0\n3,2.25,250,1\n0,7,999,1\n";
  std::ofstream(dir / "named.csv") << "X,Y,T,P\n" << xytp;
  check_events(read_events(dir / "named.csv").events);
  std::ofstream(dir / "comment.csv") << "# x y t p\n" << xytp;
  check_events(read_events(dir / "comment.csv").events);
  std::ofstream(dir / "format.csv") << "# format: x y t p\n" << xytp;
  check_events(read_events(dir / "format.csv").events);
  std::ofstream(dir / "prose.csv") << "# the columns are t x y p\n" << xytp;
  check_events(read_events(dir / "prose.csv").events);
  std::ofstream(dir / "bare.csv") << xytp;
  check_events(read_events(dir / "bare.csv").events);
  std::ofstream(dir / "other.csv") << "polarity,t,y,x\n1,100,0,1.5\n0,250,1,2\n"
                                      "1,250,2.25,3\n1,999,7,0\n";
  check_events(read_events(dir / "other.csv").events);
  // Names have priority over values, and the first column is the time if both could be.
  std::ofstream(dir / "alike.csv") << "t,x,y,p\n300,5,1,1\n200,6,2,1\n";
  CHECK(read_events(dir / "alike.csv").events.last_us() == 300);
  std::ofstream(dir / "both.csv") << "100,5,1,1\n200,6,200,1\n";
  CHECK(read_events(dir / "both.csv").events.first_us() == 100);
  std::ofstream(dir / "mark.csv") << "\xEF\xBB\xBF"
                                  << "100,1.5,0,1\n250,2,1,0\n"
                                  << "250,3,2.25,1\n999,0,7,1\n";
  check_events(read_events(dir / "mark.csv").events);
  std::ofstream(dir / "half.csv") << "100,1.5,0,0.5\n";
  CHECK_THAT(message_of([&] { read_events(dir / "half.csv"); }),
             jade::test::naming("half.csv:1", "0/1 or -1/+1", "0.5"));
}

TEST_CASE("event files: a fifth column of 0 and 1 without a name is noted, another refused",
          "[events]") {
  const TempDir dir;
  std::string lines;
  for (int i = 0; i < 12; ++i) lines += jade::concat(1000 + i, " ", i, " 3 ", i % 2, " 1\n");
  const auto labelled = read_events(
      dir.write("a.txt", "# x, y, polarity, signal/noise (1/0)\n" + lines + "1020 1 2 0 0\n"));
  CHECK(labelled.events.size() == 13);
  CHECK(labelled.events.x()[11].item<float>() == 11);
  CHECK(int(labelled.events.polarity()[12].item<int8_t>()) == -1);
  REQUIRE(labelled.warnings.size() == 1);
  CHECK_THAT(labelled.warnings[0],
             jade::test::naming("a.txt", "fifth column", "all events are kept", "of a camera"));
  CHECK_THAT(message_of([&] { read_events(dir.write("b.txt", lines + "1020 1 2 0 7\n")); }),
             jade::test::naming("b.txt:13", "fifth column", "found 7", "t x y p"));
  CHECK_THAT(message_of([&] { read_events(dir.write("c.txt", "1 2 3 0 7\n")); }),
             jade::test::naming("c.txt:1", "expected 4 numbers", "found 5"));
  // The label stands behind t x y p only.
  std::string camera, seconds, place;
  for (int i = 0; i < 12; ++i) {
    const int x = 20 + i * 7 % 5, t = 1000 + i, p = i / 2 % 2;
    camera += jade::concat(i % 2, " ", t, " ", x, " 30 ", p, "\n");
    seconds += jade::concat("0 ", t, " ", x, " 30 ", p, "\n");
    place += jade::concat(x, " 30 ", p, " ", t, " 0\n");
  }
  for (const std::string& other : {camera, seconds, place}) {
    CAPTURE(other);
    CHECK_THAT(message_of([&] { read_events(dir.write("d.txt", other)); }),
               jade::test::naming("d.txt:1", "expected 4 numbers", "found 5", "t x y p"));
  }
}

TEST_CASE("event files: numbered files of a folder are one stream", "[events]") {
  const TempDir dir;
  std::filesystem::create_directory(dir / "events");
  const auto write = [&](const std::string& name, const std::vector<int64_t>& t) {
    const auto of = [&](auto value) { return torch::full({int64_t(t.size())}, value); };
    jade::io::write_npz(dir / name, {{"x", of(int64_t(3))},
                                     {"y", of(int64_t(4))},
                                     {"t", torch::tensor(t)},
                                     {"p", of(int64_t(1))}});
  };
  // Numbers need not follow the times, and empty files count too.
  write("events/0.npz", {2000000, 2400000});
  CHECK(event_chunks(dir / "events").empty());
  write("events/1.npz", {1000000, 1900000});
  write("events/10.npz", {});
  CHECK(event_chunks(dir / "events").size() == 3);
  const auto read = read_events(dir / "events");
  CHECK(read.events.size() == 4);
  CHECK(read.events.t_us()[1].item<int64_t>() == 1900000);
  CHECK_FALSE(read.was_unsorted);
  REQUIRE(!read.warnings.empty());
  CHECK_THAT(read.warnings[0], jade::test::naming("3 files", "0.npz", "10.npz", "one recording"));
  write("events/2.npz", {0, 1500000});  // a clock of its own
  CHECK_THAT(message_of([&] { read_events(dir / "events"); }),
             jade::test::naming("follow one another in time", "1.npz", "2.npz"));
  dir.write("mixed/a1.txt", "1 2 3 0\n");
  dir.write("mixed/a2.txt", "2 2 3 0\n");
  CHECK(read_events(dir / "mixed").events.size() == 2);
  dir.write("mixed/b1.txt", "2 2 3 0\n");
  CHECK(event_chunks(dir / "mixed").empty());
  // Hidden files, and text beside arrays, are none of them; two cameras are not one stream.
  dir.write("events/._0.npz", "0");
  dir.write("events/meta1.txt", "1 2 3 4\n");
  CHECK(event_chunks(dir / "events").size() == 4);
  for (const char* name : {"cams/cam0.txt", "cams/cam1.txt"}) dir.write(name, "1 2 3 0\n");
  CHECK(event_chunks(dir / "cams").empty());
}

TEST_CASE("event files: the largest of numbered files tells the columns of all", "[events]") {
  const TempDir dir;
  std::string many, few, labelled;
  for (int i = 0; i < 12; ++i) {
    many += jade::concat(20 + i * 7 % 5, " 30 ", 1000 + i, " ", i % 2, "\n");
    labelled += jade::concat(1000 + i, " 20 30 ", i % 2, " 1\n");
  }
  for (const int x : {21, 22, 25}) few += jade::concat(x, " 31 ", 1000 + x, " 1\n");
  dir.write("events/0.txt", many);
  dir.write("events/1.txt", few);
  const auto read = read_events(dir / "events");
  CHECK(read.events.size() == 15);
  CHECK(read.events.t_us()[14].item<int64_t>() == 1025);
  CHECK(read.events.x()[14].item<float>() == 25);
  dir.write("labels/0.txt", labelled);
  dir.write("labels/1.txt", "2000 20 30 1 0\n");
  const auto labels = read_events(dir / "labels");
  CHECK(labels.events.size() == 13);
  CHECK(labels.warnings.size() == 2);
  CHECK_THAT(labels.warnings[0], jade::test::naming("labels: a fifth column"));
  EventFileOptions grouped;
  grouped.group = "left";
  CHECK_THAT(message_of([&] { read_events(dir / "events", grouped); }),
             jade::test::naming("0.txt", "group"));
}

TEST_CASE("event files: an array called by its letter comes before others", "[events]") {
  const TempDir dir;
  {
    jade::io::Hdf5Writer file(dir / "a.h5");
    file.append("x", kX.data(), 4), file.append("y", kY.data(), 4);
    file.append("t", kT.data(), 4), file.append("p", std::vector<int8_t>{1, 0, 1, 1}.data(), 4);
    file.append("timestamps", std::vector<int64_t>{7, 8}.data(), 2);
    file.close();
  }
  check_events(read_events(dir / "a.h5").events);
  jade::io::write_npz(dir / "a.npz", {{"x", torch::tensor(kX)},
                                      {"y", torch::tensor(kY)},
                                      {"t", torch::tensor(kT)},
                                      {"p", torch::tensor({1, 0, 1, 1}, torch::kInt8)},
                                      {"timestamps", torch::tensor(kT) + 5000}});
  check_events(read_events(dir / "a.npz").events);
}

TEST_CASE("event files: polarities with a fraction are refused, whole ones in floats are not",
          "[events]") {
  const TempDir dir;
  const auto write = [&](float low) {
    jade::io::Hdf5Writer file(dir / "a.h5");
    file.append("x", kX.data(), 4), file.append("y", kY.data(), 4);
    file.append("t", kT.data(), 4), file.append("p", std::vector<float>{1, low, 1, 1}.data(), 4);
    file.close();
  };
  write(0);
  check_events(read_events(dir / "a.h5").events);
  write(0.5);
  CHECK_THAT(message_of([&] { read_events(dir / "a.h5"); }), jade::test::naming("0/1 or -1/+1"));
}

TEST_CASE("event files: the unit is the one in which events meet the exposures", "[events]") {
  const TempDir dir;
  write_h5<float, int64_t>(dir / "ns.h5", kX, kY, {100999, 250000, 250001, 999500}, {1, 0, 1, 1});
  const auto found = read_events(dir / "ns.h5", {TimeUnit::kAuto, TimeWindow{0, 1000}});
  CHECK(found.time_unit == TimeUnit::kNs);
  check_events(found.events);
  check_events(read_events(dir / "ns.h5", {TimeUnit::kNs, {}}).events);
  CHECK(message_of([&] {
          read_events(dir / "ns.h5", {TimeUnit::kAuto, TimeWindow{5000000, 6000000}});
        }).find("ns.h5") != std::string::npos);
}

TEST_CASE("event files: unsorted times are sorted with a warning, equal ones keep their order",
          "[events]") {
  const TempDir dir;
  write_h5<float, int64_t>(dir / "a.h5", {2, 0, 1.5, 3}, {1, 7, 0, 2.25f}, {250, 999, 100, 250},
                           {0, 1, 1, 1});
  const auto result = read_events(dir / "a.h5");
  CHECK(result.was_unsorted);
  REQUIRE(result.warnings.size() == 1);
  CHECK(result.warnings[0].find("sorted") != std::string::npos);
  check_events(result.events);
}

TEST_CASE("event files: NaN coordinates are counted and reported", "[events]") {
  const TempDir dir;
  write_h5<float, int64_t>(dir / "a.h5", {std::nanf(""), 2, 400, 10.4f}, {1, 7, 0, 2.25f},
                           {0, 1, 2, 3}, {0, 1, 1, 1});
  const auto result = read_events(dir / "a.h5", {TimeUnit::kUs, {}});
  CHECK(result.events.size() == 4);
  REQUIRE(result.warnings.size() == 1);
  CHECK_THAT(result.warnings[0], jade::test::naming("a.h5", "1 of 4 events", "NaN"));
}

TEST_CASE("event files: damaged files are refused with their path", "[events]") {
  const TempDir dir;
  write_h5<float, int64_t>(dir / "short.h5", kX, kY, {1, 2, 3}, {1, 0, 1, 1});
  write_h5<float, int64_t>(dir / "sign.h5", kX, kY, kT, {1, 0, 2, 1});
  write_h5<float, int64_t>(dir / "mixed.h5", kX, kY, kT, {1, 0, -1, 1});
  write_h5<float, double>(dir / "nan.h5", kX, kY, {1, std::nan(""), 3, 4}, {1, 0, 1, 1});
  std::ofstream(dir / "empty.h5");
  std::ofstream(dir / "a.bin") << "x";
  std::ofstream(dir / "bad.txt") << "100 1 2 1\n100 1 2\n";
  std::ofstream(dir / "word.txt") << "100 1 2 1\n100 x 2 1\n";
  std::ofstream(dir / "sign.txt") << "100 1 2 5\n";
  jade::io::write_npy(dir / "flat.npy", torch::zeros({8}));
  jade::io::write_npz(dir / "part.npz", {{"x", torch::zeros({3})}, {"y", torch::zeros({3})}});
  {
    jade::io::Hdf5Writer file(dir / "part.h5");
    file.append("x", kX.data(), 4);
    file.close();
  }
  for (const char* name :
       {"short.h5", "sign.h5", "mixed.h5", "nan.h5", "empty.h5", "missing.h5", "a.bin", "bad.txt",
        "word.txt", "sign.txt", "missing.txt", "flat.npy", "part.npz", "part.h5"}) {
    INFO(name);
    CHECK(message_of([&] { read_events(dir / name); }).find((dir / name).string()) !=
          std::string::npos);
  }
  CHECK_THAT(message_of([&] { read_events(dir / "a.bin"); }),
             jade::test::naming("'a.bin'", ".txt"));
}

TEST_CASE("event files: an HDF5 file's t_offset is added to every time once, read whole or in part",
          "[events]") {
  const TempDir dir;
  constexpr int64_t kOffset = 5000000000;  // beyond the 32 bits of DSEC's times
  const auto write = [&](const char* name, auto per_us, auto offset) {
    std::vector<decltype(per_us)> stored;
    for (const int64_t us : kT) stored.push_back(per_us * decltype(per_us)(us));
    jade::io::Hdf5Writer file(dir / name);
    file.append("events/x", kX.data(), 4), file.append("events/y", kY.data(), 4);
    file.append("events/t", stored.data(), 4);
    file.append("events/p", std::vector<int8_t>{1, 0, 1, 1}.data(), 4);
    file.append("t_offset", &offset, 1);
    file.close();
  };
  write("us.h5", uint32_t(1), kOffset);
  write("s.h5", 1e-6, 1e-6 * double(kOffset));
  for (const char* name : {"us.h5", "s.h5"}) {
    INFO(name);
    EventFileOptions options;
    options.time_unit = std::string(name) == "s.h5" ? TimeUnit::kS : TimeUnit::kUs;
    const auto whole = read_events(dir / name, options).events;
    REQUIRE(whole.size() == 4);
    for (int64_t i = 0; i < 4; ++i) {
      CHECK(whole.t_us()[i].item<int64_t>() == kOffset + kT[size_t(i)]);
    }
    options.keep = std::vector<TimeWindow>{{kOffset + 200, kOffset + 300}};
    const auto part = read_events(dir / name, options);
    CHECK(part.stored_us.begin_us == kOffset + 100);
    CHECK(part.stored_us.end_us == kOffset + 1000);
    REQUIRE(part.events.size() == 2);
    CHECK(part.events.first_us() == kOffset + 250);
  }
}

TEST_CASE("event files: a file without events is read with a warning", "[events]") {
  const TempDir dir;
  std::ofstream(dir / "a.txt") << "# nothing\n";
  const auto result = read_events(dir / "a.txt");
  CHECK(result.events.empty());
  CHECK(result.warnings.size() == 1);
  // Events outside the request are kept as well.
  std::ofstream(dir / "b.txt") << "100 1 2 1\n";
  EventFileOptions later;
  later.keep = std::vector<TimeWindow>{{5000, 6000}};
  const auto none = read_events(dir / "b.txt", later);
  CHECK(none.events.empty());
  CHECK(none.warnings.empty());
}

TEST_CASE("event files: of an HDF5 file only the events of some spans are kept", "[events]") {
  const TempDir dir;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int i = 0; i < 1000; ++i) {
    x.push_back(float(i)), y.push_back(1);
    t.push_back(10 * i), p.push_back(int8_t(i % 2));
  }
  write_h5<float, int64_t>(dir / "us.h5", x, y, t, p);
  std::vector<double> seconds;
  for (const int64_t us : t) seconds.push_back(1e-6 * double(us));
  write_h5<float, double>(dir / "s.h5", x, y, seconds, p);
  std::swap(t[3], t[900]);
  write_h5<float, int64_t>(dir / "unsorted.h5", x, y, t, p);
  jade::events::EventFileOptions options;
  options.keep = {{1000, 1050}, {5001, 5011}, {20000, 30000}};
  for (const char* name : {"us.h5", "s.h5", "unsorted.h5"}) {
    INFO(name);
    const auto result = read_events(dir / name, options);
    CHECK(result.stored == 1000);
    CHECK(result.stored_us.begin_us == 0);
    CHECK(result.stored_us.end_us == 9991);
    REQUIRE(result.events.size() == 6);
    CHECK(result.events.first_us() == 1000);
    CHECK(result.events.last_us() == 5010);
    CHECK(result.events.x()[4].item<float>() == 104);
  }
  options.keep = std::vector<TimeWindow>{{10, 20}};
  options.event_bytes = 1e12;
  CHECK_THAT(message_of([&] { read_events(dir / "us.h5", options); }),
             jade::test::naming("1 events", "1000 GB", "0.7"));
}

TEST_CASE("event files: text in Prophesee's order, with the size and names that stand before it",
          "[events]") {
  const TempDir dir;
  const auto lines = [](const char* between, bool index) {
    std::string out;
    for (int i = 0; i < 40; ++i) {
      const std::string row[] = {std::to_string(i * 37 % 64), std::to_string(i * 23 % 48),
                                 std::to_string(i % 2), std::to_string(1000000 + 10 * i)};
      if (index) out += std::to_string(i) + between;
      out += row[0] + between + row[1] + between + row[2] + between + row[3] + "\n";
    }
    return out;
  };
  std::ofstream(dir / "comma.csv") << lines(",", false);
  std::ofstream(dir / "tab.tsv") << lines("\t", false);
  std::ofstream(dir / "semicolon.txt") << lines("; ", false);
  std::ofstream(dir / "geometry.csv") << "%geometry:64,48\n" << lines(",", false);
  std::ofstream(dir / "size.txt") << "64 48\n" << lines(" ", false);
  std::ofstream(dir / "index.csv") << ",x,y,polarity,timestamp\n" << lines(",", true);
  for (const char* name :
       {"comma.csv", "tab.tsv", "semicolon.txt", "geometry.csv", "size.txt", "index.csv"}) {
    INFO(name);
    const auto read = read_events(dir / name);
    REQUIRE(read.events.size() == 40);
    CHECK(read.events.first_us() == 1000000);
    CHECK(read.events.x()[1].item<float>() == 37);
    CHECK(read.events.y()[1].item<float>() == 23);
    CHECK(int(read.events.polarity()[0].item<int8_t>()) == -1);
    const bool says = std::string(name) == "geometry.csv" || std::string(name) == "size.txt";
    REQUIRE(read.sensor.has_value() == says);
    if (says) CHECK((read.sensor->width == 64 && read.sensor->height == 48));
  }
  std::ofstream(dir / "ns.csv") << "t_ns,x,y,p\n2000,1,2,1\n3000,1,2,0\n";
  CHECK(read_events(dir / "ns.csv").events.last_us() == 3);
  std::ofstream(dir / "three.csv") << "x,y,p,t\n1,2,1,3\n1,2,1\n";
  CHECK_THAT(message_of([&] { read_events(dir / "three.csv"); }),
             jade::test::naming("three.csv:3", "4 numbers"));
}

TEST_CASE("event files: a name or an attribute says that times are milliseconds", "[events]") {
  const TempDir dir;
  const std::string rows = ",x,y,p\n0.1,1.5,0,1\n0.25,2,1,0\n0.25,3,2.25,1\n0.999,0,7,1\n";
  for (const char* name : {"t_ms", "timestamp_ms", "t [ms]"}) {
    INFO(name);
    std::ofstream(dir / "a.csv") << name << rows;
    const auto read = read_events(dir / "a.csv");
    CHECK(read.time_unit == TimeUnit::kMs);
    check_events(read.events);
  }
  const auto write = [&](const char* unit, auto t) {
    jade::io::Hdf5Writer file(dir / "a.h5");
    file.append("events/x", kX.data(), 4), file.append("events/y", kY.data(), 4);
    file.append("events/t", t.data(), 4);
    file.append("events/p", std::vector<int8_t>{1, 0, 1, 1}.data(), 4);
    file.close();
    set_attribute(dir / "a.h5", "events/t", "units", unit);
  };
  write("milliseconds", std::vector<double>{0.1, 0.25, 0.25, 0.999});
  check_events(read_events(dir / "a.h5").events);
  write("ms", std::vector<int64_t>{1, 2, 3, 4});
  CHECK(read_events(dir / "a.h5").events.last_us() == 4000);
  write("ticks", kT);
  const auto other = read_events(dir / "a.h5");
  check_events(other.events);
  REQUIRE(other.warnings.size() == 1);
  CHECK_THAT(other.warnings[0], jade::test::naming("ticks", "events/t", "--events-unit"));
}

TEST_CASE("event files: times without a name that look like milliseconds are a warning",
          "[events]") {
  const TempDir dir;
  // 2000 events in 0.2 s, one in 100 us.
  const auto read = [&](double unit_us, int digits, const char* head = "") {
    std::ofstream file(dir / "a.txt");
    file << head << std::fixed << std::setprecision(digits);
    for (int i = 0; i < 2000; ++i)
      file << 100.0 * i / unit_us << ' ' << i % 31 << ' ' << i % 23 << ' ' << i % 2 << '\n';
    file.close();
    return read_events(dir / "a.txt");
  };
  const auto milliseconds = read(1000, 3);
  REQUIRE(milliseconds.warnings.size() == 1);
  CHECK_THAT(milliseconds.warnings[0], jade::test::naming("a.txt", "2000", "199.9 s", "t_ms"));
  CHECK(read(1000, 3, "t_ms x y p\n").warnings.empty());
  CHECK(read(1e6, 6).warnings.empty());
  CHECK(read(1e6, 4).warnings.empty());
  CHECK(read(1, 0).warnings.empty());
  std::ofstream dense(dir / "b.txt");
  for (int i = 0; i < 200000; ++i) {
    dense << i / 200 << ' ' << i % 31 << ' ' << i % 23 << ' ' << i % 2 << '\n';
  }
  dense.close();
  const auto counted = read_events(dir / "b.txt");
  REQUIRE(counted.warnings.size() == 1);
  CHECK_THAT(counted.warnings[0], jade::test::naming("b.txt", "999 us", "t_ms"));
}

TEST_CASE("event files: a counter that wraps is continued, with a note", "[events]") {
  const TempDir dir;
  std::vector<float> x(1000, 1), y(1000, 2);
  std::vector<int8_t> p(1000, 1);
  const auto check = [&](const std::filesystem::path& path, int64_t first, const char* bits) {
    INFO(path.filename());
    const auto read = read_events(path);
    REQUIRE(read.events.size() == 1000);
    CHECK(read.events.first_us() == first);
    CHECK(read.events.last_us() == first + 999 * 100);
    CHECK_FALSE(read.was_unsorted);
    REQUIRE(read.warnings.size() == 1);
    CHECK_THAT(read.warnings[0], jade::test::naming("counter", bits, "wraps 1 time"));
  };
  std::vector<uint32_t> unsigned32;
  std::vector<int32_t> signed32;
  std::vector<int64_t> narrow;
  std::vector<double> seconds;
  for (uint32_t i = 0; i < 1000; ++i) {
    unsigned32.push_back(uint32_t(-50000) + 100 * i);
    signed32.push_back(int32_t(uint32_t(INT32_MAX) - 50000 + 100 * i));
    narrow.push_back(((1 << 24) - 50000 + 100 * int64_t(i)) % (1 << 24));
    seconds.push_back(1e-6 * unsigned32.back());
  }
  write_h5<float, uint32_t>(dir / "u.h5", x, y, unsigned32, p);
  check(dir / "u.h5", (int64_t(1) << 32) - 50000, "32 bits");
  write_h5<float, int32_t>(dir / "i.h5", x, y, signed32, p);
  check(dir / "i.h5", INT32_MAX - 50000, "32 bits");
  write_h5<float, int64_t>(dir / "n.h5", x, y, narrow, p);
  check(dir / "n.h5", (1 << 24) - 50000, "24 bits");
  std::vector<uint16_t> shortest;
  for (uint32_t i = 0; i < 1000; ++i) shortest.push_back(uint16_t(15536 + 100 * i));
  write_h5<float, uint16_t>(dir / "w.h5", x, y, shortest, p);
  check(dir / "w.h5", 15536, "16 bits");
  write_h5<float, double>(dir / "s.h5", x, y, seconds, p);
  check(dir / "s.h5", (int64_t(1) << 32) - 50000, "32 bits");
}

TEST_CASE("event files: negative times in uint64 are refused, events far from all others named",
          "[events]") {
  const TempDir dir;
  write_h5<float, uint64_t>(dir / "u.h5", kX, kY, {uint64_t(-200), uint64_t(-100), 0, 100},
                            {1, 0, 1, 1});
  CHECK_THAT(message_of([&] { read_events(dir / "u.h5"); }),
             jade::test::naming("2^63", "unsigned", "store the times as int64"));
  EventFileOptions part;
  part.keep = std::vector<TimeWindow>{{0, 1000}};
  write_h5<float, uint64_t>(dir / "v.h5", kX, kY,
                            {uint64_t(-400), uint64_t(-300), uint64_t(-200), uint64_t(-100)},
                            {1, 0, 1, 1});
  CHECK_THAT(message_of([&] { read_events(dir / "v.h5", part); }), jade::test::naming("2^63"));
  const int64_t today = 1700000000000000;
  write_h5<float, int64_t>(dir / "far.h5", kX, kY, {0, today, today + 10, today + 20},
                           {1, 0, 1, 1});
  const auto far = read_events(dir / "far.h5");
  REQUIRE(far.warnings.size() == 1);
  CHECK_THAT(far.warnings[0], jade::test::naming("1 events", "3 events", "damaged"));
}

TEST_CASE("event files: float32 times too coarse for events are refused", "[events]") {
  const TempDir dir;
  const auto message = [&](float first, float step) {
    std::vector<float> x(200, 1), y(200, 2), t;
    for (int i = 0; i < 200; ++i) t.push_back(first + float(i) * step);
    write_h5<float, float>(dir / "a.h5", x, y, t, std::vector<int8_t>(200, 1));
    return message_of([&] { read_events(dir / "a.h5"); });
  };
  CHECK_THAT(message(1.7e9F, 1e-3F), jade::test::naming("float32", "128", "float64"));
  CHECK_THAT(message(1.7e15F, 1e9F), jade::test::naming("float32", "float64"));
  CHECK_THAT(message(65536.5F, 0.25F), jade::test::naming("float32"));
  CHECK(message(0, 1e-3F).empty());
  CHECK(message(1e6F, 100).empty());
  jade::io::write_npz(dir / "a.npz", {{"x", torch::ones({200})},
                                      {"y", torch::ones({200})},
                                      {"t", torch::full({200}, 1.7e9)},
                                      {"p", torch::ones({200})}});
  CHECK_THAT(message_of([&] { read_events(dir / "a.npz"); }), jade::test::naming("float32"));
}

TEST_CASE("event files: times that lost their digits are refused, others are not", "[events]") {
  const TempDir dir;
  const auto message = [&](const std::function<double(int)>& time, int count = 2000) {
    std::vector<float> x, y;
    std::vector<double> t;
    for (int i = 0; i < count; ++i) {
      x.push_back(float(i % 31)), y.push_back(float(i % 23)), t.push_back(time(i));
    }
    write_h5<float, double>(dir / "a.h5", x, y, t, std::vector<int8_t>(x.size(), 1));
    return message_of([&] { read_events(dir / "a.h5"); });
  };
  CHECK_THAT(message([](int) { return 1.6e9; }),
             jade::test::naming("a.h5", "2000 events at 1 time", "digits"));
  CHECK_THAT(message([](int i) { return 1.6e9 + 128.5 * (i / 1000); }),
             jade::test::naming("2000 events at 2 times", "128.5"));
  CHECK_THAT(message([](int i) { return 0.5 + 1.0 * (i / 100); }),
             jade::test::naming("2000 events at 20 times"));
  // Seconds since 1970 that were float32 once; whole numbers are taken for microseconds.
  CHECK_THAT(message([](int i) { return 1.6e9 + 128 * (i / 2000); }, 8000),
             jade::test::naming("float32", "128", "digits"));
  CHECK(message([](int i) { return 1.6e9 + 128 * i; }).empty());
  CHECK(message([](int i) { return 1.6e9 + i / 500; }).empty());
  CHECK(message([](int) { return 1.6e9; }, 500).empty());
  CHECK(message([](int i) { return 1e-5 * i; }).empty());
  // A sensor that reads all its pixels at once, 100 times per second.
  CHECK(message([](int i) { return 0.01 * (i / 60); }).empty());
  CHECK(message([](int i) { return 0.25 * i; }).empty());
}

TEST_CASE("event files: text in the dialects of spreadsheets", "[events]") {
  const TempDir dir;
  const auto check = [&](const std::string& text) {
    INFO(text);
    std::ofstream(dir / "a.csv") << text;
    check_events(read_events(dir / "a.csv").events);
  };
  check(
      "\"timestamp\",\"x\",\"y\",\"polarity\"\n\"100\",\"1.5\",\"0\",\"1\"\n"
      "\"250\",\"2\",\"1\",\"0\"\n\"250\",\"3\",\"2.25\",\"1\"\n\"999\",\"0\",\"7\",\"1\"\n");
  check("t,x,y,p\n100,1.5,0,ON\n250,2,1,OFF\n250,3,2.25,on\n999,0,7,ON\n");
  check("t,x,y,p\n100,1.5,0,True\n250,2,1,False\n250,3,2.25,TRUE\n999,0,7,true\n");
  check("t;x;y;p\n0,0001;1,5;0;1\n0,00025;2;1;0\n0,00025;3;2,25;1\n0,000999;0;7;1\n");
  check("t,x,y,p,\n100,1.5,0,1,\n250,2,1,0,\n250,3,2.25,1,\n999,0,7,1,\n");
  check("t,x,y,p\r100,1.5,0,1\r250,2,1,0\r250,3,2.25,1\r999,0,7,1\r");
  check("t,x,y,p\r\n100,1.5,0,1\r\n250,2,1,0\r\n250,3,2.25,1\r\n999,0,7,1");
  std::ofstream(dir / "a.csv") << "t,x,y,p\n100,1,0,pos\n250,2,1,neg\n";
  CHECK_THROWS_NAMING(jade::DataError, read_events(dir / "a.csv"), "a.csv:2", "polarity",
                      "1 for brighter");
}

TEST_CASE("event files: text with seconds and nanoseconds, and in UTF-16", "[events]") {
  const TempDir dir;
  const auto read = [&](const std::string& text) {
    std::ofstream(dir / "a.csv", std::ios::binary) << text;
    return read_events(dir / "a.csv").events;
  };
  const std::string rows =
      "\n5,100000,1.5,0,1\n5,250000,2,1,0\n6,250000,3,2.25,1\n6,999000,0,7,1\n";
  for (const char* names :
       {"secs,nsecs,x,y,p", "# stamp.sec,stamp.nanosec,x,y,polarity", "ts_secs,ts_nsecs,x,y,p"}) {
    INFO(names);
    const EventStream events = read(names + rows);
    CHECK(events.first_us() == 5000100);
    CHECK(events.last_us() == 6000999);
  }
  CHECK_THAT(message_of([&] { read("secs,nsecs,x,y,p\n5,1500000000,1,2,1\n"); }),
             jade::test::naming("a.csv:2", "999999999", "1.5e+09"));
  CHECK_THAT(message_of([&] { read(std::string("\xFF\xFEt\0,\0", 6)); }),
             jade::test::naming("UTF-16", "iconv"));
}

TEST_CASE("event files: a first line of unknown names is reported with the order assumed",
          "[events]") {
  const TempDir dir;
  const auto read = [&](const std::string& text) {
    std::ofstream(dir / "a.csv") << text;
    return read_events(dir / "a.csv");
  };
  const auto result = read("when,across,down,which\n100,1.5,0,1\n250,2,1,0\n");
  REQUIRE(result.warnings.size() == 1);
  CHECK_THAT(result.warnings[0],
             jade::test::naming("when,across,down,which", "read as t, x, y, p"));
  const auto in_words = read("t,row,col,p\n100,5,1,1\n");
  CHECK(in_words.events.y()[0].item<float>() == 5);
  REQUIRE(in_words.warnings.size() == 1);
  CHECK_THAT(in_words.warnings[0], jade::test::naming("col as x", "row as y"));
  CHECK(read("t,x,y,p\n100,5,1,1\n").warnings.empty());
  CHECK(read("346 260\n100,5,1,1\n").warnings.empty());
}

TEST_CASE("event files: a unit in which almost no event meets the exposures is refused",
          "[events]") {
  const TempDir dir;
  std::vector<float> x(400, 1), y(400, 2);
  std::vector<int64_t> t;
  for (int64_t i = 0; i < 400; ++i) t.push_back(1000 * i);
  write_h5<float, int64_t>(dir / "a.h5", x, y, t, std::vector<int8_t>(400, 1));
  const auto read = [&](const TimeWindow& exposures) {
    return read_events(dir / "a.h5", {TimeUnit::kAuto, exposures});
  };
  // In seconds the events would cover five days, and these exposures with them.
  CHECK_THAT(message_of([&] {
               read({1000500, 1400000});
             }),
             jade::test::naming("no likely unit", "of one recording"));
  CHECK(read({100000, 110000}).time_unit == TimeUnit::kUs);
}

TEST_CASE("event files: events that are stored twice are reported", "[events]") {
  const TempDir dir;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  // A part of the last `again` of 2000 is stored again at the end.
  const auto warned = [&](int64_t again) {
    x.clear(), y.clear(), t.clear(), p.clear();
    for (int64_t i = 0; i < 2000 + again; ++i) {
      const int64_t event = i < 2000 ? i : i - again;
      x.push_back(float(event % 17)), y.push_back(float(event % 11));
      t.push_back(event / 3 * 40), p.push_back(int8_t(event % 2));
    }
    write_h5<float, int64_t>(dir / "a.h5", x, y, t, p);
    for (const std::string& line : read_events(dir / "a.h5").warnings) {
      if (line.find("each event once") != std::string::npos) return true;
    }
    return false;
  };
  CHECK(warned(2000));
  CHECK(warned(200));
  CHECK_FALSE(warned(20));
  CHECK_FALSE(warned(0));
}

TEST_CASE("event files: compressed lists and other polarities say what to do", "[events]") {
  const TempDir dir;
  std::ofstream(dir / "a.txt.gz") << "\x1f\x8b\x08";
  CHECK_THAT(message_of([&] { read_events(dir / "a.txt.gz"); }),
             jade::test::naming("a.txt.gz", "damaged"));
  std::ofstream(dir / "a.npy.gz") << "\x1f\x8b\x08";
  CHECK_THAT(message_of([&] { read_events(dir / "a.npy.gz"); }),
             jade::test::naming("gzip", "gunzip -k a.npy.gz"));
  std::ofstream(dir / "a.txt.xz") << "\xFD"
                                     "7zXZ";
  CHECK_THAT(message_of([&] { read_events(dir / "a.txt.xz"); }),
             jade::test::naming("unxz -k a.txt.xz"));
  std::ofstream(dir / "b.txt.gz") << jade::io::gzip("100 1 2 1\n200 1 2 0\n");
  CHECK(
      read_events(dir / "b.txt.gz").events.t_us().equal(torch::tensor({100, 200}, torch::kInt64)));
  write_h5<float, int64_t>(dir / "two.h5", kX, kY, kT, {1, 2, 2, 1});
  CHECK_THAT(message_of([&] { read_events(dir / "two.h5"); }),
             jade::test::naming("from 1 to 2", "store 1 for brighter"));
  std::ofstream(dir / "cut.txt") << "100 1 2 1\n200 1 2 0\n3";
  CHECK_THAT(
      message_of([&] { read_events(dir / "cut.txt"); }),
      jade::test::naming("cut.txt:3", "expected 4 numbers", "found 1", "complete or remove"));
}

namespace {

/// 400 events 25 us apart, of which these are moved by a span.
std::vector<int64_t> with_moved(const std::vector<size_t>& moved, int64_t by_us,
                                int64_t scale = 1) {
  std::vector<int64_t> t;
  for (int64_t i = 0; i < 400; ++i) t.push_back(scale * (5000000 + 25 * i));
  for (const size_t i : moved) t[i] += scale * by_us;
  return t;
}

}  // namespace

TEST_CASE("event files: a few events far from all others are left out with a warning", "[events]") {
  const TempDir dir;
  const std::vector<float> place(400, 3);
  std::vector<int8_t> p;
  for (int i = 0; i < 400; ++i) p.push_back(int8_t(i % 2));
  const int64_t hour = 3600000000;
  const auto read = [&](const std::vector<int64_t>& t, const EventFileOptions& options) {
    write_h5<float, int64_t>(dir / "a.h5", place, place, t, p);
    return read_events(dir / "a.h5", options);
  };
  const auto warned = [](const EventFileResult& result) {
    std::string all;
    for (const std::string& line : result.warnings) all += line + "\n";
    return all;
  };
  EventFileOptions plain, exposures, kept;
  exposures.exposures = kept.exposures = TimeWindow{5000000, 5010000};
  kept.keep = std::vector<TimeWindow>{{0, 10000000}};
  for (const auto& options : {plain, exposures, kept}) {
    for (const auto& moved : {std::vector<size_t>{399}, {200}, {0, 7, 399}}) {
      const auto result = read(with_moved(moved, hour), options);
      CHECK(result.time_unit == TimeUnit::kUs);
      CHECK(result.events.size() == int64_t(400 - moved.size()));
      CHECK(result.stored == result.events.size());
      CHECK(result.stored_us.duration_us() <= 10000);
      CHECK_THAT(warned(result), jade::test::naming("left out"));
    }
  }
  const auto early = read(with_moved({0}, -hour), plain);
  CHECK(early.events.size() == 399);
  CHECK_THAT(warned(early), jade::test::naming("1 event", "1 before"));
  // A pause is no damage, nor are many events.
  CHECK(read(with_moved({399}, 5000000), plain).events.size() == 400);
  std::vector<size_t> many;
  for (size_t i = 380; i < 400; ++i) many.push_back(i);
  CHECK(read(with_moved(many, hour), plain).events.size() == 400);
}

TEST_CASE("event files: beside frames, whole ns from 0 are read as ns with a warning", "[events]") {
  const TempDir dir;
  const std::vector<float> place(400, 3);
  std::vector<int8_t> p;
  std::vector<int64_t> us, ns;
  for (int64_t i = 0; i < 400; ++i) {
    p.push_back(int8_t(i % 2)), us.push_back(25 * i), ns.push_back(25000 * i);
  }
  write_h5<float, int64_t>(dir / "us.h5", place, place, us, p);
  write_h5<float, int64_t>(dir / "ns.h5", place, place, ns, p);
  EventFileOptions options;
  options.frames = TimeWindow{1000, 9000};
  const auto as_ns = read_events(dir / "ns.h5", options);
  CHECK(as_ns.time_unit == TimeUnit::kNs);
  CHECK(as_ns.events.last_us() == 25 * 399);
  REQUIRE(as_ns.warnings.size() == 1);
  CHECK_THAT(as_ns.warnings[0], jade::test::naming("ns.h5", "nanoseconds"));
  const auto as_us = read_events(dir / "us.h5", options);
  CHECK(as_us.time_unit == TimeUnit::kUs);
  CHECK(as_us.warnings.empty());
  // Frames with a clock of their own say nothing.
  options.frames = TimeWindow{900000000, 908000000};
  CHECK(read_events(dir / "us.h5", options).time_unit == TimeUnit::kUs);
  CHECK(read_events(dir / "ns.h5", options).time_unit == TimeUnit::kUs);
}

TEST_CASE("event files: events that last as long as the exposures in ns only name this unit",
          "[events]") {
  const TempDir dir;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int64_t i = 0; i < 20000; ++i) {
    x.push_back(float(i % 17)), y.push_back(float(i % 11));
    t.push_back(250000 * i), p.push_back(int8_t(i % 2));
  }
  write_h5<float, int64_t>(dir / "a.h5", x, y, t, p);
  EventFileOptions options;
  // In ns they lie before the exposures; in us, they last a thousand times as long.
  options.exposures = TimeWindow{2000000000, 2005000000};
  bool named = false;
  try {
    for (const std::string& line : read_events(dir / "a.h5", options).warnings)
      named = named || line.find(" ns") != std::string::npos;
  } catch (const jade::DataError& error) {
    named = std::string(error.what()).find(" ns") != std::string::npos;
  }
  CHECK(named);
  options.exposures = TimeWindow{20000000000, 20005000000};
  CHECK_THAT(message_of([&] { read_events(dir / "a.h5", options); }),
             jade::test::naming("if they are ns"));
  options.exposures = TimeWindow{0, 5000000};
  const EventFileResult good = read_events(dir / "a.h5", options);
  CHECK(good.time_unit == TimeUnit::kNs);
  CHECK(good.warnings.empty());
}

TEST_CASE("event files: an unusual unit that the exposures suggest is doubted", "[events]") {
  const TempDir dir;
  const auto read = [&](int64_t first_us, const TimeWindow& exposures) {
    std::vector<float> place(80000, 3);
    std::vector<int64_t> t;
    std::vector<int8_t> p;
    for (int64_t i = 0; i < 80000; ++i) t.push_back(first_us + 7 * i), p.push_back(int8_t(i % 2));
    write_h5<float, int64_t>(dir / "a.h5", place, place, t, p);
    return read_events(dir / "a.h5", {TimeUnit::kAuto, exposures});
  };
  CHECK(read(9, {0, 560000}).time_unit == TimeUnit::kUs);
  // Exposures in ms: in ns the events fit them, but come faster than a sensor sends them.
  CHECK_THAT(message_of([&] {
               read(9, {0, 560});
             }),
             jade::test::naming("a.h5", "100 million events per second", "read as ns",
                                "0 to 560 us", "in milliseconds?"));
  // A clock 5 s ahead: in ns the events fall into the exposures, a thousandth as long.
  CHECK_THAT(message_of([&] {
               read(5000000, {0, 560000});
             }),
             jade::test::naming("a.h5", "no likely unit", "if they are us", "--offset-ms"));
}
