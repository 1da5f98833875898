// SPDX-License-Identifier: Apache-2.0
#include "jade/run/checkpoint.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <torch/serialize.h>
#include <torch/serialize/archive.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/digest.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kFormatVersion = 2;

/// Prefix of the names of a state's tensors.
constexpr char kState[] = "state.";

torch::Tensor bytes_of(const std::string& text) {
  return torch::from_blob(const_cast<char*>(text.data()), {static_cast<int64_t>(text.size())},
                          torch::kUInt8)
      .clone();
}

std::string text_of(const torch::Tensor& bytes) {
  return {static_cast<const char*>(bytes.data_ptr()), static_cast<size_t>(bytes.numel())};
}

std::string digest_of(const Checkpoint& entries) {
  Sha256 digest;
  for (const auto& [name, tensor] : entries) {
    digest.update(concat(name, tensor.scalar_type(), shape_string(tensor), ";"));
    digest.update(tensor.data_ptr(), tensor.nbytes());
  }
  return digest.hex();
}

Checkpoint read_archive(const fs::path& path) {
  if (!fs::exists(path)) {
    throw CheckpointError(path.string() + ": expected a checkpoint, found no such file");
  }
  Checkpoint all;
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(path.string(), torch::kCPU);
    for (const std::string& name : archive.keys()) {
      c10::IValue value;
      archive.read(name, value);
      if (value.isTensor()) all[name] = value.toTensor();
    }
  } catch (const c10::Error&) {
    throw CheckpointError(concat(
        path.string(), ": expected a checkpoint, found a file that is cut short, damaged or ",
        "something else; resume from an older one"));
  } catch (const std::exception& failure) {
    throw CheckpointError(
        concat(path.string(), ": cannot be read as a checkpoint: ", failure.what()));
  }
  const auto version = all.find("format_version");
  const auto checksum = all.find("sha256");
  if (version == all.end() || checksum == all.end()) {
    throw CheckpointError(concat(
        path.string(), ": expected a checkpoint of jade_train, found another torch archive"));
  }
  if (version->second.item<int64_t>() != kFormatVersion) {
    throw CheckpointError(concat(path.string(), ": expected checkpoint format ", kFormatVersion,
                                 ", found ", version->second.item<int64_t>(),
                                 "; use the program that wrote it"));
  }
  const std::string expected = text_of(checksum->second);
  all.erase(checksum);
  if (digest_of(all) != expected) {
    throw CheckpointError(
        concat(path.string(), ": damaged (its checksum does not match); resume from an older one"));
  }
  return all;
}

torch::Tensor take(const Checkpoint& entries, const std::string& name, const fs::path& path) {
  const auto found = entries.find(name);
  if (found == entries.end()) {
    throw CheckpointError(
        concat(path.string(), ": lacks '", name, "'; it was made with other options"));
  }
  return found->second;
}

splat::Gaussians take_gaussians(const Checkpoint& entries, const fs::path& path) {
  splat::Gaussians gaussians;
  for (int i = 0; i < gaussians::kParameterCount; ++i) {
    gaussians::parameter(gaussians, i) =
        take(entries, concat(kState, "gaussians.", gaussians::kParameterNames[i]), path);
  }
  return gaussians;
}

/// Copies the entries whose names begin with `prefix` to the tensors that `visit` names.
/// @throws CheckpointError if an entry is missing, left over or of another shape.
template <class Visit>
void restore(const Checkpoint& entries, const std::string& prefix, const Visit& visit,
             const fs::path& path) {
  const torch::NoGradGuard no_grad;
  int64_t expected = 0;
  visit([&](const std::string& name, const torch::Tensor& tensor) {
    if (!tensor.defined()) return;
    ++expected;
    const torch::Tensor saved = take(entries, prefix + name, path);
    if (saved.sizes() != tensor.sizes()) {
      throw CheckpointError(concat(path.string(), ": ", prefix, name, " has shape ",
                                   shape_string(saved), ", expected ", shape_string(tensor)));
    }
    tensor.copy_(saved);
  });
  const auto found = std::count_if(entries.begin(), entries.end(), [&](const auto& entry) {
    return entry.first.rfind(prefix, 0) == 0;
  });
  if (found != expected) {
    throw CheckpointError(concat(path.string(), ": expected ", expected, " tensors of '", prefix,
                                 "', found ", found, "; it was made from other data"));
  }
}

/// restore() of a module of the state.
void restore_module(const std::string& name, const torch::nn::Module& module,
                    const fs::path& path) {
  restore(
      read_archive(path), concat(kState, name, ".module."),
      [&](const auto& visitor) { train::visit_module(visitor, module); }, path);
}

}  // namespace

fs::path checkpoint_path(const fs::path& run, int64_t step) {
  char name[32];
  std::snprintf(name, sizeof name, "step_%07lld.pt", static_cast<long long>(step));
  return run / "checkpoints" / name;
}

int64_t step_of(const fs::path& checkpoint) {
  return std::strtoll(checkpoint.stem().string().c_str() + std::strlen("step_"), nullptr, 10);
}

std::vector<fs::path> list_checkpoints(const fs::path& run) {
  std::vector<fs::path> found;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(run / "checkpoints", missing)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("step_", 0) == 0 && entry.path().extension() == ".pt")
      found.push_back(entry.path());
  }
  // Longer names are later steps, even beyond seven digits.
  std::sort(found.begin(), found.end(), [](const fs::path& a, const fs::path& b) {
    const std::string x = a.filename().string(), y = b.filename().string();
    return x.size() != y.size() ? x.size() > y.size() : x > y;
  });
  return found;
}

int64_t set_aside_checkpoints(const fs::path& run, int64_t step) {
  int64_t count = 0;
  for (const fs::path& path : list_checkpoints(run)) {
    if (step_of(path) <= step) continue;
    fs::rename(path, path.parent_path() / ("left_" + path.filename().string()));
    ++count;
  }
  return count;
}

Checkpoint checkpoint_of(const train::TrainState& state, const CheckpointInfo& info) {
  Checkpoint all;
  const auto put = [&](const std::string& name, const torch::Tensor& tensor) {
    if (!tensor.defined()) return;
    all[name] = tensor.detach().to(torch::kCPU, tensor.scalar_type(), /*non_blocking=*/false,
                                   /*copy=*/true);
  };
  state.visit(
      [&](const std::string& name, const torch::Tensor& tensor) { put(kState + name, tensor); });
  put("extent", torch::tensor(state.gaussians.extent(), torch::kFloat64));
  put("generator", state.densifier.generator().get_state());
  put("step", torch::tensor(state.step));
  put("format_version", torch::tensor(kFormatVersion));
  put("config", bytes_of(info.config));
  put("data_fingerprint", bytes_of(info.fingerprint));
  put("restorer_sha256", bytes_of(info.restorer_sha256));
  put("origin", torch::tensor(at::ArrayRef<double>(info.origin), torch::kFloat64));
  return all;
}

void write_checkpoint(const fs::path& run, Checkpoint all, int64_t keep) {
  make_writable_folder(run / "checkpoints");
  all["sha256"] = bytes_of(digest_of(all));
  torch::serialize::OutputArchive archive;
  for (const auto& [name, tensor] : all) archive.write(name, c10::IValue(tensor));
  const fs::path path = checkpoint_path(run, all.at("step").item<int64_t>());
  AtomicFile file(path);
  {
    std::ofstream out(file.temporary_path(), std::ios::binary);
    archive.save_to([&out](const void* data, size_t bytes) -> size_t {
      out.write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
      return bytes;
    });
    out.close();
    if (!out) {
      throw DataError(
          concat(path.string(),
                 ": cannot be written; is the disk full? Free some space and go on with --resume"));
    }
  }
  file.commit();
  const auto found = list_checkpoints(run);
  for (size_t i = static_cast<size_t>(keep); i < found.size(); ++i) fs::remove(found[i]);
}

namespace {

geometry::Vector3 origin_in(const Checkpoint& all, const fs::path& path) {
  const torch::Tensor origin = take(all, "origin", path);
  const auto at = [&](int64_t axis) { return origin[axis].item<double>(); };
  return {at(0), at(1), at(2)};
}

}  // namespace

CheckpointInfo read_checkpoint_info(const fs::path& path) {
  const Checkpoint all = read_archive(path);
  const auto text = [&](const char* name) { return text_of(take(all, name, path)); };
  return {text("config"), text("data_fingerprint"), text("restorer_sha256"), origin_in(all, path)};
}

void load_checkpoint(const fs::path& path, train::TrainState& state) {
  const Checkpoint all = read_archive(path);
  // Tensors with one row per Gaussian, which the rest is copied to.
  state.gaussians =
      gaussians::GaussianModel(take_gaussians(all, path), take(all, "extent", path).item<double>(),
                               state.gaussians.device());
  state.gaussian_adam = gaussians::GaussianAdam(state.gaussians, state.gaussian_adam.options(),
                                                state.gaussian_adam.monochrome());
  state.densifier.reset_statistics(state.gaussians);
  restore(
      all, kState, [&](const auto& visitor) { state.visit(visitor); }, path);
  state.densifier.generator().set_state(take(all, "generator", path));
  state.step = take(all, "step", path).item<int64_t>();
}

gaussians::GaussianFile load_checkpoint_scene(const fs::path& path) {
  const Checkpoint all = read_archive(path);
  gaussians::GaussianFile file;
  file.gaussians = take_gaussians(all, path);
  file.origin = origin_in(all, path);
  return file;
}

void load_checkpoint_allocation(const fs::path& path, router::Allocation& allocation) {
  restore_module("allocation", allocation, path);
}

void load_checkpoint_poses(const fs::path& path, train::ExposurePoses& poses) {
  restore_module("poses", poses, path);
}

namespace {

/// SHA-256 over all that a fingerprint covers of one exposure.
std::string digest_of(const data::Exposure& exposure) {
  Sha256 digest;
  const auto add = [&](const auto& numbers) {
    digest.update(numbers.data(), numbers.size() * sizeof(numbers[0]));
  };
  const auto add_tensor = [&](const torch::Tensor& tensor) {
    const torch::Tensor whole = tensor.contiguous();
    digest.update(whole.const_data_ptr(), whole.nbytes());
  };
  const events::EventStream& events = exposure.events;
  const geometry::Intrinsics& camera = exposure.camera;
  digest.update(concat(exposure.name, ' ', exposure.t_start_us, ' ', exposure.t_end_us, ' ',
                       events.size(), ' ', exposure.gain, ';'));
  add_tensor(exposure.blurry);
  for (const geometry::Pose& pose : exposure.poses) {
    add(pose.rotation);
    add(pose.translation);
  }
  add(std::array{camera.fx, camera.fy, camera.cx, camera.cy});
  if (exposure.mask.defined()) add_tensor(exposure.mask);
  for (const torch::Tensor& each : {events.x(), events.y(), events.t_us(), events.polarity()}) {
    add_tensor(each);
  }
  return digest.hex();
}

}  // namespace

std::string data_fingerprint(const data::Dataset& dataset, const std::string& more) {
  const std::vector<data::Exposure>& train = dataset.train;
  std::vector<std::string> parts(train.size());
  at::parallel_for(0, int64_t(train.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) parts[size_t(i)] = digest_of(train[size_t(i)]);
  });
  Sha256 digest;
  // Gray frames can also train a colour scene, with other restorations.
  if (dataset.monochrome) digest.update("monochrome;");
  for (const std::string& part : parts) digest.update(part);
  digest.update(more);
  return digest.hex();
}

}  // namespace jade::run
