// SPDX-License-Identifier: Apache-2.0
// The only file that includes spdlog: torch's headers bundle another version of fmt.
#include "jade/core/log.h"

#include <memory>
#include <mutex>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/spdlog.h>

#include "jade/core/error.h"
#include "jade/core/terminal.h"

namespace jade {
namespace {

/// Writes through the terminal, which keeps a live progress bar below the messages.
class TerminalSink : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    std::string text(message.payload.data(), message.payload.size());
    if (message.level == spdlog::level::warn) text = "warning: " + text;
    if (message.level == spdlog::level::err) text = "error: " + text;
    terminal_print_line(text);
  }
  void flush_() override {}
};

struct Logs {
  std::shared_ptr<spdlog::logger> terminal =
      std::make_shared<spdlog::logger>("terminal", std::make_shared<TerminalSink>());
  std::shared_ptr<spdlog::logger> file;
  std::mutex mutex;
};

Logs& logs() {
  static Logs instance;
  return instance;
}

void write(spdlog::level::level_enum level, const std::string& message) {
  Logs& all = logs();
  const std::lock_guard<std::mutex> lock(all.mutex);
  all.terminal->log(level, spdlog::string_view_t(message.data(), message.size()));
  if (all.file) all.file->log(level, spdlog::string_view_t(message.data(), message.size()));
}

}  // namespace

void log_debug(const std::string& message) { write(spdlog::level::debug, message); }
void log_info(const std::string& message) { write(spdlog::level::info, message); }
void log_warn(const std::string& message) { write(spdlog::level::warn, message); }
void log_error(const std::string& message) { write(spdlog::level::err, message); }

void set_log_level(const std::string& level) {
  const auto parsed = spdlog::level::from_str(level);
  if (parsed == spdlog::level::off && level != "off") {
    throw ConfigError(
        concat("--log-level: expected debug, info, warn, error or off, found '", level, "'"));
  }
  logs().terminal->set_level(parsed);
}

void set_log_file(const std::filesystem::path& path) {
  Logs& all = logs();
  const std::lock_guard<std::mutex> lock(all.mutex);
  all.file.reset();
  if (path.empty()) return;
  try {
    auto sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(path.string());
    all.file = std::make_shared<spdlog::logger>("file", sink);
    all.file->set_level(spdlog::level::debug);
    all.file->set_pattern("%Y-%m-%d %H:%M:%S %l %v");
    all.file->flush_on(spdlog::level::info);
    all.file->set_error_handler([path, told = false](const std::string& reason) mutable {
      if (!told) terminal_print_line(concat("warning: ", path.string(), ": ", reason));
      told = true;
    });
  } catch (const spdlog::spdlog_ex& failure) {
    throw DataError(concat(path.string(), ": cannot write the log: ", failure.what()));
  }
}

}  // namespace jade
