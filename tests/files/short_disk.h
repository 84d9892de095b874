// A disk that takes so many bytes of each file of this process and no more, as a full one does.
#pragma once

#include <sys/resource.h>

#include <csignal>

namespace teletact::client {

class ShortDisk {
 public:
  explicit ShortDisk(rlim_t bytes) {
    handler_ = std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~ShortDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  ShortDisk(const ShortDisk&) = delete;
  ShortDisk& operator=(const ShortDisk&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int);
};

}  // namespace teletact::client
