// SPDX-License-Identifier: Apache-2.0
// Text of a table's cells, the same in every format.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "jade/sweep/results.h"

namespace jade::sweep {

/// With so many decimals; a number that is not zero never looks like it.
std::string number(double value, int decimals);

/// Our cell, empty where there is none; `scene` empty: the average.
const Cell& cell_at(const TableRow& row, const std::string& scene, const std::string& column);

/// The paper's figure; `scene` empty: the average.
std::optional<double> paper_at(const TableRow& row, const std::string& scene,
                               const std::string& column);
bool has_paper(const Table& table, const std::string& scene, const std::string& column);

/// The best of our complete cells, as printed; empty where the column has no direction.
std::string best_of(const Table& table, const std::string& scene, const Column& column);

/// How a format marks what a cell says.
struct Style {
  const char *bold_open, *bold_close, *deviation, *none, *gap;
};
inline constexpr Style kMarkdown{"**", "**", " ± ", "–", "–"};
inline constexpr Style kLatex{"\\textbf{", "}", " {\\scriptsize$\\pm$}", "--", "--"};
inline constexpr Style kPlain{"", "", " ± ", "–", "–"};

/// "34.53 ± 0.01"; "– (0/3)" and "34.5 (2/3)" where values are missing.
std::string cell_text(const TableRow& row, const Cell& cell, const Column& column,
                      const std::string& best, const Style& style);

/// Runs of the table that have finished.
size_t finished(const Table& table);

/// Scenes of the paper that are not ours, in the order in which the rows quote them.
std::vector<std::string> quoted_scenes(const Table& table);

/// "Average over 2 scenes (a, b)", or the one scene's name.
std::string average_title(const Table& table);

}  // namespace jade::sweep
