// SPDX-License-Identifier: Apache-2.0
#include "jade/data/evdeblur_writer.h"

#include <algorithm>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/data/bayer.h"
#include "jade/data/dataset.h"
#include "jade/data/evdeblur.h"
#include "jade/data/llff.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

void check_content(const EvDeblurContent& content) {
  JADE_CHECK(!content.train.empty(), "no exposure to write");
  const geometry::Intrinsics& camera = content.train.front().camera;
  JADE_CHECK(camera == geometry::Intrinsics::centred(camera.fx, camera.width, camera.height),
             "the EvDeblur layout holds one focal length and a centred principal point only");
  for (const Exposure& exposure : content.train) {
    JADE_CHECK(exposure.camera == camera, "the cameras of exposures differ");
    JADE_CHECK(exposure.duration_us() > 0, "exposure ", exposure.name, " has no duration");
    check_shape(exposure.blurry, "blurry", {3, camera.height, camera.width});
  }
  for (const SharpView& view : content.test) {
    JADE_CHECK(view.camera == camera, "the cameras of test views differ");
    JADE_CHECK(view.has_time(), "test view ", view.name, " has no time");
    check_shape(view.image, "test view", {3, camera.height, camera.width});
  }
  JADE_CHECK(content.path.size() == content.path_t_us.size() && !content.path.empty(),
             content.path.size(), " poses at ", content.path_t_us.size(), " times");
  for (size_t i = 1; i < content.path_t_us.size(); ++i) {
    JADE_CHECK(content.path_t_us[i - 1] < content.path_t_us[i],
               "times of the path do not increase");
  }
  for (const Exposure& exposure : content.train) {
    JADE_CHECK(content.path_t_us.front() <= exposure.t_start_us &&
                   content.path_t_us.back() >= exposure.t_end_us,
               "the path does not span exposure ", exposure.name);
  }
  JADE_CHECK(content.sharp_mid.empty() || content.sharp_mid.size() == content.train.size(),
             content.sharp_mid.size(), " sharp frames for ", content.train.size(), " exposures");
  JADE_CHECK(content.held_out.empty() || content.held_out.size() == content.train.size(),
             content.held_out.size(), " marks of held-out for ", content.train.size(),
             " exposures");
  if (content.points.defined()) {
    const int64_t count = content.points.size(0);
    check_shape(content.points, "points", {count, 3});
    check_shape(content.point_colors, "point colours", {count, 3});
  }
  JADE_CHECK(content.near > 0 && content.far > content.near, "depth bounds ", content.near, " to ",
             content.far);
}

/// Zero-padded, so that names sort as numbers do.
std::string frame_name(size_t index, size_t count) {
  std::string name = std::to_string(index);
  const size_t width = std::max<size_t>(2, std::to_string(count - 1).size());
  return std::string(width - name.size(), '0') + name;
}

std::vector<LlffView> llff_of(const std::vector<geometry::Pose>& poses,
                              const EvDeblurContent& content) {
  const geometry::Intrinsics& camera = content.train.front().camera;
  std::vector<LlffView> views;
  for (const geometry::Pose& pose : poses) {
    views.push_back(
        {pose, double(camera.height), double(camera.width), camera.fx, content.near, content.far});
  }
  return views;
}

void write_times(const fs::path& path, const EvDeblurContent& content) {
  std::vector<int64_t> mid, start, end;
  for (const Exposure& exposure : content.train) {
    mid.push_back(exposure.t_mid_us());
    start.push_back(exposure.t_start_us);
    end.push_back(exposure.t_end_us);
  }
  for (const SharpView& view : content.test) {
    for (auto* list : {&mid, &start, &end}) list->push_back(view.t_us);
  }
  const auto tensor = [](const std::vector<int64_t>& values) {
    return torch::tensor(values, torch::kInt64);
  };
  io::write_npz(path, {{"timestamps", tensor(mid)},
                       {"timestamps_start", tensor(start)},
                       {"timestamps_end", tensor(end)},
                       {"start", torch::tensor(start.front(), torch::kInt64)},
                       {"end", torch::tensor(end.back(), torch::kInt64)}});
}

/// Writes the names of the held-out exposures, if there are any.
void write_held_out(const fs::path& path, const EvDeblurContent& content, size_t frames) {
  std::string names;
  for (size_t i = 0; i < content.held_out.size(); ++i) {
    if (content.held_out[i]) names += frame_name(i, frames) + "\n";
  }
  if (!names.empty()) write_file(path, names);
}

/// Writes the gains of the frames, unless all are 1.
void write_gains(const fs::path& path, const EvDeblurContent& content) {
  std::vector<double> gains;
  for (const Exposure& exposure : content.train) gains.push_back(exposure.gain);
  for (const SharpView& view : content.test) gains.push_back(view.gain);
  if (std::all_of(gains.begin(), gains.end(), [](double gain) { return gain == 1; })) return;
  std::string lines = "name,gain\n";
  for (size_t i = 0; i < gains.size(); ++i) {
    lines += concat(frame_name(i, gains.size()), ",", gains[i], "\n");
  }
  write_file(path, lines);
}

}  // namespace

void write_event_file(const fs::path& path, const events::EventStream& events, int gzip_level) {
  io::Hdf5Writer writer(path, gzip_level);
  const int64_t count = events.size();
  writer.append("x", events.x().cpu().contiguous().data_ptr<float>(), count);
  writer.append("y", events.y().cpu().contiguous().data_ptr<float>(), count);
  writer.append("t", events.t_us().cpu().contiguous().data_ptr<int64_t>(), count);
  writer.append("p", events.polarity().cpu().contiguous().data_ptr<int8_t>(), count);
  writer.close();
}

void write_evdeblur(const fs::path& folder, const EvDeblurContent& content, int image_bits) {
  check_content(content);
  for (const char* name :
       {"images_1", "sharp", kHeldOutFile, kGainFile, "points.npz", "ev_map.npz"}) {
    fs::remove_all(folder / name);
  }
  make_writable_folder(folder / "images_1");
  const imaging::ImageWriteOptions image_options{image_bits, 95};
  std::vector<const torch::Tensor*> images;
  std::vector<geometry::Pose> poses;
  for (const Exposure& exposure : content.train) {
    images.push_back(&exposure.blurry);
    poses.push_back(exposure.poses[geometry::kMidPose]);
  }
  for (const SharpView& view : content.test) {
    images.push_back(&view.image);
    poses.push_back(view.pose);
  }
  for (size_t i = 0; i < images.size(); ++i) {
    imaging::write_image(folder / "images_1" / (frame_name(i, images.size()) + ".png"), *images[i],
                         image_options);
  }
  if (!content.sharp_mid.empty()) make_writable_folder(folder / "sharp");
  for (size_t i = 0; i < content.sharp_mid.size(); ++i) {
    imaging::write_image(folder / "sharp" / (frame_name(i, images.size()) + ".png"),
                         content.sharp_mid[i], image_options);
  }
  write_times(folder / "images_1" / "timestamps.npz", content);
  io::write_npy(folder / "poses_bounds.npy", llff_rows(llff_of(poses, content)));
  io::write_npy(folder / "all_poses_bounds.npy", llff_rows(llff_of(content.path, content)));
  io::write_npy(folder / "all_timestamps.npy", torch::tensor(content.path_t_us, torch::kInt64));
  write_event_file(folder / "events.h5", content.events);
  if (content.points.defined()) {
    io::write_npz(folder / "points.npz", {{"points", content.points.to(torch::kFloat32)},
                                          {"colors", content.point_colors}});
  }
  write_held_out(folder / kHeldOutFile, content, images.size());
  write_gains(folder / kGainFile, content);
  if (content.color_events && content.event_map.defined()) {
    write_event_color_map(folder / "ev_map.npz", content.event_map);
  } else if (content.color_events) {
    const geometry::Intrinsics& camera = content.train.front().camera;
    write_event_color_map(folder / "ev_map.npz", camera.height, camera.width);
  }
}

}  // namespace jade::data
