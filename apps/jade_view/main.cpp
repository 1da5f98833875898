// SPDX-License-Identifier: Apache-2.0
// Shows a scene in a browser, rendered by this program.
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/scene_file.h"
#include "jade/gaussians/summary.h"
#include "jade/page/page.h"
#include "jade/run/evaluate.h"
#include "jade/run/live_scene.h"
#include "jade/run/restored_pictures.h"
#include "jade/run/run_directory.h"
#include "jade/run/run_summary.h"
#include "jade/serve/server.h"
#include "jade/train/view.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

/// The scene on display, on its device.
struct Subject {
  data::Dataset dataset;  ///< its cameras and pictures
  splat::Gaussians gaussians;
  splat::RenderOptions draw;
  std::string config;                                         ///< text of the run's config.yaml
  std::string scores;                                         ///< text of its eval.json
  std::unique_ptr<run::RestoredPictures> restored = nullptr;  ///< of a run; reads `dataset`
};

/// A camera that sees the bulk of a scene without cameras. Scenes from structure from motion
/// usually have y down.
data::SharpView overview(const gaussians::Bulk& bulk) {
  geometry::Vector3 eye = bulk.middle;
  eye[2] -= 2 * bulk.radius;
  data::SharpView view;
  view.name = "overview";
  view.pose = geometry::look_at(eye, bulk.middle, {0, -1, 0});
  view.camera = geometry::Intrinsics::centred(800, 800, 600);
  return view;
}

void open_file(const fs::path& path, torch::Device device, Subject& subject) {
  gaussians::GaussianFile file = gaussians::read_gaussians(path);
  gaussians::check_some(file.gaussians, path);
  const std::string warning = gaussians::undrawable_warning(file.gaussians, path.string());
  if (!warning.empty()) log_warn(warning);
  subject.dataset.name = path.filename().string();
  subject.dataset.test.push_back(overview(gaussians::bulk_of(file.gaussians)));
  subject.draw.near_plane = gaussians::near_plane_of(file.gaussians, subject.draw.near_plane);
  subject.draw.antialiased = file.antialiased;
  subject.gaussians = gaussians::map_parameters(
      file.gaussians, [&](const torch::Tensor& tensor) { return tensor.to(device); });
}

void open_run(const fs::path& path, torch::Device device, Subject& subject) {
  const train::RunOptions options = run::load_run_options(path);
  run::FinishedRun opened = run::open_run(path, options);
  subject.dataset = std::move(opened.dataset);
  subject.draw = train::render_options(options);
  subject.config = read_file(path / "config.yaml");
  if (fs::exists(path / run::kScoresFile)) subject.scores = read_file(path / run::kScoresFile);
  subject.gaussians = gaussians::map_parameters(
      opened.gaussians, [&](const torch::Tensor& tensor) { return tensor.to(device); });
  if (subject.dataset.train.empty()) return;
  subject.restored =
      std::make_unique<run::RestoredPictures>(path, options, subject.dataset, device);
}

void open_subject(const fs::path& path, torch::Device device, Subject& subject) {
  if (run::is_run(path)) return open_run(path, device, subject);
  if (fs::is_directory(path) || !fs::exists(path)) {
    throw DataError(concat(
        path.string(), ": expected a run directory of jade_train or a file of Gaussians, found ",
        fs::exists(path) ? "another folder" : "nothing"));
  }
  open_file(path, device, subject);
}

run::LiveScene scene_of(const Subject& subject) {
  const run::GaussianSource gaussians = [&subject] { return subject.gaussians; };
  run::LiveScene scene(subject.dataset, subject.draw, gaussians);
  for (size_t i = 0; i < subject.dataset.train.size(); ++i) {
    const auto index = static_cast<int64_t>(i);
    auto known = subject.restored ? subject.restored->of(index) : std::vector<run::ViewPicture>();
    scene.add(concat("train.", i), run::exposure_pictures(subject.dataset, index, std::move(known),
                                                          gaussians, subject.draw));
  }
  for (size_t i = 0; i < subject.dataset.test.size(); ++i) {
    scene.add(concat("test.", i),
              run::test_pictures(subject.dataset.test[i], gaussians, subject.draw));
  }
  return scene;
}

/// Runs until Ctrl-C.
[[noreturn]] void show(const Subject& subject, serve::Server& server) {
  const run::LiveScene scene = scene_of(subject);
  server.board().set({0, 0, subject.gaussians.size(), "still"});
  server.show(page::live_page(scene.page_data({{device_name(subject.gaussians.means.device())},
                                               subject.config,
                                               server.board().id(),
                                               /*pausable=*/false,
                                               /*moving=*/false,
                                               /*report=*/"",
                                               subject.scores})));
  for (;;) {
    throw_if_interrupted();
    if (!server.queue().wait(serve::RenderQueue::Seconds(0.1))) continue;
    server.queue().render_one([&](const serve::Wanted& wanted) { return scene.draw(wanted, 0); });
  }
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_view", "Shows a scene in a browser until Ctrl-C");
  program.add_example("jade_view runs/table");
  program.add_example("jade_view table.ply --serve 9000");
  fs::path path;
  program.begin_group("Input");
  program.cli()
      .add_option("scene", path,
                  concat("Run directory of jade_train (its newest scene, cameras, pictures and "
                         "scores) or a file of Gaussians: ",
                         gaussians::kReadEndings))
      ->type_name("PATH")
      ->required();
  std::string address;
  program.begin_group("Output");
  program.add_serve_flag(address, "Serve the page");
  program.add_device_flag();
  return program.run(argc, argv, [&] {
    const torch::Device device = program.device();
    serve::Server server(serve::parse_address(address, "--serve"), "--serve");
    Subject subject;
    open_subject(path, device, subject);
    std::cout << server.url() << std::endl;
    show(subject, server);
    return ExitCode::kOk;
  });
}
