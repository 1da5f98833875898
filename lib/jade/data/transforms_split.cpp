// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms_split.h"

#include <algorithm>
#include <utility>

#include "jade/core/error.h"
#include "jade/data/frame_times.h"
#include "jade/data/named_files.h"
#include "jade/data/transforms_json.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// A normalised path, so that equal ones compare equal.
std::string plain_name(const std::string& name) {
  return fs::path(slashed(name)).lexically_normal().string();
}

/// The frames listed in train_filenames and similar keys; no value if the file has no such list.
/// @throws DataError for names that no frame has.
std::set<std::string> named_frames(const TransformsFile& file, const char* key) {
  std::set<std::string> names, known;
  if (!file.root.contains(key)) return names;
  const auto wrong = [&](const std::string& found) {
    return DataError(concat(file.path.string(), ": expected '", key,
                            "' to list values of 'file_path', found ", found,
                            "; correct or remove it"));
  };
  if (!file.root[key].is_array()) throw wrong("no list");
  for (const ListedView& view : file.views) known.insert(plain_name(view.given));
  for (const std::string& name : file.missing) known.insert(plain_name(name));
  for (const json& name : file.root[key]) {
    if (!name.is_string()) throw wrong("something else");
    names.insert(plain_name(name.get<std::string>()));
    if (known.count(plain_name(name.get<std::string>())) == 0) {
      throw wrong("'" + name.get<std::string>() + "', which no frame has");
    }
  }
  return names;
}

void check_both_left(const TransformsListing& listing) {
  if (std::count(listing.is_test.begin(), listing.is_test.end(), false) > 0) return;
  throw DataError(concat(listing.main.path.string(),
                         ": expected frames for training, found test views only; correct the "
                         "lists of the split or set dataset.split"));
}

/// Splits by train_filenames, val_filenames and test_filenames (nerfstudio). Test views are those
/// of test_filenames, or of val_filenames if there are none.
void split_by_names(TransformsFile file, const Warnings& warnings, TransformsListing& listing) {
  const auto train = named_frames(file, "train_filenames"),
             val = named_frames(file, "val_filenames"),
             named = named_frames(file, "test_filenames");
  const char* const key = named.empty() ? "val_filenames" : "test_filenames";
  const auto& test = named.empty() ? val : named;
  int64_t unused = 0, both = 0;
  for (ListedView& view : file.views) {
    const std::string name = plain_name(view.given);
    const bool tests = test.count(name) != 0;
    const bool trains =
        train.empty() ? val.count(name) == 0 && named.count(name) == 0 : train.count(name) != 0;
    if (tests && trains) ++both;
    if (!tests && !trains) {
      ++unused;
      continue;
    }
    listing.views.push_back(std::move(view));
    listing.is_test.push_back(tests);
  }
  if (both > 0) {
    warnings.add(file.path.string(), ": ", both, " frames are in train_filenames and in ", key,
                 "; they are test views only");
  }
  if (unused > 0) {
    warnings.add(file.path.string(), ": ", unused, " of ", file.views.size(),
                 " frames are neither for training nor in ", key, " and are left out");
  }
  listing.rule =
      concat(std::count(listing.is_test.begin(), listing.is_test.end(), true), " named by ", key);
}

bool names_split(const json& root) {
  return root.contains("train_filenames") || root.contains("val_filenames") ||
         root.contains("test_filenames");
}

/// Takes the test views from a file of their own; views of `main` that are not among them are for
/// training.
void split_by_files(TransformsFile file, const fs::path& test_path, const std::string& image_folder,
                    bool wants_test, const Warnings& warnings, TransformsListing& listing) {
  std::set<fs::path> tests;
  std::vector<ListedView> test_views;
  if (!test_path.empty() && wants_test) {
    TransformsFile test = read_transforms(test_path, image_folder, warnings);
    for (const ListedView& view : test.views) tests.insert(view.path);
    add_keys(test.root, listing.keys);
    test_views = std::move(test.views);
  }
  int64_t both = 0;
  for (ListedView& view : file.views) {
    if (tests.count(view.path) != 0) {
      ++both;
      continue;
    }
    listing.views.push_back(std::move(view));
  }
  if (both > 0) {
    warnings.add(file.path.string(), ": ", both, " of its frames are in ",
                 test_path.filename().string(), " too; they are test views only");
  }
  listing.is_test.assign(listing.views.size(), false);
  for (ListedView& view : test_views) listing.views.push_back(std::move(view));
  listing.is_test.resize(listing.views.size(), true);
  listing.rule = test_path.empty() ? "no file of test views" : test_path.filename().string();
}

}  // namespace

TransformsListing listing_of(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path single = options.path / "transforms.json",
                 train = options.path / "transforms_train.json";
  fs::path test;
  for (const char* name : {"transforms_val.json", "transforms_test.json"}) {
    if (fs::exists(options.path / name)) test = options.path / name;
  }
  const bool pair = fs::exists(train);
  const bool automatic = options.split == SplitKind::kAuto;
  if (pair && fs::exists(single)) {
    warnings.add(single.string(), ": is not read; ", train.filename().string(), " is");
  }
  TransformsFile file = read_transforms(pair ? train : single, options.image_folder, warnings);
  TransformsListing listing;
  listing.main = {file.path, file.root, {}, {}};
  add_keys(file.root, listing.keys);
  if (pair || (automatic && !test.empty())) {
    if (options.split == SplitKind::kLast || options.split == SplitKind::kEvery) {
      warnings.add(options.path.string(), ": dataset.split ", word_of(options.split),
                   " has no effect; transforms_train.json and transforms_test.json are the split");
    }
    split_by_files(std::move(file), test, options.image_folder, options.split != SplitKind::kNone,
                   warnings, listing);
    check_both_left(listing);
    return listing;
  }
  std::sort(file.views.begin(), file.views.end(),
            [](const ListedView& a, const ListedView& b) { return a.path < b.path; });
  if (automatic && names_split(file.root)) {
    split_by_names(std::move(file), warnings, listing);
    check_both_left(listing);
    return listing;
  }
  if (names_split(file.root)) {
    warnings.add(single.string(), ": names the frames of its split (train_filenames and others); ",
                 "dataset.split ", word_of(options.split), " is used instead");
  }
  Split split =
      split_by_position(file.views.size(), position_rule(options, warnings), single.string());
  listing.views = std::move(file.views);
  listing.is_test = std::move(split.is_test);
  listing.rule = split.rule;
  return listing;
}

}  // namespace jade::data
