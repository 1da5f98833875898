// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/fields.h"
#include "jade/data/exposure.h"
#include "jade/events/event_files.h"

namespace jade::data {

/// Which frames are test views.
enum class SplitKind { kAuto, kLast, kEvery, kNone };

constexpr auto words_of(SplitKind) {
  return std::array{
      Word{"auto", SplitKind::kAuto, "frames without exposure time, else the source's own rule"},
      Word{"last", SplitKind::kLast, "the last test_last frames"},
      Word{"every", SplitKind::kEvery, "frames 0, test_every, 2 test_every, …"},
      Word{"none", SplitKind::kNone, "no test views"}};
}

/// Whether a data set, its restorations and its scene are gray.
enum class FrameColor { kAuto, kColor, kGray };

constexpr auto words_of(FrameColor) {
  return std::array{
      Word{"auto", FrameColor::kAuto, "gray if every frame, blurry or sharp, has R = G = B"},
      Word{"color", FrameColor::kColor, "always colour"},
      Word{"gray", FrameColor::kGray, "always gray: converts frames on loading"}};
}

struct DatasetOptions {
  std::filesystem::path path;
  DatasetKind kind = DatasetKind::kAuto;
  SplitKind split = SplitKind::kAuto;
  int64_t test_every = 8;
  int64_t test_last = 5;
  std::string image_folder;
  events::TimeUnit time_unit = events::TimeUnit::kAuto;
  events::TimeUnit events_unit = events::TimeUnit::kAuto;
  std::filesystem::path events_file;
  std::filesystem::path mask;
  bool color_events = true;
  FrameColor color = FrameColor::kAuto;
};

template <class V>
void describe(V& v, DatasetOptions& o) {
  v.field("path", o.path, "folder of the data set");
  v.field("kind", o.kind, "layout of the folder; auto recognises it");
  v.field("split", o.split, "which frames are test views");
  v.field("test_every", o.test_every, "step for split every", Range{2, 1000000});
  v.field("test_last", o.test_last, "count for split last", Range{1, 1000000});
  v.field("image_folder", o.image_folder,
          "folder of the frames inside path; empty: images_1, images or images_N");
  v.field("time_unit", o.time_unit,
          "unit of the frames' time stamps; auto: from the length of the exposures");
  v.field("events_unit", o.events_unit,
          "unit of the events' time stamps; auto: the one in which events and frames overlap");
  v.field("events_file", o.events_file,
          "recording of the events; empty: events.h5 and similar names in path");
  v.field("mask", o.mask,
          "image whose black pixels are excluded in every frame (lens borders, hot areas); "
          "mask.png in path is always used");
  v.field("color_events", o.color_events,
          "use the colour filter of the event pixels (ev_map.npz "
          "or color_map.npy) if the data set has one");
  v.field("color", o.color, "whether the data set, its restorations and its scene are gray");
}

/// Reads a data set of any kind. Problems that can be repaired or ignored become one line each in
/// `warnings` (which may be null): events that are unsorted, outside the image or the recording, in
/// a part of the image only, of one polarity, or not finite; exposures without events; frames that
/// are black, white or repeated; poses that had to be interpolated or extended; a single exposure;
/// a colour filter for the events of gray frames, which is ignored. Exposures that held_out.txt in
/// the folder names go to Dataset::held_out. Pixels under the masks of frames (masks.h) have no
/// effect: they are 0 and have no events.
/// @throws DataError with the path and the fix for other problems: files that are missing,
///   truncated or unreadable, counts and sizes that differ, missing poses of an exposure, times
///   that do not overlap in any unit, held-out names that match no exposure, or match all.
Dataset load_dataset(const DatasetOptions& options, std::vector<std::string>* warnings = nullptr);

/// @throws DataError if the folder is missing or has no known layout.
DatasetKind recognise_dataset(const std::filesystem::path& folder);

/// The data sets that the path is in, or is, innermost first: folders of a known layout. The path
/// need not exist.
/// @throws DataError naming the file of a data set that cannot be read.
std::vector<std::filesystem::path> datasets_around(const std::filesystem::path& path);

/// For messages about a folder of no known layout: a data set below it, or a file with cameras that
/// is not read, and what to do; empty if there are neither.
std::string other_finding(const std::filesystem::path& folder);

/// The kind that the options name, else the kind recognised from their folder. Call it first, so
/// that a wrong path is reported before other work starts.
/// @throws as recognise_dataset; ConfigError without a path.
DatasetKind kind_of(const DatasetOptions& options);

/// File that lists a folder's held-out exposures: one frame name per line, without extension.
constexpr char kHeldOutFile[] = "held_out.txt";

}  // namespace jade::data
