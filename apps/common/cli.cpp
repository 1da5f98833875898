// SPDX-License-Identifier: Apache-2.0
#include "common/cli.h"

#include <algorithm>
#include <c10/util/Exception.h>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <unistd.h>
#include <utility>

#include "common/interface.h"
#include "common/shell.h"
#include "jade/core/asset.h"
#include "jade/core/device.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/core/version.h"

namespace jade::apps {
namespace {

constexpr char kDefaultAddress[] = "127.0.0.1:8080";  // default of serve::Address

std::string version_text(const std::string& name) {
  std::string text = concat(name, " ", version(), " (commit ", git_commit(), ")\ntorch ",
                            torch_version(), "\nCUDA ", cuda_version());
  const int gpus = cuda_device_count();
  if (gpus == 0)
    text += concat("\ndevice cpu: ", device_name(torch::kCPU), " (", cuda_problem(), ")");
  for (int i = 0; i < gpus; ++i) {
    text += concat("\ndevice cuda:", i, ": ",
                   device_name(torch::Device(torch::kCUDA, static_cast<c10::DeviceIndex>(i))));
  }
  return text;
}

/// torch appends a stack trace to the first line; users get only the line.
std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

/// Whether an error comes from CUDA or its libraries. torch has no error type for cuBLAS and cuDNN.
bool is_gpu_failure(const c10::Error& error) {
  return dynamic_cast<const c10::AcceleratorError*>(&error) != nullptr ||
         error.msg().rfind("CUDA error", 0) == 0 || error.msg().rfind("cuDNN error", 0) == 0;
}

/// torch's CPU allocator throws no dedicated type.
bool is_out_of_memory(const c10::Error& error) {
  return error.msg().find("DefaultCPUAllocator") != std::string::npos;
}

ExitCode report_out_of_memory() {
  log_error("out of memory; use a smaller scene or image, or close other programs");
  return ExitCode::kDevice;
}

/// Reports the current exception; returns its exit code.
ExitCode report_exception() {
  try {
    throw;
  } catch (const Interrupted&) {
    return ExitCode::kInterrupted;
  } catch (const Error& error) {
    log_error(error.what());
    return error.exit_code();
  } catch (const c10::OutOfMemoryError& error) {
    log_error(concat("out of GPU memory: ", first_line(error.what_without_backtrace()),
                     "; use a smaller scene (densify.max_gaussians) or --device cpu"));
    log_debug(error.what());
    return ExitCode::kDevice;
  } catch (const std::bad_alloc&) {
    return report_out_of_memory();
  } catch (const c10::Error& error) {
    if (is_out_of_memory(error)) return report_out_of_memory();
    if (is_gpu_failure(error)) {
      log_error(concat("the GPU failed: ", first_line(error.what_without_backtrace()),
                       "; try again, or use --device cpu"));
      log_debug(error.what());
      return ExitCode::kDevice;
    }
    log_error(concat("internal error in LibTorch: ", first_line(error.what_without_backtrace()),
                     "; run again with --log-level debug and report it"));
    log_debug(error.what());
    return ExitCode::kBug;
  } catch (const std::filesystem::filesystem_error& error) {
    log_error(
        concat(error.path1().string(), ": cannot be used: ", error.code().message(),
               error.code() == std::errc::permission_denied ? "; check its permissions" : ""));
    log_debug(error.what());
    return ExitCode::kData;
  } catch (const std::exception& error) {
    log_error(concat("internal error: ", error.what(),
                     "; run again with --log-level debug and report it"));
    return ExitCode::kBug;
  }
}

/// Ends a process whose current folder was deleted. Runs before the libraries' constructors,
/// because that of MKL in LibTorch would end it with a message about another cause.
void check_current_folder(int, char**, char**) {
  static char path[PATH_MAX];
  if (getcwd(path, sizeof path) != nullptr || errno != ENOENT) return;
  constexpr char kMessage[] =
      "error: the current folder is gone, perhaps deleted; change to another one (cd) and run "
      "again\n";
  const ssize_t written = write(STDERR_FILENO, kMessage, sizeof kMessage - 1);
  _exit(written < 0 ? 1 : static_cast<int>(ExitCode::kData));
}

[[gnu::section(".preinit_array"),
  gnu::used]] void (*const kCheckCurrentFolder)(int, char**, char**) = check_current_folder;

/// @throws DataError if standard output did not accept all output. If its reader has exited (`|
///   head`), only the exit code says so.
void flush_results() {
  errno = 0;
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout) return;
  if (errno == EPIPE) set_log_level("off");
  throw DataError("standard output: results cannot be written; is the disk full?");
}

/// Prints what --help or --version asked for.
int print_answer(const CLI::App& cli, const CLI::ParseError& error) {
  try {
    const int code = cli.exit(error);
    flush_results();
    return code;
  } catch (const DataError&) {
    return static_cast<int>(report_exception());
  }
}

/// The address after --serve is optional, and CLI11 would take any word for it: words that are
/// neither an IP address nor HOST:PORT, such as the name of a run, are left to other arguments.
std::vector<std::string> with_whole_addresses(std::vector<std::string> words) {
  const auto is_address = [](const std::string& word) {
    const std::string port = word.substr(word.rfind(':') + 1);
    const bool has_port = !port.empty() && port.size() < word.size() &&
                          port.find_first_not_of("0123456789") == port.npos;
    std::error_code ignored;
    if (has_port && word.find('/') == word.npos && !std::filesystem::exists(word, ignored))
      return true;
    return !word.empty() && word.find_first_not_of("0123456789abcdefABCDEF.:[]") == word.npos;
  };
  for (size_t i = 0; i < words.size(); ++i) {
    if (words[i] != "--serve" || (i + 1 < words.size() && is_address(words[i + 1]))) continue;
    words[i] += concat("=", kDefaultAddress);
  }
  return words;
}

/// CLI11 reports only the last of the two unexpected words in "--set a.b 200".
/// @throws ConfigError with the correct form.
void check_assignments(const std::vector<std::string>& words) {
  for (size_t i = 0; i + 1 < words.size(); ++i) {
    const std::string& key = words[i + 1];
    if (words[i] != "--set" || key.empty() || key.front() == '-') continue;
    if (key.find('=') != std::string::npos) continue;
    const bool has_value = i + 2 < words.size() && words[i + 2].rfind("--", 0) != 0;
    const std::string value = has_value ? words[i + 2] : "VALUE";
    throw ConfigError(concat("--set ", key, ": expected key=value; use --set ", key, "=", value));
  }
}

}  // namespace

CLI::Validator whole_number(int64_t least) {
  const auto decimal = [least](std::string& text) -> std::string {
    const size_t digit = text.find_first_not_of('0');
    const bool is_number = !text.empty() && text.find_first_not_of("0123456789") == text.npos;
    const bool enough = is_number && (least <= 0 || digit != text.npos);
    if (!enough)
      return concat("expected a whole number of ", least, " or more, found '", text, "'");
    text = digit == text.npos ? "0" : text.substr(digit);
    return "";
  };
  return CLI::Validator(decimal, "");
}

CLI::Validator within(double low, double high) {
  const auto check = [=](const std::string& text) {
    double value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= low && value <= high)
      return std::string();
    return concat("expected a number from ", readable(low), " to ", readable(high), ", found '",
                  text, "'");
  };
  return CLI::Validator(check, concat("FLOAT in [", low, " - ", high, "]"));
}

std::filesystem::path settings_file(const std::filesystem::path& file) {
  if (file.empty() || file.is_absolute() || file == "-" || std::filesystem::exists(file))
    return file;
  const std::filesystem::path shipped = asset(file.string());
  if (!std::filesystem::is_regular_file(shipped)) return file;
  log_info(concat(file.string(), ": not here; using the one that ships: ", shipped.string()));
  return shipped;
}

Program::Program(const std::string& name, const std::string& description)
    : name_(name), cli_(description, name) {
  // 1 MiB instead of 32 MiB per stream on Hopper, for the same speed
  // (docs/engineering/performance.md); cuBLAS reads it at its first use.
  setenv("CUBLAS_WORKSPACE_CONFIG", ":1024:1", /*overwrite=*/0);
  cli_.formatter(help_);
  begin_group("Common");
  cli_.set_help_flag("-h,--help", "Print this help and exit")->group("Common");
  cli_.set_version_flag(
      "--version", [name] { return version_text(name); },
      "Print the versions of the program, torch and CUDA, and the devices");
  cli_.add_option("--log-level", log_level_, "debug, info, warn, error or off")
      ->type_name("LEVEL")
      ->capture_default_str();
  cli_.add_flag("--quiet", quiet_, "Print only warnings and errors");
  begin_group("Options");
}

void Program::add_config_flags(CLI::App& cli) {
  cli.add_option("--config", config_files_,
                 "YAML file of settings; - reads standard input. Repeatable: each file is laid "
                 "over those before it")
      ->type_name("FILE")
      ->group("Settings")
      ->allow_extra_args(false);
  cli.add_option("--set", overrides_, "Set one key of those that --print-config lists. Repeatable")
      ->type_name("KEY=VALUE")
      ->group("Settings")
      ->allow_extra_args(false);
  cli.add_flag("--print-config", print_config_, "Print all settings with their meaning and exit")
      ->group("Settings");
  cli.add_flag("--print-schema", print_schema_, "Print a JSON Schema of the settings and exit")
      ->group("Settings");
  cli.footer([this] { return settings_order(); });
}

std::string Program::settings_order() const {
  std::string text = "Settings, later wins: " + settings_order_;
  if (!settings_order_.empty()) return text + ".";
  text += "defaults";
  if (cli_.get_option_no_throw("--run")) text += ", config.yaml of --run";
  if (cli_.get_option_no_throw("--resume"))
    text += ", config.yaml of a run that --resume continues";
  text += ", --config, --set";
  return text + (has_key_flags_ ? ", flags with a [key]." : ".");
}

CLI::Option* Program::add_key_flag(const std::string& flag, const std::string& key,
                                   const std::string& help) {
  has_key_flags_ = true;
  return cli_.add_option_function<std::string>(
      flag,
      [this, flag, key](const std::string& value) {
        const bool positional = flag.front() != '-';
        key_flags_.push_back({positional ? value : flag + " " + value, key, value});
      },
      concat(help, " [", key, "]"));
}

CLI::Option* Program::add_key_list_flag(const std::string& flag, const std::string& key,
                                        const std::string& help) {
  has_key_flags_ = true;
  return cli_.add_option_function<std::string>(
      flag,
      [this, flag, key](const std::string& value) {
        key_flags_.push_back({flag + " " + value, key, value, /*is_list=*/true});
      },
      concat(help, " [", key, "]"));
}

CLI::Option* Program::add_key_switch(const std::string& flag, const std::string& key,
                                     const std::string& value, const std::string& help) {
  has_key_flags_ = true;
  return cli_.add_flag_callback(
      flag,
      [this, flag, key, value] {
        key_flags_.push_back({flag, key, value});
      },
      concat(help, " [", key, "]"));
}

void Program::add_mask_flag(const std::string& key) {
  add_key_flag("--mask", key,
               "Image that excludes its black pixels in all frames (lens borders, hot areas)")
      ->type_name("FILE");
}

void Program::add_restoration_flags() {
  add_key_flag("--threshold-positive", "events.threshold_positive",
               "Change of log intensity that makes a positive event, or auto: measured")
      ->type_name("X");
  add_key_flag("--threshold-negative", "events.threshold_negative",
               "The same of a negative event; 0: equal to the positive threshold")
      ->type_name("X");
  add_key_flag("--efnet", "efnet.path",
               "TorchScript file of the learned restorer instead of the one that ships")
      ->type_name("FILE");
}

CLI::Option* Program::add_serve_flag(std::string& address, const std::string& help) {
  return cli_
      .add_option("--serve", address,
                  concat(help, " at ", kDefaultAddress,
                         " or another ADDRESS:PORT, ADDRESS or PORT (0: any free port). Other "
                         "machines need the whole printed address"))
      ->type_name("ADDRESS")
      ->expected(0, 1);
}

CLI::Option* Program::add_output_flag(CLI::App& cli, const std::string& help) {
  return cli.add_option("--output", output_, help)->type_name("DIR")->group("Output");
}

void Program::add_device_flag() {
  cli_.add_option("--device", device_, "auto (a GPU if there is one), cpu, cuda or cuda:N")
      ->type_name("DEVICE")
      ->group("Common");
}

void Program::add_seed_flag() {
  cli_.add_option("--seed", seed_, "Seed of all random numbers")
      ->type_name("N")
      ->group("Common")
      ->transform(whole_number(0));
}

void Program::add_json_flag() {
  cli_.add_flag("--json", json_, "Print results as JSON")->group("Output");
}

std::filesystem::path Program::config_file() const {
  return config_files_.empty() ? std::filesystem::path() : config_files_.front();
}

std::vector<std::filesystem::path> Program::layers() const {
  if (config_files_.empty()) return {};
  return {config_files_.begin() + 1, config_files_.end()};
}

torch::Device Program::device() const { return select_device(device_.empty() ? "auto" : device_); }

std::string Program::title() const {
  return concat(name_, " ", version(),
                " configuration; every key with its default and meaning: --print-config");
}

config::Sources Program::sources(const FieldList& fields) const {
  config::Sources all{config_file(), overrides_, layers(), key_flags_};
  if (!device_.empty() && fields.find("device")) {
    all.flags.push_back({"--device " + device_, "device", device_});
  }
  if (seed_ && fields.find("seed")) {
    all.flags.push_back({concat("--seed ", *seed_), "seed", std::to_string(*seed_)});
  }
  return all;
}

std::string Program::flag_hint(const std::string& word) const {
  const std::string flag = word.substr(0, word.find('='));
  std::vector<std::string> known, same_letter;
  const auto add = [&](const CLI::App& app) {
    for (const CLI::Option* option : app.get_options()) {
      for (const std::string& name : option->get_lnames()) {
        known.push_back("--" + name);
        if (flag.size() == 2 && name[0] == flag[1]) same_letter.push_back("--" + name);
      }
    }
  };
  add(cli_);
  for (const CLI::App* command : cli_.get_subcommands([](const CLI::App*) { return true; })) {
    add(*command);
  }
  std::string close;
  if (flag.size() > 2) close = config::nearest(flag, known);
  if (same_letter.size() == 1) close = same_letter.front();
  return close.empty() ? "" : concat("; did you mean ", close, "?");
}

std::string Program::path_hint(const std::string& word) const {
  const std::filesystem::path path = word;
  const bool is_yaml = path.extension() == ".yaml" || path.extension() == ".yml";
  std::error_code unreadable;
  const bool is_folder = std::filesystem::is_directory(path, unreadable);
  const bool is_run = is_folder && std::filesystem::exists(path / "config.yaml", unreadable);
  const bool is_file = std::filesystem::is_regular_file(path, unreadable);
  const std::vector<std::string> suited = is_yaml     ? std::vector<std::string>{"sweep", "config"}
                                          : is_run    ? std::vector<std::string>{"run"}
                                          : is_folder ? std::vector<std::string>{"dataset"}
                                          : is_file   ? std::vector<std::string>{"ply"}
                                                      : std::vector<std::string>{};
  for (const std::string& flag : suited) {
    if (cli_.get_option_no_throw("--" + flag))
      return concat("; use --", flag, " ", shell_word(word));
  }
  return "";
}

std::string Program::refusal(const CLI::ParseError& error,
                             const std::vector<std::string>& words) const {
  const std::vector<std::string> left = cli_.remaining(/*recurse=*/true);
  const auto unknown = std::find_if(words.begin(), words.end(), [&](const std::string& word) {
    return std::find(left.begin(), left.end(), word) != left.end();
  });
  const std::string word = unknown == words.end() ? "" : *unknown;
  const bool is_flag = word.size() > 1 && word.front() == '-';
  if (is_flag) return concat(word, ": unknown flag", flag_hint(word));
  const auto commands = cli_.get_subcommands([](const CLI::App*) { return true; });
  if (!commands.empty() && cli_.get_subcommands().empty()) {
    std::vector<std::string> names;
    for (const CLI::App* command : commands) names.push_back(command->get_name());
    const std::string close = config::nearest(word, names);
    return concat("expected a command (", CLI::detail::join(names, ", "), "), found ",
                  word.empty() ? "none" : word,
                  word.empty() || close.empty() ? "" : concat("; did you mean ", close, "?"));
  }
  if (!word.empty()) return concat(word, ": expected a flag before it", path_hint(word));
  const std::string text = error.what();
  // CLI11: "scene is required" and "--output: 1 required DIR missing".
  const size_t required = text.rfind(" is required"), missing = text.rfind(" missing");
  if (required != text.npos && text.rfind("--", 0) != 0)
    return concat("expected ", upper(text.substr(0, required)), ", found nothing");
  const std::string one = ": 1 required ";
  const size_t at = text.find(one);
  if (at == text.npos || missing == text.npos) return text;
  const size_t type = at + one.size();
  return concat(text.substr(0, at), ": expected ", text.substr(type, missing - type),
                ", found nothing");
}

void Program::print_usage() const {
  std::cout << help_->usage(&cli_, name_) << "\n"
            << name_ << " --help lists all flags.\n"
            << std::flush;
}

int Program::run(int argc, char** argv, const std::function<ExitCode()>& body) {
  const std::string called = argv[0];
  folder_ = called.substr(0, called.rfind('/') + 1);
  const std::vector<std::string> typed(argv + 1, argv + argc);
  if (typed == std::vector<std::string>{kPrintInterface}) {
    std::cout << interface_json(cli_) << std::endl;
    return static_cast<int>(ExitCode::kOk);
  }
  for (CLI::App* const command : cli_.get_subcommands([](const CLI::App*) { return true; })) {
    command->get_help_ptr()->group("Common");  // which CLI11 leaves in that of the flags beside it
  }
  try {
    std::vector<std::string> words = typed;
    if (cli_.get_option_no_throw("--set")) check_assignments(words);
    if (cli_.get_option_no_throw("--serve")) words = with_whole_addresses(std::move(words));
    std::reverse(words.begin(), words.end());  // in the order that CLI11 expects
    cli_.parse(std::move(words));
  } catch (const CLI::ParseError& error) {
    // CLI11 prints help and version itself and returns 0 for them; its other codes differ from this
    // program's.
    if (error.get_exit_code() == 0) return print_answer(cli_, error);
    if (typed.empty()) print_usage();
    std::fprintf(stderr, "error: %s; %s --help lists the flags\n", refusal(error, typed).c_str(),
                 name_.c_str());
    return static_cast<int>(ExitCode::kUsage);
  } catch (const ConfigError&) {
    return static_cast<int>(report_exception());
  }
  install_interrupt_handlers();
  try {
    set_log_level(quiet_ ? "warn" : log_level_);
    set_progress_enabled(!quiet_);
    for (std::filesystem::path& file : config_files_) file = settings_file(file);
    const ExitCode code = body();
    flush_results();
    return static_cast<int>(code);
  } catch (const ConfigError&) {
    if (typed.empty()) print_usage();
    return static_cast<int>(report_exception());
  } catch (...) {
    return static_cast<int>(report_exception());
  }
}

}  // namespace jade::apps
