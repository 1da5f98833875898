// SPDX-License-Identifier: Apache-2.0
// jade_deblur and jade_eval from the command line: methods, pictures, the cache, and bad input.
#include "support/catch.h"

#include <nlohmann/json.hpp>
#include <torch/script.h>

#include "jade/core/error.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/programs.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;
using test::check_error;
using test::Outcome;
using test::run;

namespace {

namespace fs = std::filesystem;

const char* const kMetadata = R"({"format": "jade-restorer", "format_version": 1, "kind": "efnet",
  "name": "probe", "width": 1, "parameters": 0, "input": "scer", "normalization": "max_abs",
  "channel_order": "rgb", "padding_multiple": 4, "minimum_size": 8, "uses_mask": false,
  "dtype": "float32", "source": "test", "weights_sha256":
  "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"})";

/// A restorer whose forward is `body`.
void save_network(const fs::path& path, const std::string& body,
                  const std::string& metadata = kMetadata) {
  torch::jit::Module module("probe");
  module.define("def forward(self, image, events, mask):\n" + body);
  module.save(path.string(), {{"jade_efnet.json", metadata}});
}

/// The tiny scene's frames and events do not determine the thresholds, which causes a warning.
const char* const kThresholds =
    "--set events.threshold_positive=0.25 --set events.threshold_negative=0.25 ";

/// A scene whose blurry frames are also its true images, and a restorer that darkens.
struct Scene {
  test::TempDir dir;
  explicit Scene(const test::TinyDatasetOptions& options = {}) {
    test::write_tiny_dataset(dir / "scene", options);
    fs::create_directories(dir / "scene/sharp");
    for (const auto& entry : fs::directory_iterator(dir / "scene/images_1")) {
      if (entry.path().extension() == ".png") {
        fs::copy(entry.path(), dir / "scene/sharp" / entry.path().filename());
      }
    }
    save_network(dir / "net.pt", "  return image * 0.9\n");
  }
  /// Into an empty folder out.
  Outcome deblur(const std::string& flags) const {
    fs::remove_all(dir / "out");
    return run(dir, concat("jade_deblur --device cpu --quiet --dataset scene --output out ",
                           kThresholds, flags));
  }
};

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

}  // namespace

TEST_CASE("jade_deblur: each method writes its frames, pictures and scores", "[apps]") {
  const Scene scene;
  const Outcome edi = scene.deblur("--json");
  INFO(edi.err);
  CHECK(edi.code == 0);
  CHECK_THAT(edi.out, Catch::Contains("\"psnr_blurry\": 100.0"));
  for (const char* method : {"efnet", "mean", "oracle"}) {
    const Outcome outcome =
        scene.deblur(std::string("--efnet net.pt --npy --poses --method ") + method);
    INFO(method << ": " << outcome.err);
    CHECK(outcome.code == 0);
    for (const char* column : {"blurry", "edi", "efnet", "mean", "oracle", "ssim", "lpips"}) {
      CHECK_THAT(outcome.out, Catch::Contains(column));
    }
  }
  for (const char* file : {"00.png", "00.npy", "00_08.png", "events/00.png", "edi/00.png",
                           "efnet/00.png", "difference/00.png", "oracle/00.png", "better/00.png"}) {
    INFO(file);
    CHECK(fs::exists(scene.dir / "out" / file));
  }
}

TEST_CASE("jade_deblur: moments are restored where they are, or refused in one line", "[apps]") {
  const Scene scene;
  std::string metadata = replaced(kMetadata, "\"format_version\": 1", "\"format_version\": 2");
  metadata = replaced(metadata, "scer", "counts");
  metadata = replaced(metadata, "max_abs", "inside");
  metadata =
      replaced(metadata, "\"uses_mask\"", "\"windows\": 4, \"any_time\": true, \"uses_mask\"");
  save_network(scene.dir / "any.pt", "  return 0 * image + 0.2 + 0.4 * mask.view(-1, 1, 1, 1)\n",
               metadata);
  const Outcome found =
      scene.deblur("--method efnet --efnet any.pt --npy --times 0,0.25,1 --poses");
  INFO(found.err);
  CHECK(found.code == 0);
  constexpr double kHalfError = 2.5e-4;  // several moments are restored in half precision
  const auto value = [&](const char* file) {
    const torch::Tensor image = imaging::read_image(scene.dir / "out" / file);
    CHECK(image.min().item<float>() == image.max().item<float>());
    return image.mean().item<double>();
  };
  CHECK(value("00.npy") == Approx(0.4).margin(kHalfError));
  CHECK(value("00_t0.npy") == Approx(0.2).margin(kHalfError));
  CHECK(value("00_t0.25.npy") == Approx(0.3).margin(kHalfError));
  CHECK(value("01_t1.npy") == Approx(0.6).margin(kHalfError));
  CHECK(value("01_02.npy") == Approx(0.25));  // of the 17 moments
  CHECK(value("02_16.npy") == Approx(0.6).margin(kHalfError));
  CHECK(scene.deblur("--method edi --times 0,1").code == 0);
  check_error(scene.deblur("--method mean --efnet net.pt --times 0.25"), 3, "net.pt", "version 1",
              "0.25");
  check_error(scene.deblur("--method oracle --efnet any.pt --times 0.25"), 2, "--times", "oracle");
  CHECK(scene.deblur("--method edi --times 1.5").code == 2);
}

TEST_CASE("jade_deblur: gray frames are restored in gray, and coloured ones in colour", "[apps]") {
  const Scene coloured, gray({36, 28, 3, false, true});
  const auto is_gray = [](const Scene& scene) {
    save_network(scene.dir / "tints.pt",
                 "  return torch.cat([image[:, :2], image[:, 2:] * 0.5], 1)\n");
    bool all = true;
    for (const char* method : {"edi", "efnet", "mean", "oracle"}) {
      const Outcome outcome =
          scene.deblur(std::string("--efnet tints.pt --poses --npy --method ") + method);
      INFO(method << ": " << outcome.err);
      CHECK(outcome.code == 0);
      for (const char* file : {"01.png", "01.npy", "01_07.npy"}) {
        all = all && imaging::is_gray(imaging::read_image(scene.dir / "out" / file));
      }
    }
    return all && imaging::is_gray(imaging::read_image(scene.dir / "out/efnet/01.png"));
  };
  CHECK(is_gray(gray));
  CHECK_FALSE(is_gray(coloured));
}

TEST_CASE("jade_deblur: a folder of other files or of another method is refused", "[apps]") {
  const Scene scene;
  const std::string into = concat("jade_deblur --device cpu --quiet --dataset scene ", kThresholds,
                                  "--efnet net.pt --output ");
  CHECK(run(scene.dir, into + "a --method edi").code == 0);
  CHECK(run(scene.dir, into + "a --method edi").code == 0);
  const std::string frame = read_file(scene.dir / "a/00.png");
  check_error(run(scene.dir, into + "a --method efnet"), 2, "--output", "method edi", "scene");
  check_error(run(scene.dir, into + "a --method edi --npy"), 2, "--output", "settings");
  for (const char* other : {"--mask scene/sharp/00.png", "--set dataset.color=gray", "--split none",
                            "--image-folder sharp", "--events-unit us"}) {
    check_error(run(scene.dir, concat(into, "a --method edi ", other)), 2, "--output", "settings");
  }
  CHECK(run(scene.dir, into + "a --method edi --events-file ''").code == 0);
  scene.dir.write("b/.DS_Store", "of a file manager");
  CHECK(run(scene.dir, into + "b --method edi").code == 0);
  fs::remove_all(scene.dir / "b");
  scene.dir.write("b/notes.md", "mine");
  check_error(run(scene.dir, into + "b --method edi"), 2, "--output", "other files", "notes.md");
  scene.dir.write("c", "");
  check_error(run(scene.dir, into + "c --method edi"), 2, "--output", "expected a folder");
  CHECK(read_file(scene.dir / "a/00.png") == frame);
}

TEST_CASE("jade_deblur: held-out exposures are restored as all others", "[apps]") {
  const Scene scene;
  const Outcome all = scene.deblur("--poses --json");
  const std::string frame = read_file(scene.dir / "out/01.png");
  scene.dir.write("scene/held_out.txt", "01\n");
  const Outcome held = scene.deblur("--poses --json");
  INFO(held.err);
  CHECK(held.code == 0);
  CHECK(read_file(scene.dir / "out/01.png") == frame);
  CHECK(fs::exists(scene.dir / "out/01_16.png"));
  const auto views = [](const Outcome& outcome) {
    return nlohmann::json::parse(outcome.out)["views"].size();
  };
  CHECK(views(all) == 3);
  CHECK(views(held) == 3);
}

TEST_CASE("jade_deblur: images without events are refused, and no folder is made", "[apps]") {
  const test::TempDir dir;
  dir.write("scene/transforms.json",
            R"({"camera_angle_x": 1, "frames": [
            {"file_path": "a.png", "transform_matrix": [[1,0,0,0], [0,1,0,0], [0,0,1,0], [0,0,0,1]]},
            {"file_path": "b.png", "transform_matrix": [[1,0,0,1], [0,1,0,0], [0,0,1,0], [0,0,0,1]]}]})");
  for (const char* name : {"scene/a.png", "scene/b.png"}) {
    imaging::write_image(dir / name, torch::rand({3, 16, 16}));
  }
  check_error(run(dir, "jade_deblur --quiet --dataset scene --split none --output out"), 3, "scene",
              "events");
  CHECK_FALSE(fs::exists(dir / "out"));
}

TEST_CASE("jade_deblur: the router of a run decides the mix", "[apps]") {
  const Scene scene;
  const Outcome trained = run(
      scene.dir,
      "jade_train --quiet --device cpu --set dataset.path=scene --set efnet.path=net.pt "
      "--set objective.target=routed --set objective.restored_poses=middle --set init.points=100 "
      "--set train.iterations=3 --output run");
  INFO(trained.err);
  REQUIRE(trained.code == 0);
  const Outcome outcome =
      run(scene.dir, "jade_deblur --quiet --device cpu --method router --run run --output out");
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK_THAT(outcome.out, Catch::Contains("router"));
  CHECK(fs::exists(scene.dir / "out/alpha/00.png"));
  scene.dir.write("scene/held_out.txt", "01\n");
  const std::string router = "jade_deblur --quiet --device cpu --method router --run run --output ";
  CHECK(run(scene.dir, router + "held").code == 0);
  CHECK(read_file(scene.dir / "held/alpha/01.png") == read_file(scene.dir / "out/alpha/01.png"));
  check_error(scene.deblur("--method router"), 2, "--run");
  check_error(scene.deblur("--method router --run nowhere"), 3, "nowhere");
}

TEST_CASE("jade_deblur: processes that share a cache do not disturb each other", "[apps]") {
  const Scene scene;
  const std::string one = concat("jade_deblur --quiet --device cpu --dataset scene --method mean ",
                                 kThresholds, "--efnet net.pt --npy --output ");
  const Outcome both = run(scene.dir, one + "a & p=$!; " + one + "b & q=$!; wait $p && wait $q");
  INFO(both.err);
  CHECK(both.code == 0);
  CHECK(both.err.empty());
  CHECK(read_file(scene.dir / "a/01.npy") == read_file(scene.dir / "b/01.npy"));
  int64_t entries = 0;
  for (const auto& entry : fs::directory_iterator(scene.dir / "cache/restorations")) {
    CHECK(entry.path().extension() == ".restoration");
    ++entries;
  }
  CHECK(entries == 4);  // three restorations of EFNet, and the measured thresholds
  for (const auto& entry : fs::directory_iterator(scene.dir / "cache/restorations")) {
    write_file(entry.path(), "cut short");
  }
  const Outcome rebuilt = run(scene.dir, one + "c");
  CHECK(rebuilt.code == 0);
  CHECK_THAT(rebuilt.err, Catch::Contains("it is made again"));
  CHECK(read_file(scene.dir / "c/01.npy") == read_file(scene.dir / "a/01.npy"));
  CHECK(run(scene.dir, "rm -r cache; " + one + "d --no-cache").code == 0);
  CHECK_FALSE(fs::exists(scene.dir / "cache"));
}

TEST_CASE("jade_deblur: a cache that cannot be written is one warning with what to do", "[apps]") {
  const Scene scene;
  scene.dir.write("blocked", "a file");
  const Outcome outcome =
      run(scene.dir, concat("JADE_CACHE=blocked jade_deblur --quiet --device cpu --dataset scene ",
                            "--efnet net.pt --method mean --output out"));
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  const auto first = outcome.err.find("blocked");
  CHECK_THAT(outcome.err, test::naming("the cache folder blocked", "JADE_CACHE", "cache.folder"));
  CHECK(outcome.err.find("the cache folder", first) == std::string::npos);
  CHECK_THAT(outcome.err, !test::naming("--output"));
}

TEST_CASE("jade_deblur: a deleted current folder gets one line", "[apps]") {
  const test::TempDir dir;
  check_error(
      run(dir, "mkdir gone && cd gone && rmdir ../gone && jade_deblur --dataset a --output b"), 3,
      "current folder", "cd");
}

TEST_CASE("jade_deblur: a bad restorer gets one line and its exit code", "[apps]") {
  const Scene scene;
  const auto efnet = [&](const std::string& flags) {
    return scene.deblur("--method efnet --efnet " + flags);
  };
  const auto network = [&](const std::string& body, const std::string& metadata = kMetadata) {
    save_network(scene.dir / "bad.pt", body, metadata);
    return efnet("bad.pt");
  };
  scene.dir.write("text.pt", "hello");
  check_error(efnet("text.pt"), 3, "text.pt", "TorchScript");
  check_error(efnet("nowhere.pt"), 3, "nowhere.pt");
  check_error(run(scene.dir,
                  "jade_deblur --method efnet --efnet nowhere.pt --dataset nothing --output out"),
              3, "nowhere.pt");
  check_error(network("  return image\n", ""), 3, "export_efnet.py");
  check_error(network("  return image\n", replaced(kMetadata, "e3b0c442", "00000000")), 3, "bad.pt",
              "00000000");
  check_error(network("  return torch.conv2d(image, torch.ones([3, 4, 1, 1]))\n"), 3, "4 channels");
  check_error(network("  assert image.size(3) < 20, 'frames up to 20 px only'\n  return image\n"),
              3, "frames up to 20 px only");
  check_error(network("  return image / 0 - image / 0\n"), 5, "NaN or Inf", "36x28");
  check_error(network("  return image[:, :1]\n"), 3, "shape");
  check_error(network("  assert False, 'CUDA out of memory'\n  return image\n"), 4, "tiles");
}

TEST_CASE("jade_deblur: other mistakes get one line and their exit code", "[apps]") {
  const Scene scene;
  check_error(scene.deblur("--method magic"), 2, "edi, efnet, mean, oracle, router");
  check_error(scene.deblur("--threshold-positive -1"), 2, "--threshold-positive -1",
              "events.threshold_positive");
  check_error(scene.deblur("--log-offset -1"), 2, "--log-offset");
  check_error(scene.deblur("--log-offset nan"), 2, "--log-offset", "0 to 1,000", "nan");
  check_error(scene.deblur("--times nan"), 2, "--times", "0 to 1,", "nan");
  const std::string frame = read_file(scene.dir / "scene/images_1/00.png");
  for (const char* folder : {"scene/images_1", "scene/sharp", "scene/../scene/images_1/below"}) {
    check_error(run(scene.dir, concat("jade_deblur --dataset scene --output ", folder)), 2,
                "--output");
  }
  CHECK(read_file(scene.dir / "scene/images_1/00.png") == frame);
  check_error(scene.deblur("--efnet net.pt --times 0.5,0.50000001"), 2, "'00_t0.5'");
  check_error(run(scene.dir, "jade_deblur --output out"), 2, "--dataset");
  check_error(run(scene.dir, "jade_deblur --dataset scene"), 2, "--output");
  check_error(run(scene.dir, "jade_deblur --dataset nowhere --output out"), 3, "nowhere");
  fs::remove_all(scene.dir / "scene/sharp");
  check_error(scene.deblur("--method oracle --efnet net.pt"), 3, "oracle", "sharp/");
  const Outcome unscored = scene.deblur("");
  CHECK(unscored.code == 0);
  CHECK_THAT(unscored.out, Catch::Contains("nothing to score"));
}

TEST_CASE("jade_eval: folders whose names or sizes differ get one line", "[apps]") {
  const Scene scene;
  const auto eval = [&](const std::string& flags) { return run(scene.dir, "jade_eval " + flags); };
  CHECK(scene.deblur("").code == 0);
  scene.dir.write("file", "");
  check_error(eval("--renders out --truth scene/sharp --output file/below"), 3, "file/below");
  const Outcome good = eval("--renders out --truth scene/sharp --json");
  CHECK(good.code == 3);  // the sharp test views have no restoration
  CHECK_THAT(good.err, test::naming("03"));
  fs::create_directories(scene.dir / "truth");
  fs::copy(scene.dir / "scene/sharp/00.png", scene.dir / "truth/00.png");
  const Outcome one = eval("--renders out --truth truth --json");
  CHECK(one.code == 0);
  CHECK_THAT(one.out, Catch::Contains("psnr_channel_mean"));
  CHECK(fs::exists(scene.dir / "out/eval.json"));
  scene.dir.write("truth/01.png", "no picture");
  check_error(eval("--renders out --truth truth"), 3, "01.png");
  test::write_tiny_dataset(scene.dir / "larger", {40, 28, 3, false});
  fs::copy(scene.dir / "larger/images_1/00.png", scene.dir / "truth/00.png",
           fs::copy_options::overwrite_existing);
  check_error(eval("--renders out --truth truth"), 3, "40x28");
  fs::create_directories(scene.dir / "empty");
  check_error(eval("--renders out --truth empty"), 3, "empty", "none");
  check_error(eval("--renders nowhere --truth truth"), 3, "nowhere");
  check_error(eval("--renders out"), 2, "--renders", "--truth");
  for (const char* flag : {"--dataset scene", "--split last", "--events-file file"}) {
    check_error(eval(concat("--renders out --truth truth ", flag)), 2,
                std::string(flag).substr(0, std::string(flag).find(' ')), "--run");
  }
}
