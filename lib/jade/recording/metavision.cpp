// SPDX-License-Identifier: Apache-2.0
// HDF5 files of Metavision: records {x, y, p, t} in CD/events, {p, t, id} in EXT_TRIGGER/events.
#include <algorithm>
#include <sstream>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/io/hdf5.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRecords = "CD/events";
constexpr const char* kTriggerRecords = "EXT_TRIGGER/events";
constexpr int64_t kRecordsAtOnce = int64_t(1) << 20;

template <class T>
void read_column(const io::Hdf5File& file, const char* field, torch::Tensor& out) {
  T* data = out.mutable_data_ptr<T>();
  for (int64_t begin = 0; begin < out.numel(); begin += kRecordsAtOnce) {
    throw_if_interrupted();
    const int64_t count = std::min(kRecordsAtOnce, out.numel() - begin);
    file.read_field<T>(kRecords, field, begin, count, data + begin);
  }
}

void read_triggers(const io::Hdf5File& file, Triggers& triggers) {
  if (!file.has(kTriggerRecords)) return;
  const int64_t count = file.length(kTriggerRecords);
  std::vector<int64_t> t(static_cast<size_t>(count)), p(t.size());
  file.read_field<int64_t>(kTriggerRecords, "t", 0, count, t.data());
  file.read_field<int64_t>(kTriggerRecords, "p", 0, count, p.data());
  for (size_t i = 0; i < t.size(); ++i)
    (p[i] > 0 ? triggers.rising_us : triggers.falling_us).push_back(t[i]);
  std::sort(triggers.rising_us.begin(), triggers.rising_us.end());
  std::sort(triggers.falling_us.begin(), triggers.falling_us.end());
}

}  // namespace

bool is_metavision(const fs::path& path) { return io::Hdf5File(path).has(kRecords); }

Contents read_metavision(const fs::path& path) {
  const io::Hdf5File file(path);
  Contents out;
  Recording& recording = out.recording;
  recording.format = "Metavision HDF5";
  char by = 0;
  std::istringstream geometry(file.attribute("geometry"));
  if (!(geometry >> recording.width >> by >> recording.height))
    recording.width = recording.height = 0;
  const int64_t count = file.length(kRecords);
  check_event_memory(path, count);
  torch::Tensor x = torch::empty({count}, torch::kFloat32), y = torch::empty_like(x);
  torch::Tensor t = torch::empty({count}, torch::kInt64), p = torch::empty({count}, torch::kInt8);
  read_column<float>(file, "x", x);
  read_column<float>(file, "y", y);
  read_column<int64_t>(file, "t", t);
  read_column<int8_t>(file, "p", p);
  p = p.gt(0).to(torch::kInt8).mul(2).sub(1);
  const bool sorted = count < 2 || t.diff().ge(0).all().item<bool>();
  if (!sorted) {
    recording.notes.push_back(
        concat(path.string(), ": event times were not in order; they have been sorted"));
  }
  recording.events = sorted ? events::EventStream(x, y, t, p) : events::sort_events(x, y, t, p);
  read_triggers(file, recording.triggers);
  return out;
}

}  // namespace jade::recording
