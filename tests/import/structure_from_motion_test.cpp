// SPDX-License-Identifier: Apache-2.0
#include "jade/import/structure_from_motion.h"

#include "support/catch.h"

#include <algorithm>
#include <sys/stat.h>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

/// A shell script in place of COLMAP.
fs::path program(const fs::path& path, const std::string& text) {
  write_file(path, "#!/bin/sh\n" + text);
  chmod(path.c_str(), 0755);
  return path;
}

std::vector<import::LatentImage> four_images() {
  return {{"00000_0.png", 0, 0},
          {"00000_4.png", 0, 50},
          {"00001_0.png", 1, 100},
          {"00001_4.png", 1, 150}};
}

/// A mapper that writes a model of `images` images, at depth 4 from its two points.
std::string mapper_of(int images) {
  std::string text =
      "case $1 in mapper) ;; *) exit 0;; esac\n"
      "while [ $1 != --output_path ]; do shift; done\nmkdir -p $2/0; cd $2/0\n"
      "echo '1 SIMPLE_PINHOLE 60 40 50 30 20' > cameras.txt\n"
      "echo '7 0 0 4 1 2 3 0.5 1 0 2 0' > points3D.txt\n"
      "echo '8 1 0 4 1 2 3 1.5 1 1 2 1' >> points3D.txt\n: > images.txt\n";
  const auto list = four_images();
  for (int i = 0; i < images; ++i) {
    text += concat("echo '", i + 1, " 1 0 0 0 ", -0.4 * i, " 0 0 1 ", list[size_t(i)].file,
                   "' >> images.txt; echo >> images.txt\n");
  }
  return text;
}

struct Search {
  test::TempDir dir;
  import::ImportOptions options;
  import::Capture capture;  ///< two sharp frames, the second to the side of the first

  explicit Search(const std::string& colmap) {
    set_log_level("error");
    set_progress_enabled(false);
    options.poses.colmap = program(dir / "colmap", colmap);
    fs::create_directories(dir / "latents/images");
    torch::manual_seed(1);
    const auto image = torch::avg_pool2d(torch::rand({1, 3, 20, 30}), 3, 1, 1)[0];
    capture.shots = {{"a", image, 0, 0, 0}, {"b", torch::roll(image, 5, 2), 100, 100, 0}};
  }
  import::SearchResult find(){
      return import::find_poses(dir / "latents", four_images(), capture, options, dir / "work");
}
};  // namespace

}  // namespace

TEST_CASE("poses: a model becomes poses by time in units of its depth", "[import]") {
  Search search(mapper_of(4));
  const import::SearchResult result = search.find();
  const import::Reconstruction& r = result.best;
  REQUIRE(r.poses.size() == 4);
  CHECK(r.camera == geometry::Intrinsics::centred(25, 30, 20));
  CHECK(r.poses[3].t_us == 150);
  CHECK(r.poses[3].shot == 1);
  CHECK(r.poses[3].pose.translation[0] == Approx(-0.3));
  CHECK(r.points[1][2].item<double>() == Approx(1));
  CHECK(r.point_errors[1].item<double>() == Approx(0.75));
  CHECK(r.seen_by[0] == std::vector<int64_t>{0, 1});
  // All images are registered and their blur is explained, so there is no other attempt.
  CHECK(result.attempts.size() == 1);
  CHECK(Search(mapper_of(3)).find().attempts.size() == 4);
  CHECK(result.attempts[result.chosen].observations == 4);
  CHECK(result.attempts[result.chosen].parallax_deg > 1);

  import::keep_reconstruction(search.dir.path(), result);
  const import::Reconstruction kept = import::load_reconstruction(search.dir.path());
  CHECK(kept.camera == r.camera);
  CHECK(kept.poses[2].pose.translation == r.poses[2].pose.translation);
  CHECK(torch::equal(kept.points, r.points));
  CHECK(kept.seen_by == r.seen_by);
}

TEST_CASE("poses: an attempt that leaves out images is repeated with a held focal length",
          "[import]") {
  // The mapper registers the fourth image only with a held focal length.
  Search search("case \"$*\" in *refine_focal_length\\ 0*)\n" + mapper_of(4) + ";; *)\n" +
                mapper_of(3) + ";; esac");
  import::SearchResult result = search.find();
  CHECK(result.best.poses.size() == 4);
  REQUIRE(result.attempts.size() == 2);
  CHECK(result.attempts[result.chosen].name == "repeated");
  CHECK_THAT(result.warning, Catch::Contains("25 px") && Catch::Contains("--calibration"));

  // A known camera is held from the start.
  search.capture.camera = geometry::Intrinsics::centred(25, 30, 20);
  result = search.find();
  CHECK(result.attempts.size() == 1);
  CHECK(result.warning.empty());
}

TEST_CASE("poses: an implausible focal length gives way to a held one that explains as much",
          "[import]") {
  // With a free focal length the mapper finds that of a telescope.
  std::string far = mapper_of(4);
  far.replace(far.find("60 40 50 30 20"), 14, "60 40 900 30 20");
  const auto find = [&](int held_images) {
    return Search("case \"$*\" in *refine_focal_length\\ 0*)\n" + mapper_of(held_images) +
                  ";; *)\n" + far + ";; esac")
        .find();
  };
  const import::SearchResult settled = find(4);
  REQUIRE(settled.attempts.size() == 2);
  CHECK(settled.attempts[settled.chosen].name == "repeated");
  CHECK(settled.best.camera.fx == Approx(25));
  CHECK_THAT(settled.warning, Catch::Contains("450 px, a view of 4 degrees") &&
                                  Catch::Contains("25 px was assumed"));
  // A held focal length that leaves out an image is not the camera's.
  const import::SearchResult kept = find(3);
  CHECK(kept.attempts[kept.chosen].name == "usual");
  CHECK(kept.best.camera.fx == Approx(450));
  CHECK_THAT(kept.warning,
             Catch::Contains("450 px") && Catch::Contains("may be wrong; pass --calibration"));
}

TEST_CASE("poses: an image far off its neighbours is left out if it sees other points",
          "[import]") {
  struct Case {
    double off;
    bool sees_others;
    size_t kept;
  };
  for (const Case& c : {Case{0, true, 12}, Case{0.4, true, 11}, Case{0.4, false, 12}}) {
    const test::TempDir dir;
    std::vector<import::LatentImage> images;
    std::string poses, track;
    for (int k = 0; k < 12; ++k) {
      images.push_back({concat(k, ".png"), k, 1000 * k});
      // A camera that moves sideways in steps of 0.1, slightly irregular.
      const double x = 0.1 * k + 0.004 * ((k * 7) % 3) - (k == 5 ? c.off : 0);
      poses += concat(k + 1, " 1 0 0 0 ", -x, " 0 0 1 ", k, ".png\n\n");
      if (k != 5 || !c.sees_others) track += concat(" ", k + 1, " 0");
    }
    dir.write("cameras.txt", "1 SIMPLE_PINHOLE 60 40 50 30 20\n");
    dir.write("images.txt", poses);
    dir.write("points3D.txt", "7 0 0 4 1 2 3 0.5" + track + "\n8 1 0 4 1 2 3 0.5" + track +
                                  "\n9 2 0 4 1 2 3 0.5 6 0\n");
    const import::Reconstruction r = import::read_reconstruction(dir.path(), images, 2);
    REQUIRE(r.poses.size() == c.kept);
    CHECK(r.poses[5].shot == (c.kept == 11 ? 6 : 5));
    CHECK(r.seen_by[0].size() == (c.sees_others ? 11 : 12));
    CHECK(r.seen_by[0].back() == int64_t(r.poses.size()) - 1);
  }
}

TEST_CASE("poses: the better of two models of one attempt is taken", "[import]") {
  std::string second = mapper_of(4);
  const auto replace = [&](const std::string& from, const std::string& to) {
    second.replace(second.find(from), from.size(), to);
  };
  replace("mkdir -p $2/0; cd $2/0", "mkdir -p $2/1; cd $2/1");
  Search search("(" + mapper_of(3) + ")\n" + second);
  const import::SearchResult result = search.find();
  CHECK(result.best.poses.size() == 4);
  CHECK(result.attempts[result.chosen].registered == 4);
}

TEST_CASE("poses: of several mappings of the same matches the one with the smallest error is taken",
          "[import]") {
  // The error of the second mapping is a tenth of the others.
  std::string better = mapper_of(4);
  for (const auto& [from, to] :
       {std::pair{" 0.5 1 0 2 0", " 0.1 1 0 2 0"}, {" 1.5 1 1 2 1", " 0.1 1 1 2 1"}}) {
    better.replace(better.find(from), std::string(from).size(), to);
  }
  Search search("case \"$*\" in *usual_1*)\n" + better + ";; *)\n" + mapper_of(4) + ";; esac");
  const import::SearchResult result = search.find();
  REQUIRE(result.attempts.size() == 1);
  CHECK(result.attempts[0].error_px == Approx(0.05));
}

TEST_CASE("poses: a global model of all images that explains the blur is enough", "[import]") {
  const std::string says =
      "[ \"$2\" = -h ] && echo \"--GlobalMapper.ba_refine_focal_length arg (=1)\" && exit 0\n"
      "echo \"$@\" >> ${0%/*}/calls.txt\n";
  const auto global = [&](const std::string& mapper) {
    return says + "if [ $1 = global_mapper ]; then shift; set -- mapper \"$@\"\n" + mapper +
           "exit 0; fi\n" + mapper_of(4);
  };
  Search enough(global(mapper_of(4)));
  enough.capture.camera = geometry::Intrinsics::centred(25, 30, 20);
  CHECK(enough.find().attempts.size() == 1);
  const std::string calls = read_file(enough.dir / "calls.txt");
  CHECK_THAT(calls, Catch::Contains("--GlobalMapper.ba_refine_focal_length 0") &&
                        Catch::Contains("usual_global") && !Catch::Contains("\nmapper"));
  // With an unknown focal length there is no global mapping.
  Search unknown(global(mapper_of(4)));
  unknown.find();
  CHECK_THAT(read_file(unknown.dir / "calls.txt"), !Catch::Contains("usual_global"));
  // One that leaves out an image, and none, are followed by incremental mappings.
  for (const std::string& mapper : {mapper_of(3), std::string()}) {
    Search few(global(mapper));
    few.capture.camera = enough.capture.camera;
    const import::SearchResult result = few.find();
    CHECK(result.best.poses.size() == 4);
    CHECK(result.attempts.size() == 1);
    CHECK_THAT(read_file(few.dir / "calls.txt"), Catch::Contains("\nmapper"));
  }
}

TEST_CASE("poses: of many images only neighbours and one of each shot are compared", "[import]") {
  std::vector<import::LatentImage> images;
  for (int64_t shot = 0; shot < 60; ++shot) {
    for (int64_t k = 0; k < 3; ++k)
      images.push_back({concat(shot, "_", k, ".png"), shot, 100 * shot + 40 * k});
  }
  const auto pairs = import::sequential_pairs(images);
  CHECK(pairs.size() < 2500);  // of 16,110
  const auto holds = [&](size_t a, size_t b) {
    return std::find(pairs.begin(), pairs.end(), std::pair{a, b}) != pairs.end();
  };
  CHECK((holds(0, 1) && holds(0, 9) && holds(170, 179)));
  CHECK((holds(1, 1 + 3 * 30) && !holds(0, 3 * 30)));
  // COLMAP receives the list.
  Search search("echo \"$@\" >> ${0%/*}/calls.txt\n" + mapper_of(4));
  search.options.poses.pairs = import::PairChoice::kSequential;
  search.find();
  CHECK_THAT(read_file(search.dir / "calls.txt"),
             Catch::Contains("matches_importer") && !Catch::Contains("exhaustive"));
  CHECK_THAT(read_file(search.dir / "work/usual/pairs.txt"),
             Catch::Contains("00000_0.png 00001_4.png\n"));
}

TEST_CASE("poses: two good models are enough, be an image missing", "[import]") {
  // 20 sharp shots, 19 of which the mapper registers.
  std::string text = mapper_of(0);
  Search search("");
  std::vector<import::LatentImage> images;
  search.capture.shots.clear();
  for (int64_t i = 0; i < 20; ++i) {
    images.push_back({concat(i, ".png"), i, 100 * i});
    search.capture.shots.push_back({concat(i), torch::rand({3, 20, 30}), 100 * i, 100 * i, 0});
    if (i < 19)
      text += concat("echo '", i + 1, " 1 0 0 0 ", -0.1 * double(i), " 0 0 1 ", i,
                     ".png' >> images.txt; echo >> images.txt\n");
  }
  program(search.dir / "colmap", text);
  const import::SearchResult result = import::find_poses(
      search.dir / "latents", images, search.capture, search.options, search.dir / "work");
  CHECK(result.attempts.size() == 2);
  CHECK(result.best.poses.size() == 19);
  CHECK(result.warning.empty());
}

TEST_CASE("poses: too few images say what to record", "[import]") {
  Search search(mapper_of(2));
  CHECK_THROWS_WITH(search.find(), Catch::Contains("2 of 4 images") && Catch::Contains("record"));
}

TEST_CASE("poses: a model with all images in it is refused where it does not explain their blur",
          "[import]") {
  // A plane at depth 2 in front of a camera of 100 px that moves sideways by 12 px in each
  // exposure.
  torch::manual_seed(4);
  const auto texture = torch::avg_pool2d(torch::rand({1, 1, 90, 130}), 3, 1, 1)[0];
  double speed = 0.12;
  const auto way_px = [&](double t_us) { return speed * t_us; };
  const auto picture = [&](double t_us) {
    const double way = way_px(t_us), part = way - std::floor(way);
    return ((1 - part) * torch::roll(texture, int64_t(std::floor(way)), 2) +
            part * torch::roll(texture, int64_t(std::ceil(way)), 2))
        .expand({3, 90, 130})
        .contiguous();
  };
  struct Case {
    double speed;
    bool right, accepted;
  };
  // Blur of a pixel is within the noise: no evidence against poses.
  for (const Case& c : {Case{0.12, true, true}, {0.12, false, false}, {0.01, false, true}}) {
    const bool right = c.right;
    speed = c.speed;
    CAPTURE(c.speed, c.right);
    Search search(
        "case $1 in mapper) ;; *) exit 0;; esac\n"
        "while [ $1 != --output_path ]; do shift; done\ncp -r ${0%/*}/model $2/0\n");
    std::vector<import::LatentImage> images;
    std::string poses, track, points;
    search.capture.shots.clear();
    for (int64_t shot = 0; shot < 2; ++shot) {
      const int64_t start = 200 * shot;
      auto blurry = torch::zeros({3, 90, 130});
      for (int k = 0; k < 9; ++k)
        blurry += picture(double(start) + 12.5 * k) * ((k == 0 || k == 8 ? 0.5 : 1.0) / 8);
      search.capture.shots.push_back({concat(shot), blurry, start, start + 100, 0});
      for (const int64_t k : {0, 4, 8}) {
        const int64_t t = start + 100 * k / 8;
        images.push_back({concat(shot, "_", k, ".png"), shot, t});
        const double shift = way_px(double(t)) * 2 / 100;
        poses += concat(images.size(), " 1 0 0 0 ", right ? shift : 0, " ", right ? 0 : shift,
                        " 0 1 ", images.back().file, "\n\n");
        track += concat(" ", images.size(), " 0");
        const auto large = picture(double(t)).repeat_interleave(2, 1).repeat_interleave(2, 2);
        imaging::write_image(search.dir / "latents/images" / images.back().file, large);
      }
    }
    int id = 0;
    for (double x = -0.8; x < 0.9; x += 0.2) {
      for (double y = -0.5; y < 0.6; y += 0.2)
        points += concat(++id, " ", x, " ", y, " 2 1 2 3 0.5", track, "\n");
    }
    search.dir.write("model/cameras.txt", "1 SIMPLE_PINHOLE 260 180 200 130 90\n");
    search.dir.write("model/images.txt", poses);
    search.dir.write("model/points3D.txt", points);
    const auto find = [&] {
      return import::find_poses(search.dir / "latents", images, search.capture, search.options,
                                search.dir / "work");
    };
    if (c.accepted) {
      const import::SearchResult result = find();
      const import::Attempt& chosen = result.attempts[result.chosen];
      CHECK(result.best.poses.size() == 6);
      CHECK(chosen.has_blur() == right);
      CHECK(chosen.blur_px == Approx(100 * speed).epsilon(0.1));
      CHECK((chosen.explained_blur > 0.8) == right);
    } else {
      CHECK_THROWS_WITH(find(),
                        test::naming("usual: 6 of 6 images") && test::naming("% of the blur"));
    }
  }
}

TEST_CASE("poses: frames that seem still are refused only where COLMAP fails", "[import]") {
  const auto stand_still = [](Search& search) {
    search.capture.shots[1].image = search.capture.shots[0].image;
  };
  Search placed(mapper_of(4));
  stand_still(placed);
  CHECK(placed.find().best.poses.size() == 4);
  // If COLMAP always gives the same result, no other attempt follows.
  Search refused("echo $1 >> ${0%/*}/calls.txt\n");
  stand_still(refused);
  CHECK_THROWS_WITH(refused.find(), test::naming("moving camera") &&
                                        test::naming("1 pairs of frames") &&
                                        test::naming("usual: no pair"));
  CHECK(read_file(refused.dir / "calls.txt").find("mapper\nfeature") == std::string::npos);
}

TEST_CASE("poses: a model without parallax is refused", "[import]") {
  std::string flat = mapper_of(4);
  const std::string depth = " 0 4 1 2 3";  // of both points
  for (size_t at = flat.find(depth); at != std::string::npos; at = flat.find(depth)) {
    flat.replace(at, depth.size(), " 0 4000 1 2 3");
  }
  CHECK_THROWS_WITH(Search(flat).find(), Catch::Contains("parallax 0.0"));
}

TEST_CASE("poses: no model, and a COLMAP that fails, are reported", "[import]") {
  Search none("exit 0\n");
  const auto wide = torch::avg_pool2d(torch::rand({1, 3, 120, 160}), 3, 1, 1)[0];
  none.capture.shots[0].image = wide,
  none.capture.shots[1].image = torch::roll(wide, {-3, 7}, {1, 2});
  CHECK_THROWS_NAMING(DataError, none.find(), "no pair", "repeated");
  none.capture.camera = geometry::Intrinsics::centred(25, 30, 20);
  CHECK_THROWS_WITH(none.find(),
                    test::naming("weak_corners: no pair") && !Catch::Contains("repeated"));
  Search failing("echo 'Check failed: no space'; exit 1\n");
  CHECK_THROWS_WITH(failing.find(),
                    test::naming("COLMAP: features") && Catch::Contains("no space"));
  Search gone("exit 0\n");
  gone.options.poses.colmap = gone.dir / "nowhere";
  CHECK_THROWS_NAMING(DataError, gone.find(), "nowhere", "colmap");
}

TEST_CASE("poses: a COLMAP since 3.13 gets its flags by its names", "[import]") {
  const std::string says =
      "[ \"$2\" = -h ] && echo \"--FeatureExtraction.use_gpu arg (=1)\" && exit 0\n"
      "echo \"$@\" >> ${0%/*}/calls.txt\n";
  const auto calls_of = [](Search& search) {
    search.find();
    return read_file(search.dir / "calls.txt");
  };
  Search old("echo \"$@\" >> ${0%/*}/calls.txt\n" + mapper_of(3));
  CHECK_THAT(calls_of(old), Catch::Contains("--SiftExtraction.use_gpu 0") &&
                                Catch::Contains("--SiftMatching.guided_matching 1"));
  Search recent(says + mapper_of(3));
  const std::string calls = calls_of(recent);
  CHECK_THAT(calls, Catch::Contains("--FeatureExtraction.use_gpu 0") &&
                        Catch::Contains("--FeatureMatching.use_gpu 0") &&
                        Catch::Contains("--FeatureMatching.guided_matching 1") &&
                        Catch::Contains("--SiftExtraction.first_octave 0"));
  CHECK_THAT(calls, !Catch::Contains("--SiftMatching") && !Catch::Contains("--SiftExtraction.use"));
}

TEST_CASE("poses: COLMAP gets the mask of all images and those of single ones", "[import]") {
  Search search("echo \"$@\" >> ${0%/*}/calls.txt\n" + mapper_of(4));
  torch::Tensor mask = torch::ones({1, 20, 30}, torch::kBool);
  mask.slice(2, 0, 7).fill_(false);
  search.capture.shots[1].mask = mask;
  search.options.latents.upscale = 2;
  search.find();
  const fs::path masks = search.dir / "work/masks";
  CHECK_THAT(read_file(search.dir / "calls.txt"),
             Catch::Contains("--ImageReader.mask_path " + masks.string()) &&
                 !Catch::Contains("camera_mask_path"));
  CHECK(imaging::read_mask(masks / "00000_0.png.png").all().item<bool>());
  const torch::Tensor written = imaging::read_mask(masks / "00001_4.png.png");
  CHECK(written.equal(mask.repeat_interleave(2, 1).repeat_interleave(2, 2)));
  search.capture.shots[1].mask = torch::Tensor();
  search.capture.mask = mask;
  search.find();
  CHECK_THAT(read_file(search.dir / "calls.txt"),
             Catch::Contains("--ImageReader.camera_mask_path"));
}
