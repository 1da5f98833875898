// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <string>

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

/// One sensor exposes one frame at a time.
bool is_exposing(const recording::Recording& written, int64_t t_us) {
  return std::any_of(written.frames.begin(), written.frames.end(), [&](const auto& frame) {
    return frame.t_start_us <= t_us && t_us < frame.t_end_us;
  });
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
  for (size_t i = 0; i < content.test.size(); ++i) {
    const data::SharpView& view = content.test[i];
    if (is_exposing(written, view.t_us)) continue;
    written.frames.push_back(
        {name_of(content.train.size() + i, count), view.image, view.t_us, view.t_us + 1});
  }
  std::sort(written.frames.begin(), written.frames.end(),
            [](const auto& a, const auto& b) { return a.t_start_us < b.t_start_us; });
  const geometry::Intrinsics& camera = content.train.front().camera;
  if (const auto& events = result.event_camera) {
    recording::write_rpg(folder, written);
    recording::write_camchain(folder, {camera, events->camera, events->from_frames});
  } else {
    recording::write_rpg(folder, written, camera);
  }
  write(result, run, folder / "truth");
}

}  // namespace jade::simulate
