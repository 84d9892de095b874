// A server in this process that asks who calls, and clients that show who they are, or do not.
#pragma once

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/access/access_folder.h"
#include "tests/access/made_certificates.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {

// How a client reaches the service and shows who it is.
enum class Transport { kLoopback, kSocket, kTls, kMutualTls };
constexpr Transport kTransports[] = {Transport::kLoopback, Transport::kSocket, Transport::kTls,
                                     Transport::kMutualTls};

inline const char* name_of(Transport transport) {
  switch (transport) {
    case Transport::kLoopback:
      return "loopback";
    case Transport::kSocket:
      return "socket";
    case Transport::kTls:
      return "TLS";
    case Transport::kMutualTls:
      return "mutual TLS";
  }
  return "";
}

// A connection and the token that its calls show; empty: none.
struct Shown {
  std::shared_ptr<grpc::Channel> channel;
  std::string token = {};
  std::string scheme = "Bearer ";
  void on(grpc::ClientContext& context) const {
    set_deadline(context);
    if (!token.empty()) context.AddMetadata("authorization", scheme + token);
  }
};

class GuardedServer {
 public:
  // With these entries (access_folder.h).
  GuardedServer(Transport transport, const std::string& entries, const ConnectionLimits& connections = {})
      : transport_(transport) {
    ServerOptions options;
    options.connections = connections;
    options.listen.listen =
        transport == Transport::kSocket ? "unix:" + (folder_ / "s").string() : "127.0.0.1:0";
    options.listen.access = folder_.put("access.toml", entries);
    if (encrypted()) {
      put_certificate();
      options.listen.tls_certificate = folder_ / "server.pem";
      options.listen.tls_key = folder_ / "server-key.pem";
    }
    if (transport == Transport::kMutualTls)
      options.listen.tls_client_ca = folder_.put("ca.pem", authority_.certificate);
    options.now = [this] { return WallClock::now() + std::chrono::seconds(later_s_.load()); };
    options.access_look = std::chrono::milliseconds(20);
    server_ = std::make_unique<Server>(std::vector{rpc_device()}, options);
    server_->make_ready();
  }
  Server* operator->() { return server_.get(); }

  void put_entries(const std::string& entries) { folder_.put("access.toml", entries); }
  // By the service's clock.
  void let_pass(std::chrono::seconds time) { later_s_ += static_cast<int>(time.count()); }
  // A new certificate of the service, signed by another authority if so.
  void put_certificate(const Identity* authority = nullptr) {
    const Identity made = make_server(authority ? *authority : authority_);
    folder_.put("server-key.pem", made.key);
    folder_.put("server.pem", made.certificate);
  }
  void put_client_authority(const Identity& authority) { folder_.put("ca.pem", authority.certificate); }
  const Identity& authority() const { return authority_; }

  // A connection of its own. `client`: shows a certificate of this name; empty: none.
  std::shared_ptr<grpc::Channel> channel(const std::string& client = "") const {
    return client.empty() ? channel(Identity()) : channel(make_client(authority_, client));
  }
  std::shared_ptr<grpc::Channel> channel(const Identity& client, const std::string& trusted = "") const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    auto credentials = grpc::InsecureChannelCredentials();
    if (encrypted())
      credentials = grpc::SslCredentials(
          {trusted.empty() ? authority_.certificate : trusted, client.key, client.certificate});
    return grpc::CreateCustomChannel(server_->address(), credentials, arguments);
  }
  // Who has an entry of this name, as this transport shows it: by certificate with mutual TLS, else by token.
  Shown as(const std::string& name) const {
    return transport_ == Transport::kMutualTls ? Shown{channel(name)} : Shown{channel(), name + "-token"};
  }

 private:
  bool encrypted() const { return transport_ == Transport::kTls || transport_ == Transport::kMutualTls; }
  const Transport transport_;
  AccessFolder folder_;
  const Identity authority_ = make_authority("test");
  std::atomic<int> later_s_{0};
  std::unique_ptr<Server> server_;
};

}  // namespace teletact::service
