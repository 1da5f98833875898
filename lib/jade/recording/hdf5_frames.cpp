// SPDX-License-Identifier: Apache-2.0
// Frames beside the events in HDF5:
//   MVSEC   davis/left/image_raw [N,H,W] and their times image_raw_ts
//   Monash  images/image000000000 [H,W], [H,W,C] or [C,H,W] with the attributes timestamp, type and
//           perhaps exposure_start and exposure_end, as event_utils, HQF, EFNet and HighREV have
//           them
#include <algorithm>
#include <cstdio>
#include <map>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/text.h"
#include "jade/events/event_files.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/recording/contents.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kLeastSide = 16;  // of a picture, in px

/// Pictures and the list of their times.
struct StoredFrames {
  std::string name, times;
};

std::string folder_of(const std::string& name) {
  const auto slash = name.rfind('/');
  return slash == std::string::npos ? "" : name.substr(0, slash);
}

/// Whether values are those of pictures that are read: integers of 8 or 16 bits. Depth in whole
/// millimetres has 16 bits too.
bool has_pixels(const io::Hdf5Dataset& dataset) {
  const std::string name = in_small_letters(fs::path(dataset.name).filename().string());
  const bool is_map =
      name.find("depth") != std::string::npos || name.find("disparity") != std::string::npos;
  return dataset.integer && (dataset.item_size == 1 || (dataset.item_size == 2 && !is_map));
}

/// Whether it is [N,H,W], or [N,H,W,C] of one or three channels, of at least 16x16 px.
bool is_pictures(const io::Hdf5Dataset& dataset) {
  const auto& shape = dataset.shape;
  if (shape.size() < 3 || shape.size() > 4) return false;
  const bool channels = shape.size() == 3 || shape[3] == 1 || shape[3] == 3;
  return channels && shape[0] > 0 && shape[1] >= kLeastSide && shape[2] >= kLeastSide;
}

/// All pictures of a file with one time each, those of 8 bits first.
/// @param passed  receives those of other values than pixels
std::vector<StoredFrames> find_frames(const io::Hdf5File& file,
                                      std::vector<io::Hdf5Dataset>& passed) {
  std::vector<StoredFrames> out;
  for (const auto& dataset : file.datasets()) {
    if (!is_pictures(dataset)) continue;
    const std::string folder = folder_of(dataset.name), above = folder_of(folder);
    for (const std::string& times : {dataset.name + "_ts", folder + "/ts", above + "/ts"}) {
      if (!file.has(times) || file.dataset(times).shape.size() != 1 ||
          file.length(times) != dataset.shape[0])
        continue;
      if (has_pixels(dataset)) {
        out.push_back({dataset.name, times});
      } else {
        passed.push_back(dataset);
      }
      break;
    }
  }
  std::stable_partition(out.begin(), out.end(), [&](const StoredFrames& frames) {
    return file.dataset(frames.name).item_size == 1;
  });
  return out;
}

std::vector<int64_t> read_times_us(const io::Hdf5File& file, const std::string& name,
                                   events::TimeUnit unit) {
  const int64_t count = file.length(name);
  const bool floating = file.dataset(name).floating;
  torch::Tensor times = torch::empty({count}, floating ? torch::kFloat64 : torch::kInt64);
  if (floating) {
    file.read<double>(name, 0, count, times.data_ptr<double>());
  } else {
    file.read<int64_t>(name, 0, count, times.data_ptr<int64_t>());
  }
  const std::string where = concat(file.path().string(), ": ", name);
  if (unit == events::TimeUnit::kAuto)
    unit = events::guess_exposure_unit(times, times, where, "give the unit");
  return events::times_us(times, unit, where);
}

/// Bits per value in a file of the picture.
int bits_of(const io::Hdf5Dataset& dataset) { return dataset.item_size == 1 ? 8 : 16; }

/// Values of a picture, in [0,1], with the data set's largest possible value as white.
torch::Tensor scaled(const io::Hdf5Dataset& dataset, std::vector<uint16_t>& values,
                     torch::IntArrayRef shape) {
  // LibTorch supports few operations on unsigned types.
  const torch::Tensor pixels = torch::from_blob(values.data(), shape, torch::kInt16)
                                   .to(torch::kInt32)
                                   .bitwise_and(UINT16_MAX);
  return pixels.to(torch::kFloat32).div(bits_of(dataset) == 8 ? UINT8_MAX : UINT16_MAX);
}

/// [1,H,W] or [3,H,W] in [0,1].
torch::Tensor read_picture(const io::Hdf5File& file, const io::Hdf5Dataset& dataset,
                           int64_t index) {
  const int64_t channels = dataset.shape.size() == 4 ? dataset.shape[3] : 1;
  std::vector<uint16_t> values(size_t(dataset.shape[1] * dataset.shape[2] * channels));
  file.read_item(dataset.name, index, values.data());
  return scaled(dataset, values, {dataset.shape[1], dataset.shape[2], channels})
      .permute({2, 0, 1})
      .contiguous();
}

/// Whether the options keep a frame; others are not decoded. Always keeps the first frame, because
/// `since_first` is later applied relative to it.
bool is_wanted(const ReadOptions& options, int64_t first_us, int64_t t_us) {
  const auto inside = [](const events::TimeWindow& w, int64_t t) {
    return t >= w.begin_us && t <= w.end_us;
  };
  if (options.since_first_frame) {
    return t_us == first_us || inside(*options.since_first_frame, t_us - first_us);
  }
  return !options.window || inside(*options.window, t_us);
}

/// One picture per data set, by group.
using PictureGroups = std::map<std::string, std::vector<io::Hdf5Dataset>>;

/// [H,W], [H,W,C] or [C,H,W]: the axis of the channels, one or three; no value for other data.
std::optional<size_t> channel_axis(const io::Hdf5Dataset& dataset) {
  const auto& shape = dataset.shape;
  if (shape.size() < 2 || shape.size() > 3) return std::nullopt;
  const auto sides = [&](size_t row, size_t column) {
    return shape[row] >= kLeastSide && shape[column] >= kLeastSide;
  };
  if (shape.size() == 2) return sides(0, 1) ? std::optional<size_t>(2) : std::nullopt;
  const auto is_channels = [&](size_t axis) { return shape[axis] == 1 || shape[axis] == 3; };
  if (is_channels(2) && sides(0, 1)) return 2;
  if (is_channels(0) && sides(1, 2)) return 0;
  return std::nullopt;
}

/// @param passed  receives those of other values than pixels
PictureGroups find_single_pictures(const io::Hdf5File& file, std::vector<io::Hdf5Dataset>& passed) {
  PictureGroups out;
  for (const auto& dataset : file.datasets()) {
    if (!channel_axis(dataset) || !file.number(dataset.name, "timestamp")) continue;
    (has_pixels(dataset) ? out[folder_of(dataset.name)] : passed).push_back(dataset);
  }
  return out;
}

/// Says which data sets with the shape and times of frames are not read: a warning if there are no
/// frames, else a note, as depth maps lie beside frames.
void report_passed(const std::vector<io::Hdf5Dataset>& passed, const fs::path& path,
                   Contents& contents) {
  if (passed.empty()) return;
  const io::Hdf5Dataset& first = passed.front();
  const std::string others =
      passed.size() == 1 ? "" : concat(" (and ", passed.size() - 1, " more like it)");
  auto& lines = contents.files.empty() ? contents.recording.warnings : contents.recording.notes;
  lines.push_back(
      concat(path.string(), ": ", first.name, others,
             " is not read as frames: expected integers of 8 or 16 bits that are no depth, found ",
             first.floating ? "floats" : "values", " of ", 8 * first.item_size,
             " bits; if these are the frames, convert them, or give images with ", "--frames DIR"));
}

/// [1,H,W] or [3,H,W] in [0,1], with colours as RGB.
torch::Tensor read_single_picture(const io::Hdf5File& file, const io::Hdf5Dataset& dataset) {
  std::vector<uint16_t> values = file.read_pixels(dataset.name);
  torch::Tensor picture = scaled(dataset, values, dataset.shape);
  if (picture.dim() == 2) picture = picture.unsqueeze(0);
  if (dataset.shape.size() == 3 && channel_axis(dataset) == size_t(2))
    picture = picture.permute({2, 0, 1});
  if (file.attribute(dataset.name, "type").find("bgr") != std::string::npos)
    picture = picture.flip(0);
  return picture.contiguous();
}

/// Exposures from the attributes; those without have the length 0.
std::vector<events::TimeWindow> picture_times(const io::Hdf5File& file,
                                              const std::vector<io::Hdf5Dataset>& pictures,
                                              events::TimeUnit unit) {
  std::vector<double> starts, ends;
  for (const auto& dataset : pictures) {
    const auto start = file.number(dataset.name, "exposure_start");
    const auto end = file.number(dataset.name, "exposure_end");
    const double stamp = *file.number(dataset.name, "timestamp");
    starts.push_back(start && end ? *start : stamp);
    ends.push_back(start && end ? *end : stamp);
  }
  const auto from = torch::tensor(starts, torch::kFloat64),
             to = torch::tensor(ends, torch::kFloat64);
  const std::string where = concat(file.path().string(), ": times of its pictures");
  if (unit == events::TimeUnit::kAuto)
    unit = events::guess_exposure_unit(from, to, where, "give the unit");
  const auto from_us = events::times_us(from, unit, where),
             to_us = events::times_us(to, unit, where);
  std::vector<events::TimeWindow> out;
  for (size_t i = 0; i < from_us.size(); ++i) {
    out.push_back({from_us[i], to_us[i]});
    if (from_us[i] <= to_us[i]) continue;
    throw DataError(concat(file.path().string(), ": ", pictures[i].name, " ends at ", to_us[i],
                           " us, before its start at ", from_us[i], " us; swap the attributes"));
  }
  return out;
}

/// Adds pictures that are data sets of their own. Sharp ones beside them are not read.
void add_single_pictures(const io::Hdf5File& file, const PictureGroups& groups,
                         const ReadOptions& options, Contents& contents) {
  if (groups.empty()) return;
  const auto named = groups.find("images");
  const auto bytes = std::find_if(groups.begin(), groups.end(), [](const auto& each) {
    return each.second.front().item_size == 1;
  });
  const auto& [group, pictures] = named != groups.end()   ? *named
                                  : bytes != groups.end() ? *bytes
                                                          : *groups.begin();
  for (const auto& [other, left] : groups) {
    if (other == group) continue;
    contents.recording.notes.push_back(concat(file.path().string(), ": frames are those of ", group,
                                              "/; the ", left.size(), " pictures of ", other,
                                              "/ are not read"));
  }
  contents.keep = std::make_shared<TemporaryFolder>();
  contents.made = {{contents.keep->path(), file.path()}};
  const auto exposures = picture_times(file, pictures, options.time_unit);
  int64_t first_us = exposures.front().begin_us;
  for (const auto& exposure : exposures) first_us = std::min(first_us, exposure.begin_us);
  for (size_t i = 0; i < pictures.size(); ++i) {
    throw_if_interrupted();
    if (!is_wanted(options, first_us, exposures[i].begin_us)) continue;
    const fs::path picture =
        contents.keep->path() / (fs::path(pictures[i].name).filename().string() + ".png");
    imaging::write_image(picture, read_single_picture(file, pictures[i]), {bits_of(pictures[i])});
    contents.files.push_back({picture, exposures[i]});
  }
}

/// Adds the pictures of the camera of the events, and notes those of others.
void add_stored_frames(const io::Hdf5File& file, const std::vector<StoredFrames>& all,
                       const ReadOptions& options, Contents& contents) {
  const fs::path& path = file.path();
  const std::string stream = events::event_group_name(path, options.events_group);
  const auto near = [&](const StoredFrames& frames) {
    const std::string folder = folder_of(frames.name);
    return folder == stream || folder == folder_of(stream);
  };
  const auto own = std::find_if(all.begin(), all.end(), near);
  std::string left;
  for (const StoredFrames& frames : all) {
    if (own == all.end() || frames.name != own->name)
      left += (left.empty() ? "" : ", ") + frames.name;
  }
  if (!left.empty()) {
    contents.recording.notes.push_back(
        concat(path.string(), ": pictures of other cameras than that of the events are not read (",
               left, "); give frames with --frames"));
  }
  if (own == all.end()) return;
  contents.keep = std::make_shared<TemporaryFolder>();
  contents.made = {{contents.keep->path(), file.path()}};
  const std::vector<int64_t> times = read_times_us(file, own->times, options.time_unit);
  const int64_t first_us = *std::min_element(times.begin(), times.end());
  const io::Hdf5Dataset& dataset = file.dataset(own->name);
  for (size_t i = 0; i < times.size(); ++i) {
    throw_if_interrupted();
    if (!is_wanted(options, first_us, times[i])) continue;
    char name[32];
    std::snprintf(name, sizeof name, "%06zu.png", i);
    const fs::path picture = contents.keep->path() / name;
    imaging::write_image(picture, read_picture(file, dataset, int64_t(i)), {bits_of(dataset)});
    contents.files.push_back({picture, events::TimeWindow{times[i], times[i]}});
  }
}

}  // namespace

void add_hdf5_frames(const fs::path& path, const ReadOptions& options, Contents& contents) {
  if (!options.frames.empty()) return;
  const io::Hdf5File file(path);
  std::vector<io::Hdf5Dataset> passed;
  const std::vector<StoredFrames> all = find_frames(file, passed);
  const PictureGroups groups = find_single_pictures(file, passed);
  if (all.empty()) {
    add_single_pictures(file, groups, options, contents);
  } else {
    add_stored_frames(file, all, options, contents);
  }
  report_passed(passed, path, contents);
}

}  // namespace jade::recording
