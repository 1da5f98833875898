// SPDX-License-Identifier: Apache-2.0
// Recordings that scripts/read_recording.py turns into a folder.
#include <fstream>
#include <sstream>
#include <string>

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

std::string last_line(const fs::path& log) {
  std::istringstream text(read_file(log));
  std::string last;
  for (std::string line; std::getline(text, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

void convert(const fs::path& path, const ReadOptions& options, const fs::path& folder) {
  const fs::path log = folder / "log.txt";
  const std::string python = interpreter(options.python);
  const int code = run_to_end(
      {python, script("read_recording.py").string(), path.string(), (folder / "out").string()}, {},
      log);
  if (code == 0) return;
  const std::string said = last_line(log);
  if (code == kScriptDataError) throw DataError(said);
  if (code == kScriptPackageMissing) throw DataError(concat(path.string(), ": ", said));
  if (code == 127) {
    throw DataError(concat(path.string(), ": is read by Python, and there is no ", python,
                           "; run scripts/setup.sh --import, or set JADE_PYTHON"));
  }
  throw DataError(concat(path.string(), ": scripts/read_recording.py failed (", code, "): ", said));
}

/// Lines "key value" of recording.txt.
void apply_description(const fs::path& path, Recording& recording, int64_t* offset_us) {
  std::istringstream text(read_file(path));
  for (std::string line; std::getline(text, line);) {
    std::istringstream words(line);
    std::string key, value;
    words >> key;
    std::getline(words >> std::ws, value);
    std::istringstream number(value);
    if (key == "format") recording.format = value;
    if (key == "stamp") recording.stamp = value_of<Stamp>(value).value_or(recording.stamp);
    if (key == "offset_us") number >> *offset_us;
    if (key == "width") number >> recording.width;
    if (key == "height") number >> recording.height;
    if (key == "note") recording.notes.push_back(value);
  }
}

void add_edges(const fs::path& path, Triggers& triggers) {
  if (!fs::is_regular_file(path)) return;
  std::istringstream text(read_file(path));
  std::string header;
  std::getline(text, header);
  int64_t t = 0, rising = 0;
  for (char comma = 0; text >> t >> comma >> rising;)
    (rising ? triggers.rising_us : triggers.falling_us).push_back(t);
}

void move(int64_t offset_us, Triggers& triggers) {
  for (auto* edges : {&triggers.rising_us, &triggers.falling_us}) {
    for (int64_t& t : *edges) t += offset_us;
  }
}

/// Notes on files that are gone by then would only confuse.
void name_original(const fs::path& made, const fs::path& original,
                   std::vector<std::string>& notes) {
  const std::string prefix = made.string() + "/";
  for (std::string& note : notes) {
    if (note.rfind(prefix, 0) == 0) note = original.string() + note.substr(note.find(": "));
  }
}

/// Events whose clock is moved by so much after reading.
ReadEvents moved(const ReadEvents& read, int64_t offset_us, const fs::path& made,
                 const fs::path& original) {
  return [=](const Kept& kept, Recording& out) {
    Kept theirs = kept;
    if (theirs) {
      for (events::TimeWindow& w : *theirs) w = {w.begin_us - offset_us, w.end_us - offset_us};
    }
    read(theirs, out);
    name_original(made, original, out.notes);
    const events::EventStream& e = out.events;
    if (offset_us != 0) out.events = {e.x(), e.y(), e.t_us() + offset_us, e.polarity()};
  };
}

/// What was converted is in µs.
ReadOptions in_microseconds(const ReadOptions& options) {
  ReadOptions out = options;
  out.time_unit = events::TimeUnit::kUs;
  return out;
}

}  // namespace

Contents read_converted(const fs::path& path, const ReadOptions& options) {
  const auto folder = std::make_shared<TemporaryFolder>();
  convert(path, options, folder->path());
  const fs::path made = folder->path() / "out";
  Contents out = read_event_folder(made, in_microseconds(options));
  int64_t offset_us = 0;
  apply_description(made / "recording.txt", out.recording, &offset_us);
  add_edges(made / "triggers.csv", out.recording.triggers);
  move(offset_us, out.recording.triggers);
  name_original(made, path, out.recording.notes);
  if (out.read_events) out.read_events = moved(out.read_events, offset_us, made, path);
  out.keep = folder;
  return out;
}

}  // namespace jade::recording
