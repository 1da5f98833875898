// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/cell_text.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "jade/core/error.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"

namespace jade::sweep {

std::string number(double value, int decimals) {
  if (decimals == 0) return grouped(std::llround(value));
  char text[48];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  // A non-zero number must not be printed as zero.
  const bool vanished = value != 0 && std::strtod(text, nullptr) == 0;
  if (vanished) {
    const int first_digit = static_cast<int>(-std::floor(std::log10(std::abs(value))));
    std::snprintf(text, sizeof text, "%.*f", std::min(first_digit, 40), value);
  }
  return text;
}

const Cell& cell_at(const TableRow& row, const std::string& scene, const std::string& column) {
  static const Cell empty;
  const std::map<std::string, Cell>* cells = &row.average;
  if (!scene.empty()) {
    const auto found = row.scenes.find(scene);
    if (found == row.scenes.end()) return empty;
    cells = &found->second;
  }
  const auto found = cells->find(column);
  return found == cells->end() ? empty : found->second;
}

std::optional<double> paper_at(const TableRow& row, const std::string& scene,
                               const std::string& column) {
  const Figures* figures = &row.paper;
  if (!scene.empty()) {
    const auto found = row.paper_scenes.find(scene);
    if (found == row.paper_scenes.end()) return std::nullopt;
    figures = &found->second;
  }
  const auto found = figures->find(column);
  return found == figures->end() ? std::nullopt : std::optional<double>(found->second);
}

std::string best_of(const Table& table, const std::string& scene, const Column& column) {
  std::optional<double> best;
  for (const TableRow& row : table.rows) {
    const Cell& cell = cell_at(row, scene, column.key);
    if (!cell.mean || cell.count < cell.expected) continue;
    if (!best || column.better * *cell.mean > column.better * *best) best = cell.mean;
  }
  return best && column.better != 0 ? number(*best, column.decimals) : "";
}

bool has_paper(const Table& table, const std::string& scene, const std::string& column) {
  return std::any_of(table.rows.begin(), table.rows.end(),
                     [&](const TableRow& row) { return paper_at(row, scene, column).has_value(); });
}

std::string cell_text(const TableRow& row, const Cell& cell, const Column& column,
                      const std::string& best, const Style& style) {
  if (!row.run || cell.expected == 0) return style.none;
  std::string text = style.gap;
  if (cell.mean) {
    text = number(*cell.mean, column.decimals);
    if (text == best && cell.count == cell.expected)
      text = style.bold_open + text + style.bold_close;
    if (cell.deviation) text += style.deviation + number(*cell.deviation, column.decimals);
  }
  if (cell.count < cell.expected) text += concat(" (", cell.count, "/", cell.expected, ")");
  return text;
}

size_t finished(const Table& table) {
  return static_cast<size_t>(
      std::count_if(table.runs.begin(), table.runs.end(),
                    [](const RunRow& run) { return run.state == RunState::kFinished; }));
}

std::vector<std::string> quoted_scenes(const Table& table) {
  std::vector<std::string> quoted;
  for (const TableRow& row : table.rows) {
    for (const auto& scene : row.paper_scenes) {
      const bool ours = std::count(table.scenes.begin(), table.scenes.end(), scene.first) > 0;
      if (!ours && std::count(quoted.begin(), quoted.end(), scene.first) == 0)
        quoted.push_back(scene.first);
    }
  }
  return quoted;
}

std::string average_title(const Table& table) {
  if (table.scenes.size() == 1) return table.scenes.front();
  return concat("Average over ", table.scenes.size(), " scenes (",
                listing(table.scenes, table.scenes.size()), ")");
}

}  // namespace jade::sweep
