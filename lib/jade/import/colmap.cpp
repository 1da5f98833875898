// SPDX-License-Identifier: Apache-2.0
#include "jade/import/colmap.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <thread>
#include <unistd.h>

#include "jade/core/atomic_file.h"
#include "jade/core/child.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/io/colmap.h"
#include "jade/recording/python.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Number of mappings of the same matches at once. Incremental mapping is random, and about one
/// model in eight is wrong, with a larger error as its only sign: on a recording that rests and
/// then shakes, seven of eight models agreed within 0.1 px, and the eighth was 22 px off with all
/// images placed. All can be wrong: on three such recordings of 16 exposures both of two were 3 to
/// 61 px off.
int mappings() { return at::get_num_threads() < 4 ? 2 : 3; }

/// COLMAP would open a window system, and often there is none.
const std::vector<std::pair<std::string, std::string>> kNoWindows{{"QT_QPA_PLATFORM", "offscreen"}};

bool is_program(const fs::path& path) {
  std::error_code unreadable;
  return fs::is_regular_file(path, unreadable) && access(path.c_str(), X_OK) == 0;
}

/// Progress of a call of COLMAP.
struct Seen {
  int64_t done = 0;
  std::string now;  ///< current activity, in words; may be empty
};

/// One call of COLMAP, and how to read its progress.
struct Step {
  std::string title;
  std::vector<std::string> command;
  int64_t expected = 0;  ///< units of work
  std::string unit;
  std::function<void(const std::string& line, Seen& seen)> read;  ///< parses a line of its log
};

bool holds(const std::string& line, const char* part) {
  return line.find(part) != std::string::npos;
}

/// Counts the lines that contain `mark`; `ahead` of them precede the work that they announce.
std::function<void(const std::string&, Seen&)> counting(const std::string& mark, int64_t ahead) {
  return [mark, ahead, marks = int64_t{0}](const std::string& line, Seen& seen) mutable {
    if (holds(line, mark.c_str())) seen.done = std::max<int64_t>(0, ++marks - ahead);
  };
}

/// Reads the mapper's progress: the number of images in the current model, and its activity. Bundle
/// adjustment takes most of the time, some of it after the last image.
std::function<void(const std::string&, Seen&)> following_mapper() {
  return [adjusted = int64_t{0}](const std::string& line, Seen& seen) mutable {
    if (holds(line, "initial image pair")) {
      seen = {0, "looking for a first pair of images"};
    } else if (holds(line, "Registering image #")) {
      // "(num_reg_frames=7)" or "(7)" in older versions: images before this one.
      const size_t open = line.rfind('('), digit = line.find_first_of("0123456789", open);
      if (open != std::string::npos && digit != std::string::npos) {
        seen.done = std::atoll(line.c_str() + digit) + 1;
      }
      seen.now = "placing images";
    } else if (holds(line, "lobal bundle adjustment")) {
      seen.now = concat("adjustment ", ++adjusted, " of all cameras");
    }
  };
}

/// Reads the global mapper's progress: the number of steps that have ended, and the current one.
std::function<void(const std::string&, Seen&)> following_global_mapper() {
  return [begun = int64_t{0}](const std::string& line, Seen& seen) mutable {
    constexpr char kMark[] = "=== Running ";
    const size_t mark = line.find(kMark);
    if (mark == std::string::npos) return;
    const size_t name = mark + sizeof kMark - 1;
    seen = {begun++, line.substr(name, line.rfind(" ===") - name)};
  };
}

/// Reads the lines appended to a growing log since the last call.
class LogFollower {
 public:
  explicit LogFollower(const fs::path& log)
      : log_(log), at_(fs::exists(log) ? static_cast<std::streamoff>(fs::file_size(log)) : 0) {}

  template <class Visit>
  void read(const Visit& visit) {
    std::ifstream in(log_);
    in.seekg(at_);
    for (std::string line; std::getline(in, line) && !in.eof();) {
      visit(line);
      at_ = in.tellg();
    }
  }

 private:
  fs::path log_;
  std::streamoff at_;
};

/// The last line with content.
std::string last_line(const fs::path& log) {
  std::istringstream in(read_file(log));
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \t=") != std::string::npos) last = line;
  }
  return last;
}

/// Runs COLMAP to its end. @return whether it succeeded
bool run_step(const Step& step, const fs::path& log) {
  LogFollower follower(log);
  Progress progress(step.title, std::max<int64_t>(1, step.expected), 0, step.unit);
  Seen seen;
  int64_t shown = 0;
  const auto show = [&] {
    follower.read([&](const std::string& line) { step.read(line, seen); });
    const int64_t now = std::min(step.expected, seen.done);
    if (progress.step(now - shown)) progress.show(seen.now);
    shown = now;
  };
  progress.show();
  return run_to_end(step.command, kNoWindows, log, show) == 0;
}

/// @throws Interrupted.
void wait_for(Child& child) {
  while (!child.poll()) {
    if (interrupt_requested()) throw Interrupted();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

void run_or_throw(const Step& step, const fs::path& log) {
  if (run_step(step, log)) return;
  throw DataError(concat(step.title, " failed: ", last_line(log), "; see ", log.string()));
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

/// Whether a command of the program has a flag in its new spelling. scripts/colmap.py accepts the
/// old ones.
bool knows(const ColmapJob& job, const std::string& command, const std::string& flag,
           const fs::path& out) {
  if (job.program.size() > 1) return false;
  std::vector<std::string> help = call(job, command);
  help.push_back("-h");
  run_to_end(help, kNoWindows, out);
  return read_file(out).find(flag) != std::string::npos;
}

void rename_flags(std::vector<std::string>& command) {
  static const std::map<std::string, std::string> names{
      {"--SiftExtraction.use_gpu", "--FeatureExtraction.use_gpu"},
      {"--SiftMatching.use_gpu", "--FeatureMatching.use_gpu"},
      {"--SiftMatching.guided_matching", "--FeatureMatching.guided_matching"},
      {"--Mapper.ba_global_images_ratio", "--Mapper.ba_global_frames_ratio"}};
  for (std::string& word : command) {
    if (const auto found = names.find(word); found != names.end()) word = found->second;
  }
}

Step match_all(const ColmapJob& job, const std::string& database) {
  const int64_t blocks = (job.count + 49) / 50;
  Step match{"COLMAP: matching", call(job, "exhaustive_matcher"), blocks * blocks, "blocks",
             counting(" block [", 1)};
  append(match.command, {"--database_path", database});
  return match;
}

Step match_list(const ColmapJob& job, const std::string& database, const fs::path& folder) {
  std::string list;
  for (const auto& [a, b] : job.pairs) list += concat(a, ' ', b, '\n');
  write_file(folder / "pairs.txt", list);
  // Pairs per block, as in scripts/colmap.py and COLMAP's default.
  const int64_t block = job.program.size() > 1 ? 100 : 1225;
  Step match{"COLMAP: matching", call(job, "matches_importer"),
             (int64_t(job.pairs.size()) + block - 1) / block, "blocks", counting(" block [", 1)};
  append(match.command, {"--database_path", database, "--match_list_path",
                         (folder / "pairs.txt").string(), "--match_type", "pairs"});
  return match;
}

const char* refines_focal_length(const ColmapJob& job, const ColmapSettings& settings) {
  return job.camera || settings.hold_focal_length ? "0" : "1";
}

/// The folders of the models that a mapping wrote; logs in one line that there are none.
std::vector<fs::path> models_in(const fs::path& output, const fs::path& log) {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(output)) {
    if (entry.is_directory() && io::is_colmap_model(entry.path())) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  if (found.empty()) {
    log_info(concat("  ", output.filename().string(), ": no model: ", last_line(log), "; see ",
                    log.string()));
  }
  return found;
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
  Step extract{"COLMAP: features", call(job, "feature_extractor"), job.count, "images",
               counting("Processed file", 0)};
  append(extract.command, {"--database_path", database, "--image_path", job.images.string(),
                           "--ImageReader.single_camera", "1", "--SiftExtraction.use_gpu", "0"});
  if (job.camera) {
    append(extract.command,
           {"--ImageReader.camera_model", "PINHOLE", "--ImageReader.camera_params",
            numbers({job.camera->fx, job.camera->fy, job.camera->cx, job.camera->cy})});
  } else {
    append(extract.command, {"--ImageReader.camera_model", "SIMPLE_PINHOLE"});
  }
  if (!job.mask.empty()) {
    append(extract.command, {"--ImageReader.camera_mask_path", job.mask.string()});
  }
  if (!job.own_masks.empty()) {
    append(extract.command, {"--ImageReader.mask_path", job.own_masks.string()});
  }
  append(extract.command, settings.extraction);
  Step match = job.pairs.empty() ? match_all(job, database) : match_list(job, database, folder);
  append(match.command, {"--SiftMatching.use_gpu", "0"});
  append(match.command, settings.matching);
  // Since 3.13 some flags have other names.
  if (knows(job, "feature_extractor", "--FeatureExtraction.use_gpu", folder / "help.txt")) {
    rename_flags(extract.command);
    rename_flags(match.command);
  }
  run_or_throw(extract, log);
  run_or_throw(match, log);
}

std::vector<fs::path> reconstruct_globally(const ColmapJob& job, const ColmapSettings& settings,
                                           const fs::path& folder) {
  // An older package ends with an error.
  if (job.program.size() == 1 &&
      !knows(job, "global_mapper", "--GlobalMapper.ba_refine_focal_length", folder / "help.txt")) {
    return {};
  }
  const fs::path output = folder / (settings.name + "_global");
  make_writable_folder(output);
  Step map{"COLMAP: poses", call(job, "global_mapper"), 5, "steps", following_global_mapper()};
  append(map.command,
         {"--database_path", (folder / "database.db").string(), "--image_path", job.images.string(),
          "--output_path", output.string(), "--GlobalMapper.random_seed", "1",
          "--GlobalMapper.ba_refine_principal_point", "0", "--GlobalMapper.ba_refine_extra_params",
          "0", "--GlobalMapper.ba_refine_focal_length", refines_focal_length(job, settings)});
  run_step(map, folder / "colmap.log");
  return models_in(output, folder / "colmap.log");
}

std::vector<fs::path> reconstruct(const ColmapJob& job, const ColmapSettings& settings,
                                  const fs::path& folder) {
  std::vector<std::string> command = call(job, "mapper");
  append(command,
         {"--database_path", (folder / "database.db").string(), "--image_path", job.images.string(),
          "--Mapper.ba_refine_principal_point", "0", "--Mapper.ba_refine_extra_params", "0",
          "--Mapper.ba_refine_focal_length", refines_focal_length(job, settings)});
  append(command, settings.mapping);
  if (knows(job, "mapper", "--Mapper.ba_global_frames_ratio", folder / "help.txt")) {
    rename_flags(command);
  }
  // Mappings with one seed are equal on one thread and for few images.
  const bool seeds =
      job.program.size() > 1 || knows(job, "mapper", "--Mapper.random_seed", folder / "help.txt");
  const auto models_of = [&](int mapping) { return folder / concat(settings.name, '_', mapping); };
  const auto command_of = [&](int mapping) {
    make_writable_folder(models_of(mapping));
    std::vector<std::string> words = command;
    append(words, {"--output_path", models_of(mapping).string()});
    if (seeds) append(words, {"--Mapper.random_seed", concat(mapping + 1)});
    return words;
  };
  const auto log_of = [&](int mapping) {
    return folder / (mapping == 0 ? "colmap.log" : concat("mapper_", mapping, ".log"));
  };
  const int count = mappings();
  std::vector<Child> others;
  for (int k = 1; k < count; ++k) {
    others.emplace_back(command_of(k), kNoWindows, log_of(k));
  }
  // One more than the images, to leave room for the final adjustment.
  const Step map{"COLMAP: poses", command_of(0), job.count + 1, "images", following_mapper()};
  // The exit codes are unreliable: a search without result succeeds in some versions.
  run_step(map, log_of(0));
  for (Child& other : others) wait_for(other);
  std::vector<fs::path> found;
  for (int k = 0; k < count; ++k) {
    for (const fs::path& model : models_in(models_of(k), log_of(k))) found.push_back(model);
  }
  return found;
}

fs::path reverse_depths(const ColmapJob& job, const ColmapSettings& settings, const fs::path& model,
                        const fs::path& folder) {
  if (job.program.size() == 1) return {};
  const fs::path reversed = folder / (settings.name + "_reversed");
  fs::remove_all(reversed);
  Step step{"COLMAP: other depths", call(job, "reverse_depths"), 1, "models",
            [](const std::string&, Seen&) {}};
  append(step.command,
         {"--database_path", (folder / "database.db").string(), "--image_path", job.images.string(),
          "--input_path", model.string(), "--output_path", reversed.string(),
          "--refine_focal_length", refines_focal_length(job, settings)});
  if (!run_step(step, folder / "colmap.log") || !io::is_colmap_model(reversed)) return {};
  return reversed;
}

}  // namespace jade::import
