// SPDX-License-Identifier: Apache-2.0
#include "jade/import/structure_from_motion.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/median.h"
#include "jade/core/readable.h"
#include "jade/geometry/trajectory.h"
#include "jade/imaging/image_io.h"
#include "jade/import/colmap.h"
#include "jade/import/motion_check.h"
#include "jade/io/npy.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Up to this number, all pairs of images are matched: 1,770 pairs.
constexpr size_t kMostExhaustive = 60;
/// Above it, each image is matched with this many successors,
constexpr size_t kNeighbours = 9;
/// and the middle images of this many shots, spread over the recording, with one another.
constexpr size_t kLoopShots = 40;
constexpr double kLeastShare = 2.0 / 3;
/// Random variation of the explained blur. If no attempt leads by more, the first is the best: on a
/// desk of 4 exposures all three explained 76 %, and their poses were 1.1, 1.3 and 1.3 px off.
constexpr double kClearlyBetter = 0.01;
/// An estimated focal length with another angle of view of the longer side is doubted: six of
/// seven imports of slider_depth found 185 to 348 px, one 1,805 px, a view of 7 degrees.
constexpr double kNarrowest_deg = 15, kWidest_deg = 120;
/// A held focal length replaces a doubted one unless this much less of the blur is explained.
constexpr double kHeldMargin = 0.05;
/// Number of frames used for checks.
constexpr size_t kChecked = 8;
/// Less motion between all frames counts as none, px.
constexpr double kStandingStill = 1;
/// COLMAP's mapping is random, so an attempt that leaves out images is repeated from the same
/// matches. The repetition holds an unknown focal length: a camera that moves along
/// a line does not determine it, and then it drifts and images are left out
/// (docs/engineering/import.md). Deblurred images have fewer and weaker corners than photographs,
/// and a handheld camera moves little: later attempts require less contrast, then less parallax.
/// The images are already enlarged; enlarging them again finds corners of noise that take most of
/// the time to match.
std::vector<ColmapSettings> attempts() {
  const std::vector<std::string> usual{"--SiftExtraction.first_octave", "0",
                                       "--SiftExtraction.max_num_features", "4000"};
  const std::vector<std::string> weak{"--SiftExtraction.first_octave",     "0",
                                      "--SiftExtraction.max_num_features", "4000",
                                      "--SiftExtraction.peak_threshold",   "0.003"};
  const std::vector<std::string> guided{"--SiftMatching.guided_matching", "1"};
  // Bundle adjustment takes most of the time. On 166 images of a simulated desk these limits reduce
  // the CPU time from 62 to 36 s, and the poses are as good.
  const std::vector<std::string> bounded{
      "--Mapper.ba_global_images_ratio",       "1.3", "--Mapper.ba_global_points_ratio",    "1.3",
      "--Mapper.ba_global_max_num_iterations", "15",  "--Mapper.ba_global_max_refinements", "2",
      "--Mapper.ba_local_max_refinements",     "1"};
  std::vector<std::string> narrow{
      "--Mapper.init_min_tri_angle", "4",   "--Mapper.filter_min_tri_angle", "0.5",
      "--Mapper.tri_min_angle",      "0.5", "--Mapper.min_num_matches",      "10"};
  narrow.insert(narrow.end(), bounded.begin(), bounded.end());
  return {{"usual", usual, {}, bounded},
          {"repeated", usual, {}, bounded, true},
          {"weak_corners", weak, guided, bounded},
          {"little_parallax", weak, guided, narrow}};
}

/// Evenly spaced indices below `count`.
std::vector<size_t> spread(size_t count) {
  std::vector<size_t> picked;
  const size_t most = std::min(count, kChecked);
  for (size_t i = 0; i < most; ++i) picked.push_back(i * count / most);
  return picked;
}

/// Motion between frames spread over the recording and their successors.
FrameMotion motion_of(const Capture& capture) {
  std::vector<torch::Tensor> frames;
  size_t next = 0;
  for (const size_t i : spread(capture.shots.size())) {
    for (size_t k = std::max(i, next); k < std::min(i + 2, capture.shots.size()); ++k) {
      frames.push_back(capture.shots[k].image);
      next = k + 1;
    }
  }
  return frames.size() < 2 ? FrameMotion{} : frame_motion(frames);
}

bool stands_still(const FrameMotion& motion) { return motion.shift_px < kStandingStill; }

std::string said_of(const FrameMotion& motion) {
  const std::string pairs = concat(motion.compared,
                                   " pairs of frames compared, without what is "
                                   "fixed to the sensor: ");
  if (motion.measured == 0) return pairs + "none shows a common shift";
  return concat(pairs, motion.measured, " show a common shift, of ", motion.shift_px,
                " px at most");
}

/// Compares blurry shots with a middle image, spread over the recording, with the poses in `found`.
void check_blur(const fs::path& latents, const std::vector<LatentImage>& images,
                const Capture& capture, const Reconstruction& found, Attempt& attempt) {
  if (found.poses.size() < 2) return;
  const PosePath path = path_of(found.poses, capture);
  std::vector<const LatentImage*> middles;
  for (const LatentImage& image : images) {
    const Shot& shot = capture.shots[static_cast<size_t>(image.shot)];
    if (shot.duration_us() > 0 && image.t_us == shot.t_mid_us()) middles.push_back(&image);
  }
  std::vector<PosedExposure> exposures;
  std::vector<double> measured;
  for (const size_t i : spread(middles.size())) {
    const LatentImage& image = *middles[i];
    const Shot& shot = capture.shots[static_cast<size_t>(image.shot)];
    PosedExposure e;
    e.blurry = shot.image;
    e.sharp = at::adaptive_avg_pool2d(imaging::read_image(latents / "images" / image.file),
                                      {shot.image.size(1), shot.image.size(2)});
    e.camera = found.camera;
    for (const double t : geometry::exposure_times(shot.t_start_us, shot.t_end_us)) {
      e.poses.push_back(path.at(t));
    }
    for (size_t k = 0; k < found.seen_by.size(); ++k) {
      const bool seen = std::any_of(
          found.seen_by[k].begin(), found.seen_by[k].end(),
          [&](int64_t pose) { return found.poses[static_cast<size_t>(pose)].shot == image.shot; });
      if (seen) e.points.push_back(point_at(found.points, static_cast<int64_t>(k)));
    }
    exposures.push_back(std::move(e));
    if (shot.blur_px >= 0) measured.push_back(shot.blur_px);
  }
  attempt.explained_blur = exposures.empty() ? 1 : explained_blur(exposures);
  attempt.blur_px = std::max(posed_blur_px(exposures), median_of(std::move(measured)));
}

/// Angle of view of the longer side, degrees.
double view_of(const geometry::Intrinsics& camera) {
  return 2 * std::atan(0.5 * std::max(camera.width, camera.height) / camera.fx) * 180 / M_PI;
}

bool is_doubtful(const geometry::Intrinsics& camera) {
  return view_of(camera) < kNarrowest_deg || view_of(camera) > kWidest_deg;
}

std::string focal_text(const geometry::Intrinsics& camera) {
  return concat(readable(camera.fx, 4), " px, a view of ", std::lround(view_of(camera)),
                " degrees");
}

[[noreturn]] void fail(const std::vector<Attempt>& tried, const FrameMotion& motion) {
  std::string all;
  for (const Attempt& a : tried) all += (all.empty() ? "" : "; ") + sentence(a);
  const bool parallax = std::any_of(tried.begin(), tried.end(), [](const Attempt& a) {
    return a.registered > 1 && a.parallax_deg >= kLeastParallax_deg;
  });
  if (stands_still(motion) && !parallax) {
    throw DataError(concat("poses: expected a moving camera, found frames that do not move (",
                           said_of(motion), ") and no poses by COLMAP (", all,
                           "); without parallax there is no depth: move sideways around the "
                           "scene"));
  }
  throw DataError(concat(
      "poses: expected structure from motion to place at least two thirds of the images and to "
      "explain their blur, found ",
      all,
      "; record with sideways motion around the scene, more texture and light and slower turns "
      "(docs/troubleshooting.md)"));
}

/// Writes masks at the size of the images, `scale` times that of the shots.
void write_masks(const std::vector<LatentImage>& images, const Capture& capture, int64_t scale,
                 const fs::path& work, ColmapJob& job) {
  const auto write = [&](const fs::path& path, const torch::Tensor& mask) {
    make_writable_folder(path.parent_path());
    imaging::write_image(
        path, mask.to(torch::kFloat32).repeat_interleave(scale, 1).repeat_interleave(scale, 2));
  };
  if (capture.mask.defined()) {
    job.mask = work / "mask.png";
    write(job.mask, capture.mask);
  }
  const auto& shots = capture.shots;
  if (std::none_of(shots.begin(), shots.end(), [](const Shot& s) { return s.mask.defined(); }))
    return;
  // COLMAP skips images without a mask as soon as others have one.
  const torch::Tensor whole = torch::ones({1, capture.height(), capture.width()});
  job.own_masks = work / "masks";
  for (const LatentImage& image : images) {
    const torch::Tensor& mask = shots[size_t(image.shot)].mask;
    write(job.own_masks / (image.file + ".png"), mask.defined() ? mask : whole);
  }
}

ColmapJob job_of(const fs::path& folder, const std::vector<LatentImage>& images,
                 const Capture& capture, const ImportOptions& options, const fs::path& work) {
  const std::optional<geometry::Intrinsics>& camera = capture.camera;
  ColmapJob job;
  job.program = find_colmap(options.poses.colmap);
  job.images = folder / "images";
  job.count = static_cast<int64_t>(images.size());
  if (camera) {
    job.camera = geometry::scaled(*camera, camera->width * options.latents.upscale,
                                  camera->height * options.latents.upscale);
  }
  write_masks(images, capture, options.latents.upscale, work, job);
  const bool all = options.poses.pairs == PairChoice::kExhaustive ||
                   (options.poses.pairs == PairChoice::kAuto && images.size() <= kMostExhaustive);
  if (all) return job;
  for (const auto& [a, b] : sequential_pairs(images)) {
    job.pairs.emplace_back(images[a].file, images[b].file);
  }
  return job;
}

Json json_of(const Attempt& a) {
  return {{"name", a.name},
          {"images", a.images},
          {"registered", a.registered},
          {"points", a.points},
          {"observations", a.observations},
          {"reprojection_error_px", a.error_px},
          {"parallax_deg", a.parallax_deg},
          {"explained_blur", a.explained_blur},
          {"blur_px", a.blur_px},
          {"problem", a.problem}};
}

}  // namespace

std::vector<std::pair<size_t, size_t>> sequential_pairs(const std::vector<LatentImage>& images) {
  std::set<std::pair<size_t, size_t>> pairs;
  std::map<int64_t, std::vector<size_t>> of_shot;
  for (size_t i = 0; i < images.size(); ++i) {
    of_shot[images[i].shot].push_back(i);
    for (size_t k = i + 1; k <= i + kNeighbours && k < images.size(); ++k) pairs.insert({i, k});
  }
  std::vector<size_t> middles, some;
  for (const auto& [shot, own] : of_shot) middles.push_back(own[own.size() / 2]);
  const size_t count = std::min(middles.size(), kLoopShots);
  for (size_t i = 0; i < count; ++i) some.push_back(middles[i * middles.size() / count]);
  for (const size_t a : some) {
    for (const size_t b : some) {
      if (a < b) pairs.insert({a, b});
    }
  }
  return {pairs.begin(), pairs.end()};
}

SearchResult find_poses(const fs::path& latents, const std::vector<LatentImage>& images,
                        const Capture& capture, const ImportOptions& options,
                        const fs::path& work) {
  const FrameMotion motion = motion_of(capture);
  if (stands_still(motion)) {
    log_warn(concat("poses: expected frames that move by a pixel or more, found ", said_of(motion),
                    "; COLMAP is asked all the same"));
  }
  const ColmapJob job = job_of(latents, images, capture, options, work);
  SearchResult result;
  Attempt chosen;
  bool doubted = false;  // the focal length of the chosen one
  std::string matched;   // flags of the extracted features
  fs::path folder;
  for (const ColmapSettings& settings : attempts()) {
    // With a known focal length the repetition has the flags and seeds of the attempt before. If
    // no pair of images began a model there, none does now.
    const bool same = settings.hold_focal_length && job.camera;
    if (same && result.attempts.back().registered == 0) continue;
    std::string flags;
    for (const auto* list : {&settings.extraction, &settings.matching}) {
      for (const std::string& flag : *list) flags += flag + " ";
    }
    if (folder.empty() || flags != matched) {
      folder = work / settings.name;
      fs::remove_all(folder);
      match_features(job, settings, folder);
      matched = flags;
    }
    Attempt best{settings.name, job.count, 0, 0, 0, 0, 0, 0, 0, "no pair of images to begin with"};
    Reconstruction found;
    fs::path best_model;
    const auto compare = [&](const std::vector<fs::path>& models) {
      for (const fs::path& model : models) {
        Reconstruction r = read_reconstruction(model, images, double(options.latents.upscale));
        Attempt attempt = attempt_of(settings.name, images.size(), r);
        check_blur(latents, images, capture, r, attempt);
        if (!fits_better(attempt, best)) continue;
        best = attempt, best_model = model;
        found = std::move(r);
      }
    };
    // On 17 simulated recordings of a known focal length, global mapping placed all images, at most
    // 1.3 px off; incremental mapping was up to 61 px off. With an unknown one it has no lead: on
    // slider_depth 4.5 px, incremental mapping 3.4 to 4.1 px (docs/engineering/import.md).
    if (job.camera && result.attempts.empty()) {
      compare(reconstruct_globally(job, settings, folder));
    }
    if (!is_enough(best, 1)) compare(reconstruct(job, settings, folder));
    const fs::path reversed =
        explains_blur(best) ? reverse_depths(job, settings, best_model, folder) : fs::path();
    if (!reversed.empty()) {
      Reconstruction r = read_reconstruction(reversed, images, double(options.latents.upscale));
      Attempt attempt = attempt_of(settings.name, images.size(), r);
      check_blur(latents, images, capture, r, attempt);
      log_info(concat("  with near and far exchanged: error ", readable(attempt.error_px, 2),
                      " px, before ", readable(best.error_px, 2), " px"));
      if (explains_blur(attempt) && attempt.registered >= best.registered) {
        best = attempt;
        found = std::move(r);
      }
    }
    const bool held = settings.hold_focal_length && !job.camera;
    const bool settles =
        doubted && held && explains_blur(best) && best.registered >= chosen.registered &&
        (!best.has_blur() || best.explained_blur >= chosen.explained_blur - kHeldMargin);
    if (best.registered > 0 &&
        (result.best.poses.empty() || settles || is_better(best, chosen, kClearlyBetter))) {
      const std::string why = settles ? concat("found ", focal_text(result.best.camera))
                                      : std::string("left out images");
      result.best = std::move(found);
      doubted = !held && !job.camera && is_doubtful(result.best.camera);
      chosen = best;
      result.chosen = result.attempts.size();
      result.warning = held      ? concat("poses: with a free focal length COLMAP ", why, ", so ",
                                          readable(result.best.camera.fx, 3),
                                          " px was assumed; pass --calibration if you have one")
                       : doubted ? concat("poses: COLMAP found a focal length of ",
                                          focal_text(result.best.camera),
                                          ", which may be wrong; pass --calibration")
                                 : "";
    }
    log_info(concat("  ", sentence(best), ", ", best.points, " points, ", best.observations,
                    " observations, error ", readable(best.error_px, 2), " px"));
    result.attempts.push_back(best);
    const bool repeats = doubted && result.attempts.size() == 1;
    if (is_enough(chosen, result.attempts.size()) && !repeats) break;
    // Two agreeing signs: the frames do not move, and COLMAP finds no initial pair.
    if (stands_still(motion) && best.registered == 0) break;
  }
  const bool enough = double(result.best.poses.size()) >= kLeastShare * double(images.size());
  if (!enough || !explains_blur(chosen)) fail(result.attempts, motion);
  return result;
}

void keep_reconstruction(const fs::path& folder, const SearchResult& result) {
  const Reconstruction& r = result.best;
  Json poses = Json::array();
  for (const TimedPose& timed : r.poses) {
    poses.push_back({{"t_us", timed.t_us},
                     {"shot", timed.shot},
                     {"rotation", timed.pose.rotation},
                     {"translation", timed.pose.translation},
                     {"observations", timed.observations}});
  }
  Json tried = Json::array();
  for (const Attempt& attempt : result.attempts) tried.push_back(json_of(attempt));
  const Json all{{"focal_px", r.camera.fx},
                 {"width", r.camera.width},
                 {"height", r.camera.height},
                 {"chosen", result.attempts[result.chosen].name},
                 {"attempts", tried},
                 {"seen_by", r.seen_by},
                 {"poses", poses}};
  write_file(folder / "poses.json", all.dump() + "\n");
  io::write_npz(folder / "points.npz",
                {{"points", r.points}, {"colors", r.colors}, {"errors_px", r.point_errors}});
}

Reconstruction load_reconstruction(const fs::path& folder) {
  Reconstruction r;
  try {
    const Json all = Json::parse(read_file(folder / "poses.json"));
    r.camera = geometry::Intrinsics::centred(all.at("focal_px"), all.at("width"), all.at("height"));
    all.at("seen_by").get_to(r.seen_by);
    for (const Json& json : all.at("poses")) {
      TimedPose timed{json.at("t_us"), json.at("shot"), {}, json.at("observations")};
      json.at("rotation").get_to(timed.pose.rotation);
      json.at("translation").get_to(timed.pose.translation);
      r.poses.push_back(timed);
    }
  } catch (const Json::exception& error) {
    throw DataError(concat((folder / "poses.json").string(),
                           ": expected what this program wrote, found ", error.what(),
                           "; import again with --from poses"));
  }
  const io::Npz points(folder / "points.npz");
  r.points = points.read("points");
  r.colors = points.read("colors");
  r.point_errors = points.read("errors_px");
  return r;
}

}  // namespace jade::import
