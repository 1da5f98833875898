// SPDX-License-Identifier: Apache-2.0
// All settings of an import's YAML and flags.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/fields.h"
#include "jade/core/words.h"
#include "jade/events/thresholds.h"
#include "jade/geometry/rectification.h"
#include "jade/recording/exposures.h"
#include "jade/restore/efnet.h"
#include "jade/restore/restoration_cache.h"

namespace jade::import {

/// Which instant of the exposure a single timestamp marks.
enum class StampChoice { kAuto, kStart, kMiddle, kEnd };

constexpr auto words_of(StampChoice) {
  return std::array{Word{"auto", StampChoice::kAuto, "the format's default"},
                    Word{"start", StampChoice::kStart, "start of the exposure"},
                    Word{"middle", StampChoice::kMiddle, "middle of the exposure"},
                    Word{"end", StampChoice::kEnd, "end of the exposure"}};
}

/// Range of clock offsets: allows a device clock that starts at 0 and one that counts from 1970,
/// until 2096.
constexpr Range kOffsetMs{-4e12, 4e12};

/// Exposure times of the frames, if the recording does not contain them.
struct TimeOptions {
  std::filesystem::path frame_times;
  AutoNumber exposure_ms = AutoNumber::automatic(0);
  StampChoice stamp = StampChoice::kAuto;
  recording::TriggerLevel trigger_level = recording::TriggerLevel::kHigh;
  double begin_s = 0, end_s = 0;
  double offset_ms = 0;
  bool find_offset = true;
};

template <class V>
void describe(V& v, TimeOptions& o) {
  v.field("frame_times", o.frame_times,
          "list of exposures, name,start_us,end_us, or of one time per frame; empty: those of the "
          "recording");
  v.field("exposure_ms", o.exposure_ms,
          "exposure time of frames without a recorded one; auto: estimated from frames and events",
          Range{0, 1e5});
  v.field("stamp", o.stamp, "instant of the exposure that a frame's single time stamp marks");
  v.field("trigger_level", o.trigger_level, "level of the trigger input while a frame is exposed");
  v.field("begin_s", o.begin_s, "start of the part to import, in seconds since the first frame",
          Range{0, 1e6});
  v.field("end_s", o.end_s, "end of the part to import; 0: the end of the recording",
          Range{0, 1e6});
  v.field("offset_ms", o.offset_ms,
          "offset of the clock of the events relative to that of the frames", kOffsetMs);
  v.field("find_offset", o.find_offset,
          "if offset_ms is 0, estimate it from frames and events, up to 50 ms");
}

/// The event sensor.
struct SensorOptions {
  bool remove_hot_pixels = true;
  bool find_thresholds = true;
};

template <class V>
void describe(V& v, SensorOptions& o) {
  v.field("remove_hot_pixels", o.remove_hot_pixels, "drop the events of hot pixels");
  v.field("find_thresholds", o.find_thresholds,
          "if events.threshold_positive is auto, measure it from frames and events");
}

/// The lens, and a second camera.
struct LensOptions {
  std::filesystem::path calibration, mask;
  geometry::RectifiedField field = geometry::RectifiedField::kFilled;
  double plane_depth = 0, near = 0, far = 0;
};

template <class V>
void describe(V& v, LensOptions& o) {
  v.field("calibration", o.calibration,
          "file of Kalibr, OpenCV, ROS, DV, basalt or RPG; empty: a pinhole with an estimated "
          "focal length");
  v.field("mask", o.mask,
          "image of the size of the frames, whose black pixels are excluded in all of them (lens "
          "borders, hot areas); copied to mask.png of the data set");
  v.field("field", o.field, "field of view of the undistorted images");
  v.field("plane_depth", o.plane_depth,
          "depth at which the events of a second camera are mapped to the frames exactly, in the "
          "unit of "
          "the calibration",
          Range{0, 1e6});
  v.field("near", o.near, "nearest depth of the scene, same unit; 0: unknown", Range{0, 1e6});
  v.field("far", o.far, "farthest", Range{0, 1e6});
}

/// Images of an exposure's start, middle and end for structure from motion.
enum class LatentKind { kEdi, kMixed, kMean };

constexpr auto words_of(LatentKind) {
  return std::array{Word{"edi", LatentKind::kEdi, "EDI"},
                    Word{"mixed", LatentKind::kMixed,
                         "EDI at both ends, the mean of EDI and EFNet in the middle"},
                    Word{"mean", LatentKind::kMean,
                         "that mean at all three; a restorer of version 1 restores only the "
                         "middle, which the ratio from the events transforms to both ends"}};
}

/// The sharp images that structure from motion uses.
struct LatentOptions {
  LatentKind kind = LatentKind::kEdi;
  int64_t upscale = 2;
};

template <class V>
void describe(V& v, LatentOptions& o) {
  v.field("kind", o.kind, "images of an exposure's start, middle and end");
  v.field("upscale", o.upscale, "factor by which images are enlarged for COLMAP", Range{1, 4});
}

/// Which pairs of images COLMAP matches.
enum class PairChoice { kAuto, kExhaustive, kSequential };

constexpr auto words_of(PairChoice) {
  return std::array{
      Word{"auto", PairChoice::kAuto, "all up to 60 images, else sequential"},
      Word{"exhaustive", PairChoice::kExhaustive, "all"},
      Word{"sequential", PairChoice::kSequential,
           "neighbours in time, and one image of every shot with one of every other"}};
}

struct PoseSearchOptions {
  std::filesystem::path colmap;
  PairChoice pairs = PairChoice::kAuto;
};

template <class V>
void describe(V& v, PoseSearchOptions& o) {
  v.field("colmap", o.colmap, "the program; empty: the package pycolmap, else colmap of the path");
  v.field("pairs", o.pairs, "which pairs of images are matched");
}

/// Whether to estimate and correct a fault of the frames.
enum class Correction { kAuto, kOff };

constexpr auto words_of(Correction) {
  return std::array{Word{"auto", Correction::kAuto, "correct it if frames show it clearly"},
                    Word{"off", Correction::kOff, "frames are not changed"}};
}

/// Faults of the frames that the lens causes.
struct CorrectionOptions {
  Correction vignetting = Correction::kAuto;
};

template <class V>
void describe(V& v, CorrectionOptions& o) {
  v.field("vignetting", o.vignetting,
          "divide frames by the transmission of the lens, estimated from tracks of points");
}

/// Which frames are used for evaluation.
struct TestOptions {
  std::vector<std::string> names;
  double sharp_px = 1;
  int64_t every = 8;
};

template <class V>
void describe(V& v, TestOptions& o) {
  v.field("names", o.names,
          "names of test frames; empty: the sharp ones, at most a quarter of all, else held-out "
          "exposures");
  v.field("sharp_px", o.sharp_px, "a frame is sharp when the scene moves less during it, px",
          Range{0, 100});
  v.field("every", o.every, "if no frame is sharp, every n-th exposure is held out; 0: none",
          Range{0, 1e6});
}

struct ImportOptions {
  std::string device = "auto";
  std::filesystem::path recording;
  std::filesystem::path frames;
  std::string events_group, topic, frames_topic;
  TimeOptions time;
  SensorOptions sensor;
  LensOptions lens;
  events::EventOptions events;
  restore::EfnetOptions efnet;
  restore::RestorationCacheOptions cache;
  LatentOptions latents;
  PoseSearchOptions poses;
  CorrectionOptions correct;
  TestOptions test;
};

template <class V>
void describe(V& v, ImportOptions& o) {
  v.field("device", o.device, "auto (a GPU if there is one), cpu, cuda or cuda:N");
  v.field("recording", o.recording, "the recording, a file or a folder");
  v.field("frames", o.frames, "folder of frames, or a video, if they are not in the recording");
  v.field(
      "events_group", o.events_group,
      "which of several event streams of an HDF5 file: the group of x, y, t, p, or the data set; "
      "empty: the first");
  v.field("topic", o.topic, "which topic of events of a ROS bag; empty: the first by name");
  v.field(
      "frames_topic", o.frames_topic,
      "which topic of images of a ROS bag; empty: pictures before depth, then the first by name");
  v.group("time", o.time, "exposure times of the frames");
  v.group("sensor", o.sensor, "the event sensor");
  v.group("lens", o.lens, "the lens, and a second camera");
  v.group("events", o.events, "how events become voxels and EDI");
  v.group("efnet", o.efnet, "the frozen learned restorer F");
  v.group("cache", o.cache, "restorations on disk");
  v.group("latents", o.latents, "sharp images for structure from motion");
  v.group("poses", o.poses, "structure from motion");
  v.group("correct", o.correct, "faults of the lens to correct in the frames");
  v.group("test", o.test, "frames for evaluation");
}

/// Checks rules between fields. @throws ConfigError naming the keys.
void validate(const ImportOptions& options);

}  // namespace jade::import
