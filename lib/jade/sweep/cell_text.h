// SPDX-License-Identifier: Apache-2.0
// Text of a table's cells, the same in every format.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "jade/sweep/results.h"

namespace jade::sweep {

/// With that many decimals, and grouped thousands if `decimals` is 0; a non-zero number is never
/// printed as zero.
std::string number(double value, int decimals);

/// The measured cell, empty if there is none; `scene` empty: the average.
const Cell& cell_at(const TableRow& row, const std::string& scene, const std::string& column);

/// The paper's figure; `scene` empty: the average.
std::optional<double> paper_at(const TableRow& row, const std::string& scene,
                               const std::string& column);
bool has_paper(const Table& table, const std::string& scene, const std::string& column);

/// The best of the complete measured cells, as printed; empty if the column has no direction.
std::string best_of(const Table& table, const std::string& scene, const Column& column);

/// Marks of a cell's content in an output format.
struct Style {
  const char *bold_open, *bold_close, *deviation, *none, *gap;
};
inline constexpr Style kMarkdown{"**", "**", " ± ", "–", "–"};
inline constexpr Style kLatex{"\\textbf{", "}", " {\\scriptsize$\\pm$}", "--", "--"};
inline constexpr Style kPlain{"", "", " ± ", "–", "–"};

/// "34.53 ± 0.01"; "– (0/3)" and "34.5 (2/3)" if values are missing.
std::string cell_text(const TableRow& row, const Cell& cell, const Column& column,
                      const std::string& best, const Style& style);

/// Number of finished runs of the table.
size_t finished(const Table& table);

/// Scenes of the paper that this sweep does not run, in the order of the rows' quotes.
std::vector<std::string> quoted_scenes(const Table& table);

/// "Average over 2 scenes (a, b)", or the one scene's name.
std::string average_title(const Table& table);

}  // namespace jade::sweep
