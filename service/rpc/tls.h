// How connections are encrypted, and which clients get one.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/file_descriptor.h"
#include "service/access/file_watch.h"
#include "service/rpc/address.h"

namespace teletact::service {

// The files of TLS, looked at twice a second, and copies of them in memory for gRPC, which would wait for a
// pipe in their place for ever, and read whatever is there. What cannot be read, or does not fit, changes no
// copy and is logged once.
class TlsFiles {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 20;  // of each

  // Throws std::runtime_error, one line with the flag, for files that cannot be read or do not fit.
  // `between`: two looks.
  explicit TlsFiles(ListenOptions, std::chrono::milliseconds between = FileWatch::kLook);

  // Paths of the copies, for this process alone; of the clients' authority empty where there is none.
  std::string key() const { return key_.path(); }
  std::string certificate() const { return certificate_.path(); }
  std::string client_ca() const { return options_.tls_client_ca.empty() ? "" : client_ca_.path(); }
  // How often the files were looked at since.
  std::uint64_t looks() const { return watch_->looks(); }

 private:
  class Copy {
   public:
    void put(const std::string& text);  // in one step for who opens it
    std::string path() const { return "/proc/self/fd/" + std::to_string(file_.get()); }

   private:
    FileDescriptor file_;
  };
  struct Texts {
    std::string key, certificate, client_ca;
    bool operator==(const Texts&) const = default;
  };
  Texts texts() const;
  void require_fit(const Texts&) const;
  void put(const Texts&);
  void look();

  const ListenOptions options_;
  Copy key_, certificate_, client_ca_;
  Texts put_;
  std::optional<FileWatch> watch_;  // last: it looks at all of these
};

// New files in the place of these are taken within two seconds, for connections that are made from then on,
// and while the result lives; those that do not fit are not taken. Throws std::runtime_error, one line with
// the flag, for PEM files that cannot be read or do not fit.
std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions&);

}  // namespace teletact::service
