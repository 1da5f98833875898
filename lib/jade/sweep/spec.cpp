// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/spec.h"

#include <algorithm>
#include <cstdlib>
#include <set>

#include "jade/config/config.h"
#include "jade/config/document.h"
#include "jade/config/problems.h"
#include "jade/core/error.h"

namespace jade::sweep {
namespace {

namespace fs = std::filesystem;
using config::DocumentNode;
using Kind = config::DocumentNode::Kind;

/// A sweep file, or one that it extends.
struct Document {
  fs::path file;
  DocumentNode root;
};

[[noreturn]] void fail(const fs::path& file, const DocumentNode& node, const std::string& what) {
  throw ConfigError(concat(file.string(), ":", node.line, ":", node.column, ": ", what));
}

/// Appends the file after those that it extends.
void collect(const fs::path& file, std::vector<fs::path>& chain, std::vector<Document>& documents) {
  chain.push_back(fs::weakly_canonical(file));
  DocumentNode root = config::read_document(file);
  if (const DocumentNode* extends = root.find("extends")) {
    std::vector<DocumentNode> parents = extends->items;
    if (extends->kind == Kind::kText) parents = {*extends};
    if (parents.empty()) fail(file, *extends, "extends: expected a path or a list of paths");
    for (const DocumentNode& parent : parents) {
      if (parent.kind != Kind::kText) {
        fail(file, parent, "extends: expected a path or a list of paths");
      }
      const fs::path path = (fs::absolute(file).parent_path() / parent.text).lexically_normal();
      if (!fs::is_regular_file(path)) {
        fail(file, parent, concat("extends: no such file: ", path.string()));
      }
      if (std::find(chain.begin(), chain.end(), fs::weakly_canonical(path)) != chain.end()) {
        std::string circle;
        for (const fs::path& link : chain) circle += link.filename().string() + " -> ";
        fail(file, parent, concat("extends: goes in a circle: ", circle, path.filename().string()));
      }
      collect(path, chain, documents);
    }
  }
  chain.pop_back();
  documents.push_back({file, std::move(root)});
}

/// Converts nodes to values and collects their problems.
class SpecReader {
 public:
  /// Later documents win, key by key.
  Spec read(const std::vector<Document>& documents) {
    Spec spec;
    spec.name = documents.back().file.stem().string();
    for (const Document& document : documents) {
      file_ = document.file;
      folder_ = fs::absolute(document.file).parent_path();
      apply(document.root, spec);
    }
    const DocumentNode& root = documents.back().root;
    if (spec.columns.empty()) complain(root, "columns: expected a list of columns, found none");
    if (spec.rows.empty()) complain(root, "rows: expected a list of rows, found none");
    check_figures(spec);
    return spec;
  }

  void throw_problems() const { problems_.throw_if_any(); }

 private:
  void apply(const DocumentNode& root, Spec& spec) {
    known(root, {"extends", "title", "note", "paper_source", "columns", "seeds", "jobs", "set",
                 "scenes", "rows"});
    text(root, "title", spec.title);
    text(root, "note", spec.note);
    text(root, "paper_source", spec.paper_source);
    if (root.find("columns")) spec.columns.clear();
    for (const std::string& key : texts(root, "columns")) add_column(root, key, spec);
    if (root.find("seeds")) spec.seeds = whole_numbers(root, "seeds");
    if (const DocumentNode* jobs = root.find("jobs")) {
      const int64_t count = whole(*jobs, "jobs");
      if (count < 0 || count > kMostJobs) {
        complain(*jobs, concat("jobs: expected from 0 to ", kMostJobs, ", found ", count));
      }
      spec.jobs = static_cast<int>(count);
    }
    if (root.find("set")) spec.set = texts(root, "set", &spec.set_places);
    if (root.find("scenes")) spec.scenes.clear();
    for (const DocumentNode& node : maps(root, "scenes")) spec.scenes.push_back(scene(node));
    if (const DocumentNode* rows = root.find("rows")) {
      spec.rows.clear();
      rows_place_ = place(*rows);
    }
    for (const DocumentNode& node : maps(root, "rows")) spec.rows.push_back(row(node));
    if (root.find("scenes")) names_differ(root, "scenes", spec.scenes);
    if (root.find("rows")) names_differ(root, "rows", spec.rows);
  }

  std::string place(const DocumentNode& node) const {
    return concat(file_.string(), ":", node.line, ":", node.column, ": ");
  }

  void complain(const DocumentNode& node, const std::string& what) {
    problems_.add(place(node) + what);
  }

  void known(const DocumentNode& map, const std::vector<std::string>& names) {
    if (map.kind != Kind::kMap) {
      complain(map, "expected 'key: value' lines");
      return;
    }
    std::set<std::string> seen;
    for (const auto& [key, node] : map.entries) {
      if (!seen.insert(key).second) complain(node, key + ": given twice");
      bool found = false;
      for (const std::string& name : names) found = found || name == key;
      if (found) continue;
      const std::string close = config::nearest(key, names);
      complain(node,
               key + ": unknown key" + (close.empty() ? "" : "; did you mean " + close + "?"));
    }
  }

  void text(const DocumentNode& map, const std::string& name, std::string& target) {
    const DocumentNode* node = map.find(name);
    if (!node) return;
    if (node->kind != Kind::kText) {
      complain(*node, name + ": expected a text");
    } else {
      target = node->text;
    }
  }

  /// A string or a list of strings.
  /// @param places  if not null, becomes that of each
  std::vector<std::string> texts(const DocumentNode& map, const std::string& name,
                                 std::vector<std::string>* places = nullptr) {
    std::vector<std::string> list;
    const DocumentNode* node = map.find(name);
    if (places) places->clear();
    if (!node || node->kind == Kind::kNothing) return list;
    if (node->kind == Kind::kText) {
      if (places) places->push_back(place(*node));
      return {node->text};
    }
    if (node->kind != Kind::kList) complain(*node, name + ": expected a list");
    for (const DocumentNode& item : node->items) {
      if (item.kind != Kind::kText)
        complain(item, name + ": expected texts, such as train.iterations=1000");
      list.push_back(item.text);
      if (places) places->push_back(place(item));
    }
    return list;
  }

  int64_t whole(const DocumentNode& node, const std::string& name) {
    char* end = nullptr;
    const long long value = std::strtoll(node.text.c_str(), &end, 10);
    if (node.kind != Kind::kText || node.text.empty() || *end != 0 || value < 0) {
      complain(node, name + ": expected whole numbers of 0 or more, found '" + node.text + "'");
      return 0;
    }
    return value;
  }

  std::vector<int64_t> whole_numbers(const DocumentNode& map, const std::string& name) {
    std::vector<int64_t> list;
    const DocumentNode* node = map.find(name);
    if (!node) return list;
    if (node->kind == Kind::kText) return {whole(*node, name)};
    for (const DocumentNode& item : node->items) {
      const int64_t value = whole(item, name);
      for (const int64_t other : list) {
        if (other == value) complain(item, concat(name, ": ", value, " is given twice"));
      }
      list.push_back(value);
    }
    if (list.empty()) complain(*node, name + ": expected a list of whole numbers");
    return list;
  }

  std::vector<DocumentNode> maps(const DocumentNode& map, const std::string& name) {
    const DocumentNode* node = map.find(name);
    if (!node || node->kind == Kind::kNothing) return {};
    if (node->kind != Kind::kList)
      complain(*node, name + ": expected a list of entries, each with a name");
    return node->items;
  }

  void add_column(const DocumentNode& root, const std::string& key, Spec& spec) {
    try {
      spec.columns.push_back(column_of(key));
    } catch (const ConfigError& error) {
      complain(*root.find("columns"), concat("columns: ", error.what()));
    }
  }

  std::string name_of(const DocumentNode& map) {
    std::string name;
    text(map, "name", name);
    // The name is used as a folder name.
    const bool fit = !name.empty() && name[0] != '.' &&
                     name.find_first_not_of(
                         "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-") ==
                         std::string::npos;
    if (!fit) complain(map, "name: expected letters, digits, _, - and ., found '" + name + "'");
    return name;
  }

  fs::path file_of(const DocumentNode& map, const std::string& text) {
    const fs::path path = (folder_ / text).lexically_normal();
    if (!fs::is_regular_file(path)) complain(map, "config: no such file: " + path.string());
    return path;
  }

  Scene scene(const DocumentNode& map) {
    known(map, {"name", "config", "set", "make"});
    Scene scene;
    scene.name = name_of(map);
    std::string config;
    text(map, "config", config);
    if (config.empty()) complain(map, "config: expected the scene's YAML, found nothing");
    if (!config.empty()) scene.config = file_of(map, config);
    scene.set = texts(map, "set", &scene.set_places);
    text(map, "make", scene.make);
    return scene;
  }

  Row row(const DocumentNode& map) {
    known(map,
          {"name", "title", "block", "config", "set", "seeds", "run", "paper", "paper_scenes"});
    Row row;
    row.name = name_of(map);
    row.title = row.name;
    text(map, "title", row.title);
    text(map, "block", row.block);
    for (const std::string& config : texts(map, "config"))
      row.configs.push_back(file_of(map, config));
    row.set = texts(map, "set", &row.set_places);
    row.seeds = whole_numbers(map, "seeds");
    std::string run = "true";
    text(map, "run", run);
    if (run != "true" && run != "false")
      complain(map, "run: expected true or false, found '" + run + "'");
    row.run = run == "true";
    if (const DocumentNode* node = map.find("paper")) row.paper = figures(*node);
    if (const DocumentNode* scenes = map.find("paper_scenes")) {
      if (scenes->kind != Kind::kMap) {
        complain(*scenes, "paper_scenes: expected figures by scene, such as {desk: {ssim: 0.92}}");
      }
      for (const auto& [name, node] : scenes->entries) row.paper_scenes[name] = figures(node);
    }
    if (!row.run && row.paper.empty() && row.paper_scenes.empty()) {
      complain(map, "paper: a row that is not run needs figures to quote");
    }
    return row;
  }

  Figures figures(const DocumentNode& map) {
    Figures figures;
    if (map.kind != Kind::kMap) complain(map, "paper: expected figures, such as {ssim: 0.92}");
    for (const auto& [key, node] : map.entries) {
      char* end = nullptr;
      figures[key] = std::strtod(node.text.c_str(), &end);
      if (node.kind != Kind::kText || node.text.empty() || *end != 0) {
        complain(node, concat("paper: ", key, ": expected a number, found '", node.text, "'"));
      }
    }
    return figures;
  }

  template <class Entry>
  void names_differ(const DocumentNode& root, const std::string& what,
                    const std::vector<Entry>& list) {
    std::set<std::string> seen;
    for (const Entry& entry : list) {
      if (!seen.insert(entry.name).second) {
        complain(*root.find(what), concat(what, ": two are named ", entry.name));
      }
    }
  }

  /// A figure for a column that the table does not have would be ignored silently.
  void check_figures(const Spec& spec) {
    std::vector<std::string> names;
    for (const Column& column : spec.columns) names.push_back(column.key);
    const auto check = [&](const Row& row, const Figures& figures) {
      for (const auto& figure : figures) {
        bool found = false;
        for (const std::string& name : names) found = found || name == figure.first;
        if (found) continue;
        const std::string close = config::nearest(figure.first, names);
        problems_.add(concat(rows_place_, "rows: ", row.name, ": paper: ", figure.first,
                             " is none of the columns",
                             close.empty() ? "" : "; did you mean " + close + "?"));
      }
    };
    for (const Row& row : spec.rows) {
      check(row, row.paper);
      for (const auto& scene : row.paper_scenes) check(row, scene.second);
    }
  }

  fs::path file_, folder_;  ///< of the current document
  std::string rows_place_;
  config::Problems problems_;
};

}  // namespace

Spec read_spec(const fs::path& file) {
  std::vector<fs::path> chain;
  std::vector<Document> documents;
  collect(file, chain, documents);
  SpecReader reader;
  Spec spec = reader.read(documents);
  reader.throw_problems();
  return spec;
}

}  // namespace jade::sweep
