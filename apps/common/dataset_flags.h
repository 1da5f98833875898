// SPDX-License-Identifier: Apache-2.0
// Command line of programs that read a data set: the keys of jade_train, and short flags for some
// of them.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>

#include "common/cli.h"
#include "jade/data/transforms.h"
#include "jade/run/evaluate.h"
#include "jade/train/options.h"

namespace jade::apps {

/// "a, b or c": the words of an enum.
template <class E>
std::string words_text() {
  std::string text;
  const auto words = words_of(E{});
  for (size_t i = 0; i < words.size(); ++i) {
    text += concat(i == 0 ? "" : i + 1 == words.size() ? " or " : ", ", words[i].word);
  }
  return text;
}

/// Flags of the data set, except for --mask.
inline constexpr const char* kDatasetFlags[] = {"--dataset",      "--kind",        "--split",
                                                "--image-folder", "--events-file", "--events-unit",
                                                "--time-unit"};

/// Adds --config, --set and related flags, and flags for keys of the data set.
/// @param path  the flag, or positional argument, that names its folder
inline void add_dataset_flags(Program& program, const std::string& path = "--dataset",
                              const std::string& path_help = "Folder of the data set") {
  program.add_config_flags();
  program.begin_group("Input");
  program.add_key_flag(path, "dataset.path", path_help)->type_name("DIR");
  program
      .add_key_flag("--kind", "dataset.kind",
                    "Format of the data set: " + words_text<data::DatasetKind>())
      ->type_name("WORD");
  program
      .add_key_flag("--split", "dataset.split",
                    "Choice of the test views: " + words_text<data::SplitKind>())
      ->type_name("WORD");
  program
      .add_key_flag("--image-folder", "dataset.image_folder",
                    "Folder of the frames inside the data set")
      ->type_name("NAME");
  program.add_mask_flag("dataset.mask");
  program.add_key_flag("--events-file", "dataset.events_file", "File of the events")
      ->type_name("FILE");
  program
      .add_key_flag("--events-unit", "dataset.events_unit",
                    "Unit of the events' times: " + words_text<events::TimeUnit>())
      ->type_name("WORD");
  program
      .add_key_flag("--time-unit", "dataset.time_unit",
                    "Unit of the frames' times: " + words_text<events::TimeUnit>())
      ->type_name("WORD");
}

/// The settings of a program that reads a data set: those of `run`, if given, overridden by the
/// command line. No value if --print-config or --print-schema was given and has been handled.
inline std::optional<train::RunOptions> load_settings(Program& program,
                                                      const std::filesystem::path& run = {}) {
  return program.load_options(run.empty() ? train::RunOptions() : run::load_run_options(run));
}

/// The absolute path without links and dots, whether it exists or not, for comparisons.
inline std::filesystem::path whole_path(const std::filesystem::path& path) {
  return std::filesystem::weakly_canonical(std::filesystem::absolute(path));
}

/// The options with whole paths, for comparing settings.
inline data::DatasetOptions with_whole_paths(data::DatasetOptions dataset) {
  for (std::filesystem::path* path : {&dataset.path, &dataset.mask, &dataset.events_file}) {
    if (!path->empty()) *path = whole_path(*path);
  }
  return dataset;
}

/// The part of check_apart() for one data set.
inline void check_apart_from(const data::DatasetOptions& dataset,
                             const std::filesystem::path& output) {
  const std::filesystem::path whole = whole_path(output);
  const std::filesystem::path inside = whole.lexically_relative(whole_path(dataset.path));
  const std::string first = inside.empty() ? "" : inside.begin()->string();
  const bool numbered = first.rfind("images_", 0) == 0 &&
                        first.find_first_not_of("0123456789", 7) == std::string::npos;
  const bool lists_frames = std::filesystem::is_directory(dataset.path) &&
                            data::kind_of(dataset) == data::DatasetKind::kTransforms;
  const auto named =
      lists_frames ? data::named_folders(dataset.path) : std::vector<std::filesystem::path>();
  if (first == "sharp" || first == "images" || numbered ||
      (!dataset.image_folder.empty() && first == dataset.image_folder) ||
      std::find(named.begin(), named.end(), whole) != named.end()) {
    throw ConfigError(concat("--output: expected a folder of its own, found ", output.string(),
                             ", where the data set keeps pictures of these names; choose another"));
  }
}

/// Prevents a program that writes pictures named after frames from overwriting these frames.
/// @param dataset  that of the settings; other data sets around `output` are checked too
/// @throws ConfigError if `output` is, or is inside, a folder of pictures of a data set (a name
///   that data/frames.h searches for, existing or not, or sharp/), or a folder of frames that a
///   transforms.json names.
inline void check_apart(const std::filesystem::path& output, const data::DatasetOptions& dataset) {
  if (output.empty()) return;
  if (!dataset.path.empty()) check_apart_from(dataset, output);
  for (const std::filesystem::path& folder : data::datasets_around(output)) {
    data::DatasetOptions other;
    other.path = folder;
    check_apart_from(other, output);
  }
}

/// Prevents a program from replacing pictures in folders of a data set that check_apart() does not
/// know by their names.
/// @param files  to be written in `output`
/// @throws ConfigError if one of them exists, and `output` is a data set or a folder in one.
inline void check_replaces_none(const std::filesystem::path& output,
                                const std::vector<std::string>& files) {
  const std::filesystem::path whole = whole_path(output);
  for (const std::filesystem::path& dataset : data::datasets_around(whole)) {
    if (dataset != whole && dataset != whole.parent_path()) continue;
    for (const std::string& file : files) {
      if (!std::filesystem::exists(whole / file)) continue;
      throw ConfigError(concat("--output: expected a folder without ", file, ", found it in ",
                               output.string(), " of the data set ", dataset.string(),
                               "; choose another"));
    }
  }
}

/// A run writes folders and files with names that data sets use, such as images/.
/// @throws ConfigError if `run` is the data set's folder, or contains its frames; as check_apart().
inline void check_run_apart(const std::filesystem::path& run, const data::DatasetOptions& dataset) {
  if (whole_path(run) == whole_path(dataset.path)) {
    throw ConfigError(concat("--output: expected a folder for the run, found ", run.string(),
                             ", the data set; choose another"));
  }
  check_apart(run, dataset);
  check_apart(run / "images", dataset);
}

}  // namespace jade::apps
