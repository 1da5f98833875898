// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restoration_cache.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <fstream>
#include <mutex>
#include <set>
#include <torch/cuda.h>
#include <torch/types.h>
#include <unistd.h>

#include "jade/core/atomic_file.h"
#include "jade/core/cache_folder.h"
#include "jade/core/check.h"
#include "jade/core/digest.h"
#include "jade/core/log.h"

namespace jade::restore {
namespace {

namespace fs = std::filesystem;

// A file is one line of text, "jade-restoration 2 <SHA-256 of the values> <f16 or f32>
// <C>x<H>x<W>", and the values of that type in native byte order.
constexpr const char* kMagic = "jade-restoration 2 ";
constexpr const char* kExtension = ".restoration";
constexpr std::chrono::hours kAbandoned{1};

std::string sha256_of(const void* data, size_t bytes) {
  Sha256 digest;
  digest.update(data, bytes);
  return digest.hex();
}

std::string header_of(const torch::Tensor& image) {
  return concat(kMagic, sha256_of(image.const_data_ptr(), image.nbytes()),
                image.scalar_type() == torch::kHalf ? " f16 " : " f32 ", image.size(0), 'x',
                image.size(1), 'x', image.size(2), '\n');
}

/// Parses a file into `image`; returns the problem, or an empty string.
std::string parse(const std::string& file, torch::IntArrayRef shape, torch::Tensor* image) {
  const size_t newline = file.find('\n');
  if (newline == std::string::npos || file.compare(0, std::strlen(kMagic), kMagic) != 0) {
    return "is no restoration of this version";
  }
  const bool half = file.rfind(" f16 ", newline) != std::string::npos;
  *image = torch::empty(shape, half ? torch::kHalf : torch::kFloat32);
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
  if (!out) throw DataError(concat(path.filename().string(), ": cannot be written"));
  file.commit();
}

/// Reads an entry and marks it as used. @param problem  set if there is one that cannot be read
std::optional<torch::Tensor> read_entry(const fs::path& path, torch::IntArrayRef shape,
                                        std::string* problem) {
  std::error_code missing;
  if (!fs::is_regular_file(path, missing)) return std::nullopt;
  torch::Tensor image;
  try {
    *problem = parse(read_file(path), shape, &image);
  } catch (const DataError& error) {  // removed meanwhile, or not readable
    *problem = error.what();
  }
  if (!problem->empty()) return std::nullopt;
  fs::last_write_time(path, fs::file_time_type::clock::now(), missing);
  return image;
}

fs::path folder_of(const RestorationCacheOptions& options) {
  return options.folder.empty() ? cache_folder() / "restorations" : options.folder;
}

/// Makes the folder. Returns why nothing can be written there, or an empty string.
std::string problem_of(const fs::path& folder) {
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (failure) return failure.message();
  if (!fs::is_directory(folder)) return "a file of that name is in the way";
  return access(folder.c_str(), W_OK | X_OK) == 0 ? "" : "it is not writable";
}

fs::path file_of(const fs::path& folder, const std::string& key) {
  return folder / (key + kExtension);
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

bool is_cached(const RestorationCacheOptions& options, const std::string& key) {
  std::error_code ignored;
  return options.enabled && fs::is_regular_file(file_of(folder_of(options), key), ignored);
}

RestorationCache::RestorationCache(const RestorationCacheOptions& options)
    : max_bytes_(options.max_mib << 20) {
  if (!options.enabled) return;
  is_on_ = true;
  folder_ = folder_of(options);
  if (const std::string problem = problem_of(folder_); !problem.empty()) give_up(problem);
}

RestorationCache::~RestorationCache() { finish_writing(); }

void RestorationCache::finish_writing() {
  if (!writing_.valid()) return;
  const std::string problem = writing_.get();
  writing_key_.clear();
  if (!problem.empty()) give_up(problem);
}

void RestorationCache::give_up(const std::string& why) {
  // A run has several caches in one folder, whose problem is one.
  static std::mutex mutex;
  static std::set<fs::path> told;
  const std::lock_guard lock(mutex);
  if (told.insert(folder_).second) {
    log_warn(concat("the cache folder ", folder_.string(), " cannot be used (", why,
                    "), so restorations are not kept for the next run; choose another with "
                    "cache.folder or the environment variable JADE_CACHE, or make room"));
  }
  prune();  // the last chance to prune
  is_on_ = false;
}

std::optional<torch::Tensor> RestorationCache::find(const std::string& key,
                                                    torch::IntArrayRef shape) {
  if (!is_on_) return std::nullopt;
  if (key == writing_key_) finish_writing();
  std::string problem;
  std::optional<torch::Tensor> image = read_entry(file_of(folder_, key), shape, &problem);
  if (!problem.empty()) {
    log_warn(concat(file_of(folder_, key).string(), ": ", problem, "; it is made again"));
  }
  ++(image ? hits_ : misses_);
  return image;
}

std::optional<torch::Tensor> RestorationCache::peek(const std::string& key,
                                                    torch::IntArrayRef shape) const {
  std::string ignored;
  if (!is_on_) return std::nullopt;
  return read_entry(file_of(folder_, key), shape, &ignored);
}

void RestorationCache::keep(const std::string& key, const torch::Tensor& image) {
  check_shape(image, "restoration", {-1, -1, -1});
  finish_writing();
  if (!is_on_) return;
  const bool half = image.scalar_type() == torch::kHalf;
  const auto bytes = image.numel() * int64_t{half ? 2 : 4};
  // More would remove the first entries of this run, and the next run would find none of them.
  if (kept_bytes_ + bytes > max_bytes_) return;
  kept_bytes_ += bytes;
  ++kept_;
  // The other thread's stream must find it complete.
  if (image.is_cuda()) torch::cuda::synchronize(image.device().index());
  const auto to_cpu = [half](const torch::Tensor& values) {
    return values.to(torch::kCPU, half ? torch::kHalf : torch::kFloat32, /*non_blocking=*/false,
                     /*copy=*/true);
  };
  // The caller may change an image on the CPU.
  const torch::Tensor values = image.is_cuda() ? image.detach() : to_cpu(image.detach());
  writing_key_ = key;
  writing_ = std::async(
      std::launch::async, [path = file_of(folder_, key), values, to_cpu]() -> std::string {
        try {
          const torch::NoGradGuard no_grad;
          write_entry(path, (values.is_cuda() ? to_cpu(values) : values).contiguous());
        } catch (const std::exception& problem) {
          return problem.what();
        }
        return "";
      });
  const int64_t eighth = max_bytes_ / 8;
  if (eighth > 0 && kept_bytes_ / eighth > (kept_bytes_ - bytes) / eighth) prune();
}

torch::Tensor RestorationCache::get(const std::string& key, torch::IntArrayRef shape,
                                    const std::function<torch::Tensor()>& compute) {
  if (const auto kept = find(key, shape)) return *kept;
  const torch::Tensor computed = compute();
  JADE_CHECK(computed.sizes() == shape, "expected a restoration of shape ", shape, ", found ",
             computed.sizes());
  keep(key, computed);
  finish_writing();
  return computed;
}

void RestorationCache::prune() {
  finish_writing();
  if (!is_on_) return;
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
