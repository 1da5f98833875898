// SPDX-License-Identifier: Apache-2.0
// HDF5 files of Metavision: records {x, y, p, t} in CD/events, {p, t, id} in EXT_TRIGGER/events.
#include <algorithm>
#include <map>
#include <sstream>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/events/stream_faults.h"
#include "jade/events/time_survey.h"
#include "jade/io/hdf5.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRecords = "CD/events";
constexpr const char* kTriggerRecords = "EXT_TRIGGER/events";
constexpr int64_t kRecordsAtOnce = int64_t(1) << 20;

template <class T>
torch::Tensor read_column(const io::Hdf5File& file, const char* field,
                          const std::vector<events::Stretch>& stretches, torch::ScalarType type) {
  int64_t length = 0;
  for (const events::Stretch& stretch : stretches) length += stretch.size();
  torch::Tensor out = torch::empty({length}, type);
  T* data = out.mutable_data_ptr<T>();
  for (const events::Stretch& stretch : stretches) {
    for (int64_t begin = stretch.begin; begin < stretch.end; begin += kRecordsAtOnce) {
      throw_if_interrupted();
      const int64_t count = std::min(kRecordsAtOnce, stretch.end - begin);
      file.read_field<T>(kRecords, field, begin, count, data);
      data += count;
    }
  }
  return out;
}

/// Stretches of the file that contain the events of the spans; the whole file if it is unsorted.
std::vector<events::Stretch> stretches_of(const events::TimeSurvey& survey, const Kept& kept,
                                          int64_t most) {
  std::vector<events::Stretch> found{{0, survey.count()}};
  if (kept && survey.sorted()) {
    found.clear();
    for (const events::TimeWindow& window : *kept)
      found.push_back(survey.between(double(window.begin_us), double(window.end_us)));
  }
  if (most > 0) events::shorten(found, most);
  return found;
}

void read_records(const fs::path& path, const Kept& kept, const ReadOptions& options,
                  Recording& recording) {
  const io::Hdf5File file(path);
  const events::TimeSurvey survey(file.length(kRecords),
                                  [&](int64_t begin, int64_t at_once, double* out) {
                                    file.read_field<double>(kRecords, "t", begin, at_once, out);
                                  });
  const auto stretches = stretches_of(survey, kept, options.most_events);
  int64_t count = 0;
  for (const events::Stretch& stretch : stretches) count += stretch.size();
  events::check_event_memory(path, count, options.event_bytes);
  const torch::Tensor x = read_column<float>(file, "x", stretches, torch::kFloat32);
  const torch::Tensor y = read_column<float>(file, "y", stretches, torch::kFloat32);
  const torch::Tensor t = read_column<int64_t>(file, "t", stretches, torch::kInt64);
  torch::Tensor p = read_column<int8_t>(file, "p", stretches, torch::kInt8);
  p = p.gt(0).to(torch::kInt8).mul(2).sub(1);
  if (!survey.sorted()) {
    events::ClockOrder order;
    const int64_t* const times = t.const_data_ptr<int64_t>();
    std::for_each(times, times + t.numel(), [&](int64_t time) { order.add(time); });
    if (!order.sorted()) recording.warnings.push_back(concat(path.string(), ": ", order.fault()));
  }
  recording.events =
      survey.sorted() ? events::EventStream(x, y, t, p) : events::sort_events(x, y, t, p);
  if (kept && !survey.sorted()) recording.events = events::only_in(*kept, recording.events);
  events::TimeWindow span;
  if (survey.count() > 0) span = {int64_t(survey.smallest()), int64_t(survey.largest()) + 1};
  note_stored(survey.count(), span, options.most_events, recording);
}

void read_triggers(const io::Hdf5File& file, Recording& recording) {
  if (!file.has(kTriggerRecords)) return;
  const int64_t count = file.length(kTriggerRecords);
  std::vector<int64_t> t(static_cast<size_t>(count)), p(t.size()), id(t.size());
  file.read_field<int64_t>(kTriggerRecords, "t", 0, count, t.data());
  file.read_field<int64_t>(kTriggerRecords, "p", 0, count, p.data());
  file.read_field<int64_t>(kTriggerRecords, "id", 0, count, id.data());
  std::map<int64_t, Triggers> channels;
  for (size_t i = 0; i < t.size(); ++i) {
    Triggers& edges = channels[id[i]];
    (p[i] > 0 ? edges.rising_us : edges.falling_us).push_back(t[i]);
  }
  choose_channel(file.path(), channels, recording);
}

}  // namespace

bool is_metavision(const fs::path& path, const std::string& group) {
  return (group.empty() || group == kRecords) && io::Hdf5File(path).has(kRecords);
}

Contents read_metavision(const fs::path& path, const ReadOptions& options) {
  const io::Hdf5File file(path);
  Contents out;
  Recording& recording = out.recording;
  recording.format = "Metavision HDF5";
  char by = 0;
  std::istringstream geometry(file.attribute("geometry"));
  if (!(geometry >> recording.width >> by >> recording.height))
    recording.width = recording.height = 0;
  read_triggers(file, recording);
  out.read_events = [path, options](const Wanted& wanted, Recording& to) {
    read_records(path, wanted.kept, options, to);
  };
  return out;
}

}  // namespace jade::recording
