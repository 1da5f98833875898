// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/evt.h"

#include "support/catch.h"

#include <random>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/recording/recording.h"
#include "recording/evt_words.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using namespace jade::test;

namespace {

struct PlainEvent {
  int64_t t;
  int x, y, p;
};
bool operator==(const PlainEvent& a, const PlainEvent& b) {
  return a.t == b.t && a.x == b.x && a.y == b.y && a.p == b.p;
}
std::ostream& operator<<(std::ostream& out, const PlainEvent& e) {
  return out << "(" << e.t << " " << e.x << " " << e.y << " " << e.p << ")";
}

/// All events, decoded `at_once` at a time.
std::vector<PlainEvent> decoded(EvtDecoder& decoder, int64_t at_once = 1000) {
  std::vector<PlainEvent> out;
  EvtEvents events;
  while (decoder.next(at_once, events)) {
    for (size_t i = 0; i < events.size(); ++i)
      out.push_back({events.t_us[i], events.x[i], events.y[i], events.polarity[i]});
  }
  return out;
}

std::vector<PlainEvent> decoded(const std::filesystem::path& path, int64_t at_once = 1000) {
  EvtDecoder decoder(path);
  return decoded(decoder, at_once);
}

std::string message_of(const std::filesystem::path& path) {
  try {
    read_recording(path);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("evt: EVT 2.0 with times, both polarities and triggers", "[recording]") {
  const TempDir dir;
  std::string text = evt_header("2.0", "% geometry 640x480\n");
  text += bytes_of(evt2_event(5, 1, 1, true), 4);  // before any time
  for (const uint32_t word :
       {evt2_time(1000000), evt2_event(1000003, 639, 479, true), evt2_event(1000003, 0, 7, false),
        14U << 28, 15U << 28, evt2_trigger(1000010, true), evt2_time(1000064),
        evt2_trigger(1000070, false), evt2_event(1000127, 12, 34, true),
        evt2_event(1000127, 640, 3, true)}) {
    text += bytes_of(word, 4);
  }
  const auto path = dir.write("a.raw", text);
  const std::vector<PlainEvent> expected{
      {1000003, 639, 479, 1}, {1000003, 0, 7, -1}, {1000127, 12, 34, 1}};
  EvtDecoder decoder(path);
  CHECK(decoder.header().width == 640);
  CHECK(decoder.header().height == 480);
  CHECK(decoded(decoder) == expected);
  CHECK(decoder.triggers().at(3).rising_us == std::vector<int64_t>{1000010});
  CHECK(decoder.triggers().at(3).falling_us == std::vector<int64_t>{1000070});
  CHECK(decoder.counts().before_time == 1);
  CHECK(decoder.counts().outside == 1);
  CHECK(decoder.counts().unknown == 0);
  CHECK(decoder.progress() == 1);
  CHECK(decoded(path, 1) == expected);
}

TEST_CASE("evt: EVT 2.1 vectors in both orders of the word's halves", "[recording]") {
  const TempDir dir;
  for (const bool upper_first : {false, true}) {
    std::string text = evt_header("2.1", "% format EVT21;height=720;width=1280\n");
    text += evt21_word(evt2_time(640), 0, upper_first);
    text += evt21_word(evt2_event(645, 32, 5, true), 0x80000005U, upper_first);
    text += evt21_word(evt2_trigger(646, true), 0, upper_first);
    text += evt21_word(evt2_event(650, 1248, 6, false), 0x40000000U, upper_first);
    EvtDecoder decoder(dir.write("a.raw", text));
    CHECK(decoder.header().width == 1280);
    CHECK(decoded(decoder) ==
          std::vector<PlainEvent>{
              {645, 32, 5, 1}, {645, 34, 5, 1}, {645, 63, 5, 1}, {650, 1278, 6, -1}});
    CHECK(decoder.triggers().at(3).rising_us == std::vector<int64_t>{646});
  }
}

TEST_CASE("evt: EVT 3.0 single events, vectors of 12, 12 and 8, redundant times", "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 1280x720\n");
  text += evt3_word(0, 9) + evt3_word(2, 5);  // before any time
  text += evt3_time(4096 * 3 + 17);
  text += evt3_word(0, 100) + evt3_word(2, 0x800 | 7) + evt3_word(2, 8);
  text += evt3_word(8, 3);  // the same upper bits again change nothing
  text +=
      evt3_word(3, 0x800 | 640) + evt3_word(4, 0x801) + evt3_word(4, 0x002) + evt3_word(5, 0x80);
  text += evt3_word(10, 0x300 | 1) + evt3_word(14, 0) + evt3_word(7, 0) + evt3_word(15, 0);
  text += evt3_time(4096 * 4) + evt3_word(2, 9) + evt3_word(1, 0);
  const auto path = dir.write("a.raw", text);
  const int64_t t = 4096 * 3 + 17;
  const std::vector<PlainEvent> expected{{t, 7, 100, 1},        {t, 8, 100, -1},  {t, 640, 100, 1},
                                         {t, 651, 100, 1},      {t, 653, 100, 1}, {t, 671, 100, 1},
                                         {4096 * 4, 9, 100, -1}};
  EvtDecoder decoder(path);
  CHECK(decoded(decoder) == expected);
  CHECK(decoder.triggers().at(3).rising_us == std::vector<int64_t>{t});
  CHECK(decoder.counts().before_time == 1);
  CHECK(decoder.counts().unknown == 1);
  CHECK(decoded(path, 1) == expected);
}

TEST_CASE("evt: a damaged time far from its neighbours moves no later events", "[recording]") {
  const TempDir dir;
  std::string three = evt_header("3.0"), two = evt_header("2.0");
  for (const int64_t t : {1 << 12, 4095 << 12, 1 << 12, 2 << 12})
    three += evt3_time(t) + evt3_word(2, 1);
  for (const int64_t t : {int64_t(64), int64_t(1) << 33, (int64_t(1) << 33) + 128, int64_t(128)})
    two += bytes_of(evt2_time(t), 4) + bytes_of(evt2_event(t, 0, 0, true), 4);
  for (const auto& [text, last] :
       {std::pair{three, int64_t(2) << 12}, std::pair{two, int64_t(128)}}) {
    EvtDecoder decoder(dir.write("a.raw", text));
    CHECK(decoded(decoder).back().t == last);
  }
  const Recording read = read_recording(dir.write("three.raw", three));
  CHECK(read.events.size() == 4);
  std::string warnings;
  for (const std::string& line : read.warnings) warnings += line + "\n";
  CHECK_THAT(warnings, test::naming("1 times", "far from", "damaged"));
  std::string behind = evt_header("3.0");
  for (const int64_t t : {0xa00 << 12, 0xa01 << 12, 0x010 << 12, 0xa02 << 12, 0xa03 << 12})
    behind += evt3_time(t) + evt3_word(2, 1);
  EvtDecoder decoder(dir.write("behind.raw", behind));
  CHECK(decoded(decoder).back().t == int64_t(0xa03) << 12);
}

TEST_CASE("evt: up to four damaged times in a row move no later events", "[recording]") {
  const TempDir dir;
  for (const std::vector<int>& damaged :
       {std::vector<int>{0xfff, 0x100}, std::vector<int>{0x010, 0x800},
        std::vector<int>{0xf00, 0xf01, 0x001}, std::vector<int>{0xfff, 0x300, 0xe00, 0x080}}) {
    std::string text = evt_header("3.0");
    const auto add = [&](int high) { text += evt3_time(int64_t(high) << 12) + evt3_word(2, 1); };
    for (int high = 0x9f0; high <= 0xa01; ++high) add(high);
    for (const int high : damaged) add(high);
    for (const int high : {0xa02, 0xa03, 0xfff, 0x000}) add(high);
    EvtDecoder decoder(dir.write("a.raw", text));
    const std::vector<PlainEvent> events = decoded(decoder);
    CAPTURE(damaged.size(), damaged.front());
    REQUIRE(events.size() == damaged.size() + 22);
    CHECK(events[damaged.size() + 18].t == int64_t(0xa02) << 12);
    CHECK(events.back().t == int64_t(0x1000) << 12);
    CHECK(decoder.counts().astray > 0);
  }
  // scripts/ros_bag.py writes wraps that a silent sensor hides as half, largest time and 0.
  std::string text = evt_header("3.0");
  for (const int high : {4090, 2047, 4095, 0, 2047, 4095, 0, 2047, 4091})
    text += evt3_time(int64_t(high) << 12) + evt3_word(2, 1);
  EvtDecoder decoder(dir.write("a.raw", text));
  CHECK(decoded(decoder).back().t == int64_t(2 * 4096 + 4091) << 12);
  CHECK(decoder.counts().astray == 0);
}

TEST_CASE("evt: long pauses are no damaged times", "[recording]") {
  const TempDir dir;
  for (const int pause : {0x410, 0x560, 0x700}) {  // 4.3, 5.6 and 7.3 s of 16.8
    std::string text = evt_header("3.0");
    int64_t high = 0;
    for (int i = 0; i < 100; ++i, high += i % 3 == 0 ? 1 : pause)
      text += evt3_time((high & 0xfff) << 12) + evt3_word(2, 1);
    high -= 100 % 3 == 0 ? 1 : pause;
    EvtDecoder decoder(dir.write("a.raw", text));
    CAPTURE(pause);
    CHECK(decoded(decoder).back().t == high << 12);
    CHECK(decoder.counts().astray == 0);
  }
}

TEST_CASE("evt: data of another version than the header says are read as what they are",
          "[recording]") {
  const TempDir dir;
  std::string two, three, vectors;
  std::vector<PlainEvent> expected;
  for (int i = 0; i < 1000; ++i) {
    const int64_t t = 100 * int64_t(i);
    const int x = i * 7 % 640, y = i * 11 % 480;
    two += bytes_of(evt2_time(t), 4) + bytes_of(evt2_event(t, x, y, true), 4);
    three += evt3_time(t) + evt3_word(0, y) + evt3_word(2, 0x800 | x);
    vectors += evt21_word(evt2_time(t), 0, false) +
               evt21_word(evt2_event(t, x / 32 * 32, y, true), 1U << x % 32, false);
    expected.push_back({t, x, y, 1});
  }
  const std::vector<std::pair<std::string, std::string>> data{
      {"2.0", two}, {"2.1", vectors}, {"3.0", three}};
  for (const auto& [said, ignored] : data) {
    for (const auto& [meant, words] : data) {
      CAPTURE(said, meant);
      EvtDecoder decoder(dir.write("a.raw", evt_header(said) + words));
      CHECK((decoded(decoder) == expected));
    }
  }
  std::string warnings;
  for (const std::string& line :
       read_recording(dir.write("a.raw", evt_header("2.0") + three)).warnings)
    warnings += line + "\n";
  CHECK_THAT(warnings, test::naming("a.raw", "header says EVT2", "EVT3"));
}

TEST_CASE("evt: the time counter wraps, small steps back do not wrap it", "[recording]") {
  const TempDir dir;
  const int64_t range = int64_t(1) << 24;
  std::string text = evt_header("3.0");
  for (const int64_t t :
       {range - 5, int64_t(3), int64_t(5000), int64_t(4000), range / 2, range - 1, int64_t(0)})
    text += evt3_time(t) + evt3_word(2, 1);
  EvtDecoder decoder(dir.write("a.raw", text));
  std::vector<int64_t> times;
  for (const PlainEvent& event : decoded(decoder)) times.push_back(event.t);
  CHECK(times == std::vector<int64_t>{range - 5, range + 3, range + 5000, range + 4000,
                                      range + range / 2, 2 * range - 1, 2 * range});
  CHECK(decoder.counts().backwards == 1);

  const int64_t range2 = int64_t(1) << 34;
  std::string second = evt_header("2.0");
  for (const int64_t t : {range2 - 1, int64_t(2)})
    second += bytes_of(evt2_time(t), 4) + bytes_of(evt2_event(t, 0, 0, true), 4);
  const auto wrapped = decoded(dir.write("b.raw", second));
  REQUIRE(wrapped.size() == 2);
  CHECK(wrapped[1].t == range2 + 2);
}

TEST_CASE("evt: pieces across the decoder's buffer join to the whole", "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 1280x720\n");
  std::vector<PlainEvent> expected;
  for (int i = 0; i < 300000; ++i) {  // 10 bytes each: three buffers
    const int64_t t = 10 * int64_t(i);
    text += evt3_time(t) + evt3_word(0, i % 720) + evt3_word(3, i % 1200) + evt3_word(5, 0x81);
    expected.push_back({t, i % 1200, i % 720, -1});
    expected.push_back({t, i % 1200 + 7, i % 720, -1});
  }
  const auto path = dir.write("a.raw", text);
  CHECK((decoded(path, 1 << 18) == expected));
  CHECK((decoded(path, 7) == expected));
  EvtDecoder decoder(path);
  EvtEvents events;
  REQUIRE(decoder.next(7, events));
  CHECK(events.size() == 8);  // a vector is not split
}

TEST_CASE("evt: any bytes behind a header are decoded within the sensor", "[recording]") {
  const TempDir dir;
  std::mt19937 random(1);
  for (const char* version : {"2.0", "2.1", "3.0"}) {
    for (const char* size : {"", "% geometry 64x48\n"}) {
      std::string text = evt_header(version, size);
      for (int i = 0; i < 40001; ++i) text += char(random() & 0xff);
      EvtDecoder decoder(dir.write("a.raw", text));
      const bool known = decoder.header().width > 0;
      EvtEvents events;
      while (decoder.next(100, events)) {
        for (size_t i = 0; i < events.size(); ++i) {
          REQUIRE(events.x[i] < (known ? 64 : 2048));
          REQUIRE(events.y[i] < (known ? 48 : 2048));
        }
      }
      CHECK(decoder.counts().unknown > 0);
      CHECK(decoder.counts().cut_bytes == 1);
      CHECK(decoder.progress() > 0.999);
    }
  }
}

TEST_CASE("evt: a recording has the sensor, the events, the triggers and what is wrong",
          "[recording]") {
  const TempDir dir;
  std::string text = evt_header("3.0", "% geometry 640x480\n");
  text += evt3_time(100) + evt3_word(0, 1) + evt3_word(2, 0x800 | 2) + evt3_word(10, 1);
  text += evt3_word(10, 0x601);  // of another channel
  text += evt3_time(50) + evt3_word(2, 3) + evt3_word(2, 700) + evt3_word(10, 0) + "\x01";
  const Recording recording = read_recording(dir.write("a.raw", text));
  CHECK(recording.format == "Prophesee EVT3");
  CHECK(recording.width == 640);
  CHECK(recording.height == 480);
  CHECK(recording.events.t_us().equal(torch::tensor({50, 100}, torch::kInt64)));
  CHECK(recording.events.x().equal(torch::tensor({3.F, 2.F})));
  CHECK(recording.triggers.rising_us == std::vector<int64_t>{100});
  std::string notes;
  for (const auto* const lines : {&recording.notes, &recording.warnings}) {
    for (const std::string& line : *lines) notes += line + "\n";
  }
  for (const char* part : {"1 events lie beside the sensor", "1 bytes at the end are no whole word",
                           "1 times the clock went backwards",
                           "1 trigger edges of channel 6 are left out", "there are no frames"}) {
    CHECK_THAT(notes, Catch::Contains(part));
  }
  ReadOptions options;
  options.window = events::TimeWindow{60, 200};
  const Recording part = read_recording(dir / "a.raw", options);
  CHECK(part.events.size() == 1);
  CHECK(part.triggers.falling_us.empty());
}

TEST_CASE("evt: headers of other kinds are refused in one line", "[recording]") {
  const TempDir dir;
  CHECK_THAT(message_of(dir.write("a.raw", "% evt 4.0\n% end\n....")),
             test::naming("EVT2, EVT2.1 or EVT3", "4.0"));
  CHECK_THAT(message_of(dir.write("b.raw", "% format HISTO3D;height=320;width=320\n% end\n")),
             test::naming("HISTO3D"));
  CHECK_THAT(message_of(dir.write("c.raw", "% Date today\n")), Catch::Contains("found none"));
  CHECK_THAT(message_of(dir.write("d.raw", "% evt 3.0\n% geometry -5x9\n% end\n")),
             test::naming("-5x9"));
  const Recording empty = read_recording(dir.write("e.raw", evt_header("3.0")));
  CHECK(empty.events.empty());
}
