// SPDX-License-Identifier: Apache-2.0
#include "jade/data/undistorter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/events/warp.h"
#include "jade/geometry/rectification.h"
#include "jade/imaging/warp.h"

namespace jade::data {
namespace {

/// A smaller shift is invisible, and resampling costs sharpness.
constexpr double kLeastShiftPx = 1;

/// A lens without coefficients moves pixels by rounding errors only.
constexpr double kLeastToldPx = 0.01;

/// Maps are large; a scene with more cameras that alternate recomputes them.
constexpr size_t kMostKnown = 8;

bool same(const geometry::LensCamera& a, const geometry::LensCamera& b) {
  const auto numbers = [](const geometry::Lens& l) {
    return std::array{l.k1, l.k2, l.p1, l.p2, l.k3, l.k4, l.k5, l.k6, l.s1, l.s2, l.s3, l.s4};
  };
  return a.pinhole() == b.pinhole() && a.lens().model == b.lens().model &&
         numbers(a.lens()) == numbers(b.lens());
}

/// The picture ends half a pixel beyond the centres of its border pixels.
torch::Tensor has_content(const torch::Tensor& map, int64_t width, int64_t height) {
  const torch::Tensor columns = map[0], rows = map[1];
  return ((columns >= -0.5) & (columns <= double(width) - 0.5) & (rows >= -0.5) &
          (rows <= double(height) - 0.5))
      .unsqueeze(0);
}

/// Remaps a [C,H,W] bool picture by nearest neighbour; false if a pixel has no source.
torch::Tensor remapped_flags(const torch::Tensor& flags, const torch::Tensor& map,
                             const torch::Tensor& inside) {
  const auto nearest = [&](int64_t plane, int64_t size) {
    return torch::where(inside[0], map[plane], 0).round().to(torch::kInt64).clamp(0, size - 1);
  };
  const torch::Tensor columns = nearest(0, flags.size(2)), rows = nearest(1, flags.size(1));
  return (flags.reshape({flags.size(0), -1})
              .index_select(1, (rows * flags.size(2) + columns).flatten())
              .reshape({flags.size(0), map.size(1), map.size(2)})) &
         inside;
}

/// Whether the size is a multiple of the camera's, up to a pixel of rounding on either side.
bool has_shape_of(const geometry::Intrinsics& camera, int64_t width, int64_t height) {
  const auto w = double(width), h = double(height);
  const auto camera_w = double(camera.width), camera_h = double(camera.height);
  return std::max((w - 1) / camera_w, (h - 1) / camera_h) <
         std::min((w + 1) / camera_w, (h + 1) / camera_h);
}

void add_once(std::vector<std::string>& names, const std::string& name) {
  if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
}

std::string rounded(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value < 10 ? "%.1f" : "%.0f", value);
  return text;
}

}  // namespace

bool principal_point_inside(const geometry::Intrinsics& camera) {
  constexpr double kLeastMargin = 0.01;
  const auto inside = [](double place, int64_t size) {
    return place > kLeastMargin * double(size) && place < (1 - kLeastMargin) * double(size);
  };
  return inside(camera.cx, camera.width) && inside(camera.cy, camera.height);
}

void check_plausible(const geometry::Intrinsics& camera, const std::string& what) {
  // relative to the larger side of the image
  constexpr double kShortest = 1.0 / 20, kLongest = 100;
  // A crop may lie beside the principal point.
  const auto near = [](double place, int64_t size) {
    return place > -double(size) && place < 2 * double(size);
  };
  if (!near(camera.cx, camera.width) || !near(camera.cy, camera.height)) {
    throw DataError(concat(what, ": expected a principal point in the image of ", camera.width, "x",
                           camera.height, " px or within its size of it, found (", camera.cx, ", ",
                           camera.cy, "); correct it, or give the image size that was calibrated"));
  }
  const auto side = double(std::max(camera.width, camera.height));
  for (const double focal : {camera.fx, camera.fy}) {
    if (focal >= kShortest * side && focal <= kLongest * side) continue;
    throw DataError(concat(what, ": expected focal lengths from ", kShortest * side, " to ",
                           kLongest * side, " px for images of ", camera.width, "x", camera.height,
                           " px, found ", focal,
                           "; correct it, or give the image size that was calibrated"));
  }
}

geometry::Intrinsics fit_to_picture(const geometry::Intrinsics& camera, int64_t width,
                                    int64_t height, const std::string& what) {
  if (has_shape_of(camera, width, height)) {
    check_plausible(camera, what);
    return geometry::scaled(camera, width, height);
  }
  const bool turned = has_shape_of(camera, height, width);
  throw DataError(concat(
      what, ": expected images of the camera's shape, ", camera.width, "x", camera.height,
      " px or this times one number, found ", width, "x", height, " px; ",
      turned ? "one of the two was turned by 90 degrees, perhaps by the orientation that EXIF "
               "notes: turn the images back, or calibrate the turned ones"
             : "give the images that were calibrated, not cropped or padded ones, or the camera "
               "that belongs to them"));
}

std::string scale_note(const geometry::Intrinsics& camera, int64_t width, int64_t height,
                       const std::string& what) {
  const auto is_multiple = [](int64_t large_w, int64_t large_h, int64_t small_w, int64_t small_h) {
    const int64_t times = std::max<int64_t>(1, std::llround(double(large_w) / double(small_w)));
    return std::abs(large_w - times * small_w) <= times &&
           std::abs(large_h - times * small_h) <= times;
  };
  if (is_multiple(camera.width, camera.height, width, height) ||
      is_multiple(width, height, camera.width, camera.height))
    return "";
  return concat(what, ": a camera of ", camera.width, "x", camera.height,
                " px is scaled to images ", "of ", width, "x", height,
                " px; if the images were cropped, not resized, give the camera of the crop");
}

double lens_shift_px(const geometry::LensCamera& camera) {
  if (camera.lens().model == geometry::LensModel::kPinhole) return 0;
  const geometry::Intrinsics& pinhole = camera.pinhole();
  double most = 0;
  const auto look = [&](double u, double v) {
    const auto place = camera.project(geometry::unproject(pinhole, u, v));
    const double shift = std::hypot(place[0] - u, place[1] - v);
    most = std::isnan(shift) ? std::numeric_limits<double>::infinity() : std::max(most, shift);
  };
  const auto right = double(pinhole.width), bottom = double(pinhole.height);
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i) {
    const double u = right * i / kSteps, v = bottom * i / kSteps;
    look(u, 0), look(u, bottom), look(0, v), look(right, v);
  }
  return most;
}

const Undistorter::Straight& Undistorter::straight(const geometry::LensCamera& camera,
                                                   const std::string& what) {
  for (const Straight& known : known_) {
    if (same(known.camera, camera)) return known;
  }
  Straight made{camera, lens_shift_px(camera), {}, {}};
  if (made.shift_px > kLeastShiftPx) {
    const geometry::Intrinsics& pinhole = camera.pinhole();
    made.map = geometry::undistortion_map(camera, pinhole);
    made.inside = has_content(made.map, pinhole.width, pinhole.height);
    if (!made.inside.any().item<bool>()) {
      throw DataError(concat(what,
                             ": expected a lens that shows something in its image, found "
                             "coefficients that put every pixel outside; calibrate again"));
    }
  }
  if (known_.size() == kMostKnown) known_.erase(known_.begin());
  known_.push_back(std::move(made));
  return known_.back();
}

geometry::Intrinsics Undistorter::undistort(const geometry::LensCamera& camera,
                                            const std::string& what, torch::Tensor& image,
                                            torch::Tensor& mask) {
  const Straight& to = straight(camera, what);
  if (!to.map.defined()) {
    if (to.shift_px > kLeastToldPx) add_once(ignored_, what);
    most_ignored_px_ = std::max(most_ignored_px_, to.shift_px);
    return camera.pinhole();
  }
  image = imaging::remap(image, to.map);
  const bool filled = to.inside.all().item<bool>();
  if (mask.defined()) {
    mask = imaging::remap_mask(mask, to.map) & to.inside;
  } else if (!filled) {
    mask = to.inside;
  }
  image = image * to.inside;
  add_once(undistorted_, what);
  most_undistorted_px_ = std::max(most_undistorted_px_, to.shift_px);
  pixels_ += double(to.inside.numel());
  masked_ += filled ? 0 : to.inside.logical_not().sum().item<double>();
  return camera.pinhole();
}

void Undistorter::tell(const Warnings& warnings, std::vector<std::string>& notes) const {
  if (!ignored_.empty()) {
    warnings.add(listing(ignored_, 3), ": lens distortion of at most ", rounded(most_ignored_px_),
                 " px at the border of the image is ignored");
  }
  if (undistorted_.empty()) return;
  const std::string shift =
      std::isfinite(most_undistorted_px_)
          ? concat("the lens moved their border by up to ", rounded(most_undistorted_px_), " px")
          : std::string("the lens sees less than a pinhole of its focal length");
  std::string note =
      concat("undistorted on loading: frames of ", listing(undistorted_, 3), "; ", shift);
  if (masked_ > 0) {
    note += concat("; ", rounded(100 * masked_ / pixels_), " % of the pixels have no source and ",
                   "are masked");
  }
  notes.push_back(note);
}

void undistort_events(const geometry::LensCamera& camera, Dataset& data) {
  if (!(lens_shift_px(camera) > kLeastShiftPx)) return;
  const geometry::Intrinsics& pinhole = camera.pinhole();
  const torch::Tensor map = geometry::rectification_map(camera, pinhole);
  if (data.event_color.defined()) {
    const torch::Tensor back = geometry::undistortion_map(camera, pinhole);
    data.event_color =
        remapped_flags(data.event_color, back, has_content(back, pinhole.width, pinhole.height));
  }
  if (data.events.empty()) return;
  const events::WarpedEvents moved =
      events::warp(data.events, map, {pinhole.height, pinhole.width});
  data.events = moved.events;
  for (std::vector<Exposure>* exposures : {&data.train, &data.held_out}) {
    for (Exposure& exposure : *exposures) {
      exposure.events = data.events.slice(exposure.t_start_us, exposure.t_end_us);
    }
  }
  data.notes.push_back(concat("undistorted on loading: ", moved.events.size(), " events; ",
                              moved.dropped, " that left the image are dropped"));
}

}  // namespace jade::data
