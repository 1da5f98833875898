// SPDX-License-Identifier: Apache-2.0
// The result table as Markdown, CSV and LaTeX.
#include <algorithm>
#include <cstdio>

#include "jade/core/error.h"
#include "jade/sweep/cell_text.h"
#include "jade/sweep/results.h"

namespace jade::sweep {
namespace {

/// Full precision, for CSV.
std::string exact(const std::optional<double>& value) {
  char text[48] = "";
  if (value) std::snprintf(text, sizeof text, "%.10g", *value);
  return text;
}

std::string arrow(const Column& column) {
  return column.better > 0 ? " ↑" : column.better < 0 ? " ↓" : "";
}

/// Escapes bars, which would begin the next cell.
std::string markdown_text(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
  return out;
}

/// One Markdown table; `scene` empty: the averages.
std::string markdown_rows(const Table& table, const std::string& scene) {
  std::string head = "| |", rule = "|---|";
  for (const Column& column : table.columns) {
    head += " " + column.heading + arrow(column) + " |";
    rule += "---:|";
    if (!has_paper(table, scene, column.key)) continue;
    head += " *paper* |";
    rule += "---:|";
  }
  std::string out = head + "\n" + rule + "\n", block;
  for (const TableRow& row : table.rows) {
    if (row.block != block && !row.block.empty()) out += "| *" + markdown_text(row.block) + "* |\n";
    block = row.block;
    out += "| " + markdown_text(row.title) + (row.run ? "" : " (quoted)") + " |";
    for (const Column& column : table.columns) {
      out += " " +
             cell_text(row, cell_at(row, scene, column.key), column, best_of(table, scene, column),
                       kMarkdown) +
             " |";
      if (!has_paper(table, scene, column.key)) continue;
      const auto figure = paper_at(row, scene, column.key);
      out += figure ? " *" + number(*figure, column.decimals) + "* |" : " |";
    }
    out += "\n";
  }
  return out;
}

std::string csv_text(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    out += c;
    if (c == '"') out += c;
  }
  return out + "\"";
}

/// Escapes LaTeX's special characters and the non-ASCII characters in the tables.
std::string latex_text(const std::string& text) {
  static const std::vector<std::pair<std::string, std::string>> signs = {
      {"α", "$\\alpha$"},
      {"→", "$\\rightarrow$"},
      {"½", "$\\frac{1}{2}$"},
      {"≡", "$\\equiv$"},
      {"†", "$^\\dagger$"},
      {"²", "$^2$"},
      {"&", "\\&"},
      {"%", "\\%"},
      {"_", "\\_"},
      {"#", "\\#"},
      {"$", "\\$"},
      {"{", "\\{"},
      {"}", "\\}"},
      {"\\", "\\textbackslash{}"},
      {"~", "\\textasciitilde{}"},
      {"^", "\\textasciicircum{}"}};
  std::string out;
  for (size_t i = 0; i < text.size();) {
    bool replaced = false;
    for (const auto& [sign, tex] : signs) {
      if (text.compare(i, sign.size(), sign) != 0) continue;
      out += tex;
      i += sign.size();
      replaced = true;
      break;
    }
    if (!replaced) out += text[i++];
  }
  return out;
}

std::string markdown_head(const Table& table) {
  std::string out = "# " + (table.title.empty() ? table.name : table.title) + "\n\n";
  if (!table.note.empty()) out += table.note + "\n\n";
  out += concat(finished(table), " of ", table.runs.size(), " runs finished. Steps: ", table.steps,
                ".");
  for (const std::string& machine : table.machines) out += " " + machine + ".";
  out +=
      " Mean over seeds ± sample deviation; (n/m): only n of m values are there; best complete "
      "value bold.";
  if (!table.paper_source.empty()) out += " *Paper*: quoted, " + table.paper_source + ".";
  return out + "\n";
}

}  // namespace

std::string to_markdown(const Table& table) {
  std::string out = markdown_head(table);
  if (!table.scenes.empty()) out += "\n## " + average_title(table) + "\n\n";
  out += markdown_rows(table, "");
  for (const std::string& scene : table.scenes) {
    if (table.scenes.size() > 1) out += "\n## " + scene + "\n\n" + markdown_rows(table, scene);
  }
  for (const std::string& scene : quoted_scenes(table)) {
    out += "\n## " + scene + " (quoted from the paper; not run here)\n\n" +
           markdown_rows(table, scene);
  }
  if (!table.remarks.empty()) out += "\n## What is missing\n\n";
  for (const std::string& remark : table.remarks) out += "- " + remark + "\n";
  out += "\n## Columns\n\n";
  for (const Column& column : table.columns)
    out += "- " + column.heading + ": " + column.meaning + "\n";
  return out;
}

std::string to_csv(const Table& table) {
  std::string out = "row,title,scene,column,mean,deviation,count,expected,paper\n";
  const auto add = [&](const TableRow& row, const std::string& scene) {
    for (const Column& column : table.columns) {
      const Cell& cell = cell_at(row, scene, column.key);
      const auto figure = paper_at(row, scene, column.key);
      if (cell.expected == 0 && !figure) continue;
      out += concat(row.name, ",", csv_text(row.title), ",", scene.empty() ? "average" : scene, ",",
                    column.key, ",", exact(cell.mean), ",", exact(cell.deviation), ",", cell.count,
                    ",", cell.expected, ",", exact(figure), "\n");
    }
  };
  for (const TableRow& row : table.rows) {
    add(row, "");
    std::vector<std::string> scenes = table.scenes;
    for (const auto& quoted : row.paper_scenes) {
      if (std::count(scenes.begin(), scenes.end(), quoted.first) == 0)
        scenes.push_back(quoted.first);
    }
    for (const std::string& scene : scenes) add(row, scene);
  }
  return out;
}

std::string runs_csv(const Table& table) {
  std::string out = "row,scene,seed,state,reason";
  for (const Column& column : table.columns) out += "," + column.key;
  out += "\n";
  for (const RunRow& run : table.runs) {
    out += concat(run.row, ",", run.scene, ",", run.seed, ",", to_string(run.state), ",",
                  csv_text(run.word));
    for (const Column& column : table.columns) {
      const auto found = run.measured.find(column.key);
      out += "," + (found == run.measured.end() ? "" : exact(found->second));
    }
    out += "\n";
  }
  return out;
}

std::string to_latex(const Table& table) {
  std::string columns = "l", head;
  for (const Column& column : table.columns) {
    const bool paper = has_paper(table, "", column.key);
    columns += paper ? "cc" : "c";
    head += " & " + latex_text(column.heading) +
            (column.better > 0   ? "$\\uparrow$"
             : column.better < 0 ? "$\\downarrow$"
                                 : "");
    if (paper) head += " & \\emph{paper}";
  }
  std::string out = concat("% ", table.name, ": ", finished(table), " of ", table.runs.size(),
                           " runs finished; needs booktabs. Italic: quoted from the paper.\n");
  for (const std::string& remark : table.remarks) out += "% missing: " + remark + "\n";
  out += "\\begin{tabular}{" + columns + "}\n\\toprule\n" + head + " \\\\\n\\midrule\n";
  std::string block;
  for (const TableRow& row : table.rows) {
    if (row.block != block && !row.block.empty()) {
      out += concat("\\multicolumn{", columns.size(), "}{l}{\\emph{", latex_text(row.block),
                    "}} \\\\\n");
    }
    block = row.block;
    out += latex_text(row.title) + (row.run ? "" : " (quoted)");
    for (const Column& column : table.columns) {
      out += " & " + cell_text(row, cell_at(row, "", column.key), column,
                               best_of(table, "", column), kLatex);
      if (!has_paper(table, "", column.key)) continue;
      const auto figure = paper_at(row, "", column.key);
      out += figure ? " & \\emph{" + number(*figure, column.decimals) + "}" : " & --";
    }
    out += " \\\\\n";
  }
  return out + "\\bottomrule\n\\end{tabular}\n";
}

}  // namespace jade::sweep
