// SPDX-License-Identifier: Apache-2.0
#include "jade/run/checkpoint.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <torch/serialize.h>
#include <torch/serialize/archive.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/digest.h"
#include "jade/geometry/origin.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kFormatVersion = 1;

/// All entries by name, in a fixed order; texts are byte tensors.
using Entries = std::map<std::string, torch::Tensor>;

torch::Tensor bytes_of(const std::string& text) {
  return torch::from_blob(const_cast<char*>(text.data()), {static_cast<int64_t>(text.size())},
                          torch::kUInt8)
      .clone();
}

std::string text_of(const torch::Tensor& bytes) {
  return {static_cast<const char*>(bytes.data_ptr()), static_cast<size_t>(bytes.numel())};
}

std::string digest_of(const Entries& entries) {
  Sha256 digest;
  for (const auto& [name, tensor] : entries) {
    digest.update(concat(name, tensor.scalar_type(), shape_string(tensor), ";"));
    digest.update(tensor.data_ptr(), tensor.nbytes());
  }
  return digest.hex();
}

/// The tensors of a state by name; which exist depends on the options alone.
Entries entries_of(const train::TrainState& state) {
  Entries all;
  const auto put = [&](const std::string& name, const torch::Tensor& tensor) {
    if (tensor.defined()) all[name] = tensor.detach().cpu().contiguous();
  };
  for (int i = 0; i < gaussians::kParameterCount; ++i) {
    const std::string name = gaussians::kParameterNames[i];
    put("gaussians." + name, gaussians::parameter(state.gaussians.parameters(), i));
    put("adam.first." + name, gaussians::parameter(state.gaussian_adam.first_moments(), i));
    put("adam.second." + name, gaussians::parameter(state.gaussian_adam.second_moments(), i));
  }
  put("adam.step", state.gaussian_adam.step_count());
  put("extent", torch::tensor(state.gaussians.extent(), torch::kFloat64));
  put("densify.gradient_norm", state.densifier.accumulated().gradient_norm);
  put("densify.visible_count", state.densifier.accumulated().visible_count);
  put("densify.max_radius_px", state.densifier.accumulated().max_radius_px);
  put("densify.generator", const_cast<train::TrainState&>(state).densifier.generator().get_state());
  const auto put_parameters = [&](const std::string& prefix, const torch::nn::Module& module) {
    for (const auto& parameter : module.named_parameters())
      put(prefix + "." + parameter.key(), parameter.value());
  };
  const auto put_module = [&](const std::string& prefix, const torch::nn::Module& module,
                              const train::ModuleAdam& adam) {
    put_parameters(prefix, module);
    const auto moments = adam.state();
    for (size_t i = 0; i < moments.size(); ++i) put(concat(prefix, ".adam.", i), moments[i]);
  };
  if (state.allocation) put_module("allocation", *state.allocation, state.allocation_adam);
  if (state.response) put_module("crf", *state.response, state.response_adam);
  const auto put_rows = [&](const std::string& prefix, const torch::nn::Module& module,
                            const train::RowAdam& rows) {
    put_parameters(prefix, module);
    if (rows.empty()) return;
    const train::RowAdamState& adam = rows.state();
    put(prefix + ".adam.0", adam.first);
    put(prefix + ".adam.1", adam.second);
    put(prefix + ".adam.2", adam.steps);
  };
  if (state.poses) put_rows("poses", *state.poses, state.poses_adam);
  if (state.gains) put_rows("gains", *state.gains, state.gains_adam);
  if (state.pattern) put_module("pattern", *state.pattern, state.pattern_adam);
  return all;
}

Entries read_archive(const fs::path& path) {
  if (!fs::exists(path)) {
    throw CheckpointError(path.string() + ": expected a checkpoint, found no such file");
  }
  Entries all;
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

torch::Tensor take(const Entries& entries, const std::string& name, const fs::path& path) {
  const auto found = entries.find(name);
  if (found == entries.end()) {
    throw CheckpointError(concat(path.string(), ": lacks '", name,
                                 "'; it was made with other options or by an older program"));
  }
  return found->second;
}

splat::Gaussians take_gaussians(const Entries& entries, const std::string& prefix,
                                const fs::path& path) {
  splat::Gaussians gaussians;
  for (int i = 0; i < gaussians::kParameterCount; ++i) {
    gaussians::parameter(gaussians, i) =
        take(entries, prefix + gaussians::kParameterNames[i], path);
  }
  return gaussians;
}

/// Number of a module's parameters in a checkpoint.
int64_t parameter_count(const Entries& entries, const std::string& prefix) {
  return std::count_if(entries.begin(), entries.end(), [&](const auto& entry) {
    const auto begins_with = [&](const std::string& start) {
      return entry.first.rfind(prefix + start, 0) == 0;
    };
    return begins_with(".") && !begins_with(".adam.");
  });
}

void restore_parameters(const Entries& entries, const std::string& prefix,
                        torch::nn::Module& module, const fs::path& path) {
  const torch::NoGradGuard no_grad;
  for (auto& parameter : module.named_parameters()) {
    const torch::Tensor saved = take(entries, prefix + "." + parameter.key(), path);
    if (saved.sizes() != parameter.value().sizes()) {
      throw CheckpointError(concat(path.string(), ": ", prefix, ".", parameter.key(), " has shape ",
                                   shape_string(saved), ", expected ",
                                   shape_string(parameter.value())));
    }
    parameter.value().copy_(saved);
  }
  const int64_t found = parameter_count(entries, prefix);
  const auto expected = static_cast<int64_t>(module.named_parameters().size());
  if (found != expected) {
    throw CheckpointError(concat(path.string(), ": expected ", expected, " parameters of '", prefix,
                                 "', found ", found, "; it was made from other data"));
  }
}

void restore_module(const Entries& entries, const std::string& prefix, torch::nn::Module& module,
                    train::ModuleAdam& adam, const fs::path& path) {
  restore_parameters(entries, prefix, module, path);
  std::vector<torch::Tensor> moments = adam.state();
  for (size_t i = 0; i < moments.size(); ++i)
    moments[i] = take(entries, concat(prefix, ".adam.", i), path);
  adam.restore(moments);
}

void restore_rows(const Entries& entries, const std::string& prefix, torch::nn::Module& module,
                  train::RowAdam& adam, const fs::path& path) {
  restore_parameters(entries, prefix, module, path);
  if (adam.empty()) return;
  const auto of_adam = [&](int i) { return take(entries, concat(prefix, ".adam.", i), path); };
  adam.restore({of_adam(0), of_adam(1), of_adam(2), {}, {}});
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

void save_checkpoint(const fs::path& run, const train::TrainState& state,
                     const CheckpointInfo& info, int64_t keep) {
  make_writable_folder(run / "checkpoints");
  Entries all = entries_of(state);
  all["format_version"] = torch::tensor(kFormatVersion);
  all["step"] = torch::tensor(state.step);
  all["config"] = bytes_of(info.config);
  all["data_fingerprint"] = bytes_of(info.fingerprint);
  if (!info.restorer_sha256.empty()) all["restorer_sha256"] = bytes_of(info.restorer_sha256);
  if (!geometry::is_zero(info.origin)) {
    all["origin"] =
        torch::tensor({info.origin[0], info.origin[1], info.origin[2]}, torch::kFloat64);
  }
  all["sha256"] = bytes_of(digest_of(all));

  torch::serialize::OutputArchive archive;
  for (const auto& [name, tensor] : all) archive.write(name, c10::IValue(tensor));
  AtomicFile file(checkpoint_path(run, state.step));
  {
    std::ofstream out(file.temporary_path(), std::ios::binary);
    archive.save_to([&out](const void* data, size_t bytes) -> size_t {
      out.write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
      return bytes;
    });
    out.close();
    if (!out) {
      throw DataError(
          concat(checkpoint_path(run, state.step).string(),
                 ": cannot be written; is the disk full? Free some space and go on with --resume"));
    }
  }
  file.commit();
  const auto found = list_checkpoints(run);
  for (size_t i = static_cast<size_t>(keep); i < found.size(); ++i) fs::remove(found[i]);
}

namespace {

/// Scenes that were never moved have no entry.
geometry::Vector3 origin_in(const Entries& all) {
  const auto found = all.find("origin");
  if (found == all.end() || found->second.numel() != 3) return {0, 0, 0};
  const auto at = [&](int64_t axis) { return found->second[axis].item<double>(); };
  return {at(0), at(1), at(2)};
}

}  // namespace

CheckpointInfo read_checkpoint_info(const fs::path& path) {
  const Entries all = read_archive(path);
  CheckpointInfo info{
      text_of(take(all, "config", path)), text_of(take(all, "data_fingerprint", path)), {}};
  if (const auto found = all.find("restorer_sha256"); found != all.end()) {
    info.restorer_sha256 = text_of(found->second);
  }
  info.origin = origin_in(all);
  return info;
}

void load_checkpoint(const fs::path& path, train::TrainState& state) {
  const Entries all = read_archive(path);
  const double extent = take(all, "extent", path).item<double>();
  const torch::Device device = state.gaussians.device();
  state.gaussians =
      gaussians::GaussianModel(take_gaussians(all, "gaussians.", path), extent, device);
  state.gaussian_adam = gaussians::GaussianAdam(state.gaussians, state.gaussian_adam.options(),
                                                state.gaussian_adam.monochrome());
  const auto on_device = [&](const torch::Tensor& tensor) { return tensor.to(device); };
  state.gaussian_adam.restore(
      gaussians::map_parameters(take_gaussians(all, "adam.first.", path), on_device),
      gaussians::map_parameters(take_gaussians(all, "adam.second.", path), on_device),
      take(all, "adam.step", path).to(device));
  state.densifier.generator().set_state(take(all, "densify.generator", path));
  splat::ScreenStatistics statistics;
  if (all.count("densify.gradient_norm") != 0) {
    statistics = {take(all, "densify.gradient_norm", path).to(device),
                  take(all, "densify.visible_count", path).to(device),
                  take(all, "densify.max_radius_px", path).to(device)};
  }
  state.densifier.restore(statistics);
  if (state.allocation)
    restore_module(all, "allocation", *state.allocation, state.allocation_adam, path);
  if (state.response) restore_module(all, "crf", *state.response, state.response_adam, path);
  if (state.poses) restore_rows(all, "poses", *state.poses, state.poses_adam, path);
  if (state.gains) restore_rows(all, "gains", *state.gains, state.gains_adam, path);
  if (state.pattern) restore_module(all, "pattern", *state.pattern, state.pattern_adam, path);
  state.step = take(all, "step", path).item<int64_t>();
}

gaussians::GaussianFile load_checkpoint_scene(const fs::path& path) {
  const Entries all = read_archive(path);
  gaussians::GaussianFile file;
  file.gaussians = take_gaussians(all, "gaussians.", path);
  file.origin = origin_in(all);
  return file;
}

void load_checkpoint_allocation(const fs::path& path, router::Allocation& allocation) {
  train::ModuleAdam none;
  restore_module(read_archive(path), "allocation", allocation, none, path);
}

void load_checkpoint_poses(const fs::path& path, train::ExposurePoses& poses) {
  restore_parameters(read_archive(path), "poses", poses, path);
}

namespace {

/// Adds all that a fingerprint covers of one exposure.
void add_exposure(const data::Exposure& exposure, FingerprintOf what, Sha256& digest) {
  const auto add = [&](const auto& numbers) {
    digest.update(numbers.data(), numbers.size() * sizeof(numbers[0]));
  };
  digest.update(concat(exposure.name, ' ', exposure.t_start_us, ' ', exposure.t_end_us, ' ',
                       exposure.events.size(), ';'));
  const auto pixels = exposure.blurry.contiguous();
  digest.update(pixels.data_ptr(), pixels.nbytes());
  for (const geometry::Pose& pose : exposure.poses) {
    add(pose.rotation);
    add(pose.translation);
  }
  if (what == FingerprintOf::kCounts) return;
  const geometry::Intrinsics& camera = exposure.camera;
  add(std::array{camera.fx, camera.fy, camera.cx, camera.cy});
  if (exposure.gain != 1) digest.update(concat("gain ", exposure.gain, ';'));
  if (exposure.mask.defined()) {
    const torch::Tensor mask = exposure.mask.contiguous();
    digest.update(mask.const_data_ptr(), mask.nbytes());
  }
  const events::EventStream& events = exposure.events;
  for (const torch::Tensor& each : {events.x(), events.y(), events.t_us(), events.polarity()}) {
    digest.update(each.data_ptr(), each.nbytes());
  }
}

}  // namespace

std::string data_fingerprint(const data::Dataset& dataset, FingerprintOf what) {
  const std::vector<data::Exposure>& train = dataset.train;
  Sha256 digest;
  // Gray frames can also train a colour scene, with other restorations.
  if (dataset.monochrome) digest.update("monochrome;");
  if (what != FingerprintOf::kContents) {
    for (const data::Exposure& exposure : train) add_exposure(exposure, what, digest);
    return digest.hex();
  }
  std::vector<std::string> parts(train.size());
  at::parallel_for(0, int64_t(train.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      Sha256 part;
      add_exposure(train[size_t(i)], what, part);
      parts[size_t(i)] = part.hex();
    }
  });
  for (const std::string& part : parts) digest.update(part);
  return digest.hex();
}

bool had_fingerprint(const data::Dataset& dataset, const std::string& fingerprint) {
  return fingerprint == data_fingerprint(dataset, FingerprintOf::kInOne) ||
         fingerprint == data_fingerprint(dataset, FingerprintOf::kCounts);
}

}  // namespace jade::run
