// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
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

/// Decodes to the end; `take` gets each piece.
template <class F>
void decode_all(EvtDecoder& decoder, const std::string& title, F take) {
  Progress progress(title, 1000);
  EvtEvents events;
  int64_t shown = 0;
  while (decoder.next(kEventsAtOnce, events)) {
    throw_if_interrupted();
    take(events);
    const auto now = int64_t(1000 * decoder.progress());
    if (progress.step(now - shown)) progress.show();
    shown = now;
  }
}

struct Kept {
  events::TimeWindow window;
  bool contains(int64_t t_us) const { return window.begin_us <= t_us && t_us < window.end_us; }
};

int64_t count_kept(const fs::path& path, const Kept& kept) {
  EvtDecoder decoder(path);
  int64_t count = 0;
  decode_all(decoder, "count events", [&](const EvtEvents& events) {
    count += std::count_if(events.t_us.begin(), events.t_us.end(),
                           [&](int64_t t) { return kept.contains(t); });
  });
  return count;
}

void note_counts(const fs::path& path, const EvtDecoder& decoder, Recording& recording) {
  const auto note = [&](int64_t count, const char* what) {
    if (count > 0) recording.notes.push_back(concat(path.string(), ": ", count, what));
  };
  const EvtCounts& c = decoder.counts();
  note(c.outside, " events lie beside the sensor and were dropped; the file may be damaged");
  note(c.before_time, " events stand before the first time stamp and were dropped");
  note(c.unknown, " words are of no known type and were skipped; the file may be damaged");
  note(c.cut_bytes, " bytes at the end are no whole word and were skipped; the file was cut short");
  note(c.backwards, " times the clock went backwards; the events have been sorted");
  if (decoder.header().width == 0)
    recording.notes.push_back(concat(path.string(), ": its header does not say the sensor's size"));
}

}  // namespace

Contents read_evt(const fs::path& path, const ReadOptions& options) {
  const Kept kept{options.window.value_or(events::TimeWindow{INT64_MIN, INT64_MAX})};
  const int64_t count = count_kept(path, kept);
  check_event_memory(path, count);
  torch::Tensor x = torch::empty({count}, torch::kFloat32), y = torch::empty_like(x);
  torch::Tensor t = torch::empty({count}, torch::kInt64);
  torch::Tensor polarity = torch::empty({count}, torch::kInt8);
  EvtDecoder decoder(path);
  int64_t at = 0;
  decode_all(decoder, "read events",
             [&, xs = x.data_ptr<float>(), ys = y.data_ptr<float>(), ts = t.data_ptr<int64_t>(),
              ps = polarity.data_ptr<int8_t>()](const EvtEvents& events) {
               for (size_t i = 0; i < events.size(); ++i) {
                 if (!kept.contains(events.t_us[i]) || at == count) continue;
                 xs[at] = events.x[i], ys[at] = events.y[i];
                 ts[at] = events.t_us[i], ps[at] = events.polarity[i];
                 ++at;
               }
             });
  if (at != count)
    throw DataError(concat(path.string(), ": changed while it was read; read it again"));
  Contents out;
  Recording& recording = out.recording;
  recording.format = concat("Prophesee ", word_of(decoder.header().version));
  recording.width = decoder.header().width, recording.height = decoder.header().height;
  recording.events = decoder.counts().backwards > 0 ? events::sort_events(x, y, t, polarity)
                                                    : events::EventStream(x, y, t, polarity);
  recording.triggers = decoder.triggers();
  for (auto* edges : {&recording.triggers.rising_us, &recording.triggers.falling_us})
    std::sort(edges->begin(), edges->end());
  note_counts(path, decoder, recording);
  return out;
}

}  // namespace jade::recording
