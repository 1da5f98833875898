// SPDX-License-Identifier: Apache-2.0
#include "jade/io/ecf.h"

#include "support/catch.h"

#include <algorithm>
#include <hdf5.h>
#include <random>

#include "jade/core/error.h"
#include "jade/io/hdf5.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::io {
namespace {

enum class Mode { kRuns, kPackedColumns, kPacked };

class Encoder {
 public:
  std::vector<uint8_t> bytes;

  void number(uint64_t value, int size) {
    for (int i = 0; i < size; ++i) bytes.push_back(uint8_t(value >> (8 * i)));
  }
  void times(const std::vector<EcfEvent>& events) {
    number(uint64_t(events[0].t), 8);
    int64_t t = events[0].t;
    for (size_t i = 0; i < events.size();) {
      const size_t count = run(events, i, [](const EcfEvent& e) { return e.t; });
      uint64_t step = uint64_t(events[i].t - t);
      if (step >= 15) {
        for (; step > 0; step >>= 4) bytes.push_back(uint8_t(0xf0 | (step & 15)));
      }
      bytes.push_back(uint8_t(step << 4 | std::min<size_t>(count, 15)));
      if (count >= 15) number(count, 2);
      t = events[i].t;
      i += count;
    }
  }
  void rows(const std::vector<EcfEvent>& events) {
    for (size_t i = 0; i < events.size();) {
      const size_t count = run(events, i, [](const EcfEvent& e) { return e.y; });
      number(uint64_t(events[i].y) << 5 | std::min<size_t>(count, 31), 2);
      if (count >= 31) number(count, 2);
      i += count;
    }
  }
  void columns(const std::vector<EcfEvent>& events) {
    for (size_t i = 0; i < events.size();) {
      const uint16_t x = events[i++].x;
      uint64_t mask = 0;
      for (uint16_t further = 1; further <= 5; ++further) {
        if (i < events.size() && events[i].x == x + further) {
          mask |= uint64_t(1) << (5 - further);
          ++i;
        }
      }
      number(uint64_t(x) << 5 | mask, 2);
    }
  }
  void polarities(const std::vector<EcfEvent>& events) {
    for (size_t i = 0; i < events.size();) {
      const size_t count = run(events, i, [](const EcfEvent& e) { return e.p; });
      bytes.push_back(uint8_t(events[i].p << 7 | int(std::min<size_t>(count, 127))));
      if (count >= 127) number(count, 2);
      i += count;
    }
  }
  void packed(const std::vector<EcfEvent>& events, bool rows) {
    const int size = rows ? 4 : 2, part = 2 * size;
    for (size_t i = 0; i < events.size(); i += 4) {
      uint64_t v[4] = {};
      for (size_t j = 0; j < 4 && i + j < events.size(); ++j) {
        const EcfEvent& e = events[i + j];
        v[j] = uint64_t(rows ? e.y : 0) << 12 | uint64_t(e.x) << 1 | uint64_t(e.p);
      }
      const auto low = [&](uint64_t value, int parts) {
        return value & ((uint64_t(1) << (parts * part)) - 1);
      };
      number(v[0] << part | low(v[1], 1), size);
      number(v[1] >> part << (2 * part) | low(v[2], 2), size);
      number(v[2] >> (2 * part) << (3 * part) | low(v[3], 3), size);
    }
  }

 private:
  template <class Get>
  static size_t run(const std::vector<EcfEvent>& events, size_t begin, Get get) {
    size_t end = begin + 1;
    while (end < events.size() && get(events[end]) == get(events[begin])) ++end;
    return end - begin;
  }
};

std::vector<uint8_t> encode(const std::vector<EcfEvent>& events, Mode mode) {
  Encoder out;
  out.number(events.size() << 2 | (mode == Mode::kPacked ? 2 : mode == Mode::kPackedColumns), 4);
  out.times(events);
  if (mode == Mode::kPacked) {
    out.packed(events, true);
  } else {
    out.rows(events);
    if (mode == Mode::kPackedColumns) {
      out.packed(events, false);
    } else {
      out.columns(events);
      out.polarities(events);
    }
  }
  return out.bytes;
}

/// Runs of equal times, rows and polarities of all lengths, and steps of all sizes.
std::vector<EcfEvent> drawn(size_t count) {
  std::mt19937 random(3);
  const auto draw = [&](int below) {
    return std::uniform_int_distribution<int>(0, below - 1)(random);
  };
  std::vector<EcfEvent> events(count);
  EcfEvent e;
  e.t = (int64_t(1) << 40) + 7;
  for (EcfEvent& out : events) {
    if (draw(40) == 0) e.t += draw(3) == 0 ? draw(1 << 20) : draw(20);
    if (draw(50) == 0) e.y = uint16_t(draw(2048));
    if (draw(200) == 0) e.p = int16_t(draw(2));
    e.x = draw(3) == 0 || e.x > 2000 ? uint16_t(draw(2000)) : uint16_t(e.x + draw(7));
    out = e;
  }
  return events;
}

bool same(const std::vector<EcfEvent>& a, const std::vector<EcfEvent>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& l, const auto& r) {
    return l.x == r.x && l.y == r.y && l.p == r.p && l.t == r.t;
  });
}

TEST_CASE("ecf: the bytes of an event, as the format has them", "[io]") {
  // One event, column 1 and row 2, darker, at 4 µs.
  const std::vector<uint8_t> bytes{6, 0, 0,    0, 4, 0, 0, 0, 0, 0, 0, 0, 0x01,
                                   0, 2, 0x20, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  std::vector<EcfEvent> out;
  REQUIRE(decode_ecf(bytes.data(), bytes.size(), out));
  CHECK(same(out, {{1, 2, 0, 4}}));
}

TEST_CASE("ecf: events of all three layouts are restored, truncated chunks are rejected", "[io]") {
  for (const Mode mode : {Mode::kRuns, Mode::kPackedColumns, Mode::kPacked}) {
    for (const size_t count : {1, 2, 3, 4, 5, 1000, 65535}) {
      INFO(int(mode) << " " << count);
      const std::vector<EcfEvent> events = drawn(count);
      const std::vector<uint8_t> bytes = encode(events, mode);
      std::vector<EcfEvent> out;
      CHECK(decode_ecf(bytes.data(), bytes.size(), out));
      CHECK(same(out, events));
    }
    const std::vector<uint8_t> bytes = encode(drawn(300), mode);
    size_t accepted = 0;
    for (size_t size = 0; size < bytes.size(); ++size) {
      const std::vector<uint8_t> cut(bytes.begin(), bytes.begin() + std::ptrdiff_t(size));
      std::vector<EcfEvent> out;
      accepted += decode_ecf(cut.data(), cut.size(), out);
    }
    CHECK(accepted == 0);
  }
}

TEST_CASE("ecf: counts beyond the events and beyond a chunk are refused", "[io]") {
  std::vector<EcfEvent> out;
  std::vector<uint8_t> bytes = encode(drawn(4), Mode::kRuns);
  bytes[0] = 3 << 2;  // one event less than its times say
  bytes[12] = 0x04;
  CHECK_FALSE(decode_ecf(bytes.data(), bytes.size(), out));
  bytes = encode(drawn(4), Mode::kPacked);
  bytes[2] = 4;  // 65540 events
  CHECK_FALSE(decode_ecf(bytes.data(), bytes.size(), out));
}

struct TestFile {
  hid_t file, type, dataset;

  TestFile(const std::filesystem::path& path, hsize_t count, hsize_t chunk, hid_t wanted = -1)
      : file(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)),
        type(wanted >= 0 ? wanted : H5Tcreate(H5T_COMPOUND, sizeof(EcfEvent))) {
    if (wanted < 0) {
      H5Tinsert(type, "x", offsetof(EcfEvent, x), H5T_NATIVE_UINT16);
      H5Tinsert(type, "y", offsetof(EcfEvent, y), H5T_NATIVE_UINT16);
      H5Tinsert(type, "p", offsetof(EcfEvent, p), H5T_NATIVE_INT16);
      H5Tinsert(type, "t", offsetof(EcfEvent, t), H5T_NATIVE_INT64);
    }
    const hid_t space = H5Screate_simple(1, &count, nullptr);
    const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(properties, 1, &chunk);
    // HDF5 creates no data set for a filter that can only read.
    if (H5Zfilter_avail(kEcfFilter) > 0) H5Zunregister(kEcfFilter);
    H5Pset_filter(properties, kEcfFilter, H5Z_FLAG_OPTIONAL, 0, nullptr);
    dataset = H5Dcreate2(file, "events", type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
    H5Pclose(properties);
    H5Sclose(space);
  }
  void chunk(hsize_t at, const std::vector<uint8_t>& bytes) const {
    H5Dwrite_chunk(dataset, H5P_DEFAULT, 0, &at, bytes.size(), bytes.data());
  }
  void close() const {
    H5Dclose(dataset);
    H5Fclose(file);
  }
};

TEST_CASE("ecf: a data set of several chunks is read, over their borders and in its last part",
          "[io]") {
  const test::TempDir folder;
  const std::vector<EcfEvent> events = drawn(2500);
  const TestFile file(folder / "a.h5", 2500, 1000);
  for (size_t at = 0; at < 2500; at += 1000) {
    const size_t end = std::min<size_t>(at + 1000, 2500);
    file.chunk(at,
               encode({events.begin() + std::ptrdiff_t(at), events.begin() + std::ptrdiff_t(end)},
                      at == 1000 ? Mode::kPacked : Mode::kRuns));
  }
  file.close();
  const Hdf5File read(folder / "a.h5");
  std::vector<int64_t> t(1700), x(1700);
  read.read_field("events", "t", 800, 1700, t.data());
  read.read_field("events", "x", 800, 1700, x.data());
  int64_t wrong = 0;
  for (size_t i = 0; i < 1700; ++i) wrong += t[i] != events[800 + i].t || x[i] != events[800 + i].x;
  CHECK(wrong == 0);
}

TEST_CASE("ecf: damaged chunks and data sets that cannot be such are one line", "[io]") {
  const test::TempDir folder;
  const TestFile damaged(folder / "a.h5", 100, 100);
  std::vector<uint8_t> bytes = encode(drawn(100), Mode::kRuns);
  bytes.resize(bytes.size() / 2);
  damaged.chunk(0, bytes);
  damaged.close();
  int64_t value = 0;
  CHECK_THROWS_NAMING(DataError, Hdf5File(folder / "a.h5").read_field("events", "t", 0, 1, &value),
                      "'events'", "damaged");

  const TestFile large(folder / "b.h5", 70000, 70000);
  large.chunk(0, encode(drawn(100), Mode::kRuns));
  large.close();
  CHECK_THROWS_WITH(Hdf5File(folder / "b.h5").read_field("events", "t", 0, 1, &value),
                    test::naming("16 bytes", "65535") && test::naming("70000"));

  const TestFile other(folder / "c.h5", 100, 100, H5Tcopy(H5T_NATIVE_INT64));
  other.chunk(0, encode(drawn(100), Mode::kRuns));
  other.close();
  CHECK_THROWS_NAMING(DataError, Hdf5File(folder / "c.h5").read("events", 0, 1, &value), "8 bytes",
                      "100");
}

}  // namespace
}  // namespace jade::io
