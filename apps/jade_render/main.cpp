// SPDX-License-Identifier: Apache-2.0
// Renders views of a trained scene.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "common/cli.h"
#include "common/dataset_flags.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/data/cameras.h"
#include "jade/data/dataset.h"
#include "jade/data/origin.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/scene_file.h"
#include "jade/gaussians/summary.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/movie.h"
#include "jade/run/evaluate.h"
#include "jade/run/page_scene.h"
#include "jade/train/view.h"
#include "jade_render/depth.h"
#include "jade_render/unblur.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

struct RenderFlags {
  fs::path run, ply;
  std::string cameras = "test";
  std::string exposure, unblur;
  std::string format = "png";
  double frames_per_second = 30;
  std::optional<double> brightness;  ///< of films; chosen from the data set if not given
  bool fps_benchmark = false;
  bool depth = false;
  double depth_step = 0.001;
};

void add_flags(apps::Program& program, RenderFlags& flags) {
  CLI::App& cli = program.cli();
  program.add_example("jade_render --run runs/table --output pictures");
  program.add_example("jade_render --run runs/table --unblur 0003 --format mp4 --output film.mp4");
  program.begin_group("Input");
  cli.add_option("--run", flags.run, "Run directory of jade_train: its newest scene and settings")
      ->type_name("DIR");
  cli.add_option("--ply", flags.ply,
                 concat("Gaussians in a file, instead of a run: ", gaussians::kReadEndings))
      ->type_name("FILE");
  apps::add_dataset_flags(program, "--dataset", "Data set of the views (default: the run's)");
  program.begin_group("Views");
  cli.add_option("--cameras", flags.cameras,
                 "test or train: views of the data set; exposure: nine poses of each exposure; or "
                 "a .json with cameras (see below)")
      ->type_name("WORD");
  cli.add_option("--exposure", flags.exposure,
                 "With --cameras exposure: only the exposure of this name")
      ->type_name("NAME");
  cli.add_option("--unblur", flags.unblur,
                 "Instead of --cameras: the blurry frame of this exposure, then its sharp moments "
                 "(exposure.samples), as NAME_blurry and NAME_K, K from 0")
      ->type_name("NAME");
  cli.add_flag("--fps-benchmark", flags.fps_benchmark,
               "Measure frames per second, one view at a time, without writing images");
  program.begin_group("Output");
  cli.add_option("--format", flags.format,
                 "png (8 bits), npy (float32 [3,H,W], not clamped), or mp4: all views in one film, "
                 "in --output or as a file in that folder (needs ffmpeg)")
      ->type_name("FORMAT")
      ->check(CLI::IsMember({"png", "npy", "mp4"}));
  cli.add_option("--fps", flags.frames_per_second, "With --format mp4: frames per second")
      ->capture_default_str()
      ->check(apps::within(0.01, 1000));
  cli.add_option(
         "--brightness", flags.brightness,
         "With --format mp4: factor on what the film shows (default: above 1 only where the "
         "frames of the data set are dark); images keep their values")
      ->check(apps::within(0.1, 20));
  auto* depth = cli.add_flag(
      "--depth", flags.depth,
      "Also write NAME_depth.npy and 16-bit NAME_depth.png: the depth along the camera's "
      "axis in units of the scene, 0 where there is none");
  cli.add_option("--depth-step", flags.depth_step,
                 "With --depth: units of the scene per step of the .png")
      ->needs(depth)
      ->check(apps::within(1e-9, 1e9))
      ->capture_default_str();
  cli.footer(
      "A .json with cameras is a list of objects, or {\"cameras\": [...]} with defaults beside "
      "it:\n"
      "  width, height, fx (px); fy, cx, cy, name where they differ from the default;\n"
      "  camera_from_world: 4x4 rows (x right, y down, z forward), or\n"
      "  position (camera centre) and rotation (3x3, world from camera), as of 3DGS.");
}

gaussians::GaussianFile load_scene(const RenderFlags& flags) {
  if (flags.run.empty() == flags.ply.empty()) {
    throw ConfigError(concat("expected either --run DIR or --ply FILE, found ",
                             flags.run.empty() ? "neither" : "both"));
  }
  if (!flags.ply.empty()) {
    gaussians::GaussianFile file = gaussians::read_gaussians(flags.ply);
    gaussians::check_some(file.gaussians, flags.ply);
    const std::string warning = gaussians::undrawable_warning(file.gaussians, flags.ply.string());
    if (!warning.empty()) log_warn(warning);
    return file;
  }
  gaussians::GaussianFile file = run::newest_scene(flags.run);
  file.antialiased = false;
  gaussians::check_some(file.gaussians, flags.run);
  return file;
}

/// The data set with its origin at that of the scene.
data::Dataset load_data(const RenderFlags& flags, const train::RunOptions& options,
                        const std::string& flag, const geometry::Vector3& origin) {
  if (options.dataset.path.empty()) throw ConfigError(flag + " needs --run or --dataset");
  data::Dataset dataset;
  if (!flags.run.empty()) {
    dataset = run::load_run_dataset(flags.run, options);
  } else {
    std::vector<std::string> warnings;
    dataset = data::load_dataset(options.dataset, &warnings);
    for (const std::string& warning : warnings) log_warn(warning);
  }
  data::move_origin(dataset, origin);
  return dataset;
}

bool has_camera_file(const RenderFlags& flags) {
  return fs::path(flags.cameras).extension() == ".json";
}

/// Whether the frames of the data set choose the brightness of a film.
bool needs_brightness(const RenderFlags& flags) {
  return flags.format == "mp4" && !flags.fps_benchmark && !flags.brightness;
}

/// Sets flags.brightness for a film of a dark recording.
std::vector<data::NamedCamera> load_cameras(RenderFlags& flags, const train::RunOptions& options,
                                            const geometry::Vector3& origin) {
  if (has_camera_file(flags)) {
    std::vector<data::NamedCamera> cameras = data::read_cameras(flags.cameras);
    for (data::NamedCamera& camera : cameras) {
      camera.camera_from_world = geometry::with_origin(camera.camera_from_world, origin);
    }
    if (!needs_brightness(flags) || options.dataset.path.empty()) return cameras;
    try {
      const data::Dataset dataset = load_data(flags, options, "--cameras " + flags.cameras, origin);
      flags.brightness = run::display_brightness(dataset);
    } catch (const DataError& error) {
      if (flags.run.empty()) throw;
      // The data of a run may be gone, and the cameras do not need them.
      log_warn(concat("the film is as bright as the scene, because its data set cannot be read (",
                      error.what(), "); name it with --dataset, or set --brightness"));
    }
    return cameras;
  }
  const auto set = value_of<data::CameraSet>(flags.cameras);
  if (!set) {
    throw ConfigError(concat("--cameras: expected test, train, exposure or a .json file, found '",
                             flags.cameras, "'"));
  }
  const data::Dataset dataset = load_data(flags, options, "--cameras " + flags.cameras, origin);
  if (*set == data::CameraSet::kExposure && !flags.exposure.empty()) {
    apps::exposure_named(dataset, flags.exposure, "--exposure");
  }
  if (!flags.brightness) flags.brightness = run::display_brightness(dataset);
  return data::dataset_cameras(dataset, *set, flags.exposure);
}

/// Scene to render, and its options.
struct Subject {
  gaussians::GaussianFile file;
  splat::RenderOptions options;
};

splat::RenderOutput render_all(const Subject& subject, const data::NamedCamera& view) {
  const torch::NoGradGuard no_grad;
  const splat::Gaussians& gaussians = subject.file.gaussians;
  const auto cameras =
      train::camera_batch({view.camera_from_world}, view.camera, gaussians.means.device());
  return splat::render(gaussians, cameras, subject.options);
}

torch::Tensor render(const Subject& subject, const data::NamedCamera& view) {
  return render_all(subject, view).color[0];
}

/// Copies 16 bytes, which waits until the frame is complete on any device.
void finish(const torch::Tensor& image) { image.flatten()[0].item<float>(); }

struct Timing {
  int64_t frames = 0;
  double median_ms = 0, min_ms = 0;
};

Timing measure(const Subject& subject, const std::vector<data::NamedCamera>& views) {
  using Clock = std::chrono::steady_clock;
  for (int i = 0; i < 5; ++i) finish(render(subject, views.front()));
  std::vector<double> times;
  const auto end = Clock::now() + std::chrono::seconds(5);
  while (Clock::now() < end || times.size() < 20) {
    throw_if_interrupted();
    const auto start = Clock::now();
    finish(render(subject, views[times.size() % views.size()]));
    times.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  std::sort(times.begin(), times.end());
  return {static_cast<int64_t>(times.size()), times[times.size() / 2], times.front()};
}

void print(const Timing& timing, const splat::Gaussians& gaussians, bool as_json) {
  const double fps = 1000 / timing.median_ms;
  if (as_json) {
    std::cout << nlohmann::json{{"gaussians", gaussians.size()},
                                {"device", device_name(gaussians.means.device())},
                                {"frames", timing.frames},
                                {"frames_per_second", fps},
                                {"frame_ms",
                                 {{"median", timing.median_ms}, {"min", timing.min_ms}}}}
                     .dump(2)
              << "\n";
    return;
  }
  std::printf("%.1f frames/s (median %.3f ms, min %.3f ms, %lld frames), %lld Gaussians, %s\n", fps,
              timing.median_ms, timing.min_ms, static_cast<long long>(timing.frames),
              static_cast<long long>(gaussians.size()),
              device_name(gaussians.means.device()).c_str());
}

/// Names of the files that write_images() writes.
/// @throws ConfigError if two views would write the same file.
std::vector<std::string> files_of(const std::vector<data::NamedCamera>& views,
                                  const RenderFlags& flags, const apps::Unblurring* film) {
  std::vector<std::string> files;
  if (film) files.push_back(concat(film->name, "_blurry.", flags.format));
  for (const data::NamedCamera& view : views) {
    files.push_back(concat(view.name, ".", flags.format));
    if (!flags.depth) continue;
    for (const char* ending : {"_depth.npy", "_depth.png"}) files.push_back(view.name + ending);
  }
  std::set<std::string> known;
  for (const std::string& file : files) {
    if (known.insert(file).second) continue;
    throw ConfigError(concat("--cameras: expected one view for each file, found two for ", file,
                             "; rename one of them"));
  }
  return files;
}

/// @param film  whose blurry frame comes first, or null
void write_images(const Subject& subject, const std::vector<data::NamedCamera>& views,
                  const fs::path& output, const RenderFlags& flags,
                  const apps::Unblurring* film = nullptr) {
  const std::string& format = flags.format;
  if (output.empty()) throw ConfigError("--output: expected a folder for the images");
  apps::check_replaces_none(output, files_of(views, flags, film));
  make_writable_folder(output);
  if (film) imaging::write_image(output / (film->name + "_blurry." + format), film->blurry);
  apps::DepthFiles depth(output, flags.depth_step);
  Progress progress("render", static_cast<int64_t>(views.size()), 0, "view");
  std::vector<std::string> black;
  for (const data::NamedCamera& view : views) {
    throw_if_interrupted();
    const splat::RenderOutput out = render_all(subject, view);
    if (out.color.max().item<float>() <= 0) black.push_back(view.name);
    imaging::write_image(output / (view.name + "." + format), out.color[0]);
    if (flags.depth) depth.write(view.name, out);
    if (progress.step()) progress.show(view.name);
  }
  if (!black.empty()) {
    log_warn(concat(black.size(), " of ", views.size(), " views are black, ", black.front(),
                    black.size() > 1 ? " first" : "",
                    ": no Gaussian lies before these cameras; check that their poses are "
                    "camera_from_world of this scene, z forward and y down"));
  }
  depth.finish();
}

/// --output itself if it names a film, else a film in that folder.
fs::path movie_path(const RenderFlags& flags, const fs::path& output) {
  if (output.empty()) throw ConfigError("--output: expected a folder or an .mp4 for the film");
  if (output.extension() == ".mp4") return output;
  const std::string name =
      flags.unblur.empty() ? fs::path(flags.cameras).stem().string() : flags.unblur;
  return output / (name + ".mp4");
}

/// Path of the film; creates its folder.
fs::path make_movie_path(const RenderFlags& flags, const fs::path& output) {
  fs::path path = movie_path(flags, output);
  make_writable_folder(path.has_parent_path() ? path.parent_path() : fs::path("."));
  return path;
}

/// Shows the blurry frame for a second, then each moment for a sixth of a second, long enough to be
/// seen.
void write_movie(const Subject& subject, const apps::Unblurring& film, const fs::path& path,
                 const RenderFlags& flags) {
  const double frames_per_second = flags.frames_per_second,
               brightness = flags.brightness.value_or(1);
  imaging::Movie movie(path, film.blurry.size(2), film.blurry.size(1), frames_per_second);
  const auto show = [&](const torch::Tensor& image, double seconds) {
    for (auto left = std::max(1L, std::lround(seconds * frames_per_second)); left > 0; --left) {
      throw_if_interrupted();
      movie.add(brightness * image);
    }
  };
  show(film.blurry, 1);
  for (const data::NamedCamera& moment : film.moments) show(render(subject, moment), 1.0 / 6);
  movie.finish();
}

void write_movie(const Subject& subject, const std::vector<data::NamedCamera>& views,
                 const fs::path& path, const RenderFlags& flags) {
  imaging::Movie movie(path, views.front().camera.width, views.front().camera.height,
                       flags.frames_per_second);
  Progress progress("render", static_cast<int64_t>(views.size()), 0, "view");
  for (const data::NamedCamera& view : views) {
    throw_if_interrupted();
    movie.add(flags.brightness.value_or(1) * render(subject, view));
    if (progress.step()) progress.show(view.name);
  }
  movie.finish();
}

ExitCode unblur(const Subject& subject, RenderFlags flags, const train::RunOptions& options,
                const fs::path& output) {
  const data::Dataset dataset = load_data(flags, options, "--unblur", subject.file.origin);
  const apps::Unblurring film = apps::unblurring_of(
      apps::exposure_named(dataset, flags.unblur, "--unblur"), options.exposure);
  const std::string what = concat("the blurry frame and ", film.moments.size(), " moments in ");
  if (flags.format == "mp4") {
    const fs::path path = make_movie_path(flags, output);
    if (!flags.brightness) flags.brightness = run::display_brightness(dataset);
    write_movie(subject, film, path, flags);
    log_info(what + path.string());
  } else {
    write_images(subject, film.moments, output, flags, &film);
    log_info(what + output.string());
  }
  return ExitCode::kOk;
}

/// Checks the flags before any file is read.
void check_flags(const RenderFlags& flags, apps::Program& program) {
  const bool other = program.cli().count("--cameras") + program.cli().count("--exposure") > 0;
  if (!flags.unblur.empty() && (other || flags.fps_benchmark)) {
    throw ConfigError(
        "--unblur: expected alone, found with --cameras, --exposure or "
        "--fps-benchmark; take one of them out");
  }
  if (!flags.exposure.empty() && flags.cameras != "exposure") {
    throw ConfigError(concat("--exposure: expected with --cameras exposure, found --cameras ",
                             flags.cameras, "; add it, or take --unblur ", flags.exposure,
                             " for the film of the exposure"));
  }
  const bool film = flags.format == "mp4";
  if (program.json() && !flags.fps_benchmark) {
    throw ConfigError("--json: expected with --fps-benchmark, whose times it prints; take it out");
  }
  const auto has_set = [&](const std::string& key) {
    const auto& all = program.overrides();
    return std::any_of(all.begin(), all.end(),
                       [&](const std::string& set) { return set.rfind(key + "=", 0) == 0; });
  };
  const bool mask = program.cli().count("--mask") > 0 || has_set("dataset.mask");
  if (flags.unblur.empty() && !film && (mask || has_set("dataset.color"))) {
    log_warn(concat(mask ? "--mask" : "dataset.color",
                    " does not change the renders, which show all pixels of the scene in its "
                    "colours; it changes the blurry frame of --unblur"));
  }
  if (flags.unblur.empty() && has_camera_file(flags) && !needs_brightness(flags)) {
    const auto refuse = [&](const std::string& what) {
      throw ConfigError(concat(what, ": expected with views of a data set, found --cameras ",
                               flags.cameras, ", which needs none; take it out"));
    };
    for (const char* flag : apps::kDatasetFlags) {
      if (program.cli().count(flag) > 0) refuse(flag);
    }
    for (const std::string& set : program.overrides()) {
      const std::string key = set.substr(0, set.find('='));
      // These two have a warning.
      if (key.rfind("dataset.", 0) == 0 && key != "dataset.mask" && key != "dataset.color")
        refuse("--set " + key);
    }
  }
  if (flags.depth && (film || flags.fps_benchmark)) {
    throw ConfigError(concat("--depth: expected with images, found ",
                             film ? "--format mp4" : "--fps-benchmark", "; take one of them out"));
  }
  if (!film && program.cli().count("--fps") > 0) {
    throw ConfigError("--fps: is of films, found --format " + flags.format + "; add --format mp4");
  }
  if (!film && flags.brightness) {
    throw ConfigError(
        concat("--brightness: is of films, found --format ", flags.format, "; add --format mp4"));
  }
  if (!film && !flags.fps_benchmark && program.output().extension() == ".mp4") {
    throw ConfigError(concat("--output: expected a folder for ", flags.format, " images, found ",
                             program.output().string(), "; add --format mp4 for a film"));
  }
  if (film && !flags.fps_benchmark) {
    imaging::find_ffmpeg();
    const fs::path path = movie_path(flags, program.output());
    if (fs::is_directory(path)) {
      throw ConfigError(concat("--output: expected ", path.string(),
                               " to be free for the film, found a folder; choose another"));
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_render",
                        "Renders views of a trained scene or of a file of Gaussians");
  RenderFlags flags;
  add_flags(program, flags);
  program.add_output_flag("Folder for the images, or the .mp4 of a film");
  program.add_device_flag();
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    const auto options = apps::load_settings(program, flags.run);
    if (!options) return ExitCode::kOk;
    check_flags(flags, program);
    apps::check_apart(program.output(), options->dataset);
    Subject subject{load_scene(flags), train::render_options(*options)};
    subject.options.antialiased = subject.file.antialiased;
    if (flags.run.empty()) {
      subject.options.near_plane =
          gaussians::near_plane_of(subject.file.gaussians, subject.options.near_plane);
    }
    subject.options.depth = flags.depth;
    const torch::Device device = select_device(options->device);
    splat::Gaussians& gaussians = subject.file.gaussians;
    gaussians = gaussians::map_parameters(
        gaussians, [&](const torch::Tensor& value) { return value.to(device); });
    if (!flags.unblur.empty()) return unblur(subject, flags, *options, program.output());
    const std::vector<data::NamedCamera> views = load_cameras(flags, *options, subject.file.origin);
    if (flags.fps_benchmark) {
      print(measure(subject, views), gaussians, program.json());
      return ExitCode::kOk;
    }
    if (flags.format == "mp4") {
      const fs::path path = make_movie_path(flags, program.output());
      write_movie(subject, views, path, flags);
      log_info(concat(views.size(), views.size() == 1 ? " view in " : " views in ", path.string()));
      return ExitCode::kOk;
    }
    write_images(subject, views, program.output(), flags);
    log_info(concat(views.size(), views.size() == 1 ? " view in " : " views in ",
                    program.output().string()));
    return ExitCode::kOk;
  });
}
