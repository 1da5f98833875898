// SPDX-License-Identifier: Apache-2.0
#include "jade/import/stages.h"

#include <algorithm>
#include <chrono>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;

/// Version of the stages' results; increase it when older results become unusable.
constexpr int kFormat = 2;
constexpr char kKeyFile[] = "stage.txt";

/// A stage's key includes that of the previous stage.
std::vector<std::string> keys_of(const std::vector<Stage>& stages) {
  std::vector<std::string> keys;
  std::string before = concat("format ", kFormat);
  for (const Stage& stage : stages) {
    Sha256 digest;
    digest.update(concat(before, '\n', stage.name, '\n', stage.settings));
    before = digest.hex();
    keys.push_back(before);
  }
  return keys;
}

bool is_kept(const fs::path& folder, const std::string& key) {
  const fs::path file = folder / kKeyFile;
  return fs::exists(file) && read_file(file).rfind(key, 0) == 0;
}

size_t index_of(const std::vector<Stage>& stages, const std::string& name, const char* flag) {
  std::string names;
  for (size_t i = 0; i < stages.size(); ++i) {
    if (stages[i].name == name) return i;
    names += (i == 0 ? "" : ", ") + stages[i].name;
  }
  throw ConfigError(concat(flag, ": expected one of ", names, ", found '", name, "'"));
}

/// Runs one stage in a temporary folder, then moves the result into place.
void make(const Stage& stage, const std::string& key, const fs::path& place) {
  const fs::path draft = place.string() + ".new";
  fs::remove_all(draft);
  make_writable_folder(draft);
  const auto start = std::chrono::steady_clock::now();
  const std::string said = stage.make(draft);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  throw_if_interrupted();
  write_file(draft / kKeyFile,
             concat(key, "\nseconds ", seconds.count(), "\n", said, "\n", stage.settings, "\n"));
  fs::remove_all(place);
  fs::rename(draft, place);
  log_info(concat(stage.name, std::string(stage.name.size() < 11 ? 11 - stage.name.size() : 1, ' '),
                  said, " (", duration_text(seconds.count()), ")"));
}

/// Marks later stages as outdated, because they used an older result with the same settings.
void outdate(const fs::path& folder, const std::vector<Stage>& stages, size_t from) {
  for (size_t i = from; i < stages.size(); ++i) fs::remove(folder / stages[i].name / kKeyFile);
}

}  // namespace

void run_stages(const fs::path& folder, const std::vector<Stage>& stages, const StageRange& range) {
  const std::vector<std::string> keys = keys_of(stages);
  size_t first = stages.size();
  for (size_t i = stages.size(); i-- > 0;) {
    if (!is_kept(folder / stages[i].name, keys[i])) first = i;
  }
  if (!range.from.empty()) first = std::min(first, index_of(stages, range.from, "--from"));
  const size_t end =
      range.until.empty() ? stages.size() : index_of(stages, range.until, "--until") + 1;
  if (!range.from.empty() && index_of(stages, range.from, "--from") >= end) {
    throw ConfigError(
        concat("--until: expected ", range.from, " or a stage after it, found ", range.until));
  }
  if (first >= end) {
    log_info(concat(folder.string(), ": up to date; --from STAGE makes it again"));
    return;
  }
  size_t i = 0;
  try {
    for (; i < end; ++i) {
      throw_if_interrupted();
      if (i >= first) {
        Progress progress("import", int64_t(end), int64_t(i), "stages");
        progress.show(stages[i].name);
        make(stages[i], keys[i], folder / stages[i].name);
        outdate(folder, stages, i + 1);
      }
      stages[i].load(folder / stages[i].name);
    }
  } catch (const Interrupted&) {
    log_info(concat("interrupted in stage ", stages[i].name,
                    "; the stages before it are kept, run the same command again to go on"));
    throw;
  }
}

}  // namespace jade::import
