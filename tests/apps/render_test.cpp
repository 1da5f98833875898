// SPDX-License-Identifier: Apache-2.0
// jade_render from the command line: the film of an exposure, with and without ffmpeg, and bad
// input.
#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/gaussians/ply.h"
#include "jade/imaging/image_io.h"
#include "support/programs.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;
using test::check_error;
using test::Outcome;
using test::run;

namespace {

namespace fs = std::filesystem;

/// A scene trained for two steps with five moments per exposure.
struct TrainedScene {
  test::TempDir dir;
  TrainedScene() {
    test::write_tiny_dataset(dir / "scene");
    const Outcome trained =
        run(dir,
            "jade_train --quiet --device cpu --set dataset.path=scene --set init.points=100 "
            "--set objective.target=edi --set exposure.samples=5 --set train.iterations=2 "
            "--output run");
    INFO(trained.err);
    REQUIRE(trained.code == 0);
  }
  Outcome render(const std::string& flags) const {
    return run(dir, "jade_render --quiet --device cpu --run run " + flags);
  }
  /// Runs jade_render with `body` as the only ffmpeg; its output file (file:NAME) is $out.
  Outcome render_with(const std::string& body, const std::string& flags) const {
    const auto path =
        dir.write("bin/ffmpeg", "#!/bin/sh\nfor out; do :; done\nout=${out#file:}\n" + body + "\n");
    fs::permissions(path, fs::perms::owner_all);
    return without_path("bin", flags);
  }
  Outcome without_path(const std::string& folder, const std::string& flags) const {
    return run(dir, "program=$(command -v jade_render); PATH=$PWD/" + folder +
                        " $program --quiet --device cpu --run run " + flags);
  }
};

}  // namespace

TEST_CASE("jade_render --unblur: the blurry frame, then the moments that the run renders",
          "[apps]") {
  const TrainedScene scene;
  const Outcome frames = scene.render("--unblur 01 --output frames");
  INFO(frames.err);
  CHECK(frames.code == 0);
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(scene.dir / "frames")) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  CHECK(names == std::vector<std::string>{"01_0.png", "01_1.png", "01_2.png", "01_3.png",
                                          "01_4.png", "01_blurry.png"});
  const auto picture = [&](const fs::path& path) { return imaging::read_image(scene.dir / path); };
  CHECK(torch::equal(picture("frames/01_blurry.png"), picture("scene/images_1/01.png")));
  // Five equal moments are every second of the nine poses.
  CHECK(scene.render("--cameras exposure --exposure 01 --output poses").code == 0);
  for (const int k : {0, 2, 4}) {
    CHECK(torch::allclose(picture(concat("frames/01_", k, ".png")),
                          picture(concat("poses/01_", 2 * k, ".png")), 0, 1.01 / 255));
  }
  CHECK_FALSE(torch::equal(picture("frames/01_0.png"), picture("frames/01_4.png")));
  const Outcome more =
      scene.render("--unblur 00 --set exposure.samples=11 --format npy --output more");
  INFO(more.err);
  CHECK(more.code == 0);
  for (const char* name : {"00_blurry.npy", "00_00.npy", "00_10.npy"}) {
    CHECK(fs::exists(scene.dir / "more" / name));
  }
}

TEST_CASE(
    "jade_render --unblur: a film holds the blurry frame for a second, each moment for a "
    "sixth",
    "[apps]") {
  const TrainedScene scene;
  const Outcome film =
      scene.render_with("/bin/cat > \"$out\"", "--unblur 01 --format mp4 --fps 12 --output films");
  INFO(film.err);
  CHECK(film.code == 0);
  const std::string bytes = read_file(scene.dir / "films/01.mp4");
  const size_t frame = 36 * 28 * 3;
  REQUIRE(bytes.size() == frame * (12 + 5 * 2));
  const auto shown = [&](size_t k) { return bytes.substr(k * frame, frame); };
  CHECK(shown(0) == shown(11));
  CHECK(shown(11) != shown(12));
  CHECK(shown(12) == shown(13));
  CHECK(shown(13) != shown(14));
  CHECK(scene.render_with("/bin/cat > \"$out\"", "--unblur 01 --format mp4 --output a.mp4").code ==
        0);
  CHECK(fs::exists(scene.dir / "a.mp4"));
  check_error(scene.render_with("exit 1", "--unblur 01 --format mp4 --output failed.mp4"), 3,
              "ffmpeg");
  CHECK_FALSE(fs::exists(scene.dir / "failed.mp4"));
  // Rejects a folder with the film's name before reading any input.
  fs::create_directories(scene.dir / "taken/01.mp4");
  fs::remove(scene.dir / "run/point_cloud.ply");
  fs::remove_all(scene.dir / "run/checkpoints");
  for (const char* output : {"taken", "taken/01.mp4"}) {
    check_error(scene.render_with("/bin/cat > \"$out\"",
                                  concat("--unblur 01 --format mp4 --output ", output)),
                2, "--output", "taken/01.mp4");
  }
}

TEST_CASE("jade_render: views that see no Gaussian are named", "[apps]") {
  const TrainedScene scene;
  const auto render = [&](const char* z) {
    scene.dir.write("away.json",
                    concat("[{\"id\": 0, \"img_name\": \"there\", \"width\": 32, \"height\": 24, "
                           "\"position\": [0, 0, ",
                           z,
                           "], \"rotation\": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "
                           "\"fx\": 40, \"fy\": 40}]"));
    return scene.render("--cameras away.json --output seen" + std::string(z));
  };
  const Outcome away = render("1000");
  INFO(away.err);
  CHECK(away.code == 0);
  CHECK_THAT(away.err, Catch::Contains("1 of 1 views are black, there"));
  CHECK_THAT(render("-1").err, !Catch::Contains("black"));
}

TEST_CASE("jade_render: films of dark frames are brightened, images keep their values", "[apps]") {
  const TrainedScene scene;
  const auto mean_of_film = [&](const std::string& flags) {
    const Outcome film = scene.render_with(
        "/bin/cat > \"$out\"", "--unblur 01 --format mp4 --fps 12 --output film.mp4 " + flags);
    INFO(film.err);
    REQUIRE(film.code == 0);
    const std::string blurry = read_file(scene.dir / "film.mp4").substr(0, 36 * 28 * 3);
    double sum = 0;
    for (const char byte : blurry) sum += static_cast<unsigned char>(byte);
    return sum / double(blurry.size());
  };
  const double usual = mean_of_film("");
  CHECK(mean_of_film("--brightness 1") == usual);
  CHECK(mean_of_film("--brightness 0.5") == Approx(usual / 2).margin(1));
  for (const char* name : {"00.png", "01.png", "02.png"}) {
    const fs::path path = scene.dir / "scene/images_1" / name;
    imaging::write_image(path, 0.2 * imaging::read_image(path));
  }
  const double dark = mean_of_film("--brightness 1");
  CHECK(mean_of_film("") > 2 * dark);
  CHECK(scene.render("--unblur 01 --output frames").code == 0);
  CHECK(torch::equal(imaging::read_image(scene.dir / "frames/01_blurry.png"),
                     imaging::read_image(scene.dir / "scene/images_1/01.png")));
  check_error(scene.render("--unblur 01 --brightness 2 --output out"), 2, "--brightness",
              "--format mp4");
}

TEST_CASE("jade_render: films along a file of cameras are as bright as those of the data set",
          "[apps]") {
  const TrainedScene scene;
  for (const char* name : {"00.png", "01.png", "02.png"}) {
    const fs::path path = scene.dir / "scene/images_1" / name;
    imaging::write_image(path, 0.2 * imaging::read_image(path));
  }
  scene.dir.write("path.json",
                  R"([{"width":36,"height":28,"fx":40,"position":[0,0,0],
                       "rotation":[[1,0,0],[0,1,0],[0,0,1]]}])");
  const auto film = [&](const std::string& flags) {
    const Outcome outcome = scene.render_with(
        "/bin/cat > \"$out\"", "--cameras path.json --format mp4 --output film.mp4 " + flags);
    INFO(outcome.err);
    REQUIRE(outcome.code == 0);
    return std::pair{read_file(scene.dir / "film.mp4"), outcome.err};
  };
  const std::string plain = film("--brightness 1").first;
  CHECK(film("").first != plain);
  // The film does not need the data.
  fs::rename(scene.dir / "scene", scene.dir / "moved");
  const auto [bytes, told] = film("");
  CHECK(bytes == plain);
  CHECK_THAT(told, test::naming("scene", "--dataset", "--brightness"));
  CHECK(film("--dataset moved").first != plain);
}

TEST_CASE("jade_render: the poses of an exposure that is held out", "[apps]") {
  const TrainedScene scene;
  scene.dir.write("scene/held_out.txt", "01\n");
  const std::string render =
      "jade_render --quiet --device cpu --ply run/point_cloud.ply --dataset scene "
      "--cameras exposure ";
  const Outcome named = run(scene.dir, render + "--exposure 01 --output named");
  INFO(named.err);
  CHECK(named.code == 0);
  CHECK(fs::exists(scene.dir / "named/01_8.png"));
  CHECK(run(scene.dir, render + "--output all").code == 0);
  CHECK(fs::exists(scene.dir / "all/00_8.png"));
  CHECK_FALSE(fs::exists(scene.dir / "all/01_8.png"));
}

TEST_CASE("jade_render --depth: the depth of an opaque Gaussian as .npy and .png", "[apps]") {
  const test::TempDir dir;
  splat::Gaussians one;
  one.means = torch::tensor({{0.f, 0.f, 2.f}});
  one.log_scales = torch::full({1, 3}, std::log(0.4f));
  one.rotations = torch::tensor({{1.f, 0.f, 0.f, 0.f}});
  one.logit_opacities = torch::tensor({8.f});
  one.sh = torch::ones({1, 1, 3});
  gaussians::write_ply(dir / "one.ply", {one, false});
  dir.write("cameras.json",
            R"([{"name":"a","width":24,"height":16,"fx":20,"position":[0,0,-1],
                 "rotation":[[1,0,0],[0,1,0],[0,0,1]]}])");
  const std::string render =
      "jade_render --quiet --device cpu --ply one.ply --cameras cameras.json --depth ";
  const Outcome fine = run(dir, render + "--output fine");
  INFO(fine.err);
  REQUIRE(fine.code == 0);
  const torch::Tensor depth = io::read_npy(dir / "fine/a_depth.npy");
  REQUIRE(depth.sizes() == torch::IntArrayRef({1, 16, 24}));
  CHECK(depth[0][8][12].item<double>() == Approx(3));
  CHECK(depth[0][0][0].item<double>() == 0);
  const double full = 65535 * 0.001;
  const torch::Tensor png = imaging::read_image(dir / "fine/a_depth.png");
  CHECK(torch::allclose(png[0] * full, depth[0], 0, 0.00051));
  const Outcome told =
      run(dir, "jade_render --device cpu --ply one.ply --cameras cameras.json --output told");
  CHECK_THAT(told.out + told.err, Catch::Contains("1 view in "));
  // Steps so small that 65535 of them are not enough: the .png contains the maximum, with a
  // warning.
  const Outcome coarse = run(dir, render + "--depth-step 0.00001 --output coarse");
  CHECK(coarse.code == 0);
  CHECK_THAT(coarse.err, Catch::Contains("--depth-step"));
  CHECK(imaging::read_image(dir / "coarse/a_depth.png").max().item<double>() == 1);
  check_error(run(dir, render + "--format mp4 --output film"), 2, "--depth: expected with images");
}

TEST_CASE("jade_render: pictures of any data set, and of another view, are not replaced",
          "[apps]") {
  const TrainedScene scene;
  fs::copy(scene.dir / "scene", scene.dir / "other", fs::copy_options::recursive);
  fs::copy(scene.dir / "other/images_1", scene.dir / "other/frames");
  const auto camera = [](const std::string& name) {
    return concat(R"({"name":")", name, R"(","width":24,"height":16,"fx":20,"position":[0,0,-1],
                  "rotation":[[1,0,0],[0,1,0],[0,0,1]]})");
  };
  scene.dir.write("one.json", "[" + camera("00") + "]");
  scene.dir.write("two.json", "[" + camera("a") + "," + camera("a_depth") + "]");
  const auto render = [&](const std::string& flags) {
    return run(scene.dir, "jade_render --quiet --device cpu --ply run/point_cloud.ply " + flags);
  };
  const std::string frame = read_file(scene.dir / "other/frames/00.png");
  for (const char* folder : {"other/images_1", "other/images_1/below", "other/sharp"}) {
    check_error(render(concat("--cameras one.json --output ", folder)), 2, "--output", folder);
  }
  check_error(render("--cameras one.json --output other/frames"), 2, "--output", "00.png",
              "other/frames", "choose another");
  CHECK(read_file(scene.dir / "other/images_1/00.png") == frame);
  CHECK(read_file(scene.dir / "other/frames/00.png") == frame);
  CHECK(render("--cameras one.json --output other/renders").code == 0);
  CHECK(render("--cameras two.json --output two").code == 0);
  CHECK(render("--cameras two.json --output two").code == 0);
  check_error(render("--cameras two.json --depth --output depth"), 2, "--cameras", "a_depth.png");
  CHECK_FALSE(fs::exists(scene.dir / "depth"));
}

TEST_CASE("programs: a scene without Gaussians is none to draw or to write", "[apps]") {
  const test::TempDir dir;
  splat::Gaussians none;
  none.means = torch::zeros({0, 3});
  none.log_scales = torch::zeros({0, 3});
  none.rotations = torch::zeros({0, 4});
  none.logit_opacities = torch::zeros({0});
  none.sh = torch::zeros({0, 1, 3});
  gaussians::write_ply(dir / "none.ply", {none, false});
  const std::string told = "none.ply: expected Gaussians, found none";
  dir.write("cameras.json",
            R"([{"width":8,"height":6,"fx":9,"position":[0,0,0],
                 "rotation":[[1,0,0],[0,1,0],[0,0,1]]}])");
  check_error(run(dir,
                  "jade_render --quiet --device cpu --ply none.ply --cameras cameras.json "
                  "--output out"),
              3, told);
  check_error(run(dir, "jade_export --ply none.ply --output out/none.splat"), 3, told);
  CHECK_FALSE(fs::exists(dir / "out"));
}

TEST_CASE("jade_export: a wrong --output is reported before anything is read or made", "[apps]") {
  const test::TempDir dir;
  const std::string flags = "jade_export --ply missing.ply --output ";
  check_error(run(dir, flags + "made/a.obj"), 2, "--output", ".ply", ".sog", ".splat",
              "made/a.obj");
  CHECK_FALSE(fs::exists(dir / "made"));
  fs::create_directory(dir / "taken.spz");
  check_error(run(dir, flags + "taken.spz"), 2, "--output", "taken.spz");
  check_error(run(dir, flags + "made/a.sog --spz-version 4"), 2, "--spz-version", "made/a.sog");
}

TEST_CASE("jade_render: --depth-step without --depth would do nothing", "[apps]") {
  const test::TempDir dir;
  check_error(run(dir, "jade_render --ply a.ply --output out --depth-step 0.01"), 2, "--depth-step",
              "--depth");
}

TEST_CASE("jade_render: what renders would ignore is refused or named", "[apps]") {
  const test::TempDir dir;
  const std::string render = "jade_render --ply a.ply --output b --dataset c ";
  check_error(run(dir, render + "--json"), 2, "--json", "--fps-benchmark");
  for (const char* setting :
       {"--mask m.png", "--set dataset.mask=m.png", "--set dataset.color=gray"}) {
    CHECK_THAT(run(dir, render + setting).err,
               test::naming("does not change the renders", "--unblur"));
  }
  const std::string path = "jade_render --ply a.ply --output b --cameras c.json ";
  for (const char* setting :
       {"--dataset d", "--kind colmap", "--split last", "--set dataset.path=d"}) {
    check_error(run(dir, path + setting), 2, std::string(setting).substr(0, 6),
                ": expected with views of a data set", "c.json", "take it out");
  }
  check_error(run(dir, path + "--dataset c --brightness 2 --format mp4"), 2, "--dataset");
}

TEST_CASE("jade_render: without ffmpeg one line says how to get it, before anything is read",
          "[apps]") {
  const TrainedScene scene;
  fs::remove(scene.dir / "run/point_cloud.ply");
  fs::remove_all(scene.dir / "run/checkpoints");
  fs::create_directory(scene.dir / "empty");
  for (const char* what : {"--unblur 01", "--cameras test"}) {
    check_error(scene.without_path("empty", concat(what, " --format mp4 --output films")), 2,
                "ffmpeg", "PATH", "--format png");
  }
  CHECK_FALSE(fs::exists(scene.dir / "films"));
}

TEST_CASE("jade_render: a wrong exposure comes with those that are near", "[apps]") {
  const TrainedScene scene;
  check_error(scene.render("--unblur 0l --output out"), 2, "'0l'", "00, 01, 02");
  check_error(scene.render("--cameras exposure --exposure 11 --output out"), 2, "--exposure",
              "3 exposures");
  check_error(scene.render("--unblur elsewhere --output out"), 2, "00, 01, 02");
  check_error(scene.render("--unblur 01 --cameras test --output out"), 2, "--unblur", "--cameras");
  check_error(scene.render("--unblur 01"), 2, "--output");
  check_error(scene.render("--cameras train --output scene/images_1"), 2, "--output");
  check_error(scene.render("--exposure 01 --output out"), 2, "--exposure", "--cameras exposure");
  check_error(scene.render("--fps 10 --output out"), 2, "--fps");
  check_error(scene.render("--output film.mp4"), 2, "--format mp4");
  check_error(run(scene.dir,
                  "jade_render --quiet --device cpu --ply run/point_cloud.ply "
                  "--unblur 01 --output out"),
              2, "--unblur", "--run or --dataset");
  CHECK_FALSE(fs::exists(scene.dir / "out"));
}
