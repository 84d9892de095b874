#include "service/access/trial_set.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "service/access/certificates.h"
#include "service/access/token.h"
#include "service/limits/shown.h"

namespace teletact::service {

namespace fs = std::filesystem;

namespace {

void require_host(const std::string& host) {
  constexpr std::string_view kAllowed = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-:";
  constexpr std::size_t kMost = 64;  // bytes of a common name
  if (host.empty() || host.size() > kMost || host.find_first_not_of(kAllowed) != std::string::npos)
    throw std::runtime_error(
        fmt::format("--host {}: give the name or the address of at most {} bytes that clients connect to",
                    shown(host), kMost));
}

void make_folder(const fs::path& folder) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(fmt::format("--out {}: {}", folder.string(), why));
  };
  if (::mkdir(folder.c_str(), 0700) == 0) return;
  if (errno != EEXIST) refuse(fmt::format("{}; give a folder that can be made", std::strerror(errno)));
  std::error_code error;
  const bool empty = fs::is_directory(folder, error) && fs::is_empty(folder, error);
  if (error) refuse(error.message());
  if (!empty) refuse("it exists and is not an empty folder; give a new one: no file is written over");
  if (::chmod(folder.c_str(), 0700) != 0) refuse(std::strerror(errno));
}

class Writer {
 public:
  explicit Writer(const fs::path& folder) : folder_(folder) {}
  void write(const std::string& name, const std::string& text) const {
    const fs::path path = folder_ / name;
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    const bool wrote = file >= 0 && ::write(file, text.data(), text.size()) == ssize_t(text.size());
    const int error = errno;
    const bool closed = file < 0 || ::close(file) == 0;
    if (!wrote || !closed)
      throw std::runtime_error(
          fmt::format("--out: cannot write {}: {}", path.string(), std::strerror(error)));
  }
  void write(const std::string& name, const Identity& identity) const {
    write(name + ".pem", identity.certificate);
    write(name + "-key.pem", identity.key);
  }

 private:
  const fs::path folder_;
};

}  // namespace

void make_trial_set(const fs::path& folder, const std::string& host, WallClock::time_point end) {
  require_host(host);
  make_folder(folder);
  const Writer out(folder);
  const Identity authority = make_authority("teletact trial", end);
  out.write("ca", authority);
  std::vector<std::string> hosts{host};
  for (const char* local : {"localhost", "127.0.0.1"})
    if (host != local) hosts.push_back(local);
  out.write("server", make_server(authority, hosts, end));
  std::string access =
      "# Who may do what: docs/guide/service.md (Security). The service takes a change over within a "
      "second.\n"
      "# To revoke one, take its entry out. Write beside and rename, so that no half of it is read.\n";
  for (const Role role : kRoles) {
    const std::string name = name_of(role), token = make_token();
    out.write(name, make_client(authority, name, end));
    out.write(name + ".token", token + "\n");
    access += fmt::format(
        "\n[[entry]]\nname = \"{0}\"\ntoken_sha256 = \"{1}\"\ncertificate = \"{0}\"\n"
        "expires = {2:%Y-%m-%dT%H:%M:%SZ}\nroles = {{ \"*\" = \"{0}\" }}\n",
        name, hex_of(digest_of(token)), fmt::gmtime(WallClock::to_time_t(end)));
  }
  out.write("access.toml", access);
}

}  // namespace teletact::service
