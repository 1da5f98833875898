// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace jade::apps {

/// The hidden flag that prints interface_json(); must be the only argument.
inline constexpr char kPrintInterface[] = "--print-interface";

/// The declarations behind --help of a program, as JSON, from which scripts/manuals.py generates
/// man pages and shell completion: name, description, footer, options (flags, value, choices, help,
/// group) and subcommands, with the same keys. Omits options without a group, which are hidden.
std::string interface_json(const CLI::App& app);

}  // namespace jade::apps
