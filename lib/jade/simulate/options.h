// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "jade/core/fields.h"

namespace jade::simulate {

struct MotionOptions {
  double blur_px = 16;  ///< mean length of the blur
  double reach = 1;
  double rest = 0;
  double rest_period_ms = 500;
};
template <class V>
void describe(V& v, MotionOptions& o) {
  v.field("blur_px", o.blur_px, "mean length of the blur over an exposure, px; sets the speed",
          Range{0.1, 200});
  v.field("reach", o.reach, "amplitude of the camera's motion; 1 fits the scene", Range{0.01, 1.5});
  v.field("rest", o.rest,
          "part of each rest_period_ms in which the camera is static; it catches up in the "
          "remaining time, and so is faster",
          Range{0, 0.95});
  v.field("rest_period_ms", o.rest_period_ms, "from one rest to the next, ms", Range{1, 1e5});
}

/// Empty vectors: the source's defaults.
struct CameraOptions {
  std::vector<double> eye, target, up, eye_reach, target_reach;
};
template <class V>
void describe(V& v, CameraOptions& o) {
  v.field("eye", o.eye, "mean place of the camera [x, y, z]; empty: the source's own");
  v.field("target", o.target, "mean point looked at [x, y, z]; empty: the source's own");
  v.field("up", o.up, "[x, y, z]; empty: +y");
  v.field("eye_reach", o.eye_reach, "largest excursions of the eye [x, y, z]; empty: the source's");
  v.field("target_reach", o.target_reach, "the same of the target");
}

struct SamplingOptions {
  double max_flow_px = 1;
  double min_fps = 0;
  int64_t samples = 4;
  int64_t sharp_samples = 16;
};
template <class V>
void describe(V& v, SamplingOptions& o) {
  v.field("max_flow_px", o.max_flow_px, "no pixel moves further than this between two frames, px",
          Range{0.05, 4});
  v.field("min_fps", o.min_fps, "frames per second at least, Hz; 0 leaves it to max_flow_px",
          Range{0, 100000});
  v.field("samples", o.samples, "rays per pixel of each frame", Range{1, 256});
  v.field("sharp_samples", o.sharp_samples, "rays per pixel of sharp pictures", Range{1, 256});
}

/// The light on the scene.
struct LightOptions {
  double brightness = 1;
  double flicker = 0, flicker_hz = 100;
};
template <class V>
void describe(V& v, LightOptions& o) {
  v.field("brightness", o.brightness, "of the scene, as a multiple of its light", Range{1e-3, 100});
  v.field("flicker", o.flicker,
          "part by which lamps on the mains lower and raise the light, as a cosine",
          Range{0, 0.99});
  v.field("flicker_hz", o.flicker_hz, "twice the frequency of the mains, Hz", Range{1, 10000});
}

/// Optics in front of both sensors.
struct OpticsOptions {
  double vignetting = 0;
  int64_t dust = 0;
  double dust_radius_px = 4;
};
template <class V>
void describe(V& v, OpticsOptions& o) {
  v.field("vignetting", o.vignetting,
          "part of the light that is lost in the corners; with the square of the distance to the "
          "middle",
          Range{0, 1});
  v.field("dust", o.dust, "dark spots that stay where they are in the image", Range{0, 10000});
  v.field("dust_radius_px", o.dust_radius_px, "mean radius of a spot, px", Range{0.5, 1000});
}

/// A striped ball that oscillates in front of the scene; the camera does not follow it.
struct ObjectOptions {
  double radius_px = 0;
  double travel_px = 60;
  double period_ms = 1000;
};
template <class V>
void describe(V& v, ObjectOptions& o) {
  v.field("radius_px", o.radius_px, "apparent radius of a moving ball, px; 0: none",
          Range{0, 10000});
  v.field("travel_px", o.travel_px, "how far it swings to each side, px", Range{0, 10000});
  v.field("period_ms", o.period_ms, "of its swing, ms", Range{10, 1e6});
}

/// Mapping from light to stored values.
enum class Encoding { kLinear, kSrgb };

constexpr auto words_of(Encoding) {
  return std::array{Word{"linear", Encoding::kLinear}, Word{"srgb", Encoding::kSrgb}};
}

/// Quantity that a sensor integrates.
enum class Space { kStored, kLinear };

constexpr auto words_of(Space) {
  return std::array{Word{"stored", Space::kStored, "stored values"},
                    Word{"linear", Space::kLinear, "linear light"}};
}

struct ImageSensorOptions {
  Encoding encoding = Encoding::kLinear;
  Space blur_space = Space::kStored;
  double full_well = 0;
  double read_noise = 0;
  double pattern_rows = 0, pattern_columns = 0, pattern_pixels = 0;
  int64_t dead_columns = 0;
  double auto_exposure = 0;
};
template <class V>
void describe(V& v, ImageSensorOptions& o) {
  v.field("encoding", o.encoding, "how light becomes stored values; the scene holds stored values");
  v.field("blur_space", o.blur_space, "what an exposure averages");
  v.field("full_well", o.full_well, "electrons of a white pixel, for photon noise; 0: none",
          Range{0, 1e9});
  v.field("read_noise", o.read_noise, "standard deviation, as a fraction of white", Range{0, 1});
  v.field(
      "pattern_rows", o.pattern_rows,
      "fixed pattern: standard deviation of an offset that each row has, as a fraction of white",
      Range{0, 1});
  v.field("pattern_columns", o.pattern_columns, "the same of each column", Range{0, 1});
  v.field("pattern_pixels", o.pattern_pixels, "the same of each pixel", Range{0, 1});
  v.field("dead_columns", o.dead_columns, "columns that are black in every frame", Range{0, 8192});
  v.field("auto_exposure", o.auto_exposure,
          "mean that the middle of a frame is brought to, by a shorter exposure or by gain, from "
          "what the frame before was like; 0: length and gain are fixed",
          Range{0, 1});
}

/// The colour filter on the event pixels, in the words of data/bayer.h.
enum class Bayer { kNone, kRggb };

constexpr auto words_of(Bayer) {
  return std::array{Word{"none", Bayer::kNone, "gray"},
                    Word{"rggb", Bayer::kRggb, "red at even rows and even columns"}};
}

struct EventSensorOptions {
  double threshold_positive = 0.2, threshold_negative = 0.2;
  double threshold_spread = 0;
  Space space = Space::kStored;
  Bayer bayer = Bayer::kNone;
  double log_eps = 1e-3;
  int64_t refractory_us = 0;
  double cutoff_hz = 0;
  double leak_hz = 0;
  double shot_hz = 0;
  double hot_fraction = 0, hot_hz = 0;
  double latency_us = 0, dark_latency_us = 0;
  double burst_hz = 0;
  int64_t dead_columns = 0;
};
template <class V>
void describe(V& v, EventSensorOptions& o) {
  v.field("threshold_positive", o.threshold_positive, "log intensity step of an ON event",
          Range{0.01, 5});
  v.field("threshold_negative", o.threshold_negative, "log intensity step of an OFF event",
          Range{0.01, 5});
  v.field("threshold_spread", o.threshold_spread,
          "standard deviation of each threshold from pixel to pixel (kept above 0.01)",
          Range{0, 1});
  v.field("space", o.space, "what the event pixels see");
  v.field("bayer", o.bayer, "colour filter before them: each sees one channel, or gray");
  v.field("log_eps", o.log_eps, "added to the intensity before the logarithm", Range{1e-6, 1});
  v.field("refractory_us", o.refractory_us, "dead time of a pixel after an event, µs",
          Range{0, 1e6});
  v.field("cutoff_hz", o.cutoff_hz,
          "bandwidth of a white pixel, Hz; falls with intensity; 0: no limit", Range{0, 1e6});
  v.field("leak_hz", o.leak_hz, "ON events of a pixel that sees no change, Hz", Range{0, 1000});
  v.field("shot_hz", o.shot_hz, "random events of a dark pixel, Hz; a white one has a quarter",
          Range{0, 1000});
  v.field("hot_fraction", o.hot_fraction, "part of the pixels that fire by themselves",
          Range{0, 1});
  v.field("hot_hz", o.hot_hz, "their rate, Hz", Range{0, 10000});
  v.field("latency_us", o.latency_us, "from what a pixel sees to the time of its event, µs",
          Range{0, 1e6});
  v.field("dark_latency_us", o.dark_latency_us,
          "added to it where the pixel sees a tenth of white or less, µs; falls with brightness",
          Range{0, 1e6});
  v.field("burst_hz", o.burst_hz, "instants at which all pixels fire, of random sign, per second",
          Range{0, 1000});
  v.field("dead_columns", o.dead_columns, "columns without events", Range{0, 8192});
}

/// An event camera beside the camera of the frames. If `centre` is empty, one sensor records both.
struct EventCameraOptions {
  std::vector<double> centre, turn_deg;
  int64_t width = 0, height = 0;
  double focal_px = 0;
  bool is_beside() const { return !centre.empty(); }
};
template <class V>
void describe(V& v, EventCameraOptions& o) {
  v.field("centre", o.centre,
          "where it stands [x, y, z], in the axes of the camera of the frames (x right, y down, z "
          "forward), world units; empty: one sensor gives frames and events");
  v.field("turn_deg", o.turn_deg,
          "rotation vector of its axes from those of the frames' camera, degrees; empty: none");
  v.field("width", o.width, "px; 0: as the frames", Range{0, 8192});
  v.field("height", o.height, "px; 0: as the frames", Range{0, 8192});
  v.field("focal_px", o.focal_px, "px; 0: as the frames", Range{0, 1e5});
}

/// Metadata that a recording contains.
struct RecordingOptions {
  bool exposure_times = true;
};
template <class V>
void describe(V& v, RecordingOptions& o) {
  v.field("exposure_times", o.exposure_times,
          "with --recording: write exposures.csv, and sharp views among the frames; false: frames "
          "have a time stamp alone, of the middle");
}

/// Which poses are estimated; the others are derived from them.
enum class PoseTimes { kPath, kMidExposure, kThirds };

constexpr auto words_of(PoseTimes) {
  return std::array{
      Word{"path", PoseTimes::kPath, "the whole path"},
      Word{"mid_exposure", PoseTimes::kMidExposure,
           "one per exposure, at its middle, and the path runs through these alone"},
      Word{"thirds", PoseTimes::kThirds, "three per exposure, at the middles of its thirds"}};
}

struct PoseNoiseOptions {
  PoseTimes at = PoseTimes::kPath;
  double rotation_deg = 0;
  double position = 0;
  double correlation_ms = 0;
};
template <class V>
void describe(V& v, PoseNoiseOptions& o) {
  v.field("at", o.at, "which poses are estimated");
  v.field("rotation_deg", o.rotation_deg,
          "standard deviation of estimated rotations about each axis, degrees (1 px at the image "
          "centre is atan(1/focal_px))",
          Range{0, 10});
  v.field("position", o.position,
          "standard deviation of estimated camera centres along each axis, world units",
          Range{0, 10});
  v.field("correlation_ms", o.correlation_ms,
          "time over which the errors change, ms: Δ apart they correlate by exp(-Δ²/2 "
          "correlation_ms²); 0: every estimated pose has an error of its own",
          Range{0, 1e6});
}

/// Defaults of all other options.
enum class Preset { kCdavis, kBlender };

constexpr auto words_of(Preset) {
  return std::array{
      Word{"cdavis", Preset::kCdavis, "346×260, 100 ms, thresholds 0.25, noisy sensor"},
      Word{"blender", Preset::kBlender, "600×400, 40 ms at 1000 frames per second, clean"}};
}

/// Scene in front of the camera.
enum class Source { kWorld, kPly, kFrames };

constexpr auto words_of(Source) {
  return std::array{Word{"world", Source::kWorld, "a built-in world", "scene"},
                    Word{"ply", Source::kPly, "a file of Gaussians"},
                    Word{"frames", Source::kFrames, "sharp frames"}};
}

/// Options of the simulator. The initialisers describe an ideal sensor; presets change them.
struct SimulateOptions {
  Preset preset = Preset::kCdavis;
  Source source = Source::kWorld;
  std::string world = "desk";
  std::filesystem::path path;
  int64_t width = 346, height = 260;
  double focal_px = 450;
  int64_t exposures = 12, test_views = 5, seen_test_views = 2;
  double exposure_ms = 100, gap_ms = 20;
  double frame_rate_hz = 1000;
  CameraOptions camera;
  MotionOptions motion;
  LightOptions light;
  ObjectOptions object;
  OpticsOptions optics;
  SamplingOptions sampling;
  ImageSensorOptions image;
  EventSensorOptions events;
  EventCameraOptions event_camera;
  RecordingOptions recording;
  PoseNoiseOptions poses;
};
template <class V>
void describe(V& v, SimulateOptions& o) {
  v.field("preset", o.preset, "defaults of everything below");
  v.field("source", o.source, "what the camera sees");
  v.renamed("scene", "world");
  v.field("world", o.world,
          "desk, workshop, bookshelf, corridor, garden, market, gallery, clutter");
  v.field("path", o.path,
          "source ply: the file of Gaussians (.ply, .spz, .sog, .glb, .gltf or .splat); source "
          "frames: a folder with transforms.json");
  v.field("width", o.width, "px", Range{8, 8192});
  v.field("height", o.height, "px", Range{8, 8192});
  v.field("focal_px", o.focal_px, "px", Range{1, 1e5});
  v.field("exposures", o.exposures, "blurry frames", Range{1, 1000});
  v.field("test_views", o.test_views, "sharp frames for evaluation", Range{0, 1000});
  v.field(
      "seen_test_views", o.seen_test_views,
      "how many of them are taken at the middle of an exposure; the others lie between exposures",
      Range{0, 1000});
  v.field("exposure_ms", o.exposure_ms, "ms", Range{0.1, 10000});
  v.field("gap_ms", o.gap_ms, "from the end of an exposure to the next, ms", Range{0, 10000});
  v.field("frame_rate_hz", o.frame_rate_hz, "source frames: frames per second of the folder, Hz",
          Range{1, 1e6});
  v.group("camera", o.camera, "where the camera is");
  v.group("motion", o.motion, "the camera's path");
  v.group("light", o.light, "the light on the scene");
  v.group("object", o.object, "what moves before the scene");
  v.group("optics", o.optics, "what lies before both sensors");
  v.group("sampling", o.sampling, "frames that are rendered");
  v.group("image", o.image, "the frame sensor");
  v.group("events", o.events, "the event sensor");
  v.group("event_camera", o.event_camera, "where the event sensor is not that of the frames");
  v.group("recording", o.recording, "what a recording says of itself");
  v.group("poses", o.poses, "error of the written poses, as structure from motion makes");
}

/// Defaults of a preset; kBlender has thresholds of 0.2.
SimulateOptions preset_options(Preset preset);

/// The top level of a simulation file.
struct SimulateRun {
  int64_t seed = 0;
  SimulateOptions simulate;
};
template <class V>
void describe(V& v, SimulateRun& o) {
  v.field("seed", o.seed, "of the world, the camera's path and all noise", Range{0, 9e15});
  v.group("simulate", o.simulate, "what to simulate");
}

/// Checks rules between fields. @throws ConfigError naming the key.
void validate(const SimulateRun& run);

}  // namespace jade::simulate
