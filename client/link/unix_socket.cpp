#include "client/link/unix_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include "client/text/shown.h"

namespace teletact::client {
namespace {

constexpr std::size_t kLongestPath = sizeof(sockaddr_un::sun_path) - 1;  // 107
constexpr int kWaiting = 8;

[[noreturn]] void refuse(const char* flag, const std::string& path, const std::string& why) {
  throw std::runtime_error(std::string(flag) + " " + shown(path, 2 * kLongestPath) + ": " + why);
}

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

}  // namespace

FileDescriptor connect_to(const std::string& path) {
  if (path.empty() || path.size() > kLongestPath) return FileDescriptor();
  FileDescriptor file(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const sockaddr_un address = address_of(path);
  if (!file || ::connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0)
    return FileDescriptor();
  return file;
}

FileDescriptor listen_at(const char* flag, const std::string& path) {
  if (path.empty() || path.size() > kLongestPath)
    refuse(flag, path, "a Unix socket's path has 1 to " + std::to_string(kLongestPath) + " bytes");
  std::error_code ignored;
  if (std::filesystem::exists(path, ignored)) {
    if (!std::filesystem::is_socket(path, ignored))
      refuse(flag, path, "exists and is not a socket; choose another path");
    if (connect_to(path)) refuse(flag, path, "another session publishes there; choose another path");
    std::filesystem::remove(path, ignored);  // left over by one that was killed
  }
  FileDescriptor file(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const sockaddr_un address = address_of(path);
  // Nobody can connect before it listens: by then it is this user's alone.
  if (!file || ::bind(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::chmod(path.c_str(), S_IRUSR | S_IWUSR) != 0 || ::listen(file.get(), kWaiting) != 0)
    refuse(flag, path,
           std::strerror(errno) + std::string("; choose an existing folder that you may write to"));
  return file;
}

}  // namespace teletact::client
