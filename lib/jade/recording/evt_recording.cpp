// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <numeric>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/recording/contents.h"
#include "jade/recording/evt.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kEventsAtOnce = int64_t(1) << 18;

/// Decodes to the end, or until `take`, which receives each piece, returns false.
template <class F>
void decode_all(EvtDecoder& decoder, const std::string& title, F take) {
  Progress progress(title, 1000);
  EvtEvents events;
  int64_t shown = 0;
  while (decoder.next(kEventsAtOnce, events)) {
    throw_if_interrupted();
    if (!take(events)) break;
    const auto now = int64_t(1000 * decoder.progress());
    if (progress.step(now - shown)) progress.show();
    shown = now;
  }
}

/// Number of events per time span of about a millisecond.
class Histogram {
 public:
  void add(const EvtEvents& events) {
    // Neighbours in the file are nearly always in the same span.
    int64_t bin = 0, *count = nullptr;
    for (const int64_t t : events.t_us) {
      if (count == nullptr || t >> kShift != bin) bin = t >> kShift, count = &counts_[bin];
      ++*count;
    }
  }
  int64_t total() const {
    return std::accumulate(counts_.begin(), counts_.end(), int64_t(0),
                           [](int64_t sum, const auto& bin) { return sum + bin.second; });
  }
  /// From the first event to the last, to a millisecond.
  events::TimeWindow span_us() const {
    if (counts_.empty()) return {};
    return {counts_.begin()->first << kShift, (counts_.rbegin()->first + 1) << kShift};
  }
  /// Upper bound of the number of events in the windows.
  int64_t most_in(const std::vector<events::TimeWindow>& windows) const {
    int64_t sum = 0;
    for (const events::TimeWindow& window : windows) {
      for (auto bin = counts_.lower_bound(window.begin_us >> kShift);
           bin != counts_.end() && (bin->first << kShift) < window.end_us; ++bin) {
        sum += bin->second;
      }
    }
    return sum;
  }

 private:
  static constexpr int kShift = 10;
  std::map<int64_t, int64_t> counts_;
};

bool is_kept(const Kept& kept, int64_t t_us) {
  if (!kept) return true;
  const auto next =
      std::upper_bound(kept->begin(), kept->end(), t_us,
                       [](int64_t t, const events::TimeWindow& w) { return t < w.begin_us; });
  return next != kept->begin() && t_us < std::prev(next)->end_us;
}

void note_counts(const fs::path& path, const EvtDecoder& decoder, Recording& recording) {
  const auto warn = [&](int64_t count, const char* what) {
    if (count > 0) recording.warnings.push_back(concat(path.string(), ": ", count, what));
  };
  const EvtHeader& header = decoder.header();
  if (header.version != header.named_version) {
    recording.warnings.push_back(concat(path.string(), ": its header says ",
                                        word_of(header.named_version), ", its data are ",
                                        word_of(header.version), " and are read as such"));
  }
  const EvtCounts& c = decoder.counts();
  warn(c.outside, " events lie beside the sensor and were dropped; the file may be damaged");
  warn(c.before_time, " events stand before the first time stamp and were dropped");
  warn(c.unknown, " words are of no known type and were skipped; the file may be damaged");
  warn(c.astray, " times lie far from those around them; the file may be damaged");
  warn(c.cut_bytes, " bytes at the end are no whole word and were skipped; the file was cut short");
  warn(c.backwards, " times the clock went backwards; the events have been sorted");
  if (header.width == 0)
    recording.notes.push_back(concat(path.string(), ": its header does not say the sensor's size"));
}

/// Decodes the file again, into lists of at most `most` kept events.
events::EventStream kept_events(const fs::path& path, const Kept& kept, int64_t most) {
  torch::Tensor x = torch::empty({most}, torch::kFloat32), y = torch::empty_like(x);
  torch::Tensor t = torch::empty({most}, torch::kInt64);
  torch::Tensor polarity = torch::empty({most}, torch::kInt8);
  EvtDecoder decoder(path);
  int64_t at = 0;
  decode_all(decoder, "read events",
             [&, xs = x.data_ptr<float>(), ys = y.data_ptr<float>(), ts = t.data_ptr<int64_t>(),
              ps = polarity.data_ptr<int8_t>()](const EvtEvents& events) {
               for (size_t i = 0; i < events.size() && at < most; ++i) {
                 if (!is_kept(kept, events.t_us[i])) continue;
                 xs[at] = events.x[i], ys[at] = events.y[i];
                 ts[at] = events.t_us[i], ps[at] = events.polarity[i];
                 ++at;
               }
               return at < most;
             });
  const auto head = [&](const torch::Tensor& list) { return list.narrow(0, 0, at); };
  return decoder.counts().backwards > 0
             ? events::sort_events(head(x), head(y), head(t), head(polarity))
             : events::EventStream(head(x), head(y), head(t), head(polarity));
}

}  // namespace

ReadEvents events_of_evt(const fs::path& path, const ReadOptions& options, Recording& recording) {
  Histogram histogram;
  EvtDecoder decoder(path);
  decode_all(decoder, "count events", [&](const EvtEvents& events) {
    histogram.add(events);
    return true;
  });
  recording.width = decoder.header().width, recording.height = decoder.header().height;
  choose_channel(path, decoder.triggers(), recording);
  note_counts(path, decoder, recording);
  return [path, histogram, bytes = options.event_bytes, limit = options.most_events](
             const Wanted& wanted, Recording& out) {
    const Kept& kept = wanted.kept;
    const int64_t all = histogram.total();
    int64_t most = kept ? histogram.most_in(*kept) : all;
    if (limit > 0) most = std::min(most, limit);
    events::check_event_memory(path, most, bytes);
    out.events = kept_events(path, kept, most);
    note_stored(all, histogram.span_us(), limit, out);
  };
}

Contents read_evt(const fs::path& path, const ReadOptions& options) {
  Contents out;
  out.recording.format = concat("Prophesee ", word_of(EvtDecoder(path).header().version));
  out.read_events = events_of_evt(path, options, out.recording);
  return out;
}

}  // namespace jade::recording
