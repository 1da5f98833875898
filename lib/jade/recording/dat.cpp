// SPDX-License-Identifier: Apache-2.0
// Prophesee's DAT files (docs.prophesee.ai, "DAT File Format"): lines of '%', two bytes with the
// type and the size of an event, then eight bytes each: 32 bits of time in µs and 32 of coordinates
// and polarity.
#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/text.h"
#include "jade/events/stream_faults.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr size_t kDatRecordBytes = 8;
constexpr size_t kDatRecordsAtOnce = size_t(1) << 18;
// Types of events.
constexpr int kDat2d = 0, kDatCd = 12;

struct DatHeader {
  int64_t width = 0, height = 0;  ///< 0: unknown
  int64_t version = 2;
  int64_t bytes = 0;  ///< before the first event
  int64_t records = 0;
  int64_t cut_bytes = 0;  ///< bytes of an incomplete event at the end of the file
};

DatHeader read_dat_header(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  DatHeader header;
  for (std::string line; file.peek() == '%' && std::getline(file, line);) {
    std::istringstream words(line);
    std::string percent, key;
    words >> percent >> key;
    key = in_small_letters(key);
    if (key == "width") words >> header.width;
    if (key == "height") words >> header.height;
    if (key == "version") words >> header.version;
  }
  const int type = file.get(), size = file.get();
  if (!file) {
    throw DataError(concat(path.string(),
                           ": expected events after the header of a Prophesee DAT "
                           "file, found its end; copy it again"));
  }
  if ((type != kDat2d && type != kDatCd) || size != int(kDatRecordBytes)) {
    throw DataError(concat(path.string(),
                           ": expected change-detection events (type 12, 8 bytes) "
                           "in a Prophesee DAT file, found type ",
                           type, " of ", size, " bytes; give the file of the CD events"));
  }
  header.bytes = int64_t(file.tellg());
  const int64_t left = int64_t(fs::file_size(path)) - header.bytes;
  header.records = left / int64_t(kDatRecordBytes);
  header.cut_bytes = left % int64_t(kDatRecordBytes);
  return header;
}

/// Calls `take` with the unwrapped time in µs and the other word of each event.
template <class Take>
void for_each_dat_event(const fs::path& path, const DatHeader& header, const Take& take) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(header.bytes);
  std::vector<std::array<uint32_t, 2>> records(kDatRecordsAtOnce);
  constexpr int64_t kHalf = int64_t(1) << 31;
  int64_t wrap_us = 0, last = -1;
  for (int64_t left = header.records; left > 0;) {
    throw_if_interrupted();
    const auto count = std::min<int64_t>(left, int64_t(kDatRecordsAtOnce));
    file.read(reinterpret_cast<char*>(records.data()), count * int64_t(kDatRecordBytes));
    if (!file) throw DataError(concat(path.string(), ": the file cannot be read to its end"));
    for (int64_t i = 0; i < count; ++i) {
      const int64_t t = records[size_t(i)][0];
      // A damaged time far ahead is one from before a wrap, so that the next is none after it.
      if (last - t > kHalf) wrap_us += 2 * kHalf;
      if (last >= 0 && t - last > kHalf) wrap_us -= 2 * kHalf;
      last = t;
      take(wrap_us + t, records[size_t(i)][1]);
    }
    left -= count;
  }
}

bool is_in(const Kept& kept, int64_t t_us) {
  return !kept || std::any_of(kept->begin(), kept->end(), [&](const events::TimeWindow& w) {
    return t_us >= w.begin_us && t_us < w.end_us;
  });
}

void read_dat_events(const fs::path& path, const DatHeader& header, const Kept& kept,
                     const ReadOptions& options, Recording& recording) {
  int64_t count = 0, latest_us = INT64_MIN, earliest_us = INT64_MAX;
  events::ClockOrder order;
  for_each_dat_event(path, header, [&](int64_t t_us, uint32_t) {
    order.add(t_us);
    latest_us = std::max(latest_us, t_us), earliest_us = std::min(earliest_us, t_us);
    count += is_in(kept, t_us);
  });
  if (options.most_events > 0) count = std::min(count, options.most_events);
  events::check_event_memory(path, count, options.event_bytes);
  torch::Tensor x = torch::empty({count}, torch::kFloat32), y = torch::empty_like(x);
  torch::Tensor t = torch::empty({count}, torch::kInt64);
  torch::Tensor p = torch::empty({count}, torch::kInt8);
  // Before version 2 coordinates had 9 and 8 bits, with the polarity in the next bit.
  const bool old = header.version < 2;
  int64_t at = 0;
  for_each_dat_event(
      path, header,
      [&, xs = x.data_ptr<float>(), ys = y.data_ptr<float>(), ts = t.data_ptr<int64_t>(),
       ps = p.data_ptr<int8_t>()](int64_t t_us, uint32_t word) {
        if (at == count || !is_in(kept, t_us)) return;
        xs[at] = float(old ? word & 0x1ff : word & 0x3fff);
        ys[at] = float(old ? word >> 9 & 0xff : word >> 14 & 0x3fff);
        ps[at] = (old ? word >> 17 & 1 : word >> 28 & 1) != 0 ? 1 : -1;
        ts[at++] = t_us;
      });
  if (!order.sorted()) recording.warnings.push_back(concat(path.string(), ": ", order.fault()));
  recording.events =
      order.sorted() ? events::EventStream(x, y, t, p) : events::sort_events(x, y, t, p);
  const events::TimeWindow span =
      header.records > 0 ? events::TimeWindow{earliest_us, latest_us + 1} : events::TimeWindow{};
  note_stored(header.records, span, options.most_events, recording);
}

}  // namespace

Contents read_dat(const fs::path& path, const ReadOptions& options) {
  const DatHeader header = read_dat_header(path);
  Contents out;
  out.recording.format = "Prophesee DAT";
  out.recording.width = header.width, out.recording.height = header.height;
  if (header.width == 0) {
    out.recording.notes.push_back(
        concat(path.string(), ": its header does not say the sensor's size"));
  }
  if (header.cut_bytes > 0) {
    out.recording.warnings.push_back(
        concat(path.string(), ": ", header.cut_bytes,
               " bytes at the end are no whole event and were skipped; "
               "the file was cut short"));
  }
  out.read_events = [path, header, options](const Wanted& wanted, Recording& to) {
    read_dat_events(path, header, wanted.kept, options, to);
  };
  return out;
}

}  // namespace jade::recording
