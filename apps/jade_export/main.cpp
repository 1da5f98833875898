// SPDX-License-Identifier: Apache-2.0
// Converts Gaussians from a run, a checkpoint or a file to the formats of splat viewers.
#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/gaussians/scene_file.h"
#include "jade/gaussians/summary.h"
#include "jade/geometry/origin.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"

using namespace jade;

namespace {

namespace fs = std::filesystem;

struct Sources {
  fs::path run, checkpoint, ply;
};

gaussians::GaussianFile load(const Sources& sources) {
  const int given = !sources.run.empty() + !sources.checkpoint.empty() + !sources.ply.empty();
  if (given != 1) {
    throw ConfigError(
        concat("expected exactly one of --run, --checkpoint and --ply, found ", given));
  }
  const fs::path& path = !sources.ply.empty()          ? sources.ply
                         : !sources.checkpoint.empty() ? sources.checkpoint
                                                       : sources.run;
  gaussians::GaussianFile file;
  if (!sources.ply.empty()) {
    file = gaussians::read_gaussians(path);
  } else if (!sources.checkpoint.empty()) {
    file = run::load_checkpoint_scene(path);
  } else {
    file = run::newest_scene(path);
  }
  gaussians::check_some(file.gaussians, path);
  if (gaussians::count_visible(gaussians::drawable(file.gaussians)) == 0) {
    throw DataError(concat(path.string(), ": expected Gaussians that show, found ",
                           grouped(file.gaussians.size()),
                           " with an opacity below 1/255 or numbers that cannot be rendered; use "
                           "another checkpoint"));
  }
  return file;
}

/// Checks the output path before any file is read or written.
void check_output(const fs::path& path) {
  if (!gaussians::can_write(path)) {
    throw ConfigError(concat("--output: expected a file that ends in ", gaussians::kWrittenEndings,
                             ", found ", path.string().empty() ? "nothing" : path.string()));
  }
  if (fs::is_directory(path)) {
    throw ConfigError(
        concat("--output: expected a file, found the folder ", path.string(), "; choose another"));
  }
}

/// Logs the coordinate system of the file, for a scene with its own origin.
void tell_coordinates(const fs::path& path, const geometry::Vector3& origin, bool of_dataset) {
  if (geometry::is_zero(origin)) return;
  if (of_dataset) {
    log_warn(concat(path.string(), ": x y z are in the coordinates of the data set and of type ",
                    "double, as float32 is too coarse there; viewers that compute in float32 show "
                    "them well only with --coordinates scene"));
    return;
  }
  log_warn(concat(path.string(), ": coordinates are about (", geometry::text_of(origin),
                  ") of the data set; add it for those of the data set",
                  gaussians::is_exact(path) ? " (--coordinates dataset does)"
                                            : ", which only a .ply can hold"));
}

/// Writes the format of check_output(). Returns the number of Gaussians.
int64_t save(const fs::path& path, const gaussians::GaussianFile& file, bool of_dataset,
             int spz_version) {
  const bool exact = gaussians::is_exact(path);
  tell_coordinates(path, file.origin, of_dataset && exact);
  if (path.has_parent_path()) make_writable_folder(path.parent_path());
  gaussians::SceneWriting writing;
  writing.spz_version = spz_version;
  if (exact) {
    const std::string warning = gaussians::undrawable_warning(file.gaussians, path.string());
    if (!warning.empty()) log_warn(warning);
    if (of_dataset) writing.coordinates = gaussians::PlyCoordinates::kDataset;
    gaussians::write_scene_file(path, file, writing);
    return file.gaussians.size();
  }
  const gaussians::GaussianFile finite{gaussians::drawable(file.gaussians), file.antialiased,
                                       file.origin};
  if (const int64_t left = file.gaussians.size() - finite.gaussians.size(); left > 0) {
    log_warn(concat(path.string(), ": ", grouped(left), " of ", grouped(file.gaussians.size()),
                    " Gaussians have NaN or Inf in their numbers, or numbers beyond all bounds, so "
                    "are in no picture, and are left out; a .ply holds them"));
  }
  gaussians::write_scene_file(path, finite, writing);
  return finite.gaussians.size();
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_export", concat("Writes Gaussians as ", gaussians::kWrittenEndings));
  Sources sources;
  program.add_example("jade_export --run runs/table --output table.spz");
  program.add_example("jade_export --ply table.ply --output table.splat");
  program.begin_group("Input");
  program.cli()
      .add_option("--run", sources.run, "Run directory of jade_train: its newest scene")
      ->type_name("DIR");
  program.cli()
      .add_option("--checkpoint", sources.checkpoint, "One checkpoint of a run")
      ->type_name("FILE");
  program.cli()
      .add_option("--ply", sources.ply,
                  concat("Gaussians in a file to convert: ", gaussians::kReadEndings))
      ->type_name("FILE");
  program
      .add_output_flag(
          concat("File to write; its extension is the format: ", gaussians::kWrittenEndings))
      ->type_name("FILE");
  program.begin_group("Output");
  std::string coordinates = "dataset";
  program.cli()
      .add_option("--coordinates", coordinates,
                  "Origin of the coordinates of a scene that lies far from that of its data set: "
                  "dataset (.ply only), or scene, which viewers need")
      ->type_name("WORD")
      ->capture_default_str()
      ->check(CLI::IsMember({"dataset", "scene"}));
  int spz_version = 2;
  auto* version_flag = program.cli().add_option(
      "--spz-version", spz_version,
      "Version of .spz: 2 (most viewers read it), or 3 or 4, whose rotations are finer");
  version_flag->type_name("N")->check(CLI::Range(2, 4))->capture_default_str();
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    check_output(program.output());
    if (version_flag->count() > 0 && program.output().extension() != ".spz") {
      throw ConfigError(concat("--spz-version: expected an --output that ends in .spz, found ",
                               program.output().string(), "; leave one away"));
    }
    const gaussians::GaussianFile file = load(sources);
    const int64_t written = save(program.output(), file, coordinates == "dataset", spz_version);
    const auto bytes = fs::file_size(program.output());
    if (program.json()) {
      std::cout << "{\"gaussians\": " << written << ", \"bytes\": " << bytes << "}\n";
    } else {
      log_info(concat(program.output().string(), ": ", grouped(written), " Gaussians, ",
                      grouped(static_cast<int64_t>(bytes)), " bytes"));
    }
    return ExitCode::kOk;
  });
}
