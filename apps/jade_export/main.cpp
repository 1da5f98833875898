// SPDX-License-Identifier: Apache-2.0
// Gaussians from a run, a checkpoint or a .ply to the formats of splat viewers.
#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/log.h"
#include "jade/gaussians/ply.h"
#include "jade/gaussians/splat_file.h"
#include "jade/gaussians/spz_file.h"
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
    file = gaussians::read_ply(path);
  } else if (!sources.checkpoint.empty()) {
    file = run::load_checkpoint_scene(path);
  } else {
    file = run::newest_scene(path);
  }
  gaussians::check_some(file.gaussians, path);
  if (gaussians::count_visible(gaussians::drawable(file.gaussians)) == 0) {
    throw DataError(concat(path.string(), ": expected Gaussians that show, found ",
                           file.gaussians.size(),
                           " with an opacity below 1/255 or numbers that cannot be drawn; use "
                           "another checkpoint"));
  }
  return file;
}

/// Checks the output path before any file is read or written.
void check_output(const fs::path& path) {
  const std::string extension = path.extension().string();
  if (extension != ".ply" && extension != ".splat" && extension != ".spz") {
    throw ConfigError(concat("--output: expected a file that ends in .ply, .splat or .spz, found ",
                             path.string().empty() ? "nothing" : path.string()));
  }
  if (fs::is_directory(path)) {
    throw ConfigError(
        concat("--output: expected a file, found the folder ", path.string(), "; choose another"));
  }
}

/// Says what the coordinates in the file are, of a scene that has an origin of its own.
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
                  path.extension() == ".ply"
                      ? " (--coordinates dataset does)"
                      : concat(", which ", path.extension().string(), " cannot hold; a .ply can")));
}

/// In the format of check_output(). Returns how many Gaussians it wrote.
int64_t save(const fs::path& path, const gaussians::GaussianFile& file, bool of_dataset) {
  const std::string extension = path.extension().string();
  tell_coordinates(path, file.origin, of_dataset && extension == ".ply");
  if (path.has_parent_path()) make_writable_folder(path.parent_path());
  if (extension == ".ply") {
    const std::string warning = gaussians::undrawable_warning(file.gaussians, path.string());
    if (!warning.empty()) log_warn(warning);
    gaussians::write_ply(
        path, file,
        of_dataset ? gaussians::PlyCoordinates::kDataset : gaussians::PlyCoordinates::kOwn);
    return file.gaussians.size();
  }
  const gaussians::GaussianFile drawn{gaussians::drawable(file.gaussians), file.antialiased,
                                      file.origin};
  if (const int64_t left = file.gaussians.size() - drawn.gaussians.size(); left > 0) {
    log_warn(concat(path.string(), ": ", left, " of ", file.gaussians.size(),
                    " Gaussians have NaN or Inf in their numbers, or numbers beyond all bounds, so "
                    "are in no picture, and are left out; a .ply holds them"));
  }
  if (extension == ".splat") {
    gaussians::write_splat(path, drawn.gaussians);
  } else {
    gaussians::SpzOptions options;
    options.antialiased = drawn.antialiased;
    gaussians::write_spz(path, drawn.gaussians, options);
  }
  return drawn.gaussians.size();
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_export", "Writes Gaussians as .ply, .splat or .spz");
  Sources sources;
  program.cli().add_option("--run", sources.run, "run directory; its newest scene is taken");
  program.cli().add_option("--checkpoint", sources.checkpoint, "one checkpoint");
  program.cli().add_option("--ply", sources.ply, "Gaussians in a .ply, for another format");
  program.add_output_flag("file to write; its extension names the format: .ply, .splat or .spz");
  std::string coordinates = "dataset";
  program.cli()
      .add_option("--coordinates", coordinates,
                  "of a scene far from the origin, which is trained about one of its own: dataset "
                  "(.ply only) or scene, which viewers need")
      ->check(CLI::IsMember({"dataset", "scene"}));
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    check_output(program.output());
    const gaussians::GaussianFile file = load(sources);
    const int64_t written = save(program.output(), file, coordinates == "dataset");
    const auto bytes = fs::file_size(program.output());
    if (program.json()) {
      std::cout << "{\"gaussians\": " << written << ", \"bytes\": " << bytes << "}\n";
    } else {
      log_info(concat(program.output().string(), ": ", written, " Gaussians, ", bytes, " bytes"));
    }
    return ExitCode::kOk;
  });
}
