// SPDX-License-Identifier: Apache-2.0
// Damaged input: files that are missing, cut, swapped or in other units.
#include "support/catch.h"

#include <cmath>
#include <filesystem>
#include <functional>
#include <torch/types.h>

#include "data/tiny_recording.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/imaging/image_io.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using test::mentions;

/// An intact data set on disk, which tests damage.
struct Scene {
  test::TempDir temp;
  fs::path root = temp / "scene";
  EvDeblurContent content = test::tiny_content();
  DatasetOptions options;

  Scene() {
    write_evdeblur(root, content);
    options.path = root;
  }
  std::vector<std::string> warnings() {
    std::vector<std::string> lines;
    load_dataset(options, &lines);
    return lines;
  }
  void rewrite_events(const std::function<void(test::RawEvents&)>& change) {
    test::RawEvents raw = test::raw_events(content.events);
    change(raw);
    io::Hdf5Writer writer(root / "events.h5");
    for (const auto& [name, list] :
         {std::pair{"x", &raw.x}, {"y", &raw.y}, {"t", &raw.t}, {"p", &raw.p}}) {
      if (!list->empty()) writer.append(name, list->data(), int64_t(list->size()));
    }
    writer.close();
  }
  void rewrite_poses(const char* name, const std::function<torch::Tensor(torch::Tensor)>& change) {
    io::write_npy(root / name, change(io::read_npy(root / name)));
  }
  void cut(const char* name, double part) {
    const std::string whole = read_file(root / name);
    write_file(root / name, whole.substr(0, size_t(double(whole.size()) * part)));
  }
};

TEST_CASE("damage: missing, empty and truncated events are refused with the path", "[data]") {
  Scene scene;
  scene.cut("events.h5", 0.5);
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("events.h5"));
  scene.cut("events.h5", 0);
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("events.h5"));
  scene.rewrite_events([](test::RawEvents& raw) { raw.p.clear(); });
  CHECK_THROWS_AS(scene.warnings(), DataError);
  scene.rewrite_events([](test::RawEvents& raw) { raw.x.resize(500); });
  CHECK_THROWS_AS(scene.warnings(), DataError);
  scene.rewrite_events([](test::RawEvents& raw) { raw.p[5] = 7; });
  CHECK_THROWS_AS(scene.warnings(), DataError);
}

TEST_CASE("damage: a scene without events loads, with a warning", "[data]") {
  Scene scene;
  fs::remove(scene.root / "events.h5");
  CHECK(mentions(scene.warnings(), "no recording of events"));
  CHECK(load_dataset(scene.options).events.empty());
  scene.options.events_file = scene.root / "other.h5";
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("other.h5"));
  scene.options.events_file = scene.root;
  CHECK_THROWS_WITH(scene.warnings(),
                    Catch::Contains("expected one file of events, found a folder"));
}

TEST_CASE("damage: files named like events that are not read are named", "[data]") {
  Scene scene;
  fs::remove(scene.root / "events.h5");
  write_file(scene.root / "events.txt.gz", "x");
  fs::create_directories(scene.root / "events_npz");
  CHECK(mentions(scene.warnings(), "events.txt.gz, events_npz/"));
}

TEST_CASE("damage: a scene without times or events goes by its COLMAP model", "[data]") {
  Scene scene;
  for (const char* name : {"images_1/timestamps.npz", "all_timestamps.npy"})
    fs::remove(scene.root / name);
  fs::create_directories(scene.root / "sparse/0");
  for (const char* name : {"cameras", "images"})
    write_file(scene.root / "sparse/0" / (std::string(name) + ".txt"), "");
  CHECK_THROWS_WITH(scene.warnings(), test::naming("timestamps.npz", "dataset.kind colmap"));
  fs::remove(scene.root / "events.h5");
  CHECK(recognise_dataset(scene.root) == DatasetKind::kColmap);
}

TEST_CASE("damage: unsorted events are sorted, with a warning", "[data]") {
  Scene scene;
  scene.rewrite_events([](test::RawEvents& raw) { std::swap(raw.t[10], raw.t[500]); });
  CHECK(mentions(scene.warnings(), "events.h5"));
  const torch::Tensor t = load_dataset(scene.options).events.t_us();
  CHECK((t.diff() >= 0).all().item<bool>());
}

TEST_CASE("damage: events outside the image and NaN coordinates are named", "[data]") {
  Scene scene;
  scene.rewrite_events([](test::RawEvents& raw) {
    for (size_t i = 0; i < 300; ++i) raw.x[i] = 400;
  });
  CHECK(mentions(scene.warnings(), "events.h5"));
  scene.rewrite_events([](test::RawEvents& raw) { raw.y[3] = std::nan(""); });
  CHECK(mentions(scene.warnings(), "events.h5"));
}

TEST_CASE("damage: events of one polarity are named", "[data]") {
  Scene scene;
  CHECK_FALSE(mentions(scene.warnings(), "darker"));
  for (const double polarity : {0.0, 1.0}) {
    scene.rewrite_events(
        [&](test::RawEvents& raw) { std::fill(raw.p.begin(), raw.p.end(), polarity); });
    CHECK(mentions(scene.warnings(), "darker; expected some of both"));
  }
}

TEST_CASE("damage: a frame of another brightness is named, until its gain is given", "[data]") {
  Scene scene;
  CHECK_FALSE(mentions(scene.warnings(), "brightness"));
  const std::string name = load_dataset(scene.options).train[1].name;
  const fs::path frame = scene.root / "images_1" / (name + ".png");
  imaging::write_image(frame, 0.4 * imaging::read_image(frame));
  CHECK(mentions(scene.warnings(), name + " is 0.4 times as bright"));
  write_file(scene.root / "gains.csv", "name,gain\n" + name + ",1\n");
  CHECK_FALSE(mentions(scene.warnings(), "brightness"));
}

TEST_CASE("damage: a mask that excludes nearly all is named", "[data]") {
  Scene scene;
  torch::Tensor mask = torch::zeros({1, test::kHeight, test::kWidth});
  mask[0][5][7] = 1;
  imaging::write_image(scene.root / "mask.png", mask);
  CHECK(mentions(scene.warnings(), "expected masks that leave most pixels"));
}

TEST_CASE("damage: a hot pixel is named, until a mask excludes it", "[data]") {
  Scene scene;
  CHECK_FALSE(mentions(scene.warnings(), "hot pixel"));
  scene.rewrite_events([](test::RawEvents& raw) {
    for (size_t i = 0; i < 100; ++i) raw.x[10 * i] = 7, raw.y[10 * i] = 5;
  });
  CHECK(mentions(scene.warnings(), "pixel (7, 5) has 10"));
  torch::Tensor mask = torch::ones({1, test::kHeight, test::kWidth});
  mask[0][5][7] = 0;
  imaging::write_image(scene.root / "mask.png", mask);
  CHECK_FALSE(mentions(scene.warnings(), "hot pixel"));
}

TEST_CASE("damage: a data set in milliseconds is read as such, and reported", "[data]") {
  Scene scene;
  scene.rewrite_events([](test::RawEvents& raw) {
    for (double& t : raw.t) t /= 1000;
  });
  CHECK(mentions(scene.warnings(), "milliseconds"));
  CHECK(load_dataset(scene.options).events.last_us() == scene.content.events.last_us());
}

TEST_CASE("damage: exposures without events are named", "[data]") {
  Scene scene;
  scene.rewrite_events([](test::RawEvents& raw) {
    for (auto* list : {&raw.x, &raw.y, &raw.t, &raw.p}) list->resize(480);
  });
  const auto lines = scene.warnings();
  CHECK(mentions(lines, "2 of 4 exposures have no events (02, 03)"));
}

TEST_CASE("damage: events that meet the exposures in no unit are refused", "[data]") {
  Scene scene;
  scene.rewrite_events([](test::RawEvents& raw) {
    for (double& t : raw.t) t = t + 7e12;
  });
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("events.h5"));
}

TEST_CASE("damage: counts of images, times and poses that differ are all reported", "[data]") {
  Scene scene;
  fs::remove(scene.root / "images_1/03.png");
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("5 images") && Catch::Contains("6 times") &&
                                          Catch::Contains("6 poses"));
}

TEST_CASE("damage: missing files say what they must hold", "[data]") {
  for (const char* name : {"poses_bounds.npy", "images_1/timestamps.npz", "all_timestamps.npy"}) {
    Scene scene;
    fs::remove(scene.root / name);
    CHECK_THROWS_WITH(scene.warnings(), Catch::Contains(fs::path(name).filename().string()) &&
                                            Catch::Contains("missing"));
  }
  Scene scene;
  scene.options.path = scene.root / "nowhere";
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("no such folder"));
  scene.options.path = scene.root / "images_1";
  fs::remove(scene.root / "images_1/timestamps.npz");
  CHECK_THROWS_WITH(scene.warnings(),
                    test::naming("images_1", "poses_bounds.npy", "transforms.json"));
  scene.options.path = "";
  CHECK_THROWS_AS(scene.warnings(), ConfigError);
}

TEST_CASE("damage: poses that are NaN, no rotation, cut or of other counts are refused", "[data]") {
  Scene scene;
  scene.rewrite_poses("all_poses_bounds.npy", [](torch::Tensor rows) {
    rows[7][3] = std::nan("");
    return rows;
  });
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("row 7"));
  Scene second;
  second.rewrite_poses("all_poses_bounds.npy",
                       [](const torch::Tensor& rows) { return rows.slice(0, 0, 50); });
  CHECK_THROWS_NAMING(DataError, second.warnings(), "101 times", "50 poses");
  Scene third;
  third.cut("poses_bounds.npy", 0.7);
  CHECK_THROWS_WITH(third.warnings(), Catch::Contains("poses_bounds.npy"));
  Scene fourth;
  fourth.rewrite_poses("poses_bounds.npy", [](torch::Tensor rows) {
    rows[2][0] = 5;
    return rows;
  });
  CHECK_THROWS_WITH(fourth.warnings(), Catch::Contains("row 2"));
}

TEST_CASE("damage: a focal length that no image of this size has is refused", "[data]") {
  Scene scene;
  scene.rewrite_poses("poses_bounds.npy", [](torch::Tensor rows) {
    rows = rows.clone();
    rows.select(1, 14).mul_(1000);
    return rows;
  });
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "poses_bounds.npy", "focal lengths", "25000");
}

TEST_CASE("damage: an exposure beyond the trajectory has no poses", "[data]") {
  Scene scene;
  for (const char* name : {"all_poses_bounds.npy", "all_timestamps.npy"}) {
    scene.rewrite_poses(name, [](const torch::Tensor& rows) { return rows.slice(0, 0, 60); });
  }
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("exposure 03") && Catch::Contains("outside"));
}

TEST_CASE("damage: a trajectory of other coordinates than the frames is noticed", "[data]") {
  Scene scene;
  scene.rewrite_poses("poses_bounds.npy", [](torch::Tensor rows) {
    rows.select(1, 3) += 5;
    return rows;
  });
  CHECK(mentions(scene.warnings(), "away from all_poses_bounds.npy"));
}

TEST_CASE("damage: a trajectory out of order or with repeated times is repaired", "[data]") {
  Scene scene;
  const torch::Tensor order = torch::cat({torch::arange(100, -1, -1), torch::tensor({50})});
  for (const char* name : {"all_poses_bounds.npy", "all_timestamps.npy"}) {
    scene.rewrite_poses(name, [&](const torch::Tensor& rows) { return rows.index({order}); });
  }
  const auto lines = scene.warnings();
  CHECK(mentions(lines, "not in order"));
  CHECK(mentions(lines, "more than once"));
}

TEST_CASE("damage: unreadable and differently sized images are named", "[data]") {
  Scene scene;
  scene.cut("images_1/02.png", 0);
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("02.png"));
  imaging::write_image(scene.root / "images_1/02.png", torch::rand({3, 9, 9}));
  CHECK_THROWS_WITH(scene.warnings(), Catch::Contains("02.png") && Catch::Contains("9x9"));
}

TEST_CASE("damage: 16-bit and gray images count as images", "[data]") {
  Scene scene;
  const torch::Tensor gray = torch::rand({1, test::kHeight, test::kWidth});
  imaging::write_image(scene.root / "images_1/00.png", gray, {16, 95});
  const Dataset data = load_dataset(scene.options);
  CHECK(torch::allclose(data.train[0].blurry, gray.expand({3, -1, -1}), 0, 1.0 / 65535));
}

TEST_CASE("damage: a single exposure loads, with a warning", "[data]") {
  test::TempDir temp;
  EvDeblurContent content = test::tiny_content();
  content.train.resize(1);
  content.sharp_mid.resize(1);
  write_evdeblur(temp / "scene", content);
  DatasetOptions options;
  options.path = temp / "scene";
  std::vector<std::string> lines;
  CHECK(load_dataset(options, &lines).train.size() == 1);
  CHECK(mentions(lines, "single training frame"));
}

TEST_CASE("damage: swapped starts and ends, and impossible splits, are refused", "[data]") {
  Scene scene;
  const io::Npz times(scene.root / "images_1/timestamps.npz");
  const torch::Tensor start = times.read("timestamps_start");
  const torch::Tensor end = times.read("timestamps_end");
  scene.options.split = SplitKind::kLast;
  scene.options.test_last = 6;
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "none is left");
  scene.options.split = SplitKind::kEvery;
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "dataset.split");
  scene.options.split = SplitKind::kAuto;
  io::write_npz(scene.root / "images_1/timestamps.npz",
                {{"timestamps_start", end}, {"timestamps_end", start}});
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "timestamps.npz", "swap the two arrays");
  torch::Tensor once = end.clone();
  once[0] = start[0] - 1000;
  io::write_npz(scene.root / "images_1/timestamps.npz",
                {{"timestamps_start", start}, {"timestamps_end", once}});
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "frame 0 ends", "correct its times");
  io::write_npz(scene.root / "images_1/timestamps.npz",
                {{"timestamps_start", start}, {"timestamps_end", end.slice(0, 1)}});
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "timestamps.npz", "length");
}

TEST_CASE("damage: a link to events that are missing is refused", "[data]") {
  Scene scene;
  fs::remove(scene.root / "events.h5");
  fs::create_symlink("elsewhere/events.h5", scene.root / "events.h5");
  CHECK_THROWS_NAMING(DataError, scene.warnings(), "events.h5", "elsewhere", "does not exist");
}

TEST_CASE("damage: blank and repeated frames are named", "[data]") {
  Scene scene;
  CHECK_FALSE(mentions(scene.warnings(), "expected frames"));
  const auto image = [&](int64_t i) { return scene.root / concat("images_1/0", i, ".png"); };
  imaging::write_image(image(2), torch::zeros({3, test::kHeight, test::kWidth}));
  fs::copy_file(image(0), image(1), fs::copy_options::overwrite_existing);
  CHECK(mentions(scene.warnings(), "1 of 6 all black (the first is 02)"));
  CHECK(mentions(scene.warnings(), "1 of 6 identical to the frame before (the first is 01)"));
}

TEST_CASE("damage: events in a part of the frames are named", "[data]") {
  Scene scene;
  const auto squeeze = [&](double divisor) {
    scene.rewrite_events([&](test::RawEvents& raw) {
      for (size_t i = 0; i < raw.x.size(); ++i)
        raw.x[i] = std::floor(raw.x[i] / divisor), raw.y[i] = std::floor(raw.y[i] / divisor);
    });
    return scene.warnings();
  };
  CHECK_FALSE(mentions(squeeze(1), "expected events all over"));
  CHECK(mentions(squeeze(2), "expected events all over the 21x13 frames"));
}

TEST_CASE("damage: times whose set unit makes exposures of seconds are refused", "[data]") {
  Scene scene;
  scene.options.time_unit = events::TimeUnit::kS;
  CHECK_THROWS_WITH(scene.warnings(), test::naming("timestamps.npz", "dataset.time_unit"));
}

TEST_CASE("evdeblur: poses made for another size are scaled, or refused with both sizes",
          "[data]") {
  const auto with_size = [](double height, double width, double focal_factor) {
    Scene scene;
    scene.rewrite_poses("poses_bounds.npy", [&](torch::Tensor rows) {
      rows.select(1, 4).fill_(height), rows.select(1, 9).fill_(width);
      rows.select(1, 14).mul_(focal_factor);
      return rows;
    });
    return load_dataset(scene.options);
  };
  const double focal = with_size(test::kHeight, test::kWidth, 1).train[0].camera.fx;
  const Dataset scaled = with_size(2 * test::kHeight, 2 * test::kWidth, 2);
  CHECK(scaled.train[0].camera.fx == Approx(focal));
  CHECK(mentions(scaled.notes, "42x26 while these are 21x13; the focal length is scaled by 0.5"));
  CHECK_THROWS_NAMING(DataError, with_size(test::kHeight, 2 * test::kWidth, 1), "42x13", "21x13");
  CHECK_THROWS_NAMING(DataError, with_size(test::kWidth, test::kHeight, 1), "13x21", "exchange");
}

TEST_CASE("damage: lost packets of events are named, pauses of the camera are not", "[data]") {
  const auto silence_in = [](bool rests) {
    Scene scene;
    scene.rewrite_events([](test::RawEvents& raw) {
      for (size_t i = raw.t.size(); i-- > 0;) {
        if (raw.t[i] <= 31000 || raw.t[i] >= 36000) continue;
        for (auto* list : {&raw.x, &raw.y, &raw.t, &raw.p})
          list->erase(list->begin() + std::ptrdiff_t(i));
      }
    });
    if (rests) {
      scene.rewrite_poses("all_poses_bounds.npy", [](torch::Tensor rows) {
        rows = rows.clone();
        for (int64_t i = 31; i <= 36; ++i) rows[i].copy_(rows[31]);
        return rows;
      });
    }
    for (const std::string& line : scene.warnings()) {
      if (line.find("lost packets") != std::string::npos) return line;
    }
    return std::string();
  };
  CHECK_THAT(silence_in(false), test::naming("events.h5", "1 stretch", "01", "5 ms", "31000 us"));
  CHECK(silence_in(true).empty());
}

}  // namespace
}  // namespace jade::data
