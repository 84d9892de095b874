// Unix sockets between processes of one person on this machine.
#pragma once

#include <string>

namespace teletact::client {

// An open file, closed with this.
class Descriptor {
 public:
  explicit Descriptor(int file = -1) noexcept : file_(file) {}
  ~Descriptor();
  Descriptor(Descriptor&& from) noexcept : file_(from.release()) {}
  Descriptor& operator=(Descriptor&& from) noexcept;
  int get() const noexcept { return file_; }
  explicit operator bool() const noexcept { return file_ >= 0; }

 private:
  int release() noexcept;
  int file_;
};

// A socket that listens at `path`, for this user alone; one that nobody serves any more is taken over.
// Neither it nor what it accepts waits. Throws std::runtime_error, one line that names `flag`.
Descriptor listen_at(const char* flag, const std::string& path);
// None when nobody listens there.
Descriptor connect_to(const std::string& path);

}  // namespace teletact::client
