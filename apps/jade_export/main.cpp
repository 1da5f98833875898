// SPDX-License-Identifier: Apache-2.0
// Gaussians from a run, a checkpoint or a .ply to the formats of splat viewers.
#include "common/cli.h"
#include "jade/core/atomic_file.h"
#include "jade/core/log.h"
#include "jade/gaussians/ply.h"
#include "jade/gaussians/splat_file.h"
#include "jade/gaussians/spz_file.h"
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
  if (!sources.ply.empty()) return gaussians::read_ply(sources.ply);
  if (!sources.checkpoint.empty()) {
    return {run::load_checkpoint_gaussians(sources.checkpoint), false};
  }
  return {run::newest_gaussians(sources.run), false};
}

void save(const fs::path& path, const gaussians::GaussianFile& file) {
  const std::string extension = path.extension().string();
  if (path.has_parent_path()) make_writable_folder(path.parent_path());
  if (extension == ".ply") {
    gaussians::write_ply(path, file);
  } else if (extension == ".splat") {
    gaussians::write_splat(path, file.gaussians);
  } else if (extension == ".spz") {
    gaussians::SpzOptions options;
    options.antialiased = file.antialiased;
    gaussians::write_spz(path, file.gaussians, options);
  } else {
    throw ConfigError(concat("--output: expected a file that ends in .ply, .splat or .spz, found ",
                             path.string().empty() ? "nothing" : path.string()));
  }
}

}  // namespace

int main(int argc, char** argv) {
  apps::Program program("jade_export", "Writes Gaussians as .ply, .splat or .spz");
  Sources sources;
  program.cli().add_option("--run", sources.run, "run directory; its newest scene is taken");
  program.cli().add_option("--checkpoint", sources.checkpoint, "one checkpoint");
  program.cli().add_option("--ply", sources.ply, "Gaussians in a .ply, for another format");
  program.add_output_flag("file to write; its extension names the format: .ply, .splat or .spz");
  program.add_json_flag();
  return program.run(argc, argv, [&] {
    const gaussians::GaussianFile file = load(sources);
    save(program.output(), file);
    const auto bytes = fs::file_size(program.output());
    if (program.json()) {
      std::cout << "{\"gaussians\": " << file.gaussians.size() << ", \"bytes\": " << bytes << "}\n";
    } else {
      log_info(concat(program.output().string(), ": ", file.gaussians.size(), " Gaussians, ", bytes,
                      " bytes"));
    }
    return ExitCode::kOk;
  });
}
