// SPDX-License-Identifier: Apache-2.0
// Numbered files of one stream of events, as rpg_vid2e writes them: events/0000000000.npz, …
#include <algorithm>
#include <limits>
#include <map>
#include <torch/types.h>

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
/// names without a number, or of other kinds.
std::string pattern_of(const fs::path& file) {
  const std::string stem = file.stem().string(),
                    ending = in_small_letters(file.extension().string());
  const size_t letters = stem.find_last_not_of("0123456789") + 1;
  const bool is_known = ending == ".npz" || ending == ".npy" || ending == ".h5" ||
                        ending == ".hdf5" || ending == ".txt" || ending == ".csv";
  return letters == stem.size() || !is_known ? "" : stem.substr(0, letters) + ending;
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
  std::map<std::string, std::vector<fs::path>> found;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string pattern = pattern_of(entry->path());
    if (!pattern.empty() && entry->is_regular_file(ignored))
      found[pattern].push_back(entry->path());
  }
  if (found.size() != 1 || found.begin()->second.size() < 2) return {};
  std::vector<fs::path> files = found.begin()->second;
  std::sort(files.begin(), files.end());
  return files;
}

RawEvents read_chunks(const fs::path& folder, const std::string& group,
                      std::vector<std::string>& warnings) {
  std::vector<Chunk> chunks;
  const std::vector<fs::path> files = event_chunks(folder);
  RawEvents out;
  for (const fs::path& path : files) {
    throw_if_interrupted();
    const EventFileKind kind = file_kind(path);
    Chunk chunk{
        path, kind == EventFileKind::kHdf5 ? Hdf5Events(path, group).read() : read_raw(path, kind)};
    if (!chunk.raw.note.empty()) warnings.push_back(chunk.raw.note);
    if (chunk.raw.time.numel() == 0) continue;
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
  std::stable_sort(chunks.begin(), chunks.end(),
                   [](const Chunk& a, const Chunk& b) { return a.first < b.first; });
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
