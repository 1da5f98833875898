// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restoration_cache.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <fstream>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/cache_folder.h"
#include "jade/core/check.h"
#include "jade/core/digest.h"
#include "jade/core/log.h"

namespace jade::restore {
namespace {

namespace fs = std::filesystem;

// A file is one line of text, "jade-restoration 1 <SHA-256 of the values> <C>x<H>x<W>", and the
// values in float32 in native byte order.
constexpr const char* kMagic = "jade-restoration 1 ";
constexpr const char* kExtension = ".restoration";
constexpr std::chrono::hours kAbandoned{1};

std::string sha256_of(const void* data, size_t bytes) {
  Sha256 digest;
  digest.update(data, bytes);
  return digest.hex();
}

std::string header_of(const torch::Tensor& image) {
  return concat(kMagic, sha256_of(image.const_data_ptr(), image.nbytes()), ' ', image.size(0), 'x',
                image.size(1), 'x', image.size(2), '\n');
}

/// Parses a file into `image`; returns the problem, or an empty string.
std::string parse(const std::string& file, torch::IntArrayRef shape, torch::Tensor* image) {
  const size_t newline = file.find('\n');
  if (newline == std::string::npos || file.compare(0, std::strlen(kMagic), kMagic) != 0) {
    return "is no restoration of this version";
  }
  *image = torch::empty(shape, torch::kFloat32);
  const size_t begin = newline + 1;
  if (file.size() - begin != image->nbytes()) {
    return concat("holds ", file.size() - begin, " bytes of values, expected ", image->nbytes());
  }
  std::memcpy(image->mutable_data_ptr(), file.data() + begin, image->nbytes());
  if (file.compare(0, begin, header_of(*image)) != 0) return "does not match its checksum";
  return "";
}

void write_entry(const fs::path& path, const torch::Tensor& image) {
  AtomicFile file(path);
  std::ofstream out(file.temporary_path(), std::ios::binary);
  out << header_of(image);
  out.write(static_cast<const char*>(image.const_data_ptr()),
            static_cast<std::streamsize>(image.nbytes()));
  out.close();
  if (!out) throw DataError(concat(path.string(), ": cannot be written; is the disk full?"));
  file.commit();
}

struct Entry {
  fs::path path;
  fs::file_time_type used;
  int64_t bytes;
};

/// Lists the files of a cache and removes abandoned temporary ones. Ignores failures, because other
/// processes may remove files meanwhile.
std::vector<Entry> list_entries(const fs::path& folder) {
  std::vector<Entry> entries;
  std::error_code ignored;
  const auto now = fs::file_time_type::clock::now();
  for (const auto& item : fs::directory_iterator(folder, ignored)) {
    std::error_code gone;
    const auto used = item.last_write_time(gone);
    const auto bytes = static_cast<int64_t>(item.file_size(gone));
    if (gone) continue;
    const bool unfinished = item.path().filename().string().find(kExtension) != std::string::npos &&
                            item.path().extension() == ".part";
    if (unfinished && now - used > kAbandoned) fs::remove(item.path(), gone);
    if (item.path().extension() == kExtension) entries.push_back({item.path(), used, bytes});
  }
  return entries;
}

}  // namespace

std::string restoration_key(const std::string& recipe, const std::vector<torch::Tensor>& inputs) {
  Sha256 digest;
  digest.update(concat(recipe, ';'));
  for (const torch::Tensor& input : inputs) {
    const torch::Tensor values = input.detach().cpu().contiguous();
    digest.update(concat(values.scalar_type(), shape_string(values), ';'));
    digest.update(values.const_data_ptr(), values.nbytes());
  }
  return digest.hex();
}

RestorationCache::RestorationCache(const RestorationCacheOptions& options)
    : max_bytes_(options.max_mib << 20) {
  if (!options.enabled) return;
  folder_ = options.folder.empty() ? cache_folder() / "restorations" : options.folder;
  try {
    make_writable_folder(folder_);
  } catch (const DataError& problem) {
    give_up(problem.what());
  }
}

void RestorationCache::give_up(const std::string& why) {
  log_warn(concat("restorations are not kept for the next run: ", why));
  prune();  // the last chance to prune
  folder_.clear();
}

fs::path RestorationCache::path_of(const std::string& key) const {
  return folder_ / (key + kExtension);
}

std::optional<torch::Tensor> RestorationCache::find(const std::string& key,
                                                    torch::IntArrayRef shape) {
  if (folder_.empty()) return std::nullopt;
  const fs::path path = path_of(key);
  std::error_code missing;
  if (fs::is_regular_file(path, missing)) {
    torch::Tensor image;
    std::string problem;
    try {
      problem = parse(read_file(path), shape, &image);
    } catch (const DataError& error) {  // removed meanwhile, or not readable
      problem = error.what();
    }
    if (problem.empty()) {
      ++hits_;
      fs::last_write_time(path, fs::file_time_type::clock::now(), missing);
      return image;
    }
    log_warn(concat(path.string(), ": ", problem, "; it is made again"));
  }
  ++misses_;
  return std::nullopt;
}

void RestorationCache::keep(const std::string& key, const torch::Tensor& image) {
  if (folder_.empty()) return;
  check_shape(image, "restoration", {-1, -1, -1});
  try {
    const auto values = image.detach().to(torch::kCPU, torch::kFloat32).contiguous();
    write_entry(path_of(key), values);
    kept_bytes_ += static_cast<int64_t>(values.nbytes());
    if (kept_bytes_ > max_bytes_ / 8) {
      prune();
      kept_bytes_ = 0;
    }
  } catch (const DataError& problem) {
    give_up(problem.what());
  }
}

torch::Tensor RestorationCache::get(const std::string& key, torch::IntArrayRef shape,
                                    const std::function<torch::Tensor()>& compute) {
  if (const auto kept = find(key, shape)) return *kept;
  const torch::Tensor computed = compute();
  JADE_CHECK(computed.sizes() == shape, "expected a restoration of shape ", shape, ", found ",
             computed.sizes());
  keep(key, computed);
  return computed;
}

void RestorationCache::prune() const {
  if (folder_.empty()) return;
  std::vector<Entry> entries = list_entries(folder_);
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return a.used < b.used; });
  int64_t bytes = 0;
  for (const Entry& entry : entries) bytes += entry.bytes;
  for (const Entry& entry : entries) {
    if (bytes <= max_bytes_) break;
    std::error_code gone;
    fs::remove(entry.path, gone);
    bytes -= entry.bytes;
  }
}

}  // namespace jade::restore
