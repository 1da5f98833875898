// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace jade::apps {

/// The hidden flag that prints interface_json(); only alone on a command line.
inline constexpr char kPrintInterface[] = "--print-interface";

/// The declarations behind --help of a program, as JSON, from which scripts/manuals.py makes man
/// pages and the completion of shells: name, description, footer, options (flags, value, choices,
/// help, group) and subcommands, which are the same again. Options without a group are hidden and
/// left out.
std::string interface_json(const CLI::App& app);

}  // namespace jade::apps
