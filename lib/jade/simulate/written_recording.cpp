// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>
#include <string>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/recording/rpg_writer.h"
#include "jade/simulate/simulator.h"

namespace jade::simulate {
namespace {

/// File name that write() gives a frame: exposures first, then test views.
std::string name_of(size_t index, size_t count) {
  const std::string name = std::to_string(index);
  const size_t width = std::max<size_t>(2, std::to_string(count - 1).size());
  return std::string(width - name.size(), '0') + name;
}

/// A sensor can expose only one frame at a time.
bool is_exposing(const recording::Recording& written, int64_t t_us) {
  return std::any_of(written.frames.begin(), written.frames.end(), [&](const auto& frame) {
    return frame.t_start_us <= t_us && t_us < frame.t_end_us;
  });
}

std::string gain_list(const SimulateResult& result, size_t count) {
  std::string list = "name,gain\n";
  const auto& exposures = result.content.train;
  for (size_t i = 0; i < exposures.size(); ++i) {
    list += concat(name_of(i, count), ",", exposures[i].gain, "\n");
  }
  for (size_t i = 0; i < result.recorded_views.size(); ++i) {
    list += concat(name_of(exposures.size() + i, count), ",", result.recorded_views[i].gain, "\n");
  }
  return list;
}

}  // namespace

void write_recording(const SimulateResult& result, const SimulateRun& run,
                     const std::filesystem::path& folder) {
  const data::EvDeblurContent& content = result.content;
  const size_t count = content.train.size() + content.test.size();
  recording::Recording written;
  written.events = content.events;
  for (size_t i = 0; i < content.train.size(); ++i) {
    const data::Exposure& exposure = content.train[i];
    written.frames.push_back(
        {name_of(i, count), exposure.blurry, exposure.t_start_us, exposure.t_end_us});
  }
  const bool timed = run.simulate.recording.exposure_times;
  for (size_t i = 0; timed && i < result.recorded_views.size(); ++i) {
    const data::SharpView& view = result.recorded_views[i];
    if (is_exposing(written, view.t_us)) continue;
    written.frames.push_back(
        {name_of(content.train.size() + i, count), view.image, view.t_us, view.t_us + 1});
  }
  std::sort(written.frames.begin(), written.frames.end(),
            [](const auto& a, const auto& b) { return a.t_start_us < b.t_start_us; });
  const geometry::Intrinsics& camera = content.train.front().camera;
  if (const auto& events = result.event_camera) {
    recording::write_rpg(folder, written, std::nullopt, timed);
    recording::write_camchain(folder, {camera, events->camera, events->from_frames});
  } else {
    recording::write_rpg(folder, written, camera, timed);
  }
  write(result, run, folder / "truth");
  if (run.simulate.image.auto_exposure > 0) {
    write_file(folder / "truth" / "gains.csv", gain_list(result, count));
  }
}

}  // namespace jade::simulate
