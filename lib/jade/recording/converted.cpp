// SPDX-License-Identifier: Apache-2.0
// Recordings that scripts/read_recording.py converts to a folder.
#include <sstream>
#include <string>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/child.h"
#include "jade/core/error.h"
#include "jade/recording/contents.h"
#include "jade/recording/python.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

// Exit codes of the script.
constexpr int kScriptDataError = 3, kScriptPackageMissing = 4;

void convert(const fs::path& path, const ReadOptions& options, const fs::path& folder) {
  const fs::path log = folder / "log.txt";
  const std::string python = interpreter(options.python);
  std::vector<std::string> command = {python, script("read_recording.py").string(), path.string(),
                                      (folder / "out").string()};
  if (!options.topic.empty()) command.insert(command.end(), {"--events-topic", options.topic});
  if (!options.frames_topic.empty())
    command.insert(command.end(), {"--frames-topic", options.frames_topic});
  if (options.stamp) command.insert(command.end(), {"--stamp", word_of(*options.stamp)});
  const int code = run_to_end(command, {}, log);
  if (code == 0) return;
  const std::string said = last_line(log);
  if (said.empty() && code != 127) {
    throw DataError(concat(path.string(), ": scripts/read_recording.py failed (", code,
                           ") and could not say why; is ", folder.parent_path().string(),
                           " full? Set TMPDIR to a folder with space"));
  }
  if (code == kScriptDataError) throw DataError(said);
  if (code == kScriptPackageMissing) throw DataError(concat(path.string(), ": ", said));
  if (code == 127) {
    throw DataError(
        concat(path.string(), ": is read by Python, and there is no ", python,
               "; run scripts/setup.sh --import, or pip install 'jade-gs[import]', or set "
               "JADE_PYTHON"));
  }
  throw DataError(concat(path.string(), ": scripts/read_recording.py failed (", code, "): ", said));
}

}  // namespace

std::string last_line(const fs::path& log) {
  std::istringstream text(read_file(log));
  std::string last;
  for (std::string line; std::getline(text, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

Contents read_converted(const fs::path& path, const ReadOptions& options) {
  const auto folder = std::make_shared<TemporaryFolder>();
  convert(path, options, folder->path());
  Contents out = read_made({folder->path() / "out", path, false}, options);
  out.keep = folder;
  return out;
}

}  // namespace jade::recording
