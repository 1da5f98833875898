// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/movie.h"

#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <spawn.h>
#include <sstream>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"

extern char** environ;

namespace jade::imaging {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> arguments(const fs::path& program, const fs::path& output, int64_t width,
                                   int64_t height, double frames_per_second) {
  return {program.string(), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s",
          concat(width, "x", height), "-r", concat(frames_per_second), "-i", "pipe:0",
          // Players need even sizes for subsampled chroma; crop an odd last column or row.
          "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-an", "-pix_fmt", "yuv420p", "-movflags",
          "+faststart", "-f", "mp4",
          // ffmpeg reads a bare name with a colon as a URL, and one that begins with a dash as a
          // flag.
          "file:" + output.string()};
}

/// Starts the program with `read_end` as its standard input, in its own process group, so that
/// Ctrl-C reaches only this process, which can discard the unfinished film.
pid_t start(const std::vector<std::string>& words, int read_end) {
  std::vector<char*> argv;
  for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, read_end, STDIN_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  pid_t child = -1;
  const int error = posix_spawn(&child, argv[0], &actions, &attributes, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (error != 0) throw DataError(concat(words[0], ": cannot be started (error ", error, ")"));
  return child;
}

/// Makes writing to a closed pipe an error instead of a fatal signal.
class BrokenPipeIgnored {
 public:
  BrokenPipeIgnored() {
    struct sigaction ignore {};
    ignore.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &ignore, &before_);
  }
  ~BrokenPipeIgnored() { sigaction(SIGPIPE, &before_, nullptr); }

 private:
  struct sigaction before_ {};
};

}  // namespace

std::filesystem::path find_ffmpeg() {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(path == nullptr ? "" : path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path candidate = fs::path(folder.empty() ? "." : folder) / "ffmpeg";
    if (access(candidate.c_str(), X_OK) == 0 && fs::is_regular_file(candidate)) return candidate;
  }
  throw ConfigError(
      "--format mp4 needs the program ffmpeg, and none is on PATH: install it (apt install ffmpeg) "
      "or choose --format png");
}

struct Movie::State {
  State(const fs::path& target, int64_t frame_width, int64_t frame_height)
      : path(target), file(target), width(frame_width), height(frame_height) {}

  fs::path path;
  AtomicFile file;
  int64_t width, height;
  int pipe_end = -1;
  pid_t child = -1;

  void close_pipe() {
    if (pipe_end >= 0) close(pipe_end);
    pipe_end = -1;
  }
  /// The program's exit status, or −1.
  int wait_for_child() {
    int status = -1;
    while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    child = -1;
    return status;
  }
};

Movie::Movie(const fs::path& path, int64_t width, int64_t height, double frames_per_second) {
  if (width < 2 || height < 2) {
    throw ConfigError(
        concat("--format mp4: expected at least 2x2 pixels, found ", width, "x", height));
  }
  const fs::path program = find_ffmpeg();
  state_ = std::make_unique<State>(path, width, height);
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw DataError("ffmpeg: no pipe could be made");
  state_->pipe_end = ends[1];
  const auto words =
      arguments(program, state_->file.temporary_path(), width, height, frames_per_second);
  try {
    state_->child = start(words, ends[0]);
  } catch (...) {
    close(ends[0]);
    state_->close_pipe();
    throw;
  }
  close(ends[0]);
}

Movie::~Movie() {
  if (state_->child > 0) kill(state_->child, SIGKILL);
  state_->close_pipe();
  state_->wait_for_child();
}

void Movie::add(const torch::Tensor& image) {
  if (image.dim() != 3 || image.size(1) != state_->height || image.size(2) != state_->width) {
    throw DataError(concat("--format mp4: expected every view to be ", state_->width, "x",
                           state_->height, " pixels like the first, found ", shape_string(image)));
  }
  const torch::Tensor bytes = (image.detach().nan_to_num(0).clamp(0, 1) * 255)
                                  .round()
                                  .to(torch::kUInt8)
                                  .permute({1, 2, 0})
                                  .contiguous()
                                  .cpu();
  const BrokenPipeIgnored no_signal;
  const auto* from = bytes.data_ptr<uint8_t>();
  for (int64_t left = bytes.numel(); left > 0;) {
    const ssize_t count = write(state_->pipe_end, from, static_cast<size_t>(left));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      throw DataError(concat(state_->path.string(), ": ffmpeg stopped; what it said is above"));
    }
    from += count;
    left -= count;
  }
}

void Movie::finish() {
  state_->close_pipe();
  const int status = state_->wait_for_child();
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw DataError(
        concat(state_->path.string(), ": not written, ffmpeg failed; what it said is above"));
  }
  state_->file.commit();
}

}  // namespace jade::imaging
