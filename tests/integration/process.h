// The product's binaries as processes, for tests that need them whole.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/environment.h"

namespace teletact::test {

inline std::string client_binary() {
  return required_environment("TELETACT_BINARY_DIR") + "/client/teletact-client";
}
inline std::string service_binary() {
  return required_environment("TELETACT_BINARY_DIR") + "/service/teletact-service";
}

// A folder with a short path (sockets have 107 bytes), gone with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    char name[] = "/tmp/tt-int-XXXXXX";
    if (mkdtemp(name) == nullptr) throw std::runtime_error("mkdtemp failed");
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

using Environment = std::vector<std::pair<std::string, std::string>>;

// A pipe, both of its ends closed with the object.
class Pipe {
 public:
  Pipe() {
    if (pipe2(ends_, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
  }
  ~Pipe() {
    close_end(0);
    close_end(1);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int read_end() const { return ends_[0]; }
  int write_end() const { return ends_[1]; }
  void close_end(int end) {
    if (ends_[end] >= 0) ::close(ends_[end]);
    ends_[end] = -1;
  }

 private:
  int ends_[2] = {-1, -1};
};

// Descriptors for a process, -1: the parent's stdin, and the log. A terminal as stdin becomes its own.
struct Streams {
  int in = -1, out = -1;
};

class Process {
 public:
  // stdout and stderr go to `log`.
  Process(const std::vector<std::string>& command, std::string log, const Environment& environment = {},
          Streams streams = {})
      : log_(std::move(log)) {
    std::vector<char*> arguments;
    for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    pid_ = fork();
    if (pid_ < 0) throw std::runtime_error("fork failed");
    if (pid_ > 0) return;
    for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
    const int file = open(log_.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600);
    dup2(streams.out < 0 ? file : streams.out, 1);
    dup2(file, 2);
    if (streams.in >= 0) dup2(streams.in, 0);
    if (streams.in >= 0 && isatty(0)) {
      setsid();
      ioctl(0, TIOCSCTTY, 0);
    }
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  ~Process() {
    if (pid_ > 0) {
      kill(SIGKILL);
      wait(10);
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void kill(int signal) {
    if (pid_ > 0) ::kill(pid_, signal);
  }
  // Exit code, 128 + signal, or -1 when it still runs after `seconds`.
  int wait(double seconds) {
    int status = 0;
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (pid_ > 0) {
      if (waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = -1;
        code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      } else if (std::chrono::steady_clock::now() > end) {
        return -1;
      } else {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    }
    return code_;
  }
  bool running() { return wait(0) == -1; }
  pid_t id() const { return pid_; }
  std::string output() const {
    std::ifstream file(log_);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }
  // True when `text` has appeared in the output within `seconds`.
  bool says(const std::string& text, double seconds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (output().find(text) == std::string::npos) {
      if (!running() || std::chrono::steady_clock::now() > end)
        return output().find(text) != std::string::npos;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }

 private:
  std::string log_;
  pid_t pid_ = -1;
  int code_ = -1;
};

struct Outcome {
  int code;
  std::string output;
};

inline Outcome run(const std::vector<std::string>& command, const std::string& log,
                   const Environment& environment = {}, double seconds = 60) {
  Process process(command, log, environment);
  const int code = process.wait(seconds);
  return {code, process.output()};
}

}  // namespace teletact::test
