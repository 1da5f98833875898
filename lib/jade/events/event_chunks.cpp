// SPDX-License-Identifier: Apache-2.0
// Numbered files of one stream of events, as rpg_vid2e writes them: events/0000000000.npz, …
#include <algorithm>
#include <limits>
#include <map>
#include <torch/types.h>
#include <tuple>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/text.h"
#include "jade/events/event_files.h"
#include "jade/events/raw_events.h"

namespace jade::events {
namespace {

namespace fs = std::filesystem;

struct Chunk {
  fs::path path;
  RawEvents raw;
  double first = 0, last = 0;
};

/// The name without its number, which is the last digits of its stem: "events_.npz". Empty for
/// names without a number, of other kinds, or hidden.
std::string pattern_of(const fs::path& file) {
  const std::string stem = file.stem().string(),
                    ending = in_small_letters(file.extension().string());
  const size_t letters = stem.find_last_not_of("0123456789") + 1;
  const bool is_known = ending == ".npz" || ending == ".npy" || ending == ".h5" ||
                        ending == ".hdf5" || ending == ".txt" || ending == ".csv";
  const bool is_other = letters == stem.size() || !is_known || stem[0] == '.';
  return is_other ? "" : stem.substr(0, letters) + ending;
}

bool is_text(const fs::path& file) {
  const std::string ending = in_small_letters(file.extension().string());
  return ending == ".txt" || ending == ".csv";
}

/// Whether a name is that of one camera among several.
bool names_camera(const fs::path& file) {
  const std::string name = in_small_letters(file.stem().string());
  const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
  return has("cam") || has("left") || has("right") || has("front") || has("back");
}

/// Adds the warnings of a file in the name of its folder, each once.
void add_warnings(const fs::path& folder, const fs::path& file,
                  const std::vector<std::string>& notes, std::vector<std::string>& warnings) {
  for (const std::string& note : notes) {
    const bool is_named = note.rfind(file.string() + ":", 0) == 0;
    const std::string line = is_named ? folder.string() + note.substr(file.string().size()) : note;
    if (!note.empty() && std::find(warnings.begin(), warnings.end(), line) == warnings.end())
      warnings.push_back(line);
  }
}

/// Refuses files whose clocks begin again: more than a tenth of one lies in the file before it.
void check_order(const fs::path& folder, const std::vector<Chunk>& chunks) {
  constexpr double kMost = 0.1;
  for (size_t i = 1; i < chunks.size(); ++i) {
    const Chunk &before = chunks[i - 1], &chunk = chunks[i];
    const double length = std::min(before.last - before.first, chunk.last - chunk.first);
    if (before.last - chunk.first <= kMost * length) continue;
    throw DataError(concat(folder.string(), ": expected numbered files of events that follow one ",
                           "another in time, found ", chunk.path.filename().string(), " from ",
                           chunk.first, " within ", before.path.filename().string(), " to ",
                           before.last, "; give one of them, or give them one clock"));
  }
}

torch::Tensor joined(const std::vector<Chunk>& chunks, torch::Tensor RawEvents::*field) {
  std::vector<torch::Tensor> parts;
  for (const Chunk& chunk : chunks) parts.push_back(chunk.raw.*field);
  return torch::cat(parts);
}

}  // namespace

std::vector<fs::path> event_chunks(const fs::path& folder) {
  std::map<std::string, std::vector<fs::path>> arrays, text;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string pattern = pattern_of(entry->path());
    if (!pattern.empty() && entry->is_regular_file(ignored))
      (is_text(entry->path()) ? text : arrays)[pattern].push_back(entry->path());
  }
  const auto& found = arrays.empty() ? text : arrays;
  if (found.size() != 1 || found.begin()->second.size() < 2) return {};
  std::vector<fs::path> files = found.begin()->second;
  if (names_camera(files.front())) return {};
  std::sort(files.begin(), files.end());
  return files;
}

RawEvents read_chunks(const fs::path& folder, const std::string& group, double event_bytes,
                      std::vector<std::string>& warnings) {
  std::vector<Chunk> chunks;
  const std::vector<fs::path> files = event_chunks(folder);
  // Read the largest file first: a file of few events may not show its columns.
  std::vector<fs::path> ordered = files;
  std::stable_sort(ordered.begin(), ordered.end(), [](const fs::path& a, const fs::path& b) {
    return fs::file_size(a) > fs::file_size(b);
  });
  RawEvents out;
  int64_t count = 0;
  for (const fs::path& path : ordered) {
    throw_if_interrupted();
    const EventFileKind kind = file_kind(path);
    Chunk chunk{path, {}};
    if (kind == EventFileKind::kHdf5) {
      const Hdf5Events file(path, group, out.columns);
      add_warnings(folder, path, file.notes(), warnings);
      chunk.raw = file.read();
    } else {
      chunk.raw = read_raw(path, kind, group, out.columns);
    }
    add_warnings(folder, path, {chunk.raw.note}, warnings);
    count += chunk.raw.time.numel();
    check_event_memory(folder, count, event_bytes);
    if (chunk.raw.time.numel() == 0) continue;
    if (chunks.empty()) out.columns = chunk.raw.columns;
    chunk.first = chunk.raw.time.min().to(torch::kFloat64).item<double>();
    chunk.last = chunk.raw.time.max().to(torch::kFloat64).item<double>();
    if (chunks.empty()) out.unit = chunk.raw.unit;
    if (chunk.raw.unit != out.unit) {
      throw DataError(concat(path.string(), ": expected times in the unit of ",
                             chunks.front().path.filename().string(), ", found another; convert ",
                             "them to one unit"));
    }
    out.time_bits = std::min(out.time_bits, chunk.raw.time_bits);
    if (!out.size) out.size = chunk.raw.size;
    chunks.push_back(std::move(chunk));
  }
  if (chunks.empty())
    throw DataError(concat(folder.string(), ": expected numbered files of events, found none"));
  std::stable_sort(chunks.begin(), chunks.end(), [](const Chunk& a, const Chunk& b) {
    return std::tie(a.first, a.path) < std::tie(b.first, b.path);
  });
  check_order(folder, chunks);
  warnings.push_back(concat(folder.string(), ": ", files.size(), " files of events, ",
                            files.front().filename().string(), " to ",
                            files.back().filename().string(), ", are read as one recording"));
  out.x = joined(chunks, &RawEvents::x);
  out.y = joined(chunks, &RawEvents::y);
  out.polarity = joined(chunks, &RawEvents::polarity);
  out.time = joined(chunks, &RawEvents::time);
  return out;
}

}  // namespace jade::events
