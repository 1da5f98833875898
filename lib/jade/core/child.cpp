// SPDX-License-Identifier: Apache-2.0
#include "jade/core/child.h"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"

namespace jade {
namespace {

/// The environment of this process and `extra`, as "name=value" lines.
std::vector<std::string> environment_with(
    const std::vector<std::pair<std::string, std::string>>& extra) {
  std::vector<std::string> lines;
  for (char** entry = environ; *entry; ++entry) {
    const std::string line = *entry;
    bool replaced = false;
    for (const auto& pair : extra) replaced = replaced || line.rfind(pair.first + "=", 0) == 0;
    if (!replaced) lines.push_back(line);
  }
  for (const auto& [name, value] : extra) lines.push_back(concat(name, "=", value));
  return lines;
}

std::vector<char*> pointers(std::vector<std::string>& lines) {
  std::vector<char*> list;
  list.reserve(lines.size() + 1);
  for (std::string& line : lines) list.push_back(line.data());
  list.push_back(nullptr);
  return list;
}

}  // namespace

Child::Child(const std::vector<std::string>& command,
             const std::vector<std::pair<std::string, std::string>>& environment,
             const std::filesystem::path& log) {
  const int out = open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (out < 0) throw DataError(concat(log.string(), ": cannot be written: ", std::strerror(errno)));
  const int in = open("/dev/null", O_RDONLY | O_CLOEXEC);
  std::vector<std::string> arguments = command, variables = environment_with(environment);
  const std::vector<char*> argv = pointers(arguments), envp = pointers(variables);
  const pid_t parent = getpid();
  // Block SIGTERM until exec: the inherited handler would swallow one that the child receives
  // before.
  sigset_t term, before;
  sigemptyset(&term);
  sigaddset(&term, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &term, &before);
  pid_ = fork();
  if (pid_ == 0) {
    signal(SIGTERM, SIG_DFL);
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    // Between fork and exec only plain system calls are allowed: other threads may hold locks.
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    // Ctrl-C in a terminal signals the whole process group. In its own group the child receives one
    // SIGINT, from interrupt(), and not a second one, which would stop it at once.
    setpgid(0, 0);
    if (getppid() != parent) _exit(static_cast<int>(ExitCode::kInterrupted));
    dup2(in, STDIN_FILENO);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    // glibc's execvpe takes no lock and allocates no memory
    execvpe(argv[0], argv.data(), envp.data());
    _exit(127);
  }
  const int reason = errno;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  close(in);
  close(out);
  if (pid_ < 0) {
    pid_ = 0;
    throw DataError(concat(command[0], ": cannot be started: ", std::strerror(reason)));
  }
}

Child::~Child() {
  if (pid_ <= 0) return;
  kill(pid_, SIGTERM);
  waitpid(pid_, nullptr, 0);
}

std::optional<ChildExit> Child::poll() {
  int status = 0;
  rusage usage{};
  if (pid_ <= 0 || wait4(pid_, &status, WNOHANG, &usage) != pid_) return std::nullopt;
  pid_ = 0;
  ChildExit exit;
  if (WIFEXITED(status)) exit.code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) exit.signal = WTERMSIG(status);
  exit.peak_bytes = int64_t{1024} * usage.ru_maxrss;
  return exit;
}

void Child::interrupt() {
  if (pid_ > 0) kill(pid_, SIGTERM);
}

int run_to_end(const std::vector<std::string>& command,
               const std::vector<std::pair<std::string, std::string>>& environment,
               const std::filesystem::path& log, const std::function<void()>& meanwhile) {
  Child child(command, environment, log);
  for (;;) {
    const std::optional<ChildExit> exit = child.poll();
    throw_if_interrupted();
    if (exit) return exit->code;
    if (meanwhile) meanwhile();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

}  // namespace jade
