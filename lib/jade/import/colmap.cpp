// SPDX-License-Identifier: Apache-2.0
#include "jade/import/colmap.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <unistd.h>

#include "jade/core/atomic_file.h"
#include "jade/core/child.h"
#include "jade/core/error.h"
#include "jade/core/progress.h"
#include "jade/io/colmap.h"
#include "jade/recording/python.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

bool is_program(const fs::path& path) {
  std::error_code unreadable;
  return fs::is_regular_file(path, unreadable) && access(path.c_str(), X_OK) == 0;
}

/// One call of COLMAP, and what tells how far it is.
struct Step {
  std::string title;
  std::vector<std::string> command;
  std::string mark;      ///< of its log, once for each unit of work
  int64_t expected = 0;  ///< marks
  int64_t ahead = 0;     ///< marks that stand before the work they announce
};

int64_t count_marks(const fs::path& log, std::streamoff from, const std::string& mark) {
  std::ifstream in(log);
  in.seekg(from);
  int64_t count = 0;
  for (std::string line; std::getline(in, line);) {
    if (line.find(mark) != std::string::npos) ++count;
  }
  return count;
}

/// The last line that says something.
std::string last_line(const fs::path& log) {
  std::istringstream in(read_file(log));
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \t=") != std::string::npos) last = line;
  }
  return last;
}

/// Runs COLMAP to its end. @return whether it ended well
bool run_step(const Step& step, const fs::path& log) {
  const auto begin = fs::exists(log) ? static_cast<std::streamoff>(fs::file_size(log)) : 0;
  // The window system is not needed, and often not there.
  Progress progress(step.title, std::max<int64_t>(1, step.expected));
  int64_t shown = 0;
  const auto show = [&] {
    const int64_t now = std::min(
        step.expected, std::max<int64_t>(0, count_marks(log, begin, step.mark) - step.ahead));
    if (progress.step(now - shown)) progress.show();
    shown = now;
  };
  return run_to_end(step.command, {{"QT_QPA_PLATFORM", "offscreen"}}, log, show) == 0;
}

void run_or_throw(const Step& step, const fs::path& log) {
  if (run_step(step, log)) return;
  throw DataError(
      concat("COLMAP (", step.title, ") failed: ", last_line(log), "; see ", log.string()));
}

std::string numbers(const std::vector<double>& values) {
  std::ostringstream out;
  out.precision(12);
  for (size_t i = 0; i < values.size(); ++i) out << (i == 0 ? "" : ",") << values[i];
  return out.str();
}

void append(std::vector<std::string>& to, const std::vector<std::string>& more) {
  to.insert(to.end(), more.begin(), more.end());
}

std::vector<std::string> call(const ColmapJob& job, const std::string& command) {
  std::vector<std::string> words = job.program;
  words.push_back(command);
  return words;
}

/// Whether the program is of those since 3.13, which keep some flags under other names.
bool has_new_names(const ColmapJob& job, const fs::path& out) {
  std::vector<std::string> help = call(job, "feature_extractor");
  help.push_back("-h");
  run_to_end(help, {{"QT_QPA_PLATFORM", "offscreen"}}, out);
  return read_file(out).find("--FeatureExtraction.use_gpu") != std::string::npos;
}

void rename_flags(std::vector<std::string>& command) {
  static const std::map<std::string, std::string> names{
      {"--SiftExtraction.use_gpu", "--FeatureExtraction.use_gpu"},
      {"--SiftMatching.use_gpu", "--FeatureMatching.use_gpu"},
      {"--SiftMatching.guided_matching", "--FeatureMatching.guided_matching"}};
  for (std::string& word : command) {
    if (const auto found = names.find(word); found != names.end()) word = found->second;
  }
}

}  // namespace

std::vector<std::string> find_colmap(const fs::path& wanted) {
  if (!wanted.empty()) {
    if (is_program(wanted)) return {wanted.string()};
    throw DataError(concat(wanted.string(),
                           ": expected the program colmap, found none; correct "
                           "poses.colmap or leave it empty"));
  }
  const std::vector<std::string> package{recording::interpreter({}),
                                         recording::script("colmap.py").string()};
  if (run_to_end({package[0], package[1], "version"}, {}, "/dev/null") == 0) return package;
  const char* path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path program = fs::path(folder) / "colmap";
    if (is_program(program)) return {program.string()};
  }
  throw DataError(
      "COLMAP: expected the Python package pycolmap or the program colmap on the path, found "
      "neither; install one with scripts/setup.sh --import, or pip install 'jade-gs[import]'");
}

void match_features(const ColmapJob& job, const ColmapSettings& settings, const fs::path& folder) {
  make_writable_folder(folder);
  const fs::path log = folder / "colmap.log";
  const std::string database = (folder / "database.db").string();
  Step extract{"features", call(job, "feature_extractor"), "Processed file", job.count};
  append(extract.command, {"--database_path", database, "--image_path", job.images.string(),
                           "--ImageReader.single_camera", "1", "--SiftExtraction.use_gpu", "0"});
  if (job.camera) {
    append(extract.command,
           {"--ImageReader.camera_model", "PINHOLE", "--ImageReader.camera_params",
            numbers({job.camera->fx, job.camera->fy, job.camera->cx, job.camera->cy})});
  } else {
    append(extract.command, {"--ImageReader.camera_model", "SIMPLE_PINHOLE"});
  }
  append(extract.command, settings.extraction);
  const int64_t blocks = (job.count + 49) / 50;
  Step match{"matching", call(job, job.sequential ? "sequential_matcher" : "exhaustive_matcher"),
             job.sequential ? " image [" : " block [", job.sequential ? job.count : blocks * blocks,
             1};
  append(match.command, {"--database_path", database, "--SiftMatching.use_gpu", "0"});
  if (job.sequential) append(match.command, {"--SequentialMatching.overlap", "20"});
  append(match.command, settings.matching);
  if (has_new_names(job, folder / "help.txt")) {
    rename_flags(extract.command);
    rename_flags(match.command);
  }
  run_or_throw(extract, log);
  run_or_throw(match, log);
}

std::vector<fs::path> reconstruct(const ColmapJob& job, const ColmapSettings& settings,
                                  const fs::path& folder) {
  const fs::path models = folder / settings.name;
  make_writable_folder(models);
  Step map{"poses", call(job, "mapper"), "Registering image", job.count};
  append(map.command, {"--database_path", (folder / "database.db").string(), "--image_path",
                       job.images.string(), "--output_path", models.string(),
                       "--Mapper.ba_refine_principal_point", "0", "--Mapper.ba_refine_extra_params",
                       "0", "--Mapper.ba_refine_focal_length", job.camera ? "0" : "1"});
  append(map.command, settings.mapping);
  // Its exit code says little: a search without result ends well in some versions only.
  run_step(map, folder / "colmap.log");
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(models)) {
    if (entry.is_directory() && io::is_colmap_model(entry.path())) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace jade::import
