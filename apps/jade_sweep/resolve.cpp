// SPDX-License-Identifier: Apache-2.0
#include "jade_sweep/resolve.h"

#include "jade/core/error.h"
#include "jade/train/options.h"

namespace jade::apps {
namespace {

namespace fs = std::filesystem;

std::vector<sweep::Missing> missing_files(const train::RunOptions& options) {
  std::vector<sweep::Missing> missing;
  const auto look = [&](const char* key, const fs::path& path, bool there) {
    if (!there) {
      missing.push_back({key, path.empty()
                                  ? "expected a path, found nothing"
                                  : concat("expected ", path.string(), ", which is not there")});
    }
  };
  look(sweep::kDatasetKey, options.dataset.path, fs::is_directory(options.dataset.path));
  const auto look_for_file = [&](const char* key, const fs::path& path) {
    look(key, path, fs::is_regular_file(path));
  };
  if (!options.dataset.events_file.empty()) {
    look_for_file("dataset.events_file", options.dataset.events_file);
  }
  if (!options.dataset.mask.empty()) look_for_file("dataset.mask", options.dataset.mask);
  if (options.init.kind == gaussians::InitKind::kPly) look_for_file("init.ply", options.init.ply);
  const fs::path efnet = restore::restorer_path(options.efnet);
  if (train::needs_efnet(options)) look_for_file("efnet.path", efnet);
  if (options.objective.target == losses::Target::kImageFolder) {
    look("train.target_images", options.train.target_images,
         fs::is_directory(options.train.target_images));
  }
  return missing;
}

/// Applies the layers to `options`.
sweep::Resolved resolve(const std::vector<config::Sources>& layers, train::RunOptions options) {
  const FieldList fields = fields_of(options);
  std::string problems;
  for (const config::Sources& layer : layers) {
    try {
      config::read(layer, fields);
    } catch (const ConfigError& error) {
      problems += concat(problems.empty() ? "" : "\n", error.what());
    }
  }
  if (!problems.empty()) throw ConfigError(problems);
  train::settle(options);
  std::string conflict;
  try {
    train::validate(options);
  } catch (const ConfigError& error) {
    conflict = error.what();
  }
  return {config::to_yaml(fields, "Settings of one run of a sweep"), config::values(fields),
          missing_files(options), conflict};
}

}  // namespace

sweep::Resolved resolve_training(const std::vector<config::Sources>& layers) {
  return resolve(layers, train::RunOptions());
}

sweep::Resolved resolve_written(const std::vector<config::Sources>& layers) {
  return resolve(layers, train::printed_options());
}

}  // namespace jade::apps
